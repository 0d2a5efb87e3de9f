# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled mean-axis frames of bodies, determined by their nodes and amplitudes.

Conditions ``C eta = 0`` say that the body on average neither translates nor rotates relative to the
frame (mean axes, Tisserand; Agrawal and Shabana, Comput. Struct. 21 (1985) 1303). They are valid
for rates and their rates as well, so that twist and acceleration of the frame follow from those of
the nodes, and the forces on the frame are carried by multipliers of the conditions, which are
eliminated body by body.
"""

import numpy as np

from flexfem._types import FloatArray, IndexArray
from flexfem.core.places.floating_frames import (
    interface_motion,
    linear_into,
    relative_motion_into,
    row_of,
    write_columns,
)
from flexfem.families.floating.inertia import BodyData, Room
from flexfem.kernels.compiled import subroutine
from flexfem.lie.se3 import retract_into

__all__ = ["carry", "condense", "locate", "relative_motion", "respond"]

#: Newton steps for the frame, and the bound of the last, whose square is far below round-off.
_STEPS, _SMALL = 30, 1e-9


@subroutine
def _solve(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """Solution (6, s) by elimination with pivots: LAPACK's takes ten seconds to compile."""
    A, X = matrix.copy(), right.copy()
    n, columns = X.shape
    for c in range(n):
        pivot = c
        for i in range(c + 1, n):
            if abs(A[i, c]) > abs(A[pivot, c]):
                pivot = i
        for j in range(n):
            A[c, j], A[pivot, j] = A[pivot, j], A[c, j]
        for j in range(columns):
            X[c, j], X[pivot, j] = X[pivot, j], X[c, j]
        for i in range(n):
            if i != c:
                factor = A[i, c] / A[c, c]
                for j in range(c, n):
                    A[i, j] -= factor * A[c, j]
                for j in range(columns):
                    X[i, j] -= factor * X[c, j]
    for i in range(n):
        for j in range(columns):
            X[i, j] /= A[i, i]
    return X


@subroutine
def _add_slope(data: BodyData, c: int, columns: FloatArray, slope: FloatArray) -> None:
    """Add an interface's part of the derivatives (6, 6) of the conditions by the frame's twist."""
    for i in range(6):
        for j in range(6):
            for m in range(6):
                slope[i, j] += data.conditions[i, 6 * c + m] * columns[m, j]


@subroutine
def _slope(data: BodyData, room: Room) -> FloatArray:
    """Derivatives (6, 6) of the conditions by twists of the frame."""
    slope = np.zeros((6, 6))
    for c in range(len(data.rest)):
        write_columns(room.X[c, 0], room.g[c], room.units[c], room.columns[c])
        _add_slope(data, c, room.columns[c], slope)
    return slope


@subroutine
def _linear_motion(rest: FloatArray, room: Room, c: int) -> None:
    """Write the coordinates of an interface of a nonlinear body with their derivatives in time."""
    eta, values, k = room.eta, np.empty(12), len(room.X)
    for t in range(3):
        linear_into(room.X[c, t], 1.0 if t == 0 else 0.0, values)
        for i in range(12):
            eta[row_of(c, i, k, len(eta)), t] = values[i]
    for i in range(3):
        eta[6 * c + i, 0] -= rest[i]


