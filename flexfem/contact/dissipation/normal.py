# SPDX-License-Identifier: LGPL-3.0-or-later
"""Restitution and damping: factors of the normal forces over a step.

Without them the forces of a group do the work -dU, U its potential, which grows in approach and
falls in separation by the distance r = -dU / N, that is negative in approach. Restitution e
multiplies them by

    1 + (1 / e^2 - 1) f(-x / (v_0 dt)) in approach,   f(y) = y (2 - y) for 0 < y < 1, then 1,
    1 - f((r - r_e) / (v_0 dt / 2)) in separation.

Of the energy of approach, e^2 is stored, and returned: bodies separate with e times the speed of
approach v_i, unless it is about v_0 or less. At rest the forces are those without a loss.

Steps may be long beside an impact. As for friction (see there) it is the FINAL speed of a step that
counts, x = min(max(2 r - u_0 dt, r), 0) with the speed u_0 at its start: approach ends with a step,
wherever a force between those of both factors ends it. Otherwise some of its energy is kinetic at
both ends of that step, and not subject to a loss; hence the second factor, for which
r_e = max(dt (e v_i + u_0) / 2, 0): no force makes the final speed of separation larger than e v_i.

Damping (Hunt, Crossley, Coefficient of restitution interpreted as damping in vibroimpact, 1975)
multiplies them by max(1 - d r / dt, 0). All factors are at least 1 in approach and at most 1 in
separation: no step makes energy.

Where the force wanted lies in the steep part of f, Newton's method would jump over it and back: see
``bridges``.
"""

from flexfem._types import FloatArray
from flexfem.contact.dissipation.bridges import inverse, is_near, ramp
from flexfem.contact.dissipation.data import (
    KNOWN,
    LAST_NORMAL,
    NORMAL,
    NORMAL_LAWS,
    PUSH,
    Groups,
    Law,
    StepMotion,
)
from flexfem.contact.primitives.data import SLOPE, Pairs, Response
from flexfem.kernels.compiled import inlined, subroutine

__all__ = ["apply_laws", "normal_speed"]

#: Restitution below which forces in approach are those with this one, since Newton's method has
#: trouble with larger factors; the limit of the final speed does the rest.
_LEAST = 0.25
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
def normal_speed(step: StepMotion, groups: Groups, g: int) -> float:
    """Speed of separation at the start of a step, m/s."""
    speed = 0.0
    for e in range(groups.starts[g], groups.starts[g + 1]):
        for a in range(3):
            rate = step.rates[groups.points[e], a]
            speed += groups.weights[e] * groups.numbers[g, NORMAL + a] * rate
    return float(speed)


@inlined
def _limit(law: Law, step: StepMotion, groups: Groups, g: int, speed: float) -> float:
    """Separation r_e from which on no force speeds it up, m."""
    impact = max(-speed, step.impacts[groups.points[groups.starts[g]]])
    return float(max(0.5 * step.dt * (law.restitution * impact + speed), 0.0))


@inlined
def _more(law: Law) -> float:
    """Growth of the forces in approach."""
    return float(1.0 / max(law.restitution, _LEAST) ** 2 - 1.0)


@inlined
def _restituted(
    law: Law, apart: float, start: float, limit: float, dt: float
) -> tuple[float, float]:
    """Factor of restitution, and minus its derivative by the separation of the step, 1/m.

    Args:
        law: the laws.
        apart: separation of the step, m.
        start: the one with the speed at its start, m.
        limit: that from which on no force speeds it up, m.
        dt: size of the step, s.
    """
    more, width = _more(law), law.rest_speed * dt
    if more == 0.0:
        return 1.0, 0.0
    if apart > 0.0:
        part, change = ramp(apart - limit, 0.5 * width)
        return 1.0 - part, change
    final = 2.0 * apart - start
    part, change = ramp(-max(final, apart), width)
    return 1.0 + more * part, more * change * (2.0 if final > apart else 1.0)


@inlined
def _place(law: Law, part: float, start: float, limit: float, dt: float) -> float:
    """Separation at which restitution leaves this part of the force, m."""
    width = law.rest_speed * dt
    if part <= 1.0:
        return float(limit + 0.5 * width * inverse(1.0 - part))
    final = -width * inverse((part - 1.0) / _more(law))
    return float(min(0.5 * (final + start), final))


@inlined
def _bridged(
    law: Law, last: FloatArray, apart: float, start: float, limit: float, push: float, force: float,
    dt: float,
) -> float:  # fmt: skip
    """Slope towards where the force is the predicted one; -1 for that of the law.

    Args:
        law: the laws.
        last: what the last trial state has left.
        apart: separation of the step.
        start: the one with the speed at its start.
        limit: that from which on no force speeds it up.
        push: force without restitution.
        force: that with restitution.
        dt: size of the step.
    """
    predicted = last[LAST_NORMAL + 1] - last[LAST_NORMAL + 2] * (apart - last[LAST_NORMAL])
    part, most, width = predicted / push, _more(law), law.rest_speed * dt
    if most == 0.0 or not 0.0 < part < 1.0 + most:
        return -1.0
    way = apart - _place(law, part, start, limit, dt)
    final = min(max(2.0 * apart - start, apart), 0.0)
    steep = 0.0 < apart - limit < 0.5 * width or -width < final < 0.0
    if is_near(abs(way), width, steep):
        return -1.0
    return float(max((part * push - force) / way, 0.0))


@inlined
def _scale(out: Response, first: int, end: int, factor: float, steeper: float) -> None:
    """Multiply forces and slopes of a group."""
    for k in range(first, end):
        out.numbers[k, SLOPE] *= steeper
        for j in range(out.forces.shape[1]):
            out.forces[k, j] *= factor


@subroutine
def apply_laws(
    own: Pairs, out: Response, rows: tuple[int, int], law: Law, step: StepMotion, groups: Groups,
    g: int, last: FloatArray,
) -> None:  # fmt: skip
    """Multiply the forces of a group by both factors, in the response and in its numbers.

    Args:
        own: all pairs.
        out: their response.
        rows: those of the group in the response, and the one after them.
        law: the laws.
        step: the motion.
        groups: all groups.
        g: row of the group.
        last: what the last trial state has left, replaced.
    """
    change, slopes = _change(own, out, rows[0], rows[1], step), groups.slopes[g]
    push, slope = groups.numbers[g, PUSH], slopes[0]
    speed, apart = normal_speed(step, groups, g), -change / push
    start, limit = speed * step.dt, _limit(law, step, groups, g, speed)
    part, growth = _restituted(law, apart, start, limit, step.dt)
    damped = max(1.0 - law.damping * apart / step.dt, 0.0)
    factor, steeper = part * damped, part * damped * slope
    if damped > 0.0:
        steeper += push * part * law.damping / step.dt
    bridge = -1.0
    if last[KNOWN] > 0.0:
        plain, forced = push * damped, push * factor
        bridge = _bridged(law, last, apart, start, limit, plain, forced, step.dt)
    steeper += bridge if bridge >= 0.0 else push * growth * damped
    groups.losses[NORMAL_LAWS] += (factor - 1.0) * change
    ratio = min(steeper / slope, _STEEPEST) if slope > 0.0 else 1.0
    _scale(out, rows[0], rows[1], factor, ratio)
    groups.numbers[g, PUSH], slopes[0] = factor * push, steeper
    last[LAST_NORMAL], last[LAST_NORMAL + 1], last[LAST_NORMAL + 2] = apart, factor * push, steeper
