#!/usr/bin/env python3
# SPDX-License-Identifier: LGPL-3.0-or-later
"""Outline of a sheet seen from above: outline.csv, outline.png, and the number of its folds.

Reads the last instant of the ParaView series of shells in a result folder:

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
from xml.etree import ElementTree as ET

import matplotlib as mpl
import numpy as np
import pyvista as pv

mpl.use("Agg")
import matplotlib.pyplot as plt

#: Depth of a valley between two folds, relative to the mean radius.
DEPTH = 0.05


def last_grid(folder: Path) -> Any:
    """The last instant of the series."""
    index = folder / "shells.pvd"
    if not index.is_file():
        raise SystemExit(f"error: {index} does not exist")
    file = ET.parse(index).getroot().findall(".//DataSet")[-1].get("file")
    return pv.read(folder / str(file))


def boundary(triangles: np.ndarray) -> np.ndarray:
    """Nodes of the only boundary in their order."""
    pairs = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    _, where, counts = np.unique(
        np.sort(pairs, axis=1), axis=0, return_index=True, return_counts=True
    )
    following = dict(pairs[where[counts == 1]].tolist())
    nodes = [next(iter(following))]
    while (node := following[nodes[-1]]) != nodes[0]:
        nodes.append(node)
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


def main() -> int:
    """Read, print, draw."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    grid = last_grid(folder).clean()
    triangles = grid.cells.reshape(-1, 4)[:, 1:]
    edge = np.asarray(grid.points)[boundary(triangles)]
    plane = edge[:, :2] - edge[:, :2].mean(axis=0)
    radius = np.linalg.norm(plane, axis=1)
    mean = radius.mean()
    print(f"folds {folds(radius)}, mean radius {mean:.5f} m, height {np.ptp(edge[:, 2]):.5f} m")
    turned = distance(plane, -plane) / mean
    mirrored = [distance(plane, sign * plane[:, ::-1]) / mean for sign in (1, -1)]
    print(f"turned by 180 degrees {turned:.4f}, mirrored {mirrored[0]:.4f} {mirrored[1]:.4f}")
    np.savetxt(folder / "outline.csv", edge, delimiter=",", header="x,y,z", comments="")
    figure = plt.figure(figsize=(11, 5))
    left = figure.add_subplot(121, projection="3d")
    left.plot_trisurf(*np.asarray(grid.points).T, triangles=triangles, color="#8fb3d9")
    left.set_box_aspect(np.ptp(grid.points, axis=0))
    left.view_init(25, -50)
    right = figure.add_subplot(122)
    right.plot(*np.vstack([edge, edge[:1]])[:, :2].T, color="#303841")
    right.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    figure.tight_layout()
    figure.savefig(folder / "outline.png", dpi=110)
    return 0


if __name__ == "__main__":
    sys.exit(main())
