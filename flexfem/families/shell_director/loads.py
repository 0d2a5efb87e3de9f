# SPDX-License-Identifier: LGPL-3.0-or-later
"""Distributed forces over the curved triangles of director shells and along their edges.

The nodal forces of a pressure p are ``p int N_i x,1 x x,2`` over the reference triangle, with the
quadratic shape functions N; with fixed coefficients ``A_ijk``, antisymmetric in j and k, they are
``p/2 sum_jk A_ijk x_j x x_k``, and ``df_i = p sum_j dx_j x v_ij`` with ``v_ij = sum_k A_ijk x_k``.
The tangent is symmetric after assembly, except at boundary edges.
"""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.families.shell_director.tables import DEGREE_4, shapes, slopes
from flexfem.kernels.compiled import inlined, kernel

__all__ = [
    "add_pressures",
    "area_shares",
    "edge_shares",
    "pressure_states",
    "pressure_tangent",
]

#: Gauss points of degree 5 along an edge from -1 to 1, and their weights.
_GAUSS = np.sqrt(0.6) * np.array([-1.0, 0.0, 1.0]), np.array([5.0, 8.0, 5.0]) / 9.0


def edge_shares(places: FloatArray) -> FloatArray:
    """Integrals (m, 3) of the shape functions of both ends and the midside node of curved edges.

    Args:
        places: positions of these nodes, (m, 3, 3).
    """
    s, weights = _GAUSS
    values = np.stack([s * (s - 1) / 2, s * (s + 1) / 2, 1 - s * s], 1)
    slope = np.stack([s - 0.5, s + 0.5, -2 * s], 1)
    lengths = np.linalg.norm(np.einsum("pn,mnc->mpc", slope, places), axis=2)
    shares: FloatArray = np.einsum("p,mp,pn->mn", weights, lengths, values)
    return shares


def area_shares(places: FloatArray) -> FloatArray:
    """Integrals (m, 6) of the shape functions over curved triangles with nodes at (m, 6, 3)."""
    points, weights = DEGREE_4
    base = np.einsum("pan,mnc->mpac", slopes(points), places)
    sizes = np.linalg.norm(np.cross(base[:, :, 0], base[:, :, 1]), axis=2)
    shares: FloatArray = np.einsum("p,mp,pn->mn", weights, sizes, shapes(points))
    return shares


def _coefficients() -> FloatArray:
    """The coefficients A (6, 6, 6); the quadrature is exact."""
    points, weights = DEGREE_4
    first, second = np.moveaxis(slopes(points), 1, 0)
    product: FloatArray = np.einsum("p,pi,pj,pk->ijk", weights, shapes(points), first, second)
    return product - np.swapaxes(product, 1, 2)


_A = _coefficients()


@inlined
def _relative(nodes: IntArray, frames: FloatArray, q: FloatArray) -> None:
    """Write positions (6, 3) relative to the first corner."""
    for i in range(6):
        for a in range(3):
            q[i, a] = frames[nodes[i], a] - frames[nodes[0], a]


@inlined
def _lever(q: FloatArray, i: int, j: int, v: FloatArray) -> None:
    """Write v_ij (3,)."""
    for a in range(3):
        v[a] = 0.0
        for k in range(1, 6):
            v[a] += _A[i, j, k] * q[k, a]


@inlined
def _force(q: FloatArray, i: int, v: FloatArray, f: FloatArray) -> None:
    """Write the force (3,) on node i of a unit pressure."""
    f[:] = 0.0
    for j in range(1, 6):
        _lever(q, i, j, v)
        for a in range(3):
            b, c = (a + 1) % 3, (a + 2) % 3
            f[a] += 0.5 * (q[j, b] * v[c] - q[j, c] * v[b])


@kernel
def add_pressures(
    nodes: IntArray, pressure: FloatArray, load: IntArray, factors: FloatArray, frames: FloatArray,
    scale: float, residual: FloatArray,
) -> None:  # fmt: skip
    """Subtract ``scale * factors[load]`` times every pressure's forces, in node axes."""
    q, v, f = np.empty((6, 3)), np.empty(3), np.empty(3)
    for m in range(len(nodes)):
        _relative(nodes[m], frames, q)
        p = scale * factors[load[m]] * pressure[m]
        for i in range(6):
            _force(q, i, v, f)
            H, to = frames[nodes[m, i]], residual[nodes[m, i]]
            for a in range(3):
                to[a] -= p * (H[3 + a] * f[0] + H[6 + a] * f[1] + H[9 + a] * f[2])


@kernel
def pressure_tangent(
    nodes: IntArray, pressure: FloatArray, load: IntArray, factors: FloatArray, frames: FloatArray,
    scale: float, out: FloatArray,
) -> None:  # fmt: skip
    """Write ``scale`` times the derivative along local twists of the nodes to (m, 36, 36)."""
    q, v, f, d = np.empty((6, 3)), np.empty(3), np.empty(3), np.empty(3)
    out[:] = 0.0
    for m in range(len(nodes)):
        _relative(nodes[m], frames, q)
        p = -scale * factors[load[m]] * pressure[m]
        for i in range(6):
            G = frames[nodes[m, i]]
            for j in range(6):
                H = frames[nodes[m, j]]
                _lever(q, i, j, v)
                for c in range(3):
                    for a in range(3):
                        b, e = (a + 1) % 3, (a + 2) % 3
                        d[a] = p * (H[3 + 3 * b + c] * v[e] - H[3 + 3 * e + c] * v[b])
                    for r in range(3):
                        value = G[3 + r] * d[0] + G[6 + r] * d[1] + G[9 + r] * d[2]
                        out[m, 6 * i + r, 6 * j + c] = value
            # in axes that rotate with the node
            _force(q, i, v, f)
            for a in range(3):
                d[a] = p * (G[3 + a] * f[0] + G[6 + a] * f[1] + G[9 + a] * f[2])
            for a in range(3):
                b, e = (a + 1) % 3, (a + 2) % 3
                out[m, 6 * i + a, 6 * i + 3 + b] -= d[e]
                out[m, 6 * i + a, 6 * i + 3 + e] += d[b]


@kernel
def pressure_states(
    nodes: IntArray, pressure: FloatArray, load: IntArray, factors: FloatArray, frames: FloatArray,
    out: FloatArray,
) -> None:  # fmt: skip
    """Write force, zero moment, position and zero angular velocity of each node to (6 m, 12)."""
    q, v, f = np.empty((6, 3)), np.empty(3), np.empty(3)
    out[:] = 0.0
    for m in range(len(nodes)):
        _relative(nodes[m], frames, q)
        for i in range(6):
            _force(q, i, v, f)
            for a in range(3):
                out[6 * m + i, a] = factors[load[m]] * pressure[m] * f[a]
                out[6 * m + i, 6 + a] = frames[nodes[m, i], a]
