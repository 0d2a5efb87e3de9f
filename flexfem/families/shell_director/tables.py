# SPDX-License-Identifier: LGPL-3.0-or-later
"""Strains of a director triangle as quadratic forms of its nodes, the same for all triangles.

Reference triangle: corners (0, 0), (1, 0), (0, 1). Nodes 0, 1, 2 are the corners, node 3 + k is the
midpoint of the edge opposite to corner k, where director k is. With ``g_a`` the derivatives of the
position and ``d`` the director along the coordinates of the reference triangle, the covariant
strains are the changes of ``g_a . g_b / 2``, ``g_a . d,b`` and ``g_a . d``: in relative positions
``q_i = x_i - x_0``, i = 1 to 5, and directors ``d_k`` they are sums of products ``q_i . q_j`` and
``q_i . d_k`` with fixed coefficients.

The membrane strains, polynomials of degree 2, are replaced by the linear ones with the same
tangential strains at the two Gauss points of each edge and the same mean: the interpolation into
Regge elements of degree 1 that removes membrane locking of curved triangles (Neunteufel, Schoeberl,
J. Comput. Phys. 426 (2021) 109933).
"""

import numpy as np

from flexfem._types import FloatArray

__all__ = [
    "BARYCENTRIC",
    "CROSSED",
    "DEGREE_4",
    "MEMBRANE",
    "MIDDLES",
    "POINTS",
    "REDUCTION",
    "shapes",
    "slopes",
]

#: Quadrature points of membrane and bending, each of weight 1/6: exact to degree 2.
POINTS = np.array([[1.0, 1.0], [4.0, 1.0], [1.0, 4.0]]) / 6.0
#: Midpoints of the edges, quadrature points of the shear, exact to degree 2 as well.
MIDDLES = np.array([[0.5, 0.5], [0.0, 0.5], [0.5, 0.0]])
#: Points and weights, exact to degree 4 (Dunavant, Int. J. Numer. Meth. Eng. 21 (1985) 1129-1148).
DEGREE_4 = (
    np.array([
        [p, q]
        for r in (0.445948490915965, 0.091576213509771)
        for p, q in ((r, r), (1 - 2 * r, r), (r, 1 - 2 * r))
    ]),
    np.repeat([0.223381589678011 / 2, 0.109951743655322 / 2], 3),
)  # fmt: skip
_CORNERS = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
#: Edges k of the reference triangle, from corner k + 1 to corner k + 2.
_EDGES = np.array([[-1.0, 1.0], [0.0, -1.0], [1.0, 0.0]])
#: Derivatives (3, 2) of the barycentric coordinates.
BARYCENTRIC = np.array([[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]])


def shapes(points: FloatArray) -> FloatArray:
    """Quadratic shape functions (p, 6) at points (p, 2)."""
    x, y = points.T
    own = np.stack([1 - x - y, x, y], 1)
    return np.concatenate([own * (2 * own - 1), 4 * np.roll(own, -1, 1) * np.roll(own, -2, 1)], 1)


def slopes(points: FloatArray) -> FloatArray:
    """Derivatives (p, 2, 6) of the quadratic shape functions at points (p, 2)."""
    x, y = points.T
    values, result = np.stack([1 - x - y, x, y]), np.empty((len(points), 2, 6))
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        result[:, :, k] = np.outer(4 * values[k] - 1, BARYCENTRIC[k])
        result[:, :, 3 + k] = 4 * np.outer(values[i], BARYCENTRIC[j])
        result[:, :, 3 + k] += 4 * np.outer(values[j], BARYCENTRIC[i])
    return result


def _products(points: FloatArray) -> FloatArray:
    """Coefficients (p, 3, 5, 5) of ``q_i . q_j`` in g_1.g_1, g_2.g_2 and 2 g_1.g_2, symmetric."""
    g1, g2 = np.moveaxis(slopes(points)[:, :, 1:], 1, 0)
    mixed = np.einsum("pi,pj->pij", g1, g2)
    both = [np.einsum("pi,pj->pij", g, g) for g in (g1, g2)]
    return np.stack([*both, mixed + np.swapaxes(mixed, 1, 2)], 1)


def _membrane() -> FloatArray:
    """Coefficients of the interpolated strains at the quadrature points, point by point."""
    gauss = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3.0)
    rows, values = [], []
    for k, edge in enumerate(_EDGES):
        places = _CORNERS[(k + 1) % 3] + np.outer(gauss, edge)
        weights = np.array([edge[0] ** 2, edge[1] ** 2, edge[0] * edge[1]])
        for place, products in zip(places, _products(places), strict=True):
            rows.append(np.kron(weights, [1.0, *place]))
            values.append(np.einsum("c,cij->ij", weights, products))
    for c, mean in enumerate(_products(MIDDLES).mean(0)):
        rows.append(np.kron(np.eye(3)[c], [1.0, 1.0 / 3.0, 1.0 / 3.0]))
        values.append(mean)
    linear = np.linalg.solve(np.array(rows), np.reshape(values, (9, 25))).reshape(3, 3, 25)
    at = np.column_stack([np.ones(3), POINTS])
    result: FloatArray = np.einsum("pk,ckv->pcv", at, linear).reshape(9, 5, 5)
    return result


def _crossed() -> FloatArray:
    """Coefficients of curvatures at the quadrature points and of shear at the midpoints."""
    g, d = slopes(POINTS)[:, :, 1:], -2.0 * BARYCENTRIC
    result = np.zeros((15, 5, 3))
    for p in range(3):
        for a in range(2):
            result[3 * p + a] = np.outer(g[p, a], d[:, a])
            result[3 * p + 2] += np.outer(g[p, a], d[:, 1 - a])
            result[9 + 2 * p + a, :, p] = slopes(MIDDLES)[p, a, 1:]
    return result


def _reduction() -> FloatArray:
    """Map (6, 6) of shear at the midpoints to that of the edge element, equal along the edges."""
    fields, along = np.zeros((6, 3)), np.zeros((3, 6))
    for k, (x, y) in enumerate(MIDDLES):
        fields[2 * k], fields[2 * k + 1] = [1.0, 0.0, -y], [0.0, 1.0, x]
        along[k, 2 * k : 2 * k + 2] = _EDGES[k]
    result: FloatArray = fields @ np.linalg.inv(along @ fields) @ along
    return result


#: Coefficients (9, 5, 5) of ``q_i . q_j / 2``: eps_11, eps_22, 2 eps_12 of each point.
MEMBRANE = _membrane()
#: Coefficients (15, 5, 3) of ``q_i . d_k``: kappa_11, kappa_22, 2 kappa_12 of each point, then
#: gamma_1, gamma_2 of each midpoint.
CROSSED = _crossed()
#: Projection (6, 6) of the shear strains onto those of the lowest edge element.
REDUCTION = _reduction()
