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
from plot_history import PlotError, read_table, table_of


def modes_over_speed(path: Path) -> dict[str, np.ndarray]:
    """Columns of a table with modes."""
    table = read_table(path)
    if not any(name.endswith("_frequency") for name in table):
        raise PlotError(f"{path}: no modes over the speed (columns <mode>_frequency)")
    return table


def style(name: str) -> dict[str, str]:
    """Line of a mode by its name."""
    if name.startswith("forward"):
        return {"color": "tab:red", "marker": "^"}
    if name.startswith("backward"):
        return {"color": "tab:blue", "marker": "v"}
    if name.startswith("collective"):
        return {"color": "tab:green", "marker": "s"}
    return {"color": "0.35", "marker": "o"}


def draw(table: dict[str, np.ndarray], axes: str, orders: int) -> plt.Figure:
    """The diagram."""
    figure, plot = plt.subplots(figsize=(9.0, 6.0), layout="constrained")
    speed, top, labels = table["t"], 0.0, []
    # frequencies in multiblade coordinates are those in fixed axes
    both = any(column.endswith("_fixed") for column in table)
    suffix = "_fixed" if axes == "fixed" and both else "_frequency"
    if axes == "turning" and not both:
        raise PlotError("modes of a rotor on a support have frequencies in fixed axes only")
    for column, values in table.items():
        if not column.endswith(suffix):
            continue
        name, size = column[: -len(suffix)], np.abs(values)
        if not np.any(np.nan_to_num(size) > 0.0):
            continue  # rigid motions lie on the axis
        top = max(top, float(np.nanmax(size)))
        plot.plot(speed, size, markersize=4, linewidth=1.3, **style(name))
        last = int(np.flatnonzero(np.isfinite(size))[-1])
        labels.append((float(size[last]), float(speed[last]), name.replace("_", " ")))
    below = -top
    for size, at, name in sorted(labels):  # of modes of almost the same frequency one above another
        below = max(size, below + 0.022 * top)
        plot.annotate(
            name, (at, below), xytext=(6, 0), textcoords="offset points", va="center", fontsize=8,
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


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options that only this diagram has."""
    parser.add_argument(
        "--axes", choices=("fixed", "turning"), default="fixed",
        help="axes in which frequencies are shown (default: fixed)",
    )  # fmt: skip
    parser.add_argument("--orders", type=int, default=3, help="number of engine orders (default 3)")


def make(folder: Path, options: argparse.Namespace) -> Path:
    """Draw the diagram of a run; returns the picture.

    Raises:
        ValueError: The table cannot be used.
        OSError: A file cannot be read or written.
    """
    output = Path(options.output or folder / "campbell.png")
    figure = draw(modes_over_speed(table_of(folder)), options.axes, options.orders)
    figure.savefig(output, dpi=130)
    plt.close(figure)
    return output


def main(argv: list[str] | None = None) -> int:
    """Plot; returns the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path, help="result folder with history.csv")
    add_arguments(parser)
    parser.add_argument("--output", type=Path, help="picture (default: campbell.png in the folder)")
    options = parser.parse_args(argv)
    try:
        print(make(options.folder, options))
    except (OSError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
