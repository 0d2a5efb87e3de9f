# SPDX-License-Identifier: LGPL-3.0-or-later
"""Derivatives of the forces of pairs over a step by the positions at its end.

The force F = f W r of a pair (see ``mean_lines``; W takes the weights w of the mean line to the
four points) changes with the end of the step

- by its factor f, the difference quotient of the potential: that by the distance D1 at the end,
  along the line n1 of the closest points there;
- by the middle positions, which move by half of what the end does;
- by the weights w = w0 + a (w1 - w0), as the closest points w1 of the end move (``turning``), and
  with the part a, whose equation 2 r . sum w_i dx_i = D1^2 - D0^2 is differentiated as well.

Mixed forces of a group (see ``steps``) are s (M - c L / S F) + (1 - s) F, with those M of the
middle, the change c of the barrier, the lacking work L and the sum S of weighted squares of c. They
change with M, by half the Hessian of the middle, with F, and with c; L / S and the share s are the
same for all pairs of the group.

It is not symmetric, as forces of discrete derivatives are: where bodies slide past each other
within a step, forces are along the mean line, and depend on the distance at its end.
"""

import numpy as np

from flexfem._types import FloatArray
from flexfem.contact.primitives.barrier import barrier, quotient, secant, slope
from flexfem.contact.primitives.closest import closest, place
from flexfem.contact.primitives.data import COMMON, FORM, LINE, MIXED, Pairs, regularisation
from flexfem.contact.primitives.statics import respond_at_rest
from flexfem.contact.primitives.tangents import write_tangent
from flexfem.contact.primitives.turning import write_turn
from flexfem.kernels.compiled import inlined, subroutine

__all__ = ["WORK", "mix_block", "write_block"]

#: Part of its terms below which the derivative of the equation for ``a`` is round-off.
_SMALL = 1e-6

# Rows of the work space: positions (4, 3) of the start, the end, the middle and the step; weights
# (4,) of the start, the end and their difference; vectors of the start, the end and the mean line;
# how closest points move; linear forms (12,) of changes of the end: of the part a, and of these.
_START, _END, _MIDDLE, _STEP = 0, 1, 2, 3
_W0, _W1, _SLID = 4, 5, 6
_R0, _R1, _R, _WAY, _MOVED = 7, 8, 9, 10, 11
_TURN, _PART, _FORM = 12, 13, 14
#: Shape of the work space.
WORK = 15, 14


@inlined
def _sum(weights: FloatArray, x: FloatArray, out: FloatArray) -> None:
    """Write sum w_i x_i for positions (12,)."""
    for a in range(3):
        out[a] = weights[0] * x[a] + weights[1] * x[3 + a] + weights[2] * x[6 + a]
        out[a] += weights[3] * x[9 + a]


@inlined
def _dot(a: FloatArray, b: FloatArray) -> float:
    """Product of two vectors (3,)."""
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


@inlined
def _add_product(
    weights: FloatArray, moved: FloatArray, line: FloatArray, r: FloatArray, form: FloatArray,
    factor: float, block: FloatArray,
) -> None:  # fmt: skip
    """Subtract ``factor`` (u r + w moved) form^T: weights change by u and r by ``moved``."""
    for i in range(4):
        for a in range(3):
            left = factor * (weights[i] * r[a] + line[i] * moved[a])
            for k in range(12):
                block[12 * (3 * i + a) + k] -= left * form[k]


@inlined
def _place_ends(
    own: Pairs, p: int, before: FloatArray, after: FloatArray, x: FloatArray, work: FloatArray
) -> tuple[float, float]:
    """Write positions, weights and vectors of both ends of a step; returns the distances."""
    kind, nodes = own.kind[p], own.points[p]
    rho = regularisation(kind, own.touch[p], own.dhat[p])
    place(before, after, nodes, 0.0, x)
    start = np.sqrt(closest(kind, x, rho, work[_W0, :4], work[_R0, :3]))
    for i in range(4):
        for a in range(3):
            work[_START, 3 * i + a] = x[i, a]
    place(before, after, nodes, 1.0, x)
    end = np.sqrt(closest(kind, x, rho, work[_W1, :4], work[_R1, :3]))
    write_turn(kind, x, rho, work[_W1, :4], 1.0, work[_TURN])
    for i in range(4):
        for a in range(3):
            k = 3 * i + a
            work[_END, k] = x[i, a]
            work[_MIDDLE, k] = 0.5 * (work[_START, k] + x[i, a])
            work[_STEP, k] = x[i, a] - work[_START, k]
        work[_SLID, i] = work[_W1, i] - work[_W0, i]
    return float(start), float(end)


