# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tilts of points of triangles whose nodes have no rotations, and their derivatives.

A point p turns with its triangles by ``omega_p = B_p(X) Y`` as points move by Y,

``omega_p = sum_t W_t / A_p``, ``W_t = sum_k (s_k (n . Y_k) - n (s_k . Y_k)/2)``,

with the sides s_k opposite of the corners, the normals n and the sum A_p of twice the areas
(``contact.dissipation.tilts``). Couples C on points act as the forces ``B^T C``. Both depend on the
geometry X: with the factors ``a_t = sum_p C_p/A_p`` of the triangles,

``d(C . B Y) = sum_t (a_t . dW_t - b_t dA_t)``, ``b_t = sum_p C_p . omega_p / A_p``.
"""

from __future__ import annotations

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray

__all__ = ["TiltDerivatives"]

#: Corners behind each one, and those before it.
_NEXT, _LAST = [1, 2, 0], [2, 0, 1]


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """Products of vectors (..., 3), which keep an axis."""
    found: FloatArray = (a * b).sum(axis=-1, keepdims=True)
    return found


class TiltDerivatives:
    """Tilts of points at some positions, and their derivatives by these."""

    def __init__(self, triangles: IntArray, here: BoolArray, points: FloatArray) -> None:
        """Store the geometry.

        Args:
            triangles: points of the triangles (t, 3).
            here: (n,) points of this rank, which alone turn, or have couples.
            points: (n, 3) positions.
        """
        self._corners, self._here = triangles, here[:, np.newaxis]
        x = points[triangles]
        self._sides = x[:, _LAST] - x[:, _NEXT]
        self._edges = x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]
        normals = np.cross(*self._edges)
        twice = np.linalg.norm(normals, axis=1, keepdims=True)
        self._twice = np.maximum(twice, 1e-300)
        self._normals = normals / self._twice
        self._areas = np.maximum(self._at_points(twice), 1e-300)

    def _at_points(self, values: FloatArray) -> FloatArray:
        """Sums (n, c) over the triangles of each point of their values (t, c)."""
        found = np.zeros((len(self._here), values.shape[1]))
        np.add.at(found, self._corners, values[:, np.newaxis])
        return found

    def _spread(self, values: FloatArray) -> FloatArray:
        """Sums (n, 3) of values of corners (t, 3, 3) at their points."""
        found = np.zeros((len(self._here), 3))
        np.add.at(found, self._corners, values)
        return found

    def _turns(self, steps: FloatArray) -> FloatArray:
        """W (t, 3) for steps (n, 3) of the points."""
        y, n = steps[self._corners], self._normals[:, np.newaxis]
        found: FloatArray = (self._sides * _dot(n, y) - 0.5 * n * _dot(self._sides, y)).sum(axis=1)
        return found

    def _weights(self, couples: FloatArray) -> FloatArray:
        """Factors a (t, 3) of the triangles for couples (n, 3) on points of this rank."""
        found: FloatArray = (self._here * couples / self._areas)[self._corners].sum(axis=1)
        return found

    def _pulls(self, weights: FloatArray) -> FloatArray:
        """Forces on the corners (t, 3, 3) by factors (t, 3) of triangles."""
        a, n = weights[:, np.newaxis], self._normals[:, np.newaxis]
        found: FloatArray = n * _dot(a, self._sides) - 0.5 * self._sides * _dot(a, n)
        return found

    def spins(self, steps: FloatArray) -> FloatArray:
        """Spins (n, 3) of points of this rank by steps (n, 3), zero of others."""
        found: FloatArray = self._here * self._at_points(self._turns(steps)) / self._areas
        return found

    def forces(self, couples: FloatArray) -> FloatArray:
        """Forces (n, 3) that do the work of couples (n, 3): the transposed :meth:`spins`."""
        return self._spread(self._pulls(self._weights(couples)))

    def _moved(self, moves: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Changes of sides (t, 3, 3), normals (t, 3) and of twice the areas (t, 1) by moves."""
        x = moves[self._corners]
        normals = np.cross(x[:, 1] - x[:, 0], self._edges[1])
        normals += np.cross(self._edges[0], x[:, 2] - x[:, 0])
        twice = _dot(self._normals, normals)
        return x[:, _LAST] - x[:, _NEXT], (normals - self._normals * twice) / self._twice, twice

    def spin_changes(self, steps: FloatArray, moves: FloatArray) -> FloatArray:
        """Changes (n, 3) of :meth:`spins` with fixed steps, by moves (n, 3) of the points."""
        sides, normals, twice = self._moved(moves)
        y, n, dn = steps[self._corners], self._normals[:, np.newaxis], normals[:, np.newaxis]
        turns = sides * _dot(n, y) + self._sides * _dot(dn, y)
        turns -= 0.5 * (dn * _dot(self._sides, y) + n * _dot(sides, y))
        found = self._at_points(turns.sum(axis=1)) - self.spins(steps) * self._at_points(twice)
        return self._here * found / self._areas

    def force_changes(self, couples: FloatArray, moves: FloatArray) -> FloatArray:
        """Changes (n, 3) of :meth:`forces` with fixed couples, by moves (n, 3) of the points."""
        sides, normals, twice = self._moved(moves)
        a, n = self._weights(couples)[:, np.newaxis], self._normals[:, np.newaxis]
        dn = normals[:, np.newaxis]
        pulls = n * _dot(a, sides) + dn * _dot(a, self._sides)
        pulls -= 0.5 * (self._sides * _dot(a, dn) + sides * _dot(a, n))
        less = self._weights(couples * self._at_points(twice) / self._areas)
        return self._spread(pulls - self._pulls(less))

    def gradient(self, couples: FloatArray, steps: FloatArray) -> FloatArray:
        """Derivatives (n, 3) of ``couples . spins(steps)`` by the positions of the points."""
        y, n = steps[self._corners], self._normals[:, np.newaxis]
        weights, work = self._weights(couples), _dot(couples, self.spins(steps)) / self._areas
        a, less = weights[:, np.newaxis], (self._here * work)[self._corners].sum(axis=1)
        by_sides = a * _dot(n, y) - 0.5 * y * _dot(a, n)
        by_normals = (y * _dot(a, self._sides) - 0.5 * a * _dot(self._sides, y)).sum(axis=1)
        across = by_normals - self._normals * _dot(self._normals, by_normals)
        across = across / self._twice - self._normals * less
        first, second = np.cross(self._edges[1], across), np.cross(across, self._edges[0])
        found = by_sides[:, _NEXT] - by_sides[:, _LAST]
        found[:, 0] -= first + second
        found[:, 1] += first
        found[:, 2] += second
        return self._spread(found)
