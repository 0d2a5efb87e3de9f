# SPDX-License-Identifier: LGPL-3.0-or-later
"""Coulomb's friction of a group of pairs over a step, implicit.

With the weights w_i of the points (``groups``) and P = I - n n^T the slip of a step is

    s = P sum w_i (dX_i + phi_i x r_i),

where phi_i are the spins of the step and r_i the arms from the mean points of both sides to a
common one between the surfaces, where both friction forces act. Forces w_i t and couples
w_i r_i x t then have no sum and no torque, and do exactly the work t . s.

Friction is directed against the slip at the END of the step: velocities that grow linearly from
those of its start, slip rate u_0, have the final one sigma / dt, sigma = 2 s - dt u_0. A law of the
mean slip would stop a body at the mean of the step and hence return its velocity, so that what
sticks in an impact leaves with reversed slip. So that no step makes energy, sigma is shortened to
what the slip has along it,

    x = min(max(s . sigma / |sigma|^2, 0), 1) sigma,   x . s >= |x|^2,
    t = -mu(|x| / dt) N f(|x| / (dt v_0)) x / |x|,

f(y) = y (2 - y) for y < 1, then 1: exactly Coulomb's law from the slip speed v_0 on. The normal
force N is that of this step. mu(v) = mu_k + (mu_s - mu_k) exp(-(v / v_s)^2) (Stribeck).
"""

import numpy as np

from flexfem._types import FloatArray
from flexfem.contact.dissipation.bridges import inverse, is_near, ramp
from flexfem.contact.dissipation.data import (
    ACROSS,
    ALONG,
    ARMS,
    FORCE,
    FRICTION,
    KNOWN,
    LAST_FORCE,
    LAST_PUSH,
    LAST_SLIP,
    LAST_TANGENT,
    NORMAL,
    PUSH,
    RATIO,
    SIGMA,
    SLIP,
    TANGENT,
    Groups,
    Law,
    StepMotion,
)
from flexfem.kernels.compiled import inlined, subroutine

__all__ = ["rub"]

#: Part of sigma that counts as none for the derivative: steady slip has all of it along, and most
#: of what changes it slows it down.
_RIM = 1e-6
#: Part of the largest friction from which on slip is predicted: all but round-off.
_SLIPS = 1.0 - 1e-9
#: Cosine to the normal of the sphere below which a way leads along it.
_OBLIQUE = 0.1


@inlined
def _write_arms(groups: Groups, g: int, step: StepMotion, numbers: FloatArray) -> None:
    """Write the arms from the mean points of both sides to the common one, in the middle."""
    start, middle, end = groups.starts[g], groups.sides[g], groups.starts[g + 1]
    first = second = 0.0
    for a in range(3):
        numbers[ARMS + a] = 0.0
    for e in range(start, end):
        w, p = groups.weights[e], groups.points[e]
        if e < middle:
            first += w * step.radius[p]
        else:
            second -= w * step.radius[p]
        for a in range(3):
            # from the first mean point to the second one
            numbers[ARMS + a] -= w * 0.5 * (step.before[p, a] + step.after[p, a])
    both = first + second
    share = min(max(first / both, 0.0), 1.0) if both > 0.0 else 0.5
    for a in range(3):
        way = numbers[ARMS + a]
        numbers[ARMS + a], numbers[ARMS + 3 + a] = share * way, (share - 1.0) * way


@inlined
def _write_slips(
    groups: Groups, g: int, step: StepMotion, numbers: FloatArray, s: FloatArray, final: FloatArray
) -> None:
    """Write the slip of the step and the one with the final slip rate."""
    start, middle, end = groups.starts[g], groups.sides[g], groups.starts[g + 1]
    for a in range(3):
        s[a] = final[a] = 0.0
    for e in range(start, end):
        w, p, at = groups.weights[e], groups.points[e], ARMS if e < middle else ARMS + 3
        for a in range(3):
            b, c = (a + 1) % 3, (a + 2) % 3
            way, rate = step.after[p, a] - step.before[p, a], step.rates[p, a]
            way += step.spins[p, b] * numbers[at + c] - step.spins[p, c] * numbers[at + b]
            rate += step.spin_rates[p, b] * numbers[at + c]
            rate -= step.spin_rates[p, c] * numbers[at + b]
            s[a] += w * way
            final[a] += w * (2.0 * way - step.dt * rate)
    along = beside = 0.0
    for a in range(3):
        along += numbers[NORMAL + a] * s[a]
        beside += numbers[NORMAL + a] * final[a]
    for a in range(3):
        s[a] -= along * numbers[NORMAL + a]
        final[a] -= beside * numbers[NORMAL + a]