@subroutine
def relative_motion(
    data: BodyData, room: Room, nodes: IndexArray, frames: FloatArray, velocity: FloatArray,
    acceleration: FloatArray,
) -> None:  # fmt: skip
    """Write the coordinates of a body with their derivatives in time, seen from its frame.

    Args:
        data: of the body.
        room: holds the frame, and gets the relative motion.
        nodes: interfaces, then amplitudes.
        frames: (n, 12) of all nodes.
        velocity: (n, 6) their local twists.
        acceleration: (n, 6) the rates of these.
    """
    k, eta, last = len(data.rest), room.eta, len(room.eta)
    nonlinear = len(data.quadratic) > 0
    if nonlinear:
        last -= 6 * k
    for c in range(k):
        H, v, w = frames[nodes[c]], velocity[nodes[c]], acceleration[nodes[c]]
        if nonlinear:
            relative_motion_into(room.base, H, v, w, room.X[c])
            _linear_motion(data.rest[c], room, c)
        else:
            own = eta[6 * c : 6 * c + 6]
            interface_motion(data.rest[c], room.base, H, v, w, room.X[c], room.g[c], own)
    for j in range(6 * k, last):
        node, i = nodes[k + (j - 6 * k) // 3], (j - 6 * k) % 3
        eta[j, 0] = frames[node, i]
        eta[j, 1], eta[j, 2] = velocity[node, i], acceleration[node, i]


@subroutine
def locate(
    data: BodyData, room: Room, nodes: IndexArray, frames: FloatArray, velocity: FloatArray,
    acceleration: FloatArray,
) -> None:  # fmt: skip
    """Write frame, twist and its rate that meet the conditions; see :func:`relative_motion`."""
    base, eta = room.base, room.eta
    H, start, step = frames[nodes[0]], np.empty(12), np.zeros(6)
    base[:] = 0.0
    start[:] = H  # initial guess: the undeformed body at its first interface
    for i in range(3):
        for j in range(3):
            start[i] -= H[3 + 3 * i + j] * data.rest[0, j]
    last = False
    for _ in range(_STEPS):
        retract_into(start, step, base[:12])
        start[:] = base[:12]
        relative_motion(data, room, nodes, frames, velocity, acceleration)
        slope = _slope(data, room)
        if last:
            break
        moved = _solve(slope, np.dot(data.conditions, eta))
        last = True
        for i in range(6):
            step[i] = -moved[i, 0]
            last = last and not abs(step[i]) > _SMALL
    for t in range(1, 3):
        moved = _solve(slope, np.dot(data.conditions, eta))
        for i in range(6):
            base[6 + 6 * t + i] = -moved[i, t]
        relative_motion(data, room, nodes, frames, velocity, acceleration)


@subroutine
def carry(data: BodyData, columns: FloatArray, force: FloatArray) -> None:
    """Add the multipliers' forces to those on coordinates, so that none is left on the frame.

    Args:
        data: of the body.
        columns: (k, 6, 12) derivatives of the interfaces' coordinates.
        force: (6 + n,) on frame and coordinates.
    """
    slope, turned, load = np.zeros((6, 6)), np.empty((6, 6)), np.empty((6, 1))
    load[:, 0] = force[:6]
    for c in range(len(columns)):
        _add_slope(data, c, columns[c], slope)
        for j in range(6):
            for i in range(6):
                load[j, 0] += columns[c, i, j] * force[6 + 6 * c + i]
    for i in range(6):
        for j in range(6):
            turned[i, j] = slope[j, i]
    multipliers = _solve(turned, load)
    for j in range(data.conditions.shape[1]):
        for i in range(6):
            force[6 + j] -= data.conditions[i, j] * multipliers[i, 0]
    force[:6] = 0.0


@subroutine
def respond(data: BodyData, room: Room) -> None:
    """Write the change of the frame along the steps of the nodes.

    The first six columns of changes are those by the place of the frame, which is written to
    ``room.moved``; the others are those by the places and rates of the nodes.
    """
    places, rates, jerks, moved = room.places, room.rates, room.jerks, room.moved
    own = np.ascontiguousarray(places[:, :6])
    back = -_solve(np.dot(data.conditions, own), data.conditions)
    moved[:] = np.dot(back, places)
    by_place, by_place_twice = (
        np.ascontiguousarray(rates[6:, :6]), np.ascontiguousarray(jerks[6:, :6])
    )  # fmt: skip
    places += np.dot(own, moved)
    rates[6:] += np.dot(by_place, moved)
    jerks[6:] += np.dot(by_place_twice, moved)
    twists = np.dot(back, np.ascontiguousarray(rates[6:]))
    rates[:6] = twists
    rates[6:] += np.dot(own, twists)
    jerks[6:] += np.dot(room.turned, twists)
    accelerations = np.dot(back, np.ascontiguousarray(jerks[6:]))
    jerks[:6] = accelerations
    jerks[6:] += np.dot(own, accelerations)


@subroutine
def condense(data: BodyData, room: Room, bent: FloatArray, full: FloatArray) -> FloatArray:
    """Condense the matrix with the frame to that of the nodes.

    Args:
        data: of the body.
        room: with the steps of the frame.
        bent: (s, s) changes of forces with their directions, by place.
        full: (s, s) changes of the forces with these steps at fixed directions.
    """
    total = full + bent + np.dot(np.ascontiguousarray(bent[:, :6]), room.moved)
    gradient = np.dot(data.conditions, np.ascontiguousarray(room.to_nodes[6:]))
    slope = np.ascontiguousarray(gradient[:, :6])
    multipliers = _solve(slope.T.copy(), np.ascontiguousarray(total[:6]))
    total -= np.dot(gradient.T.copy(), multipliers)
    own: FloatArray = total[6:, 6:]
    return own
