#!/usr/bin/env python3
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Plot the Campbell diagram of a result folder: campbell.png, frequencies over the speed.

Straight lines from the origin are the engine orders 1x, 2x, ...: where one crosses a mode, the
rotation excites it.

    python postprocess/plot_campbell.py results/campbell --axes fixed --orders 3
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")  # before pyplot, which would look for a display

import matplotlib.pyplot as plt
import numpy as np


class PlotError(Exception):
    """A user's mistake, told in one line."""


def read_table(path: Path) -> dict[str, np.ndarray]:
    """Columns of the table."""
    if not path.is_file():
        raise PlotError(f"{path}: no history table")
    lines = path.read_text(encoding="utf-8").split("\n")[:-1]
    if len(lines) < 2:
        raise PlotError(f"{path}: the table has no rows")
    names = lines[0].split(",")
    try:
        table = np.array([[float(x) for x in line.split(",")] for line in lines[1:]])
    except ValueError as exc:
        raise PlotError(f"{path}: not a table of numbers ({exc})") from exc
    if names[0] != "t" or table.shape[1] != len(names):
        raise PlotError(f"{path}: not a history table (first column t, equal rows)")
    if not any(name.endswith("_frequency") for name in names):
        raise PlotError(f"{path}: no modes over the speed (columns <mode>_frequency)")
    return dict(zip(names, table.T, strict=True))


def style(name: str) -> dict[str, str]:
    """Line of a mode by its name."""
    if name.startswith("forward"):
        return {"color": "tab:red", "marker": "^"}
    if name.startswith("backward"):
        return {"color": "tab:blue", "marker": "v"}
    return {"color": "0.35", "marker": "o"}


def draw(table: dict[str, np.ndarray], axes: str, orders: int) -> plt.Figure:
    """The diagram."""
    figure, plot = plt.subplots(figsize=(9.0, 6.0), layout="constrained")
    speed, top = table["t"], 0.0
    suffix = "_fixed" if axes == "fixed" else "_frequency"
    for column, values in table.items():
        if not column.endswith(suffix):
            continue
        name, size = column[: -len(suffix)], np.abs(values)
        if not np.any(np.nan_to_num(size) > 0.0):
            continue  # rigid motions lie on the axis
        top = max(top, float(np.nanmax(size)))
        plot.plot(speed, size, markersize=4, linewidth=1.3, **style(name))
        last = int(np.flatnonzero(np.isfinite(size))[-1])
        plot.annotate(
            name.replace("_", " "), (speed[last], size[last]), xytext=(6, 0),
            textcoords="offset points", va="center", fontsize=8,
        )  # fmt: skip
    for order in range(1, orders + 1):
        line = order * np.abs(speed) / (2.0 * np.pi)
        plot.plot(speed, line, color="0.6", linestyle="--", linewidth=0.9)
        inside = np.flatnonzero(line <= 1.05 * top)
        at = int(inside[-1]) if len(inside) else 0
        plot.annotate(
            f"{order}x", (speed[at], line[at]), xytext=(-4, 6), textcoords="offset points",
            ha="right", color="0.4", fontsize=8,
        )  # fmt: skip
    plot.set_ylim(0.0, 1.08 * top)
    room = 0.1 * (speed[-1] - speed[0])
    plot.set_xlim(speed[0], speed[-1] + room)
    plot.set_xlabel("speed of rotation [rad/s]")
    plot.set_ylabel(f"frequency in {axes} axes [Hz]")
    plot.grid(alpha=0.3)
    return figure


def main(argv: list[str] | None = None) -> int:
    """Plot; returns the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path, help="result folder with history.csv")
    parser.add_argument(
        "--axes", choices=("fixed", "turning"), default="fixed",
        help="axes in which frequencies are shown (default: fixed)",
    )  # fmt: skip
    parser.add_argument("--orders", type=int, default=3, help="number of engine orders (default 3)")
    parser.add_argument("--output", type=Path, help="picture (default: campbell.png in the folder)")
    arguments = parser.parse_args(argv)
    output = arguments.output or arguments.folder / "campbell.png"
    try:
        figure = draw(
            read_table(arguments.folder / "history.csv"), arguments.axes, arguments.orders
        )
        figure.savefig(output, dpi=130)
    except (OSError, ValueError, PlotError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(output)
    return 0


if __name__ == "__main__":
    sys.exit(main())
