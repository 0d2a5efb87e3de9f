#!/usr/bin/env python3
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Outline of a sheet seen from above: outline.png with the number of its folds, outline.csv.

Reads the last instant, or that next to --time, of the series of shells in a result folder:

    python postprocess/outline.py results/draping

A fold is where the outline is farther from its middle than to both sides by more than a
twentieth of its mean radius. Symmetry is the root mean square distance, relative to the mean
radius, of the outline from itself turned by 180 degrees and, apart, mirrored at both diagonals.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
import matplotlib.pyplot as plt
from result_series import RenderError, nearest, read_grid, read_series

#: Depth of a valley between two folds, relative to the mean radius.
DEPTH = 0.05


def grid_at(folder: Path, time: float | None) -> Any:
    """The shells at a time, by default at the last one."""
    instants = [one for one in read_series(folder) if "shells" in one.files]
    if not instants:
        raise RenderError(f"{folder}: no series of shells (shells.pvd)")
    instant = instants[-1] if time is None else nearest(instants, time)
    return read_grid(instant.files["shells"]).clean()


def boundary(triangles: np.ndarray) -> np.ndarray:
    """Nodes of the only boundary in their order."""
    pairs = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    _, where, counts = np.unique(
        np.sort(pairs, axis=1), axis=0, return_index=True, return_counts=True
    )
    following = dict(pairs[where[counts == 1]].tolist())
    nodes = [next(iter(following), -1)]
    while len(nodes) < len(following) and nodes[-1] in following:
        nodes.append(following[nodes[-1]])
    if following.get(nodes[-1]) != nodes[0] or len(set(nodes)) != int((counts == 1).sum()):
        raise RenderError("the shells have no outline: their sheets must have one boundary in all")
    return np.array(nodes)


def folds(radius: np.ndarray) -> int:
    """Number of maxima along a closed curve that stand out."""
    depth, start = DEPTH * radius.mean(), int(np.argmin(radius))
    values, count, rising, extreme = np.roll(radius, -start), 0, True, float(radius.min())
    for value in [*values, values[0]]:
        extreme = max(extreme, value) if rising else min(extreme, value)
        if rising and value < extreme - depth:
            count, rising, extreme = count + 1, False, value
        elif not rising and value > extreme + depth:
            rising, extreme = True, value
    return count


def distance(points: np.ndarray, others: np.ndarray) -> float:
    """Root mean square distance of points (n, 2) from the nearest of others."""
    gaps = np.linalg.norm(points[:, np.newaxis] - others, axis=2).min(axis=1)
    return float(np.sqrt((gaps**2).mean()))


def numbers(edge: np.ndarray) -> str:
    """What there is to tell about an outline (n, 3), in two lines."""
    plane = edge[:, :2] - edge[:, :2].mean(axis=0)
    radius = np.linalg.norm(plane, axis=1)
    mean = radius.mean()
    turned = distance(plane, -plane) / mean
    mirrored = [distance(plane, sign * plane[:, ::-1]) / mean for sign in (1, -1)]
    return (
        f"folds {folds(radius)}, mean radius {mean:.5f} m, height {np.ptp(edge[:, 2]):.5f} m\n"
        f"off itself, over that radius: after half a turn {turned:.4f}, "
        f"mirrored {mirrored[0]:.4f} and {mirrored[1]:.4f}"
    )


def draw(grid: Any, triangles: np.ndarray, edge: np.ndarray, path: Path) -> None:
    """Write the picture: the sheet, and its outline from above."""
    figure = plt.figure(figsize=(11, 5.5), layout="constrained")
    left = figure.add_subplot(121, projection="3d")
    left.plot_trisurf(*np.asarray(grid.points).T, triangles=triangles, color="#8fb3d9")
    left.set_box_aspect(np.maximum(np.ptp(grid.points, axis=0), 1e-9))
    left.view_init(25, -50)
    left.locator_params(nbins=4)
    left.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
    right = figure.add_subplot(122)
    right.plot(*np.vstack([edge, edge[:1]])[:, :2].T, color="#303841")
    right.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    right.locator_params(nbins=5)
    figure.suptitle(numbers(edge))
    figure.savefig(path, dpi=110)
    plt.close(figure)


def make(folder: Path, time: float | None = None, output: Path | None = None) -> list[Path]:
    """Draw the outline of a run; returns the picture and the table beside it.

    Raises:
        ValueError: The series or its sheets cannot be used.
        OSError: A file cannot be read or written.
    """
    picture = output or folder / "outline.png"
    grid = grid_at(folder, time)
    triangles = grid.cells.reshape(-1, 4)[:, 1:]
    edge = np.asarray(grid.points)[boundary(triangles)]
    draw(grid, triangles, edge, picture)
    table = picture.with_suffix(".csv")
    np.savetxt(table, edge, delimiter=",", header="x,y,z", comments="")
    return [picture, table]


def main(argv: list[str] | None = None) -> int:
    """Run the program."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path, metavar="RESULTS_DIR")
    parser.add_argument("--time", type=float, metavar="T", help="at t = T (default: the last)")
    parser.add_argument("--output", type=Path, metavar="FILE", help="default: outline.png")
    options = parser.parse_args(argv)
    try:
        print(*make(options.folder, options.time, options.output), sep="\n")
    except (ValueError, OSError) as exc:
        print(f"outline.py: {exc}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
