#!/usr/bin/env python3
# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Plot columns of several result folders: one panel per column, one line per run.

    python postprocess/compare_runs.py results/linear results/cosine --columns D_x,D_z

Rows before a time can be left out, to see what follows; the picture is comparison.png in the first
folder unless named:

    python postprocess/compare_runs.py results/cycloid results/cosine --columns D_z \
        --after 20 --output residual.png

Where runs diverge, the axes can be those of the others; the time is noted where a run leaves them:

    python postprocess/compare_runs.py results/consistent results/conventional results/beam --clip

Panels may stand side by side, have another column than the time on their horizontal axis, or show
the path of a point with columns P_x, P_y, P_z:

    python postprocess/compare_runs.py results/mode_1 results/mode_2 --across 2 --columns t,u2
    python postprocess/compare_runs.py results/mode_1 results/mode_2 --path P --planes xy
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
from plot_history import PlotError, choose, planes_of, read_table, table_of

Table = dict[str, np.ndarray]

#: One style for each run: lines on top of each other stay visible.
_STYLES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1)))
#: A run diverges whose extent is so many times that of the one in the middle, ...
_FAR = 3.0
#: ... and whose largest value is in the last part of its rows, this one.
_LATE = 0.8
#: Columns so much smaller than the largest one of a run are what rounding leaves of zero.
_ROUND_OFF = 1e-9


def load(folders: list[Path], after: float) -> dict[str, Table]:
    """Rows of every folder's table from a time on, by the folder's name (by its path if needed)."""
    folders = list(dict.fromkeys(folders))
    names = [folder.resolve().name for folder in folders]
    tables = {}
    for folder, name in zip(folders, names, strict=True):
        table = read_table(table_of(folder))
        late = table["t"] >= after
        if not late.any():
            raise PlotError(f"{folder}: no rows from t = {after:g} s on")
        label = name if names.count(name) == 1 else str(folder)
        tables[label] = {column: values[late] for column, values in table.items()}
    return tables


def dress(panel: Any, x: str, column: str) -> None:
    """Labels and grid of the panel of a column."""
    panel.set_xlabel("t (s)" if x == "t" else x)
    panel.set_ylabel(column)
    panel.grid(color="#d9dee4", linewidth=0.7)
    panel.spines[["top", "right"]].set_visible(False)
    panel.margins(x=0.01)


def columns_of_all(tables: dict[str, Table], columns: str | None, x: str) -> list[str]:
    """Requested columns, by default those of the first run; all runs must have them and x."""
    for label, table in tables.items():
        columns = ",".join(choose(table, columns, x, Path(label) / "history.csv"))
    assert columns is not None  # there is a run
    return columns.split(",")


def without_round_off(tables: dict[str, Table], columns: list[str]) -> list[str]:
    """The columns that are something in one run at least."""
    kept = set()
    for table in tables.values():
        sizes = {column: float(np.abs(table[column]).max()) for column in columns}
        largest = max(sizes.values())
        kept |= {column for column, size in sizes.items() if not size <= _ROUND_OFF * largest}
    return [column for column in columns if column in kept]


