# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sums over pairs of points and obstacles: potential, forces, wrenches and their linearisation.

With the relative motion e = dx - R (u + theta x q) of a point and its carrier, whose local twist is
(u, theta) and whose axes have the point at q, the tangent of the force F on the point is

    -dF = k n (n . e) + B e - (R theta) x F,

the Hessian of the potential for equilibria. For steps k is the slope of the difference quotient and
the other parts are left out, as for pairs of primitives.
"""

import numpy as np

from flexfem._types import FloatArray
from flexfem.contact.fields.data import (
    ARM,
    BEND,
    GAP,
    LOAD,
    NORMAL,
    POTENTIAL,
    SLOPE,
    FieldPairs,
    FieldResponse,
    FieldState,
)
from flexfem.kernels.compiled import inlined, kernel
from flexfem.kernels.records import Memory, unpack
from flexfem.lie import se3, so3

__all__ = [
    "add_actions", "add_forces", "add_wrenches", "maps_at_rest", "maps_of_step", "potential",
    "rows_into",
]  # fmt: skip


def maps_at_rest(frames: FloatArray) -> FloatArray:
    """Maps (f, 3, 3) from inertial forces to forces in the axes of frames (f, 12)."""
    return np.ascontiguousarray(se3.rotation(frames).swapaxes(1, 2))


def maps_of_step(before: FloatArray, after: FloatArray) -> FloatArray:
    """Maps (f, 3, 3) from inertial forces on points of carriers to local forces of a step.

    A point at the arm a moves by R0 S (u + theta x a), where (u, theta) is the increment of the
    frame and S the left tangent of its rotation: the map is the transpose of R0 S.

    Args:
        before: frames (f, 12) at the start.
        after: those at the end.
    """
    increments = se3.log(se3.compose(se3.inverse(before), after))
    turns: FloatArray = so3.tangent(increments[:, 3:]) @ maps_at_rest(before)
    return turns


@kernel
def potential(response: Memory) -> float:
    """Potential of all pairs at the end, J."""
    own, total = unpack(FieldResponse, response), 0.0
    for k in range(own.count[0]):
        total += own.numbers[k, POTENTIAL]
    return total


@kernel
def add_forces(pairs: Memory, response: Memory, scale: float, sums: FloatArray) -> None:
    """Add ``scale`` times the forces on the points to those of all points (n, 3)."""
    points, own = unpack(FieldPairs, pairs).points, unpack(FieldResponse, response)
    for k in range(own.count[0]):
        for a in range(3):
            sums[points[own.pairs[k]], a] += scale * own.forces[k, a]


@kernel
def add_wrenches(
    pairs: Memory, response: Memory, maps: FloatArray, scale: float, wrenches: FloatArray
) -> None:
    """Add ``scale`` times the opposite forces to the local wrenches (f, 6) of the carriers.

    ``maps`` (f, 3, 3) are those of :func:`maps_at_rest` or :func:`maps_of_step`. Wrenches are force
    and moment in the axes of the carriers, at the start of a step: their work on its increments
    (u, theta) is that of the forces.
    """
    fields, own, g = unpack(FieldPairs, pairs).fields, unpack(FieldResponse, response), np.empty(3)
    for k in range(own.count[0]):
        f = fields[own.pairs[k]]
        for a in range(3):
            g[a] = 0.0
            for b in range(3):
                g[a] -= scale * maps[f, a, b] * own.forces[k, b]
        _add_wrench(g, own.numbers[k, ARM : ARM + 3], wrenches[f])


@inlined
def _add_wrench(g: FloatArray, arm: FloatArray, wrench: FloatArray) -> None:
    """Add a local force at an arm."""
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        wrench[a] += g[a]
        wrench[3 + a] += arm[b] * g[c] - arm[c] * g[b]


@inlined
def _turned(frame: FloatArray, v: FloatArray, out: FloatArray) -> None:
    """Write a vector of a frame's axes in inertial ones."""
    for a in range(3):
        out[a] = frame[3 + 3 * a] * v[0] + frame[4 + 3 * a] * v[1] + frame[5 + 3 * a] * v[2]


