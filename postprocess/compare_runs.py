#!/usr/bin/env python3
# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Plot columns of several result folders: one panel per column, one line per run.

    python postprocess/compare_runs.py results/linear results/cosine --columns D_x,D_z

Rows before a time can be left out, to see what follows; the picture is comparison.png in the first
folder unless named:

    python postprocess/compare_runs.py results/cycloid results/cosine --columns D_z \
        --after 20 --output residual.png
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")  # before pyplot, which would look for a display

import matplotlib.pyplot as plt
import numpy as np
from plot_history import PlotError, choose, read_table

Table = dict[str, np.ndarray]


def load(folders: list[Path], after: float) -> dict[str, Table]:
    """Rows of every folder's table from a time on, by the folder's name (by its path if needed)."""
    folders = list(dict.fromkeys(folders))
    names = [folder.resolve().name for folder in folders]
    tables = {}
    for folder, name in zip(folders, names, strict=True):
        table = read_table(folder / "history.csv")
        late = table["t"] >= after
        if not late.any():
            raise PlotError(f"{folder}: no rows from t = {after:g} s on")
        label = name if names.count(name) == 1 else str(folder)
        tables[label] = {column: values[late] for column, values in table.items()}
    return tables


def dress(panel: Any, column: str) -> None:
    """Label and grid of the panel of a column."""
    panel.set_ylabel(column)
    panel.grid(color="#d9dee4", linewidth=0.7)
    panel.spines[["top", "right"]].set_visible(False)
    panel.margins(x=0.01)


def columns_of_all(tables: dict[str, Table], columns: str | None) -> list[str]:
    """Columns asked for, by default those of the first run; all runs must have them."""
    for label, table in tables.items():
        columns = ",".join(choose(table, columns, "t", Path(label) / "history.csv"))
    assert columns is not None  # there is a run
    return columns.split(",")


def plot(tables: dict[str, Table], columns: list[str], path: Path) -> None:
    """Write the picture of runs that all have these columns."""
    figure, axes = plt.subplots(
        len(columns),
        1,
        sharex=True,
        squeeze=False,
        figsize=(9.0, 0.8 + 2.8 * len(columns)),
        layout="constrained",
    )
    for panel, column in zip(axes[:, 0], columns, strict=True):
        for label, table in tables.items():
            panel.plot(table["t"], table[column], linewidth=1.4, label=label)
        dress(panel, column)
    axes[0, 0].legend(frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    axes[-1, 0].set_xlabel("t (s)")
    figure.savefig(path, dpi=140)
    plt.close(figure)


def make(
    folders: list[Path], columns: str | None, after: float = -np.inf, output: Path | None = None
) -> Path:
    """Plot several runs; returns the picture.

    Raises:
        ValueError: Options or tables cannot be used.
        OSError: A file cannot be read or written.
    """
    target = output or folders[0] / "comparison.png"
    tables = load(folders, after)
    plot(tables, columns_of_all(tables, columns), target)
    return target


def main(argv: list[str] | None = None) -> int:
    """Run the program."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("folders", type=Path, nargs="+", metavar="RESULTS_DIR")
    parser.add_argument(
        "--columns", metavar="A,B", help="columns to plot (default: all of the first folder)"
    )
    parser.add_argument("--after", metavar="T", type=float, default=-np.inf, help="from t = T on")
    parser.add_argument(
        "--output", type=Path, metavar="FILE", help="default: comparison.png in the first folder"
    )
    options = parser.parse_args(argv)
    try:
        print(make(options.folders, options.columns, options.after, options.output))
    except (OSError, ValueError) as exc:
        print(f"compare_runs.py: {exc}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
