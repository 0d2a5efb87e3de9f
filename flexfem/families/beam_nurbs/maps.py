# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled maps between the control points' frames and the unknowns of a NURBS element.

With R = R_r^T R_I of node I and the reference node r, an element interpolates the places
``y = R_r^T (x_I - x_r)`` and the unit quaternions ``q = (w, v)`` of R with ``w >= 0``. Along local
twists ``(u, theta)`` of both nodes

    dy = R u_I - u_r + y x theta_r,    dq = (q o theta_I - theta_r o q) / 2,
    2 dw = -v . (theta_I - theta_r),    2 dv = w (theta_I - theta_r) + v x (theta_I + theta_r).

With ``vectors`` it interpolates in place of the quaternions the rotation vectors v of R, see
``vector_maps``.

The last axis of all arrays is that of ``LANES`` elements; before it come the nodes and
their components, of places ``PLACE``: y, ``w - 1`` (0 with ``vectors``), v. Entries of the
reference node, whose place is zero, are not touched.
"""

from flexfem._types import FloatArray, IndexArray
from flexfem.core.nodes.step_kernels import add
from flexfem.families.beam_nurbs.vector_maps import (
    at,
    put_vector,
    put_vector_force_changes,
    put_vector_forces,
    put_vector_rate_changes,
    put_vector_rates,
)
from flexfem.kernels.compiled import inlined, subroutine
from flexfem.kernels.lanes import LANES
from flexfem.lie._blocks import cross, dot
from flexfem.lie._coefficients import Triple
from flexfem.lie.quaternion import from_matrix

__all__ = [
    "PLACE",
    "RELATIVE",
    "force_changes_into",
    "forces_into",
    "places_into",
    "rate_changes_into",
    "rates_into",
    "twists_into",
]

#: Entries of a node's relative rotation and of its place.
RELATIVE, PLACE = 9, 7


@inlined
def _put(a: FloatArray, node: int, first: int, lane: int, v: Triple) -> None:
    a[node, first, lane], a[node, first + 1, lane], a[node, first + 2, lane] = v


@inlined
def _add(a: FloatArray, node: int, first: int, lane: int, v: Triple) -> None:
    a[node, first, lane] += v[0]
    a[node, first + 1, lane] += v[1]
    a[node, first + 2, lane] += v[2]


@inlined
def _turned(R: FloatArray, i: int, lane: int, v: Triple) -> Triple:
    """``R v``."""
    return (
        R[i, 0, lane] * v[0] + R[i, 1, lane] * v[1] + R[i, 2, lane] * v[2],
        R[i, 3, lane] * v[0] + R[i, 4, lane] * v[1] + R[i, 5, lane] * v[2],
        R[i, 6, lane] * v[0] + R[i, 7, lane] * v[1] + R[i, 8, lane] * v[2],
    )


@inlined
def _turned_back(R: FloatArray, i: int, lane: int, v: Triple) -> Triple:
    """``R^T v``."""
    return (
        R[i, 0, lane] * v[0] + R[i, 3, lane] * v[1] + R[i, 6, lane] * v[2],
        R[i, 1, lane] * v[0] + R[i, 4, lane] * v[1] + R[i, 7, lane] * v[2],
        R[i, 2, lane] * v[0] + R[i, 5, lane] * v[1] + R[i, 8, lane] * v[2],
    )


@inlined
def _turn(w: float, v: Triple, difference: Triple, total: Triple) -> Triple:
    """``(w difference + v x total) / 2``."""
    c = cross(v, total)
    return (
        0.5 * (w * difference[0] + c[0]),
        0.5 * (w * difference[1] + c[1]),
        0.5 * (w * difference[2] + c[2]),
    )


@inlined
def _moments(w: float, v: Triple, a: float, b: Triple) -> tuple[Triple, Triple]:
    """Moments on the node and on the reference node of a force ``(a, b)`` dual to ``(w, v)``."""
    c = cross(v, b)
    e0, e1, e2 = w * b[0] - a * v[0], w * b[1] - a * v[1], w * b[2] - a * v[2]
    own = (0.5 * (e0 - c[0]), 0.5 * (e1 - c[1]), 0.5 * (e2 - c[2]))
    return own, (-0.5 * (e0 + c[0]), -0.5 * (e1 + c[1]), -0.5 * (e2 + c[2]))


@subroutine
def places_into(
    vectors: bool, cells: IndexArray, first: int, frames: FloatArray, relative: FloatArray,
    places: FloatArray,
) -> None:  # fmt: skip
    """Relative rotations (k, RELATIVE, L), places (k, PLACE, L) of the elements from ``first`` on.

    The last element is repeated in the remaining lanes.
    """
    count, k = cells.shape
    R, ref = relative[0, :, 0].copy(), k // 2
    for lane in range(LANES):
        c = min(first + lane, count - 1)
        A = frames[cells[c, ref]]
        for node in range(k):
            if node == ref:
                continue
            B = frames[cells[c, node]]
            x0, x1, x2 = B[0] - A[0], B[1] - A[1], B[2] - A[2]
            for i in range(3):
                a0, a1, a2 = A[3 + i], A[6 + i], A[9 + i]
                places[node, i, lane] = a0 * x0 + a1 * x1 + a2 * x2
                for j in range(3):
                    R[3 * i + j] = a0 * B[3 + j] + a1 * B[6 + j] + a2 * B[9 + j]
            if vectors:
                put_vector(R, node, lane, places)
            else:
                w, v = from_matrix(R, 0)
                places[node, 3, lane] = w - 1.0
                _put(places, node, 4, lane, v)
            for i in range(9):
                relative[node, i, lane] = R[i]


@subroutine
def twists_into(cells: IndexArray, first: int, values: FloatArray, twists: FloatArray) -> None:
    """Nodal twists (n, 6) of the elements from ``first`` on to (k, 6, L)."""
    count, k = cells.shape
    for lane in range(LANES):
        c = min(first + lane, count - 1)
        for node in range(k):
            for i in range(6):
                twists[node, i, lane] = values[cells[c, node], i]


@subroutine
def rates_into(
    vectors: bool, relative: FloatArray, places: FloatArray, twists: FloatArray, rates: FloatArray
) -> None:
    """Change (k, PLACE, L) of the places along local twists (k, 6, L)."""
    k = twists.shape[0]
    ref = k // 2
    for node in range(k):
        if node == ref:
            continue
        for lane in range(LANES):
            y, omega_r = at(places, node, 0, lane), at(twists, ref, 3, lane)
            speed = _turned(relative, node, lane, at(twists, node, 0, lane))
            speed = add(speed, -1.0, at(twists, ref, 0, lane))
            _put(rates, node, 0, lane, add(speed, 1.0, cross(y, omega_r)))
        if vectors:
            put_vector_rates(places, twists, node, rates)
            continue
        for lane in range(LANES):
            w, v = 1.0 + places[node, 3, lane], at(places, node, 4, lane)
            omega, omega_r = at(twists, node, 3, lane), at(twists, ref, 3, lane)
            difference, total = add(omega, -1.0, omega_r), add(omega, 1.0, omega_r)
            rates[node, 3, lane] = -0.5 * dot(v, difference)
            _put(rates, node, 4, lane, _turn(w, v, difference, total))


@subroutine
def rate_changes_into(
    vectors: bool, relative: FloatArray, places: FloatArray, twists: FloatArray,
    steps: FloatArray, moved: FloatArray, changes: FloatArray,
) -> None:  # fmt: skip
    """Change (k, PLACE, L) of :func:`rates_into` at fixed local twists as the nodes move.

    They move by the local twists ``steps`` (k, 6, L), which change the places by ``moved``
    (k, PLACE, L).
    """
    k = twists.shape[0]
    ref = k // 2
    for node in range(k):
        if node == ref:
            continue
        for lane in range(LANES):
            turn = _turned_back(relative, node, lane, at(steps, ref, 3, lane))
            turn, omega_r = add(at(steps, node, 3, lane), -1.0, turn), at(twists, ref, 3, lane)
            speed = _turned(relative, node, lane, cross(turn, at(twists, node, 0, lane)))
            speed = add(speed, -1.0, cross(omega_r, at(moved, node, 0, lane)))
            _put(changes, node, 0, lane, speed)
        if vectors:
            put_vector_rate_changes(places, twists, moved, node, changes)
            continue
        for lane in range(LANES):
            dw, dv = moved[node, 3, lane], at(moved, node, 4, lane)
            omega, omega_r = at(twists, node, 3, lane), at(twists, ref, 3, lane)
            difference, total = add(omega, -1.0, omega_r), add(omega, 1.0, omega_r)
            changes[node, 3, lane] = -0.5 * dot(dv, difference)
            _put(changes, node, 4, lane, _turn(dw, dv, difference, total))


@subroutine
def forces_into(
    vectors: bool, relative: FloatArray, places: FloatArray, dual: FloatArray, forces: FloatArray
) -> None:
    """Nodal forces (k, 6, L) of forces (k, PLACE, L) dual to the places.

    The transpose of :func:`rates_into`.
    """
    k = dual.shape[0]
    ref = k // 2
    for i in range(6):
        for lane in range(LANES):
            forces[ref, i, lane] = 0.0
    for node in range(k):
        if node == ref:
            continue
        for lane in range(LANES):
            y, f = at(places, node, 0, lane), at(dual, node, 0, lane)
            _put(forces, node, 0, lane, _turned_back(relative, node, lane, f))
            _add(forces, ref, 0, lane, (-f[0], -f[1], -f[2]))
            _add(forces, ref, 3, lane, cross(f, y))
        if vectors:
            put_vector_forces(places, dual, node, forces)
            continue
        for lane in range(LANES):
            v, b = at(places, node, 4, lane), at(dual, node, 4, lane)
            own, other = _moments(1.0 + places[node, 3, lane], v, dual[node, 3, lane], b)
            _put(forces, node, 3, lane, own)
            _add(forces, ref, 3, lane, other)


@subroutine
def force_changes_into(
    vectors: bool, relative: FloatArray, places: FloatArray, dual: FloatArray, steps: FloatArray,
    moved: FloatArray, changes: FloatArray, moments: FloatArray,
) -> None:  # fmt: skip
    """Change of :func:`forces_into` at a fixed dual (k, PLACE, L) as the nodes move.

    They move as in :func:`rate_changes_into`. ``changes`` (k, 6, L) gets the change at each node
    but the reference node, ``moments`` (k, 3, L) its contribution to the moment at the reference
    node.
    """
    k = dual.shape[0]
    ref = k // 2
    for node in range(k):
        if node == ref:
            continue
        for lane in range(LANES):
            f = at(dual, node, 0, lane)
            turn = _turned_back(relative, node, lane, at(steps, ref, 3, lane))
            turn = add(at(steps, node, 3, lane), -1.0, turn)
            _put(changes, node, 0, lane, cross(_turned_back(relative, node, lane, f), turn))
            _put(moments, node, 0, lane, cross(f, at(moved, node, 0, lane)))
        if vectors:
            put_vector_force_changes(places, dual, moved, node, changes, moments)
            continue
        for lane in range(LANES):
            b, dv = at(dual, node, 4, lane), at(moved, node, 4, lane)
            own, other = _moments(moved[node, 3, lane], dv, dual[node, 3, lane], b)
            _put(changes, node, 3, lane, own)
            _add(moments, node, 0, lane, other)
