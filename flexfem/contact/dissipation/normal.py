# SPDX-License-Identifier: LGPL-3.0-or-later
"""Damping: a factor of the normal forces over a step.

Without it the forces of a group do the work -dU, U its potential, which grows in approach and falls
in separation by the distance r = -dU / N, that is negative in approach. Damping d (Hunt, Crossley,
Coefficient of restitution interpreted as damping in vibroimpact, 1975) multiplies them by

    max(1 - d r / dt, 0),

at least 1 in approach and at most 1 in separation: no step makes energy.
"""

from flexfem.contact.dissipation.data import NORMAL_LAWS, PUSH, Groups, Law, StepMotion
from flexfem.contact.primitives.data import SLOPE, Pairs, Response
from flexfem.kernels.compiled import inlined, subroutine

__all__ = ["damp"]

#: Largest growth of the slopes of single pairs: that of the group is exact.
_STEEPEST = 1e12


@inlined
def _change(own: Pairs, out: Response, first: int, end: int, step: StepMotion) -> float:
    """Change of a group's potential, as it is done by its forces, J."""
    change = 0.0
    for k in range(first, end):
        for i in range(own.points.shape[1]):
            point = own.points[out.pairs[k], i]
            for a in range(3):
                way = step.after[point, a] - step.before[point, a]
                change -= out.forces[k, 3 * i + a] * way
    return change


@inlined
def _scale(out: Response, first: int, end: int, factor: float, steeper: float) -> None:
    """Multiply forces and slopes of a group."""
    for k in range(first, end):
        out.numbers[k, SLOPE] *= steeper
        for j in range(out.forces.shape[1]):
            out.forces[k, j] *= factor


@subroutine
def damp(
    own: Pairs, out: Response, law: Law, step: StepMotion, groups: Groups, g: int
) -> None:  # fmt: skip
    """Multiply the forces of a group by the factor, in the response and in its numbers.

    Args:
        own: all pairs.
        out: their response.
        law: the laws.
        step: the motion.
        groups: all groups.
        g: row of the group.
    """
    first, end = groups.rows[g, 0], groups.rows[g, 1]
    change, slopes = _change(own, out, first, end, step), groups.slopes[g]
    push, slope = groups.numbers[g, PUSH], slopes[0]
    factor = max(1.0 + law.damping * change / (push * step.dt), 0.0)
    steeper = factor * slope
    if factor > 0.0:
        steeper += push * law.damping / step.dt
    groups.losses[NORMAL_LAWS] += (factor - 1.0) * change
    _scale(out, first, end, factor, min(steeper / slope, _STEEPEST) if slope > 0.0 else 1.0)
    groups.numbers[g, PUSH], slopes[0] = factor * push, steeper
