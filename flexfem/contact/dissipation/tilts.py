# SPDX-License-Identifier: LGPL-3.0-or-later
"""Spins of points of triangles whose nodes have no rotations, and couples on them.

A triangle with the unit normal n and the gradients b_k of its barycentric coordinates turns by

    omega = sum_k R_k dX_k,   R_k = (b_k x n) n^T + n (n x b_k)^T / 2,

as its points move by dX_k: exactly if it is rigid, with the geometry of the middle of a step also
by a finite rotation, but for the difference of rotation vectors and twice the tangent of half the
angle. A point has the mean over its triangles, weighted with their areas. Forces R_k^T c on the
points hence do the work of a couple c; they have no sum, and its torque about this geometry.
"""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.kernels.compiled import inlined, kernel, subroutine
from flexfem.kernels.records import Float3D, Int1D, Int2D, Int3D, Memory, Record, unpack

__all__ = ["Tilts", "add_spins", "place_tilts", "spread_couples"]


class Tilts(Record):
    """Sparse matrix of 3 x 3 blocks, from steps of points to their spins.

    Attributes:
        starts: First block of each point's row, shape (n + 1,).
        columns: Point of each block, shape (e,).
        blocks: Written by :func:`place_tilts`, shape (e, 3, 3), 1/m.
        triangles: Points of the triangles, shape (t, 3).
        places: Block in the row of each point of a triangle for each of them, shape (t, 3, 3).
    """

    starts: Int1D
    columns: Int1D
    blocks: Float3D
    triangles: Int2D
    places: Int3D

    @classmethod
    def of(cls, triangles: IntArray, count: int) -> "Tilts":
        """Places of the blocks of triangles (t, 3) among ``count`` points, without geometry."""
        corners = np.ascontiguousarray(triangles, dtype=np.int64).reshape(-1, 3)
        keys = corners[:, :, None] * count + corners[:, None, :]
        found, places = np.unique(keys, return_inverse=True)
        return cls(
            starts=np.searchsorted(found, np.arange(count + 1) * count), columns=found % count,
            blocks=np.zeros((len(found), 3, 3)), triangles=corners,
            places=np.ascontiguousarray(places.reshape(keys.shape), dtype=np.int64),
        )  # fmt: skip


@subroutine
def _write_normal(x: FloatArray, n: FloatArray) -> float:
    """Write the unit normal of a triangle with corners x (3, 3); returns twice its area, m^2."""
    square = 0.0
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        n[a] = (x[1, b] - x[0, b]) * (x[2, c] - x[0, c])
        n[a] -= (x[1, c] - x[0, c]) * (x[2, b] - x[0, b])
        square += n[a] * n[a]
    twice = np.sqrt(square)
    for a in range(3):
        n[a] = n[a] / twice if twice > 0.0 else 0.0
    return float(twice)


@inlined
def _write_block(side: FloatArray, n: FloatArray, block: FloatArray) -> None:
    """Write twice the area times R of the corner opposite of a side.

    Its gradient is n x side over twice the area, so that b x n = side and n x b = -side there.
    """
    for a in range(3):
        for b in range(3):
            block[a, b] = side[a] * n[b] - 0.5 * n[a] * side[b]


@kernel
def place_tilts(tilts: Memory, points: FloatArray) -> None:
    """Write the blocks for positions (n, 3); triangles without area count nothing."""
    own = unpack(Tilts, tilts)
    x, n, side, block = np.empty((3, 3)), np.empty(3), np.empty(3), np.empty((3, 3))
    areas = np.zeros(len(own.starts) - 1)
    own.blocks[:] = 0.0
    for t in range(len(own.triangles)):
        for i in range(3):
            for a in range(3):
                x[i, a] = points[own.triangles[t, i], a]
        twice = _write_normal(x, n)
        for k in range(3):
            areas[own.triangles[t, k]] += twice
            for a in range(3):
                side[a] = x[(k + 2) % 3, a] - x[(k + 1) % 3, a]
            _write_block(side, n, block)
            for i in range(3):
                for a in range(3):
                    for b in range(3):
                        own.blocks[own.places[t, i, k], a, b] += block[a, b]
    for p in range(len(areas)):
        for e in range(own.starts[p], own.starts[p + 1]):
            for a in range(3):
                for b in range(3):
                    own.blocks[e, a, b] /= max(areas[p], 1e-300)


@kernel
def add_spins(tilts: Memory, steps: FloatArray, spins: FloatArray) -> None:
    """Add the spins of points, for steps of points, to an array, both (n, 3)."""
    own = unpack(Tilts, tilts)
    for p in range(len(own.starts) - 1):
        for e in range(own.starts[p], own.starts[p + 1]):
            for a in range(3):
                for b in range(3):
                    spins[p, a] += own.blocks[e, a, b] * steps[own.columns[e], b]


@kernel
def spread_couples(tilts: Memory, couples: FloatArray, sums: FloatArray) -> None:
    """Add the forces on points that do the work of couples on them, both (n, 3)."""
    own = unpack(Tilts, tilts)
    for p in range(len(own.starts) - 1):
        for e in range(own.starts[p], own.starts[p + 1]):
            for a in range(3):
                for b in range(3):
                    sums[own.columns[e], b] += own.blocks[e, a, b] * couples[p, a]
