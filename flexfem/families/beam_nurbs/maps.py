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

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.nodes.step_kernels import add
from flexfem.families.beam_nurbs.vector_maps import (
    put_vector,
    put_vector_force_changes,
    put_vector_forces,
    put_vector_rate_changes,
    put_vector_rates,
)
from flexfem.kernels.compiled import inlined, subroutine
from flexfem.kernels.lanes import LANES
from flexfem.kernels.vectors import add_to, load, store
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
]

#: Entries of a node's relative rotation and of its place.
RELATIVE, PLACE = 9, 7


@inlined
def _at(a: FloatArray, first: int) -> Triple:
    """Three entries of all lanes."""
    return load(a, first), load(a, first + 1), load(a, first + 2)


@inlined
def _put(a: FloatArray, first: int, v: Triple) -> None:
    store(a, first, v[0])
    store(a, first + 1, v[1])
    store(a, first + 2, v[2])


@inlined
def _add(a: FloatArray, first: int, v: Triple) -> None:
    add_to(a, first, v[0])
    add_to(a, first + 1, v[1])
    add_to(a, first + 2, v[2])


@inlined
def _column(R: FloatArray, first: int) -> Triple:
    """A column of a rotation, from its entry in the first row on."""
    return load(R, first), load(R, first + 3), load(R, first + 6)


@inlined
def _turned(R: FloatArray, node: int, v: Triple) -> Triple:
    """``R v``."""
    i = RELATIVE * node
    return dot(_at(R, i), v), dot(_at(R, i + 3), v), dot(_at(R, i + 6), v)


@inlined
def _turned_back(R: FloatArray, node: int, v: Triple) -> Triple:
    """``R^T v``."""
    i = RELATIVE * node
    return dot(_column(R, i), v), dot(_column(R, i + 1), v), dot(_column(R, i + 2), v)


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
    vectors: bool, positions: FloatArray, rotations: FloatArray, relative: FloatArray,
    places: FloatArray,
) -> None:  # fmt: skip
    """Relative rotations (k, RELATIVE, L) and places (k, PLACE, L) of the nodes.

    ``positions`` (k, 3, L) and ``rotations`` (k, 9, L) are those of their frames.
    """
    k = positions.shape[0]
    R, ref = np.empty(9), k // 2
    for node in range(k):
        if node == ref:
            continue
        x = add(_at(positions, 3 * node), -1.0, _at(positions, 3 * ref))
        for i in range(3):
            axis = _column(rotations, 9 * ref + i)
            store(places, PLACE * node + i, dot(axis, x))
            for j in range(3):
                entry = dot(axis, _column(rotations, 9 * node + j))
                store(relative, RELATIVE * node + 3 * i + j, entry)
        for lane in range(LANES):
            for i in range(9):
                R[i] = relative[node, i, lane]
            if vectors:
                put_vector(R, node, lane, places)
            else:
                w, v = from_matrix(R, 0)
                places[node, 3, lane] = w - 1.0
                places[node, 4, lane], places[node, 5, lane], places[node, 6, lane] = v


@subroutine
def rates_into(
    vectors: bool, relative: FloatArray, places: FloatArray, twists: FloatArray, rates: FloatArray
) -> None:
    """Change (k, PLACE, L) of the places along local twists (k, 6, L)."""
    k = twists.shape[0]
    velocity_r, omega_r = _at(twists, 6 * (k // 2)), _at(twists, 6 * (k // 2) + 3)
    for node in range(k):
        if node == k // 2:
            continue
        y = PLACE * node
        speed = _turned(relative, node, _at(twists, 6 * node))
        speed = add(speed, -1.0, velocity_r)
        _put(rates, y, add(speed, 1.0, cross(_at(places, y), omega_r)))
        if vectors:
            put_vector_rates(places, twists, node, rates)
            continue
        w, v, omega = 1.0 + load(places, y + 3), _at(places, y + 4), _at(twists, 6 * node + 3)
        difference, total = add(omega, -1.0, omega_r), add(omega, 1.0, omega_r)
        store(rates, y + 3, -0.5 * dot(v, difference))
        _put(rates, y + 4, _turn(w, v, difference, total))


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
    omega_r, turn_r = _at(twists, 6 * (k // 2) + 3), _at(steps, 6 * (k // 2) + 3)
    for node in range(k):
        if node == k // 2:
            continue
        y = PLACE * node
        turn = add(_at(steps, 6 * node + 3), -1.0, _turned_back(relative, node, turn_r))
        speed = _turned(relative, node, cross(turn, _at(twists, 6 * node)))
        _put(changes, y, add(speed, -1.0, cross(omega_r, _at(moved, y))))
        if vectors:
            put_vector_rate_changes(places, twists, moved, node, changes)
            continue
        dw, dv, omega = load(moved, y + 3), _at(moved, y + 4), _at(twists, 6 * node + 3)
        difference, total = add(omega, -1.0, omega_r), add(omega, 1.0, omega_r)
        store(changes, y + 3, -0.5 * dot(dv, difference))
        _put(changes, y + 4, _turn(dw, dv, difference, total))


@subroutine
def forces_into(
    vectors: bool, relative: FloatArray, places: FloatArray, dual: FloatArray, forces: FloatArray
) -> None:
    """Nodal forces (k, 6, L) of forces (k, PLACE, L) dual to the places.

    The transpose of :func:`rates_into`.
    """
    k = dual.shape[0]
    ref = 6 * (k // 2)
    for i in range(6):
        store(forces, ref + i, 0.0)
    for node in range(k):
        if node == k // 2:
            continue
        y = PLACE * node
        f = _at(dual, y)
        _put(forces, 6 * node, _turned_back(relative, node, f))
        _add(forces, ref, (-f[0], -f[1], -f[2]))
        _add(forces, ref + 3, cross(f, _at(places, y)))
        if vectors:
            put_vector_forces(places, dual, node, forces)
            continue
        w, v = 1.0 + load(places, y + 3), _at(places, y + 4)
        own, other = _moments(w, v, load(dual, y + 3), _at(dual, y + 4))
        _put(forces, 6 * node + 3, own)
        _add(forces, ref + 3, other)


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
    turn_r = _at(steps, 6 * (k // 2) + 3)
    for node in range(k):
        if node == k // 2:
            continue
        y = PLACE * node
        f = _at(dual, y)
        turn = add(_at(steps, 6 * node + 3), -1.0, _turned_back(relative, node, turn_r))
        _put(changes, 6 * node, cross(_turned_back(relative, node, f), turn))
        _put(moments, 3 * node, cross(f, _at(moved, y)))
        if vectors:
            put_vector_force_changes(places, dual, moved, node, changes, moments)
            continue
        dw, dv = load(moved, y + 3), _at(moved, y + 4)
        own, other = _moments(dw, dv, load(dual, y + 3), _at(dual, y + 4))
        _put(changes, 6 * node + 3, own)
        _add(moments, 3 * node, other)
