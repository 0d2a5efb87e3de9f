# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact forces over a step: discrete derivatives of the potential.

Forces F on points that move from X0 to X1 do exactly the work F . (X1 - X0) = -(U1 - U0) of the
potential U, have no sum, and no torque about the middle positions. A pair has the force F_j along
its mean line (see ``mean_lines``). Where a vertex slides over several triangles of a surface in one
step, these forces are those of meeting one and leaving another, and their sum is less than that of
the contact, although its work is exact. A group of pairs hence has the forces

    F = -dU/dX at the middle positions + theta sum_j (b1_j - b0_j) F_j

in such steps, where theta makes the work exact (the smallest such change, as in Gonzalez, Time
integration and discrete Hamiltonian systems, 1996), so that pairs depend on each other. Where the
change would be large, as the middle says little of the step, sum_j F_j take its place gradually.
"""

import numpy as np

from flexfem._types import FloatArray
from flexfem.contact.primitives.barrier import barrier, curvature, quotient, secant, slope
from flexfem.contact.primitives.closest import apart, closest, place
from flexfem.contact.primitives.data import (
    BEND,
    FIELDS,
    GAP,
    LINE,
    MIXED,
    NORMAL,
    POTENTIAL,
    SLOPE,
    WEIGHTS,
    Pairs,
    Response,
    regularisation,
)
from flexfem.contact.primitives.mean_lines import mean_line
from flexfem.contact.primitives.step_tangents import WORK, mix_block, write_block
from flexfem.kernels.compiled import inlined, kernel
from flexfem.kernels.records import Memory, unpack

__all__ = ["forces_of_step", "turn_forces"]

#: Change, in parts of the forces of single pairs, by which at most the work of a group's forces is
#: made exact. The step of an impact has 1.
_MOST = 4.0
#: Way of closest points along the primitives, in parts of the distance, up to which the forces of a
#: group are those of single pairs; from twice as far on they are those of the middle.
_SHORT = 0.5
#: Slopes of groups follow the difference quotient within these bounds.
_LEAST_RATIO, _MOST_RATIO = 1e-9, 10.0
#: Approach, in parts of dhat, below which the difference quotient says little of the slope.
_LITTLE = 1e-3

# Work space of a pair of a group.
#: gaps before, after, and at the middle, m
_BEFORE, _AFTER, _MIDDLE = 0, 1, 2
#: change of the barrier, J/m^2
_CHANGE = 3
#: approach of the middle's closest points, m
_WAY = 4
#: derivative of the barrier at the middle, N/m^2
_PUSH = 5
#: way of the closest points along the primitives, over the distance
_SLID = 6
#: factor of the force along the mean line, N/m
_FACTOR = 7
_WORK = 8


@kernel
def forces_of_step(pairs: Memory, before: FloatArray, after: FloatArray, response: Memory) -> None:
    """Write the response of all pairs to a step of the points from ``before`` to ``after`` (n, 3).

    No pair may touch before or after it. If one does in between, which motions from one trial state
    to the next do not exclude (``ccd``), its work is still that of the potential.
    """
    own, out = unpack(Pairs, pairs), unpack(Response, response)
    starts, count, longest = own.starts, 0, 1
    for g in range(len(starts) - 1):
        longest = max(longest, starts[g + 1] - starts[g])
    work, mixed = np.empty((longest, _WORK)), np.empty(FIELDS - MIXED)
    x, w, r = np.empty((3, 4, 3)), np.empty((3, 4)), np.empty((3, 3))
    for g in range(len(starts) - 1):
        first, alone = count, starts[g + 1] - starts[g] == 1
        for p in range(starts[g], starts[g + 1]):
            kind, nodes, touch, dhat = own.kind[p], own.points[p], own.touch[p], own.dhat[p]
            if apart(before, after, kind, nodes, touch + dhat):
                continue
            rho, gaps, nearest = regularisation(kind, touch, dhat), work[count - first], np.inf
            for c in range(2 if alone else 3):
                place(before, after, nodes, c if c < 2 else 0.5, x[c])
                gaps[c] = np.sqrt(closest(kind, x[c], rho, w[c], r[c])) - touch
                nearest = min(nearest, gaps[c])
            if nearest < dhat:
                _write_pair(own, p, gaps, x, w, out.numbers[count])
                out.whole[count], out.shared[count] = 2, 0
                if alone:
                    _finish_one(own, p, gaps, out.numbers[count], out.forces[count])
                else:
                    _write_middle(own, p, gaps, x[0], w[2], r[2], out.numbers[count])
                out.pairs[count] = p
                count += 1
        if not alone and count > first:
            _finish_group(own, work, out, first, count, mixed)
    out.count[0] = count


@kernel
def turn_forces(pairs: Memory, before: FloatArray, after: FloatArray, response: Memory) -> None:
    """Write the whole derivatives of the forces (``step_tangents``).

    Newton's method needs them near a solution; far from it forces are too large.
    """
    own, out = unpack(Pairs, pairs), unpack(Response, response)
    x, work = np.empty((4, 3)), np.empty(WORK)
    w, still, v, tangent = np.empty((2, 4)), np.empty(FIELDS), np.empty((3, 12)), np.empty(144)
    for k in range(out.count[0]):
        if out.whole[k] < 2:
            continue
        line, block, p = out.numbers[k, LINE : LINE + 4], out.blocks[k], out.pairs[k]
        factor = write_block(own, p, before, after, line, x, work, block)
        if out.whole[k] == 3:
            mix_block(own, p, out.numbers[k], factor, x, work, w, still, v, tangent, block)
        out.whole[k] = 1


@inlined
def _write_pair(
    own: Pairs, p: int, gaps: FloatArray, x: FloatArray, w: FloatArray, numbers: FloatArray
) -> None:
    """Write gap and potential at the end, and the mean line with the force along it.

    Args:
        own: the pairs.
        p: number of the pair.
        gaps: its work space, with the gaps before and after the step.
        x: positions (3, 4, 3) before and after, and place for the step and the middle.
        w: weights (3, 4) before and after.
        numbers: result.
    """
    dhat, kappa, touch = own.dhat[p], own.kappa[p], own.touch[p]
    before, after, dx = gaps[_BEFORE], gaps[_AFTER], x[0]
    for i in range(4):
        for a in range(3):
            start = x[0, i, a]
            dx[i, a] = x[1, i, a] - start
            x[2, i, a] = start + 0.5 * dx[i, a]
    final, sizes = barrier(after, dhat, kappa), before + after + 2.0 * touch
    gaps[_CHANGE] = final - barrier(before, dhat, kappa)
    numbers[GAP], numbers[POTENTIAL], numbers[BEND] = after, own.weight[p] * final, 0.0
    line, way = numbers[LINE : LINE + 4], numbers[LINE + 4 : LINE + 7]
    slid = mean_line(x[2], dx, w[0], w[1], (after - before) * sizes, line, way)
    factor = quotient(before, after, gaps[_CHANGE], dhat, kappa)
    gaps[_FACTOR] = -own.weight[p] * factor / (0.5 * sizes)
    gaps[_SLID] = slid / (min(before, after) + touch)


@inlined
def _write_middle(
    own: Pairs, p: int, gaps: FloatArray, dx: FloatArray, w: FloatArray, r: FloatArray,
    numbers: FloatArray,
) -> None:  # fmt: skip
    """Write what the middle's closest points say of a pair."""
    gaps[_PUSH] = slope(gaps[_MIDDLE], own.dhat[p], own.kappa[p])
    distance, way = max(gaps[_MIDDLE] + own.touch[p], 1e-300), 0.0
    for a in range(3):
        n = numbers[NORMAL + a] = r[a] / distance
        way += n * (w[0] * dx[0, a] + w[1] * dx[1, a] + w[2] * dx[2, a] + w[3] * dx[3, a])
    for i in range(4):
        numbers[WEIGHTS + i] = w[i]
    gaps[_WAY] = way