@inlined
def _local(frame: FloatArray, v: FloatArray, out: FloatArray) -> None:
    """Write an inertial vector in the axes of a frame."""
    for a in range(3):
        out[a] = frame[3 + a] * v[0] + frame[6 + a] * v[1] + frame[9 + a] * v[2]


@inlined
def _cross(u: FloatArray, v: FloatArray, a: int) -> float:
    """Component a of a vector product."""
    b, c = (a + 1) % 3, (a + 2) % 3
    return float(u[b] * v[c] - u[c] * v[b])


@inlined
def _lever(
    touch: float, frame: FloatArray, numbers: FloatArray, load: FloatArray, q: FloatArray
) -> None:
    """Write the load of a pair and where it acts, in the axes of the carrier.

    In steps that is the arm, at rest the point itself, which is on the same line.
    """
    _local(frame, numbers[NORMAL:], q)
    _local(frame, numbers[LOAD:], load)
    loaded = load[0] != 0.0 or load[1] != 0.0 or load[2] != 0.0
    over = numbers[GAP] + touch if loaded else 0.0
    for a in range(3):
        q[a] = numbers[ARM + a] + over * q[a]


@inlined
def _stiff(numbers: FloatArray, scale: float, e: FloatArray, h: FloatArray) -> None:
    """Write the forces against a relative motion e."""
    approach = 0.0
    for a in range(3):
        approach += numbers[NORMAL + a] * e[a]
    for a in range(3):
        h[a] = numbers[SLOPE] * approach * numbers[NORMAL + a]
        for b in range(3):
            h[a] += numbers[BEND + 3 * a + b] * e[b]
        h[a] *= scale


@kernel
def add_actions(
    pairs: Memory, state: Memory, response: Memory, scale: float, steps: FloatArray,
    twists: FloatArray, sums: FloatArray, wrenches: FloatArray,
) -> None:  # fmt: skip
    """Add ``scale`` times the tangent applied to steps of all points and twists of the carriers.

    Args:
        pairs: memory of the pairs.
        state: of the state at the end.
        response: of the response.
        scale: factor.
        steps: inertial steps (n, 3) of all points.
        twists: local ones (f, 6) of the carriers.
        sums: (n, 3), to which the part of the points is added.
        wrenches: (f, 6), to which that of the carriers is added, in their axes.
    """
    paired, at = unpack(FieldPairs, pairs), unpack(FieldState, state)
    own, load, q = unpack(FieldResponse, response), np.empty(3), np.empty(3)
    v, e, h, turned = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for k in range(own.count[0]):
        p, numbers = own.pairs[k], own.numbers[k]
        point, f = paired.points[p], paired.fields[p]
        frame, twist = at.frames[f], twists[f]
        _lever(paired.touch[p], frame, numbers, load, q)
        for a in range(3):
            v[a] = twist[a] + _cross(twist[3:], q, a)
        _turned(frame, v, e)
        for a in range(3):
            e[a] = steps[point, a] - e[a]
            v[a] = _cross(twist[3:], load, a)
        _turned(frame, v, turned)
        _stiff(numbers, scale, e, h)
        for a in range(3):
            sums[point, a] += h[a] - scale * turned[a]
            h[a] = -h[a]
        _local(frame, h, v)
        _add_wrench(v, q, wrenches[f])
        _local(frame, e, v)
        for a in range(3):
            wrenches[f, 3 + a] += scale * _cross(v, load, a)


@kernel
def rows_into(pairs: Memory, state: Memory, response: Memory, rows: FloatArray) -> None:
    """Write the rows (k, 9) of the approach of the pairs that act: n . e.

    Their entries belong to the inertial step of the point (3) and the local twist of the carrier
    (6); the slopes are column ``SLOPE`` of the response.
    """
    paired, at, own = (
        unpack(FieldPairs, pairs),
        unpack(FieldState, state),
        unpack(FieldResponse, response),
    )
    n = np.empty(3)
    for k in range(own.count[0]):
        numbers, frame = own.numbers[k], at.frames[paired.fields[own.pairs[k]]]
        _local(frame, numbers[NORMAL:], n)
        for a in range(3):
            rows[k, a] = numbers[NORMAL + a]
            rows[k, 3 + a] = -n[a]
            rows[k, 6 + a] = -_cross(numbers[ARM:], n, a)
