# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sums over groups: friction and its linearisation, and the rows of motion of the linear solver.

A group has a row along the normal, sum w_i n . dX_i, and with friction two along tangents e,
sum w_i e . (dX_i + phi_i x r_i), where phi_i are spins and r_i the arms of both sides. Friction is
proportional to the normal force: what changes this changes it with it.
"""

import numpy as np

from flexfem._types import FloatArray
from flexfem.contact.dissipation.data import (
    ACROSS,
    ALONG,
    ARMS,
    FORCE,
    NORMAL,
    RATIO,
    TANGENT,
    Groups,
)
from flexfem.kernels.compiled import inlined, kernel, subroutine
from flexfem.kernels.records import Memory, unpack

__all__ = ["add_friction", "add_friction_actions", "add_stiffness", "motions_into", "spread"]


@subroutine
def _relative(
    groups: Groups, g: int, steps: FloatArray, spins: FloatArray, way: FloatArray, slip: FloatArray
) -> None:
    """Write the relative motions of the mean points and of the points where friction acts."""
    numbers = groups.numbers[g]
    for a in range(3):
        way[a] = slip[a] = 0.0
    for e in range(groups.starts[g], groups.starts[g + 1]):
        w, p = groups.weights[e], groups.points[e]
        at = ARMS if e < groups.sides[g] else ARMS + 3
        for a in range(3):
            b, c = (a + 1) % 3, (a + 2) % 3
            way[a] += w * steps[p, a]
            slip[a] += w * (spins[p, b] * numbers[at + c] - spins[p, c] * numbers[at + b])
    for a in range(3):
        slip[a] += way[a]


@inlined
def _push(groups: Groups, g: int, force: FloatArray, sums: FloatArray) -> None:
    """Add a force at the mean points."""
    for e in range(groups.starts[g], groups.starts[g + 1]):
        for a in range(3):
            sums[groups.points[e], a] += groups.weights[e] * force[a]


@subroutine
def _rub(groups: Groups, g: int, force: FloatArray, sums: FloatArray, couples: FloatArray) -> None:
    """Add a force where friction acts, with its couples about the mean points."""
    numbers = groups.numbers[g]
    _push(groups, g, force, sums)
    for e in range(groups.starts[g], groups.starts[g + 1]):
        w, p = groups.weights[e], groups.points[e]
        at = ARMS if e < groups.sides[g] else ARMS + 3
        for a in range(3):
            b, c = (a + 1) % 3, (a + 2) % 3
            couples[p, a] += w * (numbers[at + b] * force[c] - numbers[at + c] * force[b])


@kernel
def add_friction(groups: Memory, scale: float, sums: FloatArray, couples: FloatArray) -> None:
    """Add ``scale`` times the friction to forces and couples on all points, each (n, 3)."""
    own, force = unpack(Groups, groups), np.empty(3)
    for g in range(own.count[0]):
        for a in range(3):
            force[a] = scale * own.numbers[g, FORCE + a]
        _rub(own, g, force, sums, couples)


@kernel
def add_friction_actions(
    groups: Memory, scale: float, steps: FloatArray, spins: FloatArray, sums: FloatArray,
    couples: FloatArray,
) -> None:  # fmt: skip
    """Add ``scale`` times the tangent of friction, applied to steps and spins of all points (n, 3).

    It is minus the derivative of the forces for fixed normals, weights and arms.
    """
    own, way, slip, force = unpack(Groups, groups), np.empty(3), np.empty(3), np.empty(3)
    for g in range(own.count[0]):
        numbers = own.numbers[g]
        _relative(own, g, steps, spins, way, slip)
        beside = apart = 0.0
        for a in range(3):
            beside += numbers[NORMAL + a] * slip[a]
            apart += numbers[NORMAL + a] * way[a]
        for a in range(3):
            force[a] = own.slopes[g, 0] * apart * numbers[RATIO + a]
            for b in range(3):
                tangential = slip[b] - beside * numbers[NORMAL + b]
                force[a] += numbers[TANGENT + 3 * a + b] * tangential
            force[a] *= scale
        _rub(own, g, force, sums, couples)


@kernel
def motions_into(groups: Memory, steps: FloatArray, spins: FloatArray, motions: FloatArray) -> None:
    """Write the motions of the rows for steps and spins of all points, each (n, 3).

    Args:
        groups: of :class:`Groups`.
        steps: of the points, m.
        spins: in inertial axes, rad.
        motions: result, shape (g, 3): along the normal, along the slip and across it; or (g, 1)
            without friction.
    """
    own, way, slip = unpack(Groups, groups), np.empty(3), np.empty(3)
    for g in range(own.count[0]):
        numbers = own.numbers[g]
        _relative(own, g, steps, spins, way, slip)
        for k in range(motions.shape[1]):
            motions[g, k] = 0.0
            at = NORMAL if k == 0 else ALONG + (k - 1) * (ACROSS - ALONG)
            for a in range(3):
                motions[g, k] += numbers[at + a] * (way[a] if k == 0 else slip[a])


@kernel
def spread(groups: Memory, rows: FloatArray, sums: FloatArray, couples: FloatArray) -> None:
    """Add the forces of rows to forces and couples on all points, each (n, 3).

    Those along normals bring their share of friction along.

    Args:
        groups: of :class:`Groups`.
        rows: forces along the motions of :func:`motions_into`, of the same shape, N.
        sums: forces.
        couples: couples.
    """
    own, force = unpack(Groups, groups), np.empty(3)
    for g in range(own.count[0]):
        numbers = own.numbers[g]
        for a in range(3):
            force[a] = rows[g, 0] * numbers[NORMAL + a]
        _push(own, g, force, sums)
        if rows.shape[1] > 1:
            for a in range(3):
                force[a] = rows[g, 1] * numbers[ALONG + a] + rows[g, 2] * numbers[ACROSS + a]
                force[a] += rows[g, 0] * numbers[RATIO + a]
            _rub(own, g, force, sums, couples)


@kernel
def add_stiffness(groups: Memory, moves: FloatArray, sums: FloatArray) -> None:
    """Add bounds of the sums of rows of the stiffness along the normals to (n, 3), first column.

    Args:
        groups: that act, of :class:`Groups`.
        moves: 1 for points that move, 0 for others, shape (n,).
        sums: those of the points, N/m.
    """
    own = unpack(Groups, groups)
    for g in range(own.count[0]):
        first, end, total = own.starts[g], own.starts[g + 1], 0.0
        for e in range(first, end):
            total += abs(own.weights[e]) * moves[own.points[e]]
        for e in range(first, end):
            sums[own.points[e], 0] += own.slopes[g, 0] * total * abs(own.weights[e])