@inlined
def _shorten(s: FloatArray, x: FloatArray, change: FloatArray) -> bool:
    """Replace sigma by x, the part of it that slip s has along; write dx/ds (3, 3).

    Returns:
        True if the slip has been reversed in the step.
    """
    work = square = 0.0
    for a in range(3):
        work += s[a] * x[a]
        square += x[a] * x[a]
    part = max(work / square, 0.0) if work < square else 1.0
    for a in range(3):
        for b in range(3):
            change[a, b] = 2.0 * part if a == b else 0.0
            if 0.0 < part < 1.0 - _RIM:
                change[a, b] += x[a] * (x[b] + 2.0 * s[b] - 4.0 * part * x[b]) / square
    for a in range(3):
        x[a] *= part
    return bool(part < 0.5 - _RIM)


@inlined
def _coefficient(law: Law, size: float, dt: float, width: float) -> tuple[float, float]:
    """Friction over N and the slip ``size``, and its derivative by the slip, over N, 1/m."""
    v = size / dt
    more = law.static_friction - law.friction
    ratio = v / law.stribeck_speed if more > 0.0 else 0.0
    more *= np.exp(-ratio * ratio)
    mu = law.friction + more
    change = -2.0 * more * ratio / (law.stribeck_speed * dt) if more > 0.0 else 0.0
    part, growth = ramp(size, width)
    secant = mu * (part / size if size > 0.0 else 2.0 / width)
    return secant, change * part + mu * growth


@inlined
def _write_directions(numbers: FloatArray, x: FloatArray, size: float) -> None:
    """Write unit vectors along and across the slip; any tangential ones if there is none."""
    n, d = numbers[NORMAL : NORMAL + 3], numbers[ALONG : ALONG + 3]
    along = rest = 0.0
    for a in range(3):
        along += n[a] * x[a]
    for a in range(3):
        d[a] = x[a] - along * n[a]
        rest += d[a] * d[a]
    if not rest > 0.5 * size * size:  # round-off
        least = 0
        for a in range(1, 3):
            if abs(n[a]) < abs(n[least]):
                least = a
        rest = 1.0 - n[least] ** 2
        for a in range(3):
            d[a] = (1.0 if a == least else 0.0) - n[least] * n[a]
    for a in range(3):
        d[a] /= np.sqrt(rest)
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        numbers[ACROSS + a] = n[b] * d[c] - n[c] * d[b]


@inlined
def _write_tangent(
    numbers: FloatArray, push: float, along: float, across: float, change: FloatArray
) -> None:
    """Write minus the derivative of the force by the slip."""
    d, e = numbers[ALONG : ALONG + 3], numbers[ACROSS : ACROSS + 3]
    for a in range(3):
        for b in range(3):
            total = 0.0
            for c in range(3):
                total += (along * d[a] * d[c] + across * e[a] * e[c]) * change[c, b]
            numbers[TANGENT + 3 * a + b] = push * total


@inlined
def _stiffness(numbers: FloatArray, at: int) -> float:
    """Stiffness in a direction of the group, N/m."""
    total = 0.0
    for a in range(3):
        for b in range(3):
            total += numbers[at + a] * numbers[TANGENT + 3 * a + b] * numbers[at + b]
    return max(total, 0.0)


@inlined
def _wanted(last: FloatArray, s: FloatArray, push: float, wanted: FloatArray) -> float:
    """Write the friction that the linear model of the last trial state has now; return its size."""
    square = 0.0
    for a in range(3):
        wanted[a] = push * last[LAST_FORCE + a]
        for b in range(3):
            wanted[a] -= last[LAST_TANGENT + 3 * a + b] * (s[b] - last[LAST_SLIP + b])
        square += wanted[a] * wanted[a]
    return float(np.sqrt(square))


@inlined
def _way_to(
    pull: FloatArray, place: float, s: FloatArray, final: FloatArray, way: FloatArray,
    out: FloatArray,
) -> bool:  # fmt: skip
    """Write the way from slip s to where the law has a force along a unit vector ``pull``.

    There |x| is ``place``. Either x is sigma, or sigma is so far beside s that only the part x of
    it counts: close to the sphere between no slip and half of the first one, in which none does.

    Returns:
        True for the sphere; ``out`` is then its normal.
    """
    along = 0.0
    for a in range(3):
        along += pull[a] * (2.0 * s[a] - final[a])
    beside = along > -place
    for a in range(3):
        first = 2.0 * s[a] - final[a]
        if beside:
            way[a] = 0.5 * (first - along * pull[a]) - place * pull[a] - s[a]
        else:
            way[a] = 0.5 * (first - place * pull[a]) - s[a]
        out[a] = 4.0 * (s[a] + way[a]) - first
    return bool(beside)