def common_range(tables: dict[str, Table], column: str) -> tuple[float, float]:
    """Smallest and largest value of the runs that do not diverge, with a margin."""
    finite = [values for one in tables.values() if np.isfinite(values := one[column]).all()]
    if not finite:
        raise PlotError(f"column '{column}': no run has finite values")
    middle = sorted(map(np.ptp, finite))[(len(finite) - 1) // 2]
    kept = [
        values
        for values in finite
        if np.ptp(values) <= _FAR * middle or np.argmax(np.abs(values)) < _LATE * len(values)
    ]
    low, high = min(map(np.min, kept)), max(map(np.max, kept))
    margin = 0.15 * (high - low) or 1.0
    return float(low - margin), float(high + margin)


def clip(panel: Any, tables: dict[str, Table], column: str) -> None:
    """Give a panel the range of the runs that do not diverge, and note where the others leave."""
    low, high = common_range(tables, column)
    notes = {low: 0, high: 0}
    for i, (label, table) in enumerate(tables.items()):
        outside = ~((table[column] >= low) & (table[column] <= high))
        if not outside.any():
            continue
        first = int(np.argmax(outside))
        t, edge = table["t"][first], high if table[column][first] > high else low
        panel.plot(t, edge, "x", color=f"C{i}", clip_on=False)
        inwards = 1.0 if edge == low else -1.0
        place = (t, edge + inwards * (0.03 + 0.1 * notes[edge]) * (high - low))
        late = t > 0.6 * table["t"][-1]
        panel.annotate(
            f"{label} leaves at {t:.3g} s", place, xytext=(-6 if late else 6, 0), color=f"C{i}",
            textcoords="offset points", ha="right" if late else "left", fontsize=8,
            va="bottom" if edge == low else "top",
        )  # fmt: skip
        panel.lines[i].set_data(table["t"][: first + 1], table[column][: first + 1])
        notes[edge] += 1
    panel.set_ylim(low, high)


def plot(
    tables: dict[str, Table], pairs: list[tuple[str, str]], path: Path, clipped: bool, across: int
) -> None:
    """Write the picture: a panel for each pair of columns (across, up) that all runs have."""
    across = min(across, len(pairs))
    down = -(-len(pairs) // across)
    figure, axes = plt.subplots(
        down,
        across,
        squeeze=False,
        figsize=(9.0 if across == 1 else 1.5 + 4.5 * across, 0.8 + 2.8 * down),
        layout="constrained",
    )
    panels = axes.reshape(-1)
    for panel, (x, column) in zip(panels, pairs, strict=False):
        for i, (label, table) in enumerate(tables.items()):
            style = _STYLES[i % len(_STYLES)]
            panel.plot(table[x], table[column], linestyle=style, linewidth=1.4, label=label)
        dress(panel, x, column)
        if clipped:
            clip(panel, tables, column)
    for panel in panels[len(pairs) :]:
        panel.set_axis_off()
    axes[0, -1].legend(
        *axes[0, 0].get_legend_handles_labels(),
        frameon=False,
        loc="center left",
        bbox_to_anchor=(1.0, 0.5),
    )
    figure.savefig(path, dpi=140)
    plt.close(figure)


def plot_paths(tables: dict[str, Table], planes: list[list[str]], path: Path) -> None:
    """Write the picture of a point's paths in some planes, of equal scale on both axes."""
    figure, axes = plt.subplots(
        1, len(planes), squeeze=False, figsize=(2.0 + 4.6 * len(planes), 4.6), layout="constrained"
    )
    for panel, (x, column) in zip(axes[0], planes, strict=True):
        for i, (label, table) in enumerate(tables.items()):
            style = _STYLES[i % len(_STYLES)]
            panel.plot(table[x], table[column], linestyle=style, linewidth=1.4, label=label)
        dress(panel, x, column)
        panel.set_aspect("equal", adjustable="datalim")
    axes[0, -1].legend(frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    figure.savefig(path, dpi=140)
    plt.close(figure)


def make(
    folders: list[Path], columns: str | None, after: float = -np.inf, output: Path | None = None,
    clipped: bool = False, x: str = "t", across: int = 1,
) -> Path:  # fmt: skip
    """Plot several runs; returns the picture.

    With clipped axes, columns that are nothing but round-off are left out unless they are named.

    Raises:
        ValueError: Options or tables cannot be used.
        OSError: A file cannot be read or written.
    """
    target = output or folders[0] / "comparison.png"
    tables = load(folders, after)
    chosen = columns_of_all(tables, columns, x)
    if clipped and columns is None:
        chosen = without_round_off(tables, chosen)
    plot(tables, [(x, column) for column in chosen], target, clipped, across)
    return target


def make_paths(
    folders: list[Path], point: str, planes: str, after: float, output: Path | None
) -> Path:
    """Plot the paths of a point in several runs; returns the picture.

    Raises:
        ValueError: Options or tables cannot be used.
        OSError: A file cannot be read or written.
    """
    target, tables = output or folders[0] / "comparison.png", load(folders, after)
    for label, table in tables.items():
        chosen = planes_of(table, point, planes, Path(label) / "history.csv")
    plot_paths(tables, chosen, target)
    return target


def main(argv: list[str] | None = None) -> int:
    """Run the program."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("folders", type=Path, nargs="+", metavar="RESULTS_DIR")
    parser.add_argument(
        "--columns", metavar="A,B", help="columns to plot (default: all of the first folder)"
    )
    parser.add_argument("--after", metavar="T", type=float, default=-np.inf, help="from t = T on")
    parser.add_argument("--clip", action="store_true", help="axes of the runs that do not diverge")
    parser.add_argument(
        "--output", type=Path, metavar="FILE", help="default: comparison.png in the first folder"
    )
    parser.add_argument("--x", metavar="A", default="t", help="horizontal axis (default: t)")
    parser.add_argument("--across", type=int, default=1, metavar="N", help="panels side by side")
    parser.add_argument("--path", metavar="POINT", help="paths of POINT_x, POINT_y, POINT_z")
    parser.add_argument("--planes", metavar="AB,CD", default="xy", help="planes of the paths")
    options = parser.parse_args(argv)
    folders, after, output = options.folders, options.after, options.output
    try:
        if options.path is None:
            made = make(
                folders, options.columns, after, output, options.clip, options.x, options.across
            )
        else:
            made = make_paths(folders, options.path, options.planes, after, output)
        print(made)
    except (OSError, ValueError) as exc:
        print(f"compare_runs.py: {exc}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