@inlined
def _write_tangent(own: Pairs, p: int, gaps: FloatArray, numbers: FloatArray) -> None:
    """Write the tangent of the force of a pair along its mean line."""
    size = 0.0
    for a in range(3):
        numbers[NORMAL + a] = numbers[LINE + 4 + a]
        size += numbers[NORMAL + a] ** 2
    size = max(np.sqrt(size), 1e-300)
    for i in range(4):
        numbers[WEIGHTS + i] = numbers[LINE + i]
    for a in range(3):
        numbers[NORMAL + a] /= size
    ratio = 2.0 * size / (gaps[_BEFORE] + gaps[_AFTER] + 2.0 * own.touch[p])
    bend = secant(gaps[_BEFORE], gaps[_AFTER], gaps[_CHANGE], own.dhat[p], own.kappa[p])
    numbers[SLOPE] = own.weight[p] * bend * ratio * ratio


@inlined
def _finish_one(
    own: Pairs, p: int, gaps: FloatArray, numbers: FloatArray, forces: FloatArray
) -> None:
    """Write the force of a pair alone, along its mean line, which its tangent gets as well."""
    for i in range(4):
        for a in range(3):
            forces[3 * i + a] = gaps[_FACTOR] * numbers[LINE + i] * numbers[LINE + 4 + a]
    _write_tangent(own, p, gaps, numbers)


