# SPDX-License-Identifier: LGPL-3.0-or-later
"""Broad phase of contacts: boxes in a hashed grid against spheres in SciPy's cKDTree.

Nodes of one sheet look for the triangles of another that lies a little above it and is wavy, as
``flexfem.contact.detection.neighbours`` does. The tree holds the centres of the triangles and is
asked for those within the largest radius of a triangle; what is found is cut down to the boxes that
hold the node. Both give the same pairs. Columns: nodes, triangles, pairs, processor time in
milliseconds (least of 40 blocks in turns). Run from the source tree::

    python -m tests.benchmarks.boxes_against_kdtree
"""

import numpy as np
from scipy.spatial import cKDTree

from flexfem.contact.detection.broad_phase import overlaps, triangle_boxes
from tests.benchmarks.timing import paired


def sheet(count: int, height: float) -> tuple[np.ndarray, np.ndarray]:
    """Points and triangles of a wavy square."""
    x, y = np.meshgrid(*2 * (np.linspace(0.0, 1.0, count),), indexing="ij")
    points = np.stack([x, y, height + 0.05 * np.sin(9.0 * x) * np.cos(7.0 * y)], axis=-1)
    k = np.arange(count * count).reshape(count, count)
    a, b, c, d = (n.ravel() for n in (k[:-1, :-1], k[1:, :-1], k[1:, 1:], k[:-1, 1:]))
    return points.reshape(-1, 3), np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


def compare(count: int) -> tuple[dict[str, float], tuple[int, int, int]]:
    """Times of a search, s, and the numbers of nodes, triangles and pairs."""
    nodes = sheet(count, 0.01)[0] + [0.3 / count, 0.2 / count, 0.0]
    points, triangles = sheet(count, 0.0)
    margins, low, high = np.full(len(triangles), 0.02), *np.empty((2, len(triangles), 3))

    def grid() -> tuple[np.ndarray, np.ndarray]:
        triangle_boxes(points, triangles, margins, low, high)
        return overlaps(nodes, nodes, low, high)

    def tree() -> tuple[np.ndarray, np.ndarray]:
        triangle_boxes(points, triangles, margins, low, high)
        centres = 0.5 * (low + high)
        radius = 0.5 * np.linalg.norm(high - low, axis=1).max()
        near = cKDTree(nodes).sparse_distance_matrix(
            cKDTree(centres), radius, output_type="ndarray"
        )
        i, j = near["i"], near["j"]
        inside = ((low[j] <= nodes[i]) & (nodes[i] <= high[j])).all(axis=1)
        return i[inside], j[inside]

    starts, found = grid()
    rows, others = tree()
    order = np.lexsort((others, rows))
    np.testing.assert_array_equal(np.repeat(np.arange(len(nodes)), np.diff(starts)), rows[order])
    np.testing.assert_array_equal(found, others[order])
    return paired({"ours": grid, "cKDTree": tree}), (len(nodes), len(triangles), len(found))


def main() -> None:
    """Print the table."""
    print("nodes  triangles   pairs      ours   cKDTree")
    for count in (10, 30, 100):
        times, numbers = compare(count)
        row = [1e3 * t for t in times.values()]
        print("{:5d} {:10d} {:7d} {:9.3f} {:9.3f}".format(*numbers, *row))


if __name__ == "__main__":
    main()