@inlined
def _bridge(
    law: Law, numbers: FloatArray, last: FloatArray, s: FloatArray, final: FloatArray,
    push: float, width: float, more: FloatArray,
) -> float:  # fmt: skip
    """Write slopes towards where the friction is the wanted one; return how far that is, m.

    Args:
        law: the laws.
        numbers: of the group.
        last: what the last trial state has left.
        s: slip.
        final: sigma.
        push: N.
        width: slip from which on friction is that of Coulomb's law, m.
        more: minus the derivative of the force towards there, (3, 3), N/m.
    """
    pull, way, out, missing = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    size, most = _wanted(last, s, push, pull), law.static_friction * push
    reverse = lack = far = through = square = 0.0
    for a in range(3):
        pull[a] /= max(size, 1e-300)
        reverse += pull[a] * final[a]
    if size >= _SLIPS * most and reverse < 0.0:
        return 0.0
    part = min(size / most, 1.0)
    beside = _way_to(pull, width * inverse(part), s, final, way, out)
    for a in range(3):
        missing[a] = push * numbers[RATIO + a] - part * most * pull[a]
        lack += missing[a] ** 2
        far += way[a] ** 2
        through += out[a] * way[a]
        square += out[a] ** 2
    slope = np.sqrt(lack / max(far, 1e-300))
    beside = beside and through * through > _OBLIQUE**2 * far * square
    for a in range(3):
        for b in range(3):
            flat = (1.0 if a == b else 0.0) - numbers[NORMAL + a] * numbers[NORMAL + b]
            more[a, b] = slope * flat
            if beside:
                more[a, b] += (missing[a] - slope * way[a]) * out[b] / through
    return float(np.sqrt(far))


@inlined
def _expected(step: StepMotion, groups: Groups, g: int, last: FloatArray) -> float:
    """Normal force that was expected here, N; keeps what expects the next one.

    It is that of the linear model of the last trial state, or that of the last step, or the one
    that is there.
    """
    numbers, apart = groups.numbers[g], 0.0
    for e in range(groups.starts[g], groups.starts[g + 1]):
        w, p = groups.weights[e], groups.points[e]
        for a in range(3):
            apart += w * numbers[NORMAL + a] * (step.after[p, a] - step.before[p, a])
    push = last[LAST_PUSH + 1]
    if last[KNOWN] > 0.0:
        push = max(push - last[LAST_PUSH + 2] * (apart - last[LAST_PUSH]), 0.0)
    elif push == 0.0:
        push = numbers[PUSH]
    last[LAST_PUSH], last[LAST_PUSH + 1] = apart, numbers[PUSH]
    last[LAST_PUSH + 2] = groups.slopes[g, 0]
    return float(push)


@subroutine
def rub(law: Law, step: StepMotion, groups: Groups, g: int, last: FloatArray) -> None:
    """Write arms, force and tangent of a group, and the slopes along and across the slip."""
    s, final, x = np.empty(3), np.empty(3), np.empty(3)
    change, more = np.empty((3, 3)), np.empty((3, 3))
    numbers, square, done = groups.numbers[g], 0.0, 0.0
    width = law.slip_speed * step.dt
    _write_arms(groups, g, step, numbers)
    _write_slips(groups, g, step, numbers, s, final)
    for a in range(3):
        numbers[SLIP + a], numbers[SIGMA + a] = s[a], final[a]
    x[:] = final
    reversed_ = _shorten(s, x, change)
    for a in range(3):
        square += x[a] * x[a]
    size, push = np.sqrt(square), _expected(step, groups, g, last)
    across, along = _coefficient(law, size, step.dt, width)
    along, wide = max(along, 0.0), across
    for a in range(3):
        numbers[RATIO + a] = -across * x[a]
        numbers[FORCE + a] = numbers[PUSH] * numbers[RATIO + a]
        done += numbers[FORCE + a] * s[a]
    groups.losses[FRICTION] -= done
    steep = along > 0.0 and final[0] * s[0] + final[1] * s[1] + final[2] * s[2] > 0.0
    far = 0.0
    if last[KNOWN] > 0.0 and push > 0.0 and not (reversed_ and steep):
        far = _bridge(law, numbers, last, s, final, push, width, more)
    bridged = not is_near(far, width, steep)
    _write_directions(numbers, x, size)
    if bridged and steep:
        along = wide = 0.0
    _write_tangent(numbers, push, along, wide, change)
    if bridged:
        for a in range(3):
            for b in range(3):
                numbers[TANGENT + 3 * a + b] += more[a, b]
    for a in range(3):
        last[LAST_SLIP + a], last[LAST_FORCE + a] = s[a], numbers[RATIO + a]
    for k in range(9):
        last[LAST_TANGENT + k] = numbers[TANGENT + k]
    groups.slopes[g, 1] = _stiffness(numbers, ALONG)
    groups.slopes[g, 2] = _stiffness(numbers, ACROSS)
