# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sums over pairs: potential, forces and their linearisation.

The tangent of a pair is

    k (n . w dx)^2 + c (|w dx|^2 - v_1(dx)^2 - v_2(dx)^2),

k the slope, n the normal, c the force over the distance, and v_m the changes of the closest points
(``turning``). It is the Hessian of the potential for equilibria. For steps k is the slope of the
difference quotient, and c = 0; near a solution the whole derivative takes its place, see
``steps.turn_forces``. That of a group of pairs which slide couples them: it has, beside a block of
each pair, products of a vector of forces and a form of all.
"""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.contact.primitives.data import (
    BEND,
    COMMON,
    FORM,
    NORMAL,
    POTENTIAL,
    SLOPE,
    TURN,
    WEIGHTS,
    Pairs,
    Response,
)
from flexfem.kernels.compiled import inlined, kernel, subroutine
from flexfem.kernels.records import Memory, unpack

__all__ = ["add_actions", "add_forces", "blocks_into", "potential", "write_tangent"]


@kernel
def potential(response: Memory) -> float:
    """Potential of all pairs at the end, J."""
    own, total = unpack(Response, response), 0.0
    for k in range(own.count[0]):
        total += own.numbers[k, POTENTIAL]
    return total


@kernel
def add_forces(pairs: Memory, response: Memory, scale: float, sums: FloatArray) -> None:
    """Add ``scale`` times the forces to those on all points (n, 3)."""
    points, own = unpack(Pairs, pairs).points, unpack(Response, response)
    for k in range(own.count[0]):
        p = own.pairs[k]
        for i in range(points.shape[1]):
            for a in range(3):
                sums[points[p, i], a] += scale * own.forces[k, 3 * i + a]


@inlined
def _turned(
    numbers: FloatArray, m: int, rows: IntArray, steps: FloatArray, moved: FloatArray
) -> float:
    """Change v_m of the closest points."""
    total, at = 0.0, TURN + 7 * m
    for a in range(3):
        change = 0.0
        for i in range(4):
            change += numbers[at + i] * steps[rows[i], a]
        total += numbers[NORMAL + a] * change + numbers[at + 4 + a] * moved[a]
    return total


@inlined
def _add_whole(
    block: FloatArray, rows: IntArray, scale: float, steps: FloatArray, sums: FloatArray
) -> None:
    """Add ``scale`` times a matrix (144,) applied to the steps of four points."""
    for p in range(12):
        change = 0.0
        for q in range(12):
            change += block[12 * p + q] * steps[rows[q // 3], q % 3]
        sums[rows[p // 3], p % 3] += scale * change


@inlined
def _add_shared(
    pairs: Pairs, own: Response, first: int, scale: float, steps: FloatArray, sums: FloatArray
) -> None:
    """Add what the factors do that the pairs of a group have in common."""
    one = other = 0.0
    for k in range(first, first + own.shared[first]):
        rows, forms = pairs.points[own.pairs[k]], own.blocks[k, FORM:]
        for q in range(12):
            step = steps[rows[q // 3], q % 3]
            one += forms[q] * step
            other += forms[12 + q] * step
    for k in range(first, first + own.shared[first]):
        rows, common = pairs.points[own.pairs[k]], own.blocks[k, COMMON:]
        for q in range(12):
            sums[rows[q // 3], q % 3] += scale * (one * common[q] + other * common[12 + q])


@kernel
def add_actions(
    pairs: Memory, response: Memory, scale: float, steps: FloatArray, sums: FloatArray
) -> None:
    """Add ``scale`` times the tangent applied to steps of all points (n, 3) to their ``sums``."""
    paired, own = unpack(Pairs, pairs), unpack(Response, response)
    moved, way = np.empty(3), np.empty(3)
    for k in range(own.count[0]):
        numbers, rows = own.numbers[k], paired.points[own.pairs[k]]
        if own.whole[k] == 1:
            _add_whole(own.blocks[k], rows, scale, steps, sums)
            if own.shared[k] > 0:
                _add_shared(paired, own, k, scale, steps, sums)
            continue
        bend, approach = scale * numbers[BEND], 0.0
        for a in range(3):
            moved[a] = 0.0
            for i in range(4):
                moved[a] += numbers[WEIGHTS + i] * steps[rows[i], a]
            approach += numbers[NORMAL + a] * moved[a]
        first = second = 0.0
        if bend != 0.0:
            first = _turned(numbers, 0, rows, steps, moved)
            second = _turned(numbers, 1, rows, steps, moved)
        for a in range(3):
            way[a] = scale * numbers[SLOPE] * approach * numbers[NORMAL + a]
            if bend != 0.0:
                turns = first * numbers[TURN + 4 + a] + second * numbers[TURN + 11 + a]
                way[a] += bend * (moved[a] - turns)
        for i in range(4):
            turn = 0.0
            if bend != 0.0:
                turn = first * numbers[TURN + i] + second * numbers[TURN + 7 + i]
            for a in range(3):
                change = numbers[WEIGHTS + i] * way[a] - bend * turn * numbers[NORMAL + a]
                sums[rows[i], a] += change


@kernel
def blocks_into(response: Memory, scale: float, blocks: FloatArray) -> None:
    """Write ``scale`` times the tangents (c, 12, 12) of the pairs that act, by their points.

    What couples the pairs of a group is left out.
    """
    own = unpack(Response, response)
    block, v = np.empty(144), np.empty((3, 12))
    for k in range(own.count[0]):
        if own.whole[k] != 1:
            write_tangent(own.numbers[k], v, block)
        for p in range(144):
            value = own.blocks[k, p] if own.whole[k] == 1 else block[p]
            blocks[k, p // 12, p % 12] = scale * value


@subroutine
def write_tangent(numbers: FloatArray, v: FloatArray, block: FloatArray) -> None:
    """Write the tangent (144,) of a pair that is not a whole derivative.

    Args:
        numbers: those of the pair (FIELDS,).
        v: work space (3, 12).
        block: result, N/m.
    """
    slope, bend = numbers[SLOPE], numbers[BEND]
    for i in range(4):
        w = numbers[WEIGHTS + i]
        for a in range(3):
            n = numbers[NORMAL + a]
            v[2, 3 * i + a] = w * n
            for m in range(2):
                at = TURN + 7 * m
                v[m, 3 * i + a] = numbers[at + i] * n + w * numbers[at + 4 + a]
    for p in range(12):
        for q in range(12):
            value = slope * v[2, p] * v[2, q]
            if bend != 0.0:
                value -= bend * (v[0, p] * v[0, q] + v[1, p] * v[1, q])
                if p % 3 == q % 3:
                    value += bend * numbers[WEIGHTS + p // 3] * numbers[WEIGHTS + q // 3]
            block[12 * p + q] = value
