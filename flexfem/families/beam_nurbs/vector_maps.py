# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled maps between the control points' rotations and relative rotation vectors.

The rotational part of ``maps`` where an element interpolates the rotation vectors ``v =
log(R_r^T R_I)`` of its nodes relative to the reference node (Crisfield, Jelenic, Proc. R. Soc.
Lond. A 455 (1999) 1125-1147). Along local rotations of both nodes, with ``d = theta_I - theta_r``
and ``t = theta_I + theta_r``,

    dv = d + v x t / 2 + e v x (v x d),    e = (1 - |v|/2 cot(|v|/2)) / |v|^2 .

Arrays are those of ``maps``. All functions treat one node; the first rotational component of
its place, the scalar part of a quaternion, is zero here.
"""

from flexfem._types import FloatArray
from flexfem.kernels.compiled import inlined, subroutine
from flexfem.kernels.lanes import LANES
from flexfem.lie._blocks import cross, dot
from flexfem.lie._coefficients import Triple, inverse_coefficient, inverse_derivatives
from flexfem.lie.so3 import log_entries

__all__ = [
    "put_vector",
    "put_vector_force_changes",
    "put_vector_forces",
    "put_vector_rate_changes",
    "put_vector_rates",
]


@inlined
def _at(a: FloatArray, node: int, first: int, lane: int) -> Triple:
    """Three components of a node."""
    return a[node, first, lane], a[node, first + 1, lane], a[node, first + 2, lane]


@inlined
def _square(v: Triple, u: Triple) -> Triple:
    """``v x (v x u)``."""
    return cross(v, cross(v, u))


@inlined
def _square_change(v: Triple, dv: Triple, u: Triple) -> Triple:
    """Change of ``e v x (v x u)`` along ``dv``."""
    e, e1, _ = inverse_derivatives(dot(v, v))
    p, q = cross(dv, cross(v, u)), cross(v, cross(dv, u))
    along, s = e1 * dot(v, dv), _square(v, u)
    return (
        e * (p[0] + q[0]) + along * s[0],
        e * (p[1] + q[1]) + along * s[1],
        e * (p[2] + q[2]) + along * s[2],
    )


@inlined
def put_vector(R: FloatArray, node: int, lane: int, places: FloatArray) -> None:
    """Write the rotation vector of ``R`` (9,) as a node's place."""
    places[node, 3, lane] = 0.0
    places[node, 4, lane], places[node, 5, lane], places[node, 6, lane] = log_entries(R, 0)


@subroutine
def put_vector_rates(places: FloatArray, twists: FloatArray, node: int, rates: FloatArray) -> None:
    """Write the change of a rotation vector along local twists."""
    ref = places.shape[0] // 2
    for lane in range(LANES):
        v = _at(places, node, 4, lane)
        a, b = _at(twists, node, 3, lane), _at(twists, ref, 3, lane)
        d = (a[0] - b[0], a[1] - b[1], a[2] - b[2])
        p = cross(v, (a[0] + b[0], a[1] + b[1], a[2] + b[2]))
        s, e = _square(v, d), inverse_coefficient(dot(v, v))
        rates[node, 3, lane] = 0.0
        for i in range(3):
            rates[node, 4 + i, lane] = d[i] + 0.5 * p[i] + e * s[i]


@subroutine
def put_vector_rate_changes(
    places: FloatArray, twists: FloatArray, moved: FloatArray, node: int, changes: FloatArray
) -> None:
    """Write the change of :func:`put_vector_rates` at fixed twists as places move by ``moved``."""
    ref = places.shape[0] // 2
    for lane in range(LANES):
        v, dv = _at(places, node, 4, lane), _at(moved, node, 4, lane)
        a, b = _at(twists, node, 3, lane), _at(twists, ref, 3, lane)
        p = cross(dv, (a[0] + b[0], a[1] + b[1], a[2] + b[2]))
        s = _square_change(v, dv, (a[0] - b[0], a[1] - b[1], a[2] - b[2]))
        changes[node, 3, lane] = 0.0
        for i in range(3):
            changes[node, 4 + i, lane] = 0.5 * p[i] + s[i]


@subroutine
def put_vector_forces(places: FloatArray, dual: FloatArray, node: int, forces: FloatArray) -> None:
    """Write the moment on a node from the force dual to its vector; add that on the reference."""
    ref = places.shape[0] // 2
    for lane in range(LANES):
        v, b = _at(places, node, 4, lane), _at(dual, node, 4, lane)
        p, s, e = cross(v, b), _square(v, b), inverse_coefficient(dot(v, v))
        for i in range(3):
            straight = b[i] + e * s[i]
            forces[node, 3 + i, lane] = straight - 0.5 * p[i]
            forces[ref, 3 + i, lane] -= straight + 0.5 * p[i]


@subroutine
def put_vector_force_changes(
    places: FloatArray, dual: FloatArray, moved: FloatArray, node: int, changes: FloatArray,
    moments: FloatArray,
) -> None:  # fmt: skip
    """Write the change of a node's moment at a fixed dual, and add that on the reference node."""
    for lane in range(LANES):
        v, dv, b = _at(places, node, 4, lane), _at(moved, node, 4, lane), _at(dual, node, 4, lane)
        p, s = cross(dv, b), _square_change(v, dv, b)
        for i in range(3):
            changes[node, 3 + i, lane] = s[i] - 0.5 * p[i]
            moments[node, i, lane] -= s[i] + 0.5 * p[i]
