#!/usr/bin/env python3
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Plot the history table of a result folder: history.png, one panel per quantity, or path.png.

Components (tip_x, tip_y, tip_z or hook_fx, hook_fy, hook_fz) and energies share a panel:

    python postprocess/plot_history.py results/slider_crank --columns tip_x,tip_y,energy

Another column than the time on the horizontal axis gives the path of a load over a displacement:

    python postprocess/plot_history.py results/lee_frame --columns t --x down

The path of a point with columns mass_x, mass_y, mass_z in planes, of equal scale on both axes:

    python postprocess/plot_history.py results/sliding_beam --path mass --planes xz,yz
"""

from __future__ import annotations

import argparse
import difflib
import re
import sys
import zlib
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")  # before pyplot, which would look for a display

import matplotlib.pyplot as plt
import numpy as np

#: Terms of an energy balance. What is left of it, a small difference, has a panel of its own.
_ENERGIES = ("kinetic", "strain", "gravity", "work", "dissipation")
#: Components: of vectors in axes (tip_x), of what probes record (hook_fx, root_m2, root_gamma1,
#: spot_eps11), and numbered ones (force_1).
_COMPONENT = re.compile(r"([fmpl]?)[xyz]|(|[nm]|gamma|kappa|eps)\d+")


class PlotError(ValueError):
    """A user's mistake, described in one line."""


def table_of(folder: Path) -> Path:
    """The table of a result folder, the newer one if there are two."""
    there = [path for name in ("history.csv", "history.h5") if (path := folder / name).is_file()]
    return max(there, key=lambda path: path.stat().st_mtime_ns, default=folder / "history.csv")


def read_table(path: Path) -> dict[str, np.ndarray]:
    """Columns of the table; a last row cut short by a killed run is left out."""
    if not path.is_file():
        raise PlotError(f"{path}: no history table")
    if path.suffix == ".h5":
        return read_compressed(path)
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


def read_compressed(path: Path) -> dict[str, np.ndarray]:
    """Columns of ``history.h5``; the last rows of a run that goes on, or was killed, are marked."""
    import h5py

    try:
        with h5py.File(path, "r", swmr=True) as file:
            names = [name.decode() for name in file["columns"][()]]
            table, tail = file["values"][()], file["tail"][()]
    except (KeyError, OSError) as exc:
        raise PlotError(f"{path}: not a history table ({exc})") from exc
    marked = [row for row in tail if row[0] == zlib.crc32(row[1:].tobytes()) + 1]
    rest = {int(row[1]): row[2:] for row in marked}
    last = []
    while len(table) + len(last) in rest:
        last.append(rest[len(table) + len(last)])
    table = np.concatenate([table, np.array(last).reshape(-1, len(names))])
    if not len(table):
        raise PlotError(f"{path}: the table has no rows")
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
        near = difflib.get_close_matches(unknown[0], known)
        hint = f"did you mean {' or '.join(near)}" if near else f"there are: {', '.join(known)}"
        raise PlotError(f"{path}: no column '{unknown[0]}', {hint}")
    if not chosen:
        raise PlotError(f"{path}: no columns to plot")
    return chosen


def grouped(columns: list[str]) -> list[tuple[str, list[str]]]:
    """Groups (label, columns) of components, in the order of their first columns."""
    groups: dict[str, list[str]] = {}
    for name in columns:
        groups.setdefault(quantity(name), []).append(name)
    return [(g if len(names) > 1 else names[0], names) for g, names in groups.items()]


def quantity(column: str) -> str:
    """What a column is a component of: "hook_f" for "hook_fx", itself if it is none."""
    prefix, _, last = column.rpartition("_")
    if prefix and last in _ENERGIES:
        return prefix
    found = _COMPONENT.fullmatch(last) if prefix else None
    if found is None:
        return column
    name = found[1] or found[2]
    return f"{prefix}_{name}" if name else prefix


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


def planes_of(table: dict[str, np.ndarray], point: str, planes: str, path: Path) -> list[list[str]]:
    """Columns (across, up) of the path of a point in each plane."""
    chosen = []
    for plane in planes.split(","):
        if len(plane) != 2 or not set(plane) <= set("xyz"):
            raise PlotError(f"--planes: '{plane}' is not two of x, y, z")
        names = [f"{point}_{axis}" for axis in plane]
        unknown = [name for name in names if name not in table]
        if unknown:
            raise PlotError(f"{path}: no column '{unknown[0]}', there are: {', '.join(table)}")
        chosen.append(names)
    return chosen


def plot_path(
    table: dict[str, np.ndarray], planes: list[list[str]], title: str, path: Path
) -> None:
    """Write the picture of a path in some planes; the start has an open circle."""
    figure, axes = plt.subplots(
        1, len(planes), squeeze=False, figsize=(1.0 + 4.6 * len(planes), 4.6), layout="constrained"
    )
    for panel, (across, up) in zip(axes[0], planes, strict=True):
        panel.plot(table[across], table[up], linewidth=1.4)
        panel.plot(table[across][:1], table[up][:1], "o", markerfacecolor="white", color="C0")
        panel.plot(table[across][-1:], table[up][-1:], "o", color="C0")
        panel.set_xlabel(across)
        panel.set_ylabel(up)
        panel.set_aspect("equal", adjustable="datalim")
        panel.grid(color="#d9dee4", linewidth=0.7)
        panel.spines[["top", "right"]].set_visible(False)
    figure.suptitle(f"{title}, t = 0 ... {table['t'][-1]:.4g} s")
    figure.savefig(path, dpi=140)
    plt.close(figure)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options that only the plot of one run has."""
    parser.add_argument(
        "--x", metavar="A", default="t", help="column on the horizontal axis (default: t)"
    )
    parser.add_argument("--path", metavar="POINT", help="path of POINT_x, POINT_y, POINT_z instead")
    parser.add_argument(
        "--planes",
        metavar="AB,CD",
        default="xy,xz",
        help="planes of the path (default: %(default)s)",
    )


def make(folder: Path, options: argparse.Namespace) -> Path:
    """Plot a run; returns the picture.

    Raises:
        ValueError: Options or the table cannot be used.
        OSError: A file cannot be read or written.
    """
    source, title = table_of(folder), folder.resolve().name
    table = read_table(source)
    if options.path is None:
        target = options.output or folder / "history.png"
        columns = choose(table, options.columns, options.x, source)
        plot(table, columns, options.x, title, target)
    else:
        target = options.output or folder / "path.png"
        planes = planes_of(table, options.path, options.planes, source)
        plot_path(table, planes, title, target)
    return Path(target)


def main(argv: list[str] | None = None) -> int:
    """Run the program."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("folder", type=Path, metavar="RESULTS_DIR")
    parser.add_argument("--columns", metavar="A,B", help="columns to plot (default: all)")
    add_arguments(parser)
    parser.add_argument(
        "--output", type=Path, metavar="FILE", help="default: history.png or path.png in the folder"
    )
    options = parser.parse_args(argv)
    try:
        print(make(options.folder, options))
    except (ValueError, OSError) as exc:
        print(f"plot_history.py: {exc}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