@inlined
def _mixture(
    own: Pairs, work: FloatArray, out: Response, first: int, end: int, mixed: FloatArray
) -> tuple[int, int]:
    """Write how the forces of a group are mixed, see ``MIXED``.

    Those of the pairs take the place of the others where closest points slide little, or where the
    correction would be large.

    Returns:
        The pair whose barrier changes most, and that which slides most.
    """
    lack = squares = largest = size = slid = 0.0
    touching, changes, slides = False, first, first
    for k in range(first, end):
        gaps, weight = work[k - first], own.weight[out.pairs[k]]
        change, done = gaps[_CHANGE], gaps[_PUSH] * gaps[_WAY]
        lack += weight * (done - change)
        squares += weight * change * change
        if abs(change) > largest:
            largest, changes = abs(change), k
        size += abs(weight * change) + abs(weight * done)
        if gaps[_SLID] > slid:
            slid, slides = gaps[_SLID], k
        touching = touching or gaps[_MIDDLE] <= 0.0
    sliding, correction = min(max(slid / _SHORT - 1.0, 0.0), 1.0), 0.0
    if abs(lack) > 1e-14 * size:
        correction = abs(lack) * largest / (_MOST * abs(squares))
    mixed[:] = 0.0
    if touching or not correction < 1.0:
        return changes, slides
    fitting = min(2.0 - 2.0 * correction, 1.0)
    mixed[0] = sliding * fitting
    if correction > 0.0:
        mixed[1], mixed[2] = lack / squares, squares
    if correction > 0.5:
        steep = 2.0 * sliding * correction
        mixed[4], mixed[5], mixed[6] = -steep / lack, steep / squares, -steep / largest
    if sliding < 1.0:
        mixed[7] = fitting / _SHORT
    return changes, slides


@inlined
def _finish_group(
    own: Pairs, work: FloatArray, out: Response, first: int, end: int, mixed: FloatArray
) -> None:
    """Write the forces and tangents of the pairs of a group."""
    changes, slides = _mixture(own, work, out, first, end, mixed)
    middle, ratio = mixed[0], mixed[1]
    nearest, ends = np.inf, np.inf
    for k in range(first, end):
        numbers, gaps = out.numbers[k], work[k - first]
        push = -middle * own.weight[out.pairs[k]] * gaps[_PUSH] if middle > 0.0 else 0.0
        along = (1.0 - middle - middle * ratio * gaps[_CHANGE]) * gaps[_FACTOR]
        for i in range(4):
            for a in range(3):
                out.forces[k, 3 * i + a] = (
                    push * numbers[WEIGHTS + i] * numbers[NORMAL + a]
                    + along * numbers[LINE + i] * numbers[LINE + 4 + a]
                )
        nearest, ends = min(nearest, gaps[_MIDDLE]), min(ends, gaps[_BEFORE], gaps[_AFTER])
        if middle == 0.0:
            _write_tangent(own, out.pairs[k], gaps, numbers)
            continue
        out.whole[k] = 3
        for i in range(FIELDS - MIXED):
            numbers[MIXED + i] = mixed[i]
        numbers[MIXED + 3] = gaps[_CHANGE]
        numbers[MIXED + 6] *= np.sign(gaps[_CHANGE]) if k == changes else 0.0
        numbers[MIXED + 7] *= 1.0 if k == slides else 0.0
    if middle == 0.0:
        return
    out.shared[first] = end - first
    closer = nearest - ends if nearest > ends or nearest <= 0.0 else 0.0
    _write_slopes(own, work, out, first, end, closer)


@inlined
def _write_slopes(
    own: Pairs, work: FloatArray, out: Response, first: int, end: int, closer: float
) -> None:
    """Write the slopes of a group, from the gaps of the middle less ``closer``.

    They depend on the middle alone, so that those of neighbours cancel, but for a common factor
    that makes the stiffness of the step that of the difference quotient.
    """
    wanted = found = little = 0.0
    for k in range(first, end):
        gaps, p = work[k - first], out.pairs[k]
        dhat, kappa, weight = own.dhat[p], own.kappa[p], own.weight[p]
        bend = 0.5 * curvature(gaps[_MIDDLE] - closer, dhat, kappa)
        out.numbers[k, SLOPE] = weight * bend
        found += weight * bend * gaps[_WAY] ** 2
        little += weight * bend * (_LITTLE * dhat) ** 2
        way = gaps[_AFTER] - gaps[_BEFORE]
        wanted += weight * (slope(gaps[_AFTER], dhat, kappa) * way - gaps[_CHANGE])
    factor = 1.0
    if found + little > 0.0:
        factor = min(max((wanted + little) / (found + little), _LEAST_RATIO), _MOST_RATIO)
    for k in range(first, end):
        out.numbers[k, SLOPE] *= factor