@inlined
def _part_of(line: FloatArray, work: FloatArray) -> float:
    """Part a of the mean line, 1/2 where the closest points do not slide."""
    along = square = 0.0
    for i in range(4):
        along += (line[i] - work[_W0, i]) * work[_SLID, i]
        square += work[_SLID, i] ** 2
    return along / square if square > 1e-24 else 0.5


@inlined
def _write_form(turn: FloatArray, work: FloatArray) -> None:
    """Write how the parameter of a square of ``turning`` changes with the end, (12,)."""
    for i in range(4):
        for a in range(3):
            work[_FORM, 3 * i + a] = turn[i] * work[_R1, a] + work[_W1, i] * turn[4 + a]


@subroutine
def write_block(
    own: Pairs, p: int, before: FloatArray, after: FloatArray, line: FloatArray, x: FloatArray,
    work: FloatArray, block: FloatArray,
) -> float:  # fmt: skip
    """Write minus the derivative (144,) of the forces of a pair by the end of its points.

    Args:
        own: the pairs.
        p: number of the pair.
        before: positions (n, 3) of all points at the start, m.
        after: those at the end.
        line: weights (4,) of the mean line.
        x: work space (4, 3).
        work: work space of the shape ``WORK``.
        block: result, N/m.

    Returns:
        The factor f of the forces, N/m.
    """
    d0, d1 = _place_ends(own, p, before, after, x, work)
    touch, dhat, kappa, weight = own.touch[p], own.dhat[p], own.kappa[p], own.weight[p]
    g0, g1, mean = d0 - touch, d1 - touch, 0.5 * (d0 + d1)
    change = barrier(g1, dhat, kappa) - barrier(g0, dhat, kappa)
    factor = -weight * quotient(g0, g1, change, dhat, kappa) / mean
    steepness = -weight * secant(g0, g1, change, dhat, kappa) / mean - 0.5 * factor / mean
    part, r, way = _part_of(line, work), work[_R], work[_WAY]
    _sum(line, work[_MIDDLE], r)
    _sum(line, work[_STEP], way)
    for i in range(4):
        for a in range(3):
            along = steepness * line[i] * r[a] / d1
            for k in range(12):
                block[12 * (3 * i + a) + k] = -along * work[_W1, k // 3] * work[_R1, k % 3]
            for j in range(4):
                block[12 * (3 * i + a) + 3 * j + a] -= 0.5 * factor * line[i] * line[j]
    _add_slides(line, part, factor, work, block)
    return float(factor)


@inlined
def _add_slides(
    line: FloatArray, part: float, factor: float, work: FloatArray, block: FloatArray
) -> None:
    """Add what the weights of the mean line change."""
    r, way, moved, form, slides = work[_R], work[_WAY], work[_MOVED], work[_FORM], work[_PART]
    for k in range(12):
        slides[k] = line[k // 3] * (way[k % 3] + 2.0 * r[k % 3])
        slides[k] -= 2.0 * work[_W1, k // 3] * work[_R1, k % 3]
    for m in range(2):
        turn = work[_TURN, 7 * m : 7 * m + 7]
        _write_form(turn, work)
        _sum(turn, work[_STEP], moved)
        other = _dot(r, moved)
        _sum(turn, work[_MIDDLE], moved)
        change = 2.0 * part * (_dot(moved, way) + other)
        for k in range(12):
            slides[k] -= change * form[k]
        _add_product(turn, moved, line, r, form, -part * factor, block)
    slid = work[_SLID]
    _sum(slid, work[_STEP], moved)
    other, size = _dot(r, moved), np.sqrt(_dot(r, r) * _dot(moved, moved))
    _sum(slid, work[_MIDDLE], moved)
    steep = 2.0 * (_dot(moved, way) + other)
    size += np.sqrt(_dot(moved, moved) * _dot(way, way))
    if abs(steep) > _SMALL * size:
        _add_product(slid, moved, line, r, slides, -factor / steep, block)


@subroutine
def mix_block(
    own: Pairs, p: int, numbers: FloatArray, factor: float, x: FloatArray, work: FloatArray,
    w: FloatArray, still: FloatArray, v: FloatArray, tangent: FloatArray, block: FloatArray,
) -> None:  # fmt: skip
    """Make the derivative of a pair's forces that of mixed ones, with what its group has in common.

    Args:
        own: the pairs.
        p: number of the pair.
        numbers: those of its response (FIELDS,).
        factor: of the forces along the mean line, N/m.
        x: work space (4, 3).
        work: as ``write_block`` leaves it.
        w: work space (2, 4).
        still: work space (FIELDS,).
        v: work space (3, 12).
        tangent: work space (144,).
        block: derivative (DERIVATIVE,) that is changed.
    """
    share, ratio, squares, change = numbers[MIXED : MIXED + 4]
    by_lack, by_squares, by_change, by_slid = numbers[MIXED + 4 : MIXED + 8]
    weight = own.weight[p]
    line, r, end, forces = numbers[LINE : LINE + 4], work[_R], work[_FORM], work[_PART]
    distance = np.sqrt(_dot(work[_R1], work[_R1]))
    push = slope(distance - own.touch[p], own.dhat[p], own.kappa[p])
    for q in range(12):
        end[q] = push * work[_W1, q // 3] * work[_R1, q % 3] / distance
        x[q // 3, q % 3], forces[q] = work[_MIDDLE, q], 0.0
    acts = respond_at_rest(own, p, x, w[0], w[1, :3], still, forces)
    if acts:
        write_tangent(still, v, tangent)
    else:
        tangent[:] = 0.0
    # of the factor -L / S of the change, then of the share
    single = 1.0 - share - share * ratio * change
    scale = share / squares if squares != 0.0 else 0.0
    for q in range(12):
        along, done = factor * line[q // 3] * r[q % 3], -forces[q]
        for k in range(12):
            block[12 * q + k] *= single
            block[12 * q + k] += share * (0.5 * tangent[12 * q + k] + ratio * along * end[k])
            done += 0.5 * tangent[12 * q + k] * work[_STEP, k]
        lacks, squared = done - weight * end[q], 2.0 * weight * change * end[q]
        block[COMMON + q] = change * along
        block[COMMON + 12 + q] = forces[q] - (ratio * change + 1.0) * along
        block[FORM + q] = scale * (lacks - ratio * squared)
        block[FORM + 12 + q] = -by_lack * lacks - by_squares * squared - by_change * end[q]
    if by_slid != 0.0:
        _add_slid(-by_slid, distance, work, block[FORM + 12 :])


@inlined
def _add_slid(factor: float, distance: float, work: FloatArray, out: FloatArray) -> None:
    """Add how the way of the closest points over the less distance changes with the end.

    Args:
        factor: of the change.
        distance: that at the end, m.
        work: as ``write_block`` leaves it.
        out: result (12,).
    """
    slid, way, moved = work[_SLID], work[_WAY], work[_MOVED]
    start = np.sqrt(_dot(work[_R0], work[_R0]))
    _sum(slid, work[_MIDDLE], way)
    size, least = np.sqrt(_dot(way, way)), min(start, distance)
    for k in range(12):
        out[k] += factor * 0.5 * slid[k // 3] * way[k % 3] / (size * least)
        if distance < start:
            along = work[_W1, k // 3] * work[_R1, k % 3] / distance
            out[k] -= factor * size / least**2 * along
    for m in range(2):
        turn = work[_TURN, 7 * m : 7 * m + 7]
        _sum(turn, work[_MIDDLE], moved)
        turned = factor * _dot(moved, way) / (size * least)
        _write_form(turn, work)
        for k in range(12):
            out[k] -= turned * work[_FORM, k]
