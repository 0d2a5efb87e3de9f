#!/usr/bin/env python3
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Plot the history table of a result folder: history.png, one panel per quantity.

Components (tip_x, tip_y, tip_z or force_1, force_2) share a panel:

    python postprocess/plot_history.py results/slider_crank --columns tip_x,tip_y,energy

Another column than the time on the horizontal axis gives the path of a load over a displacement:

    python postprocess/plot_history.py results/lee_frame --columns t --x down
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
    """Columns of the table; a last row cut short by a killed run is left out."""
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
    return dict(zip(names, table.T, strict=True))


def choose(table: dict[str, np.ndarray], columns: str | None, x: str, path: Path) -> list[str]:
    """Names of the columns to plot over column ``x``."""
    if x not in table:
        raise PlotError(f"{path}: no column '{x}', there are: {', '.join(table)}")
    known = [name for name in table if name != x]
    if columns is None:
        chosen = known
    else:
        chosen = list(dict.fromkeys(c.strip() for c in columns.split(",") if c.strip()))
    unknown = [name for name in chosen if name not in known]
    if unknown:
        raise PlotError(f"{path}: no column '{unknown[0]}', there are: {', '.join(known)}")
    if not chosen:
        raise PlotError(f"{path}: no columns to plot")
    return chosen


def grouped(columns: list[str]) -> list[tuple[str, list[str]]]:
    """Groups (label, columns) of components, in the order of their first columns."""
    groups: dict[str, list[str]] = {}
    for name in columns:
        prefix, _, last = name.rpartition("_")
        component = prefix and (last in ("x", "y", "z") or last.isdigit())
        groups.setdefault(prefix if component else name, []).append(name)
    return [(g if len(names) > 1 else names[0], names) for g, names in groups.items()]


def plot(table: dict[str, np.ndarray], columns: list[str], x: str, title: str, path: Path) -> None:
    """Write the picture."""
    groups = grouped(columns)
    n_columns = 1 if len(groups) <= 4 else 2
    n_rows = -(-len(groups) // n_columns)
    figure, axes = plt.subplots(
        n_rows,
        n_columns,
        sharex=True,
        squeeze=False,
        figsize=(9.0 if n_columns == 1 else 14.0, 0.8 + 2.4 * n_rows),
        layout="constrained",
    )
    panels = axes.T.reshape(-1)
    for panel, (label, names) in zip(panels, groups, strict=False):
        for name in names:
            panel.plot(table[x], table[name], linewidth=1.4, label=name)
        panel.set_ylabel(label)
        panel.grid(color="#d9dee4", linewidth=0.7)
        panel.spines[["top", "right"]].set_visible(False)
        panel.margins(x=0.01)
        if len(names) > 1:
            panel.legend(frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    for panel in panels[len(groups) :]:
        panel.set_axis_off()
    for column in range(n_columns):
        last = min((column + 1) * n_rows, len(groups)) - 1
        panels[last].set_xlabel("t (s)" if x == "t" else x)
        panels[last].tick_params(labelbottom=True)
    figure.suptitle(title)
    figure.savefig(path, dpi=140)
    plt.close(figure)


def main(argv: list[str] | None = None) -> int:
    """Run the program."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("folder", type=Path, metavar="RESULTS_DIR")
    parser.add_argument("--columns", metavar="A,B", help="columns to plot (default: all)")
    parser.add_argument(
        "--x", metavar="A", default="t", help="column on the horizontal axis (default: t)"
    )
    options = parser.parse_args(argv)
    source, target = options.folder / "history.csv", options.folder / "history.png"
    try:
        table = read_table(source)
        columns = choose(table, options.columns, options.x, source)
        plot(table, columns, options.x, options.folder.resolve().name, target)
    except (PlotError, OSError) as exc:
        print(f"plot_history.py: {exc}", file=sys.stderr)
        return 2
    print(target)
    return 0


if __name__ == "__main__":
    sys.exit(main())
