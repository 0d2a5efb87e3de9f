# SPDX-License-Identifier: LGPL-3.0-or-later
"""Weights of the bending energy beside clamped edges."""

import numpy as np

from flexfem._types import FloatArray, IndexArray
from flexfem.mesh.shells.patches import EdgeRule

__all__ = ["clamp_weights"]

#: Part of a triangle's compliance that each of its clamped edges gives to its neighbours.
_GIVEN = 1.0 / 6.0


def clamp_weights(areas: FloatArray, neighbours: IndexArray, rules: IndexArray) -> FloatArray:
    """Factors w (m,) of curvatures, so that those of the energies are w^2; 1 away from clamps.

    Moments of patches are in equilibrium as those of differences are: with M_i in rows of nodes at
    a distance h from one another and from the clamp, M_0 at the clamp itself. What is off is the
    complementary energy: triangles at the clamp take ``h/2 M_0^2``, and the sum of all is the
    trapezoidal rule for the integral of M^2, which is off by ``h^2/12 d(M^2)/dx`` at the clamp; at
    free, hinged and symmetric edges M or its derivative vanishes. Deflections of a beam between
    two clamps were off by 8 (h/L)^2, six times as much as all other errors. Gregory's correction
    takes the derivative from the first two rows: their weights are 5/12 h and 13/12 h in place of
    h/2 and h. So a triangle with a clamped edge gives a sixth of its compliance to its neighbours,
    whatever the load; their sum, and with it constant moments, stay as they are. On lattices of
    triangles with a clamp along one of their lines this removes the error of second order, on other
    meshes a part of it.

    Args:
        areas: of all triangles around those that count, m^2, (m,).
        neighbours: triangle over each edge, -1 without, (m, 3).
        rules: an ``EdgeRule`` of each edge without neighbour, (m, 3).
    """
    inner = neighbours >= 0
    clamped = (~inner & (rules == EdgeRule.CLAMPED)).sum(1)
    parts = np.zeros(len(areas))
    np.divide(_GIVEN * areas * clamped, inner.sum(1), out=parts, where=inner.any(1))
    compliances = areas - parts * inner.sum(1)
    np.add.at(compliances, neighbours[inner], np.repeat(parts, 3).reshape(-1, 3)[inner])
    weights: FloatArray = np.sqrt(areas / compliances)
    return weights
