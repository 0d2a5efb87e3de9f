#!/usr/bin/env python3
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Plot runs of one case by several theories on top of each other, also where one diverges.

One panel per column, one line per run, named by its folder. A run whose column leaves the common
range of the others is cut off there, and the time is noted:

    python postprocess/plot_theories.py results/consistent results/conventional results/beam

The range is that of the runs that stay within ``--factor`` (default 3) times the smallest extent of
all. Columns that are nothing but round-off in all runs are left out unless they are named. The
picture is theories.png in the first folder unless named.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")  # before pyplot, which would look for a display

import matplotlib.pyplot as plt
import numpy as np
from compare_runs import Table, columns_of_all, dress, load
from plot_history import PlotError

#: One style for each run: lines on top of each other stay visible.
_STYLES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1)))


#: Columns so much smaller than the largest one of a run are what rounding leaves of zero.
_ROUND_OFF = 1e-9


def without_round_off(tables: dict[str, Table], columns: list[str]) -> list[str]:
    """The columns that are something in one run at least."""
    kept = set()
    for table in tables.values():
        sizes = {column: float(np.abs(table[column]).max()) for column in columns}
        largest = max(sizes.values())
        kept |= {column for column, size in sizes.items() if not size <= _ROUND_OFF * largest}
    return [column for column in columns if column in kept]


def common_range(tables: dict[str, Table], column: str, factor: float) -> tuple[float, float]:
    """Smallest and largest value of the runs that do not diverge, with a margin."""
    ranges = [
        (float(values.min()), float(values.max()))
        for table in tables.values()
        if np.isfinite(values := table[column]).all()
    ]
    if not ranges:
        raise PlotError(f"column '{column}': no run has finite values")
    extents = [high - low for low, high in ranges]
    smallest = min(e for e in extents if e > 0.0) if any(extents) else 0.0
    kept = [r for r, e in zip(ranges, extents, strict=True) if e <= factor * smallest]
    low, high = min(r[0] for r in kept), max(r[1] for r in kept)
    margin = 0.15 * (high - low) or 1.0
    return low - margin, high + margin


def plot(tables: dict[str, Table], columns: list[str], factor: float, path: Path) -> None:
    """Write the picture."""
    rows = -(-len(columns) // 2)
    figure, axes = plt.subplots(
        rows, 2, sharex=True, squeeze=False, figsize=(13.0, 0.8 + 3.2 * rows), layout="constrained"
    )
    for panel, column in zip(axes.flat, columns, strict=False):
        low, high = common_range(tables, column, factor)
        for i, (label, table) in enumerate(tables.items()):
            t, values = table["t"], table[column]
            outside = ~((values >= low) & (values <= high))
            end = int(np.argmax(outside)) + 1 if outside.any() else len(t)
            style = _STYLES[i % len(_STYLES)]
            panel.plot(t[:end], values[:end], linestyle=style, linewidth=1.5, label=label)
            if outside.any():
                panel.plot(t[end - 1], np.clip(values[end - 1], low, high), "x", color=f"C{i}")
                panel.annotate(
                    f"{label} leaves at {t[end - 1]:.3g} s", (t[end - 1], 0.5 * (low + high)),
                    xytext=(6, 0), textcoords="offset points", color=f"C{i}", fontsize=8,
                )  # fmt: skip
        panel.set_ylim(low, high)
        dress(panel, column)
    for panel in axes.flat[len(columns) :]:
        panel.set_axis_off()
    axes[0, 0].legend(frameon=False, loc="upper center", ncols=len(tables), fontsize=9)
    for panel in axes[-1]:
        panel.set_xlabel("t (s)")
    figure.savefig(path, dpi=140)
    plt.close(figure)


def main(argv: list[str] | None = None) -> int:
    """Run the program."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("folders", type=Path, nargs="+", metavar="RESULTS_DIR")
    parser.add_argument(
        "--columns", metavar="A,B", help="columns to plot (default: those of the first folder)"
    )
    parser.add_argument(
        "--factor",
        type=float,
        default=3.0,
        help="a run with more than so many times the smallest extent diverges (default: 3)",
    )
    parser.add_argument(
        "--output", type=Path, metavar="FILE", help="default: theories.png in the first folder"
    )
    options = parser.parse_args(argv)
    target = options.output or options.folders[0] / "theories.png"
    try:
        tables = load(options.folders, -np.inf)
        columns = columns_of_all(tables, options.columns)
        if options.columns is None:
            columns = without_round_off(tables, columns)
        plot(tables, columns, options.factor, target)
    except (PlotError, OSError, ValueError) as exc:
        print(f"plot_theories.py: {exc}", file=sys.stderr)
        return 2
    print(target)
    return 0


if __name__ == "__main__":
    sys.exit(main())
