# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loops over nodes whose step lies between two states: kinematics and lumped inertia.

A node turns by the Cayley map, ``R_1 = R_0 cay(phi)``, with which ``R_1 - R_0 = skew(R_1 phi)
(R_0 + R_1)/2`` holds exactly: every product of positions and rotations has an exact discrete
derivative made of averages. Inertial velocities of mass centres and angular velocities in node axes
follow from the increments by one law (see :mod:`flexfem.integrators.energy_momentum`).

The balance of spin momentum in this form is that of Simo and Wong, Int. J. Numer. Methods Eng. 31
(1991) 19-52: ``R_1 J Omega_1 - R_0 J Omega_0 = h m`` with ``phi = h (Omega_0 + Omega_1)/2`` keeps
energy and angular momentum.
"""

import numpy as np

from flexfem._types import FloatArray
from flexfem.lie._blocks import cross, dot, triple
from flexfem.lie._coefficients import Triple
from flexfem.lie.compiled import inlined, kernel, subroutine

__all__ = [
    "add",
    "correct",
    "increment_rate",
    "mean_acceleration",
    "mean_turn",
    "momentum_force",
    "momentum_tangent",
    "start",
    "turn",
    "turn_back",
    "unit",
]


@inlined
def turn(H: FloatArray, v: Triple) -> Triple:
    """``R v`` of a frame stored as 12 numbers."""
    return (
        H[3] * v[0] + H[4] * v[1] + H[5] * v[2],
        H[6] * v[0] + H[7] * v[1] + H[8] * v[2],
        H[9] * v[0] + H[10] * v[1] + H[11] * v[2],
    )


@inlined
def turn_back(H: FloatArray, v: Triple) -> Triple:
    """``R^T v`` of a frame stored as 12 numbers."""
    return (
        H[3] * v[0] + H[6] * v[1] + H[9] * v[2],
        H[4] * v[0] + H[7] * v[1] + H[10] * v[2],
        H[5] * v[0] + H[8] * v[1] + H[11] * v[2],
    )


@inlined
def add(a: Triple, factor: float, b: Triple) -> Triple:
    """``a + factor b``."""
    return a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2]


@inlined
def unit(k: int) -> Triple:
    """Unit vector along axis ``k``, zero if there is no such axis."""
    return 1.0 if k == 0 else 0.0, 1.0 if k == 1 else 0.0, 1.0 if k == 2 else 0.0


@inlined
def mean_turn(H0: FloatArray, H1: FloatArray, v: Triple) -> Triple:
    """``(R_0 + R_1)/2 v``."""
    a, b = turn(H0, v), turn(H1, v)
    return 0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), 0.5 * (a[2] + b[2])


@inlined
def _multiply(J: FloatArray, v: Triple) -> Triple:
    """``J v`` with J (3, 3)."""
    return (
        J[0, 0] * v[0] + J[0, 1] * v[1] + J[0, 2] * v[2],
        J[1, 0] * v[0] + J[1, 1] * v[1] + J[1, 2] * v[2],
        J[2, 0] * v[0] + J[2, 1] * v[1] + J[2, 2] * v[2],
    )


@inlined
def increment_rate(phi: Triple, theta: Triple) -> Triple:
    """Change of the Cayley vector ``phi`` as the turned node turns by ``theta`` in its own axes."""
    c, d = cross(phi, theta), 0.25 * dot(phi, theta)
    return (
        theta[0] + 0.5 * c[0] + d * phi[0],
        theta[1] + 0.5 * c[1] + d * phi[1],
        theta[2] + 0.5 * c[2] + d * phi[2],
    )


@inlined
def _configure(
    i: int, frames0: FloatArray, n: FloatArray, centres: FloatArray, base: FloatArray, rate: float,
    frames: FloatArray, rates: FloatArray, velocity: FloatArray,
) -> None:  # fmt: skip
    """Frame, rates and local twist of node ``i`` from its increment: ``base + rate * change``."""
    H0, H1, c = frames0[i], frames[i], triple(centres[i], 0)
    phi = triple(n[i], 3)
    factor = 1.0 / (1.0 + 0.25 * dot(phi, phi))
    for column in range(3):
        # cay(phi) e = e + (phi x e + phi x (phi x e) / 2) / (1 + phi^2 / 4)
        e = unit(column)
        y = cross(phi, e)
        y = add(y, 0.5, cross(phi, y))
        y = turn(H0, add(e, factor, y))
        H1[3 + column], H1[6 + column], H1[9 + column] = y
    arm0, arm1 = turn(H0, c), turn(H1, c)
    for k in range(3):
        H1[k] = H0[k] + n[i, k]
        rates[i, k] = base[i, k] + rate * (n[i, k] + arm1[k] - arm0[k])
        rates[i, 3 + k] = base[i, 3 + k] + rate * n[i, 3 + k]
    omega = triple(rates[i], 3)
    v = add(turn_back(H1, triple(rates[i], 0)), -1.0, cross(omega, c))
    velocity[i, 0], velocity[i, 1], velocity[i, 2] = v
    velocity[i, 3], velocity[i, 4], velocity[i, 5] = omega


@kernel
def start(
    frames0: FloatArray, rates0: FloatArray, jumps: FloatArray, centres: FloatArray,
    law: FloatArray, n: FloatArray, base: FloatArray, frames: FloatArray, rates: FloatArray,
    velocity: FloatArray,
) -> None:  # fmt: skip
    """Start a step with the increments predicted from the rates.

    ``law`` (5,) holds the factors of ``rates0`` and ``jumps`` in the prediction, those in
    ``base``, and the rate of change.
    """
    for i in range(n.shape[0]):
        for k in range(6):
            n[i, k] = law[0] * rates0[i, k] + law[1] * jumps[i, k]
            base[i, k] = law[2] * rates0[i, k] + law[3] * jumps[i, k]
        # rates are those of the centre: the node's own increment lacks what its arm turns
        phi, c = triple(n[i], 3), triple(centres[i], 0)
        arm = turn(frames0[i], cross(phi, c))
        for k in range(3):
            n[i, k] -= arm[k]
        _configure(i, frames0, n, centres, base, law[4], frames, rates, velocity)


@kernel
def correct(
    frames0: FloatArray, n: FloatArray, centres: FloatArray, base: FloatArray, rate: float,
    frames: FloatArray, rates: FloatArray, velocity: FloatArray, step: FloatArray, sign: float,
) -> float:  # fmt: skip
    """Move by the local twists ``sign * step`` and return the largest entry of the step.

    Increments follow to first order; at the solution this is exact.
    """
    largest = 0.0
    for i in range(n.shape[0]):
        u = turn(frames[i], triple(step[i], 0))
        w = increment_rate(triple(n[i], 3), triple(step[i], 3))
        for k in range(3):
            n[i, k] += sign * u[k]
            n[i, 3 + k] += sign * w[k]
        for k in range(6):
            size = abs(step[i, k])
            if size > largest or size != size:  # a NaN stays the largest
                largest = size
        _configure(i, frames0, n, centres, base, rate, frames, rates, velocity)
    return largest


@kernel
def mean_acceleration(
    frames: FloatArray, rates0: FloatArray, rates: FloatArray, velocity: FloatArray,
    centres: FloatArray, h: float, out: FloatArray,
) -> None:  # fmt: skip
    """Rates of the local twists from the mean accelerations over the step, in ``out`` (n, 6)."""
    for i in range(len(out)):
        c, v, omega = triple(centres[i], 0), triple(velocity[i], 0), triple(velocity[i], 3)
        w = add(triple(rates[i], 3), -1.0, triple(rates0[i], 3))
        spin = (w[0] / h, w[1] / h, w[2] / h)
        a = turn_back(frames[i], add(triple(rates[i], 0), -1.0, triple(rates0[i], 0)))
        a = (a[0] / h, a[1] / h, a[2] / h)
        a = add(a, -1.0, cross(spin, c))
        a = add(a, -1.0, cross(omega, cross(omega, c)))
        a = add(a, -1.0, cross(omega, v))
        for k in range(3):
            out[i, k], out[i, 3 + k] = a[k], spin[k]


@subroutine
def momentum_force(
    mass: float, weight: float, s: FloatArray, J: FloatArray, c: FloatArray, H0: FloatArray,
    H1: FloatArray, r0: FloatArray, r1: FloatArray, gravity: FloatArray, h: float,
    total: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    """Mean inertia force minus weight of a mass at one node over the step.

    Args:
        mass: that moves with the velocity of the centre.
        weight: mass that gravity acts on at the centre.
        s: first moment about the centre, node axes (kg m).
        J: rotary inertia (3, 3) about the centre, node axes.
        c: centre, node axes.
        H0: frame at the start of the step.
        H1: frame at its end.
        r0: inertial velocity of the centre, angular velocity in node axes, at the start.
        r1: the same at the end.
        gravity: acceleration in inertial axes.
        h: step size.
        total: (6,) becomes the force and the moment about the node in inertial axes.
        out: (6,) becomes the same in the node's axes at the end.
    """
    first, centre, g = triple(s, 0), triple(c, 0), triple(gravity, 0)
    o0, o1 = triple(r0, 3), triple(r1, 3)
    a = add(triple(r1, 0), -1.0, triple(r0, 0))
    a = (a[0] / h, a[1] / h, a[2] / h)
    e = add(turn(H1, cross(o1, first)), -1.0, turn(H0, cross(o0, first)))
    f = (mass * a[0] + e[0] / h, mass * a[1] + e[1] / h, mass * a[2] + e[2] / h)
    f = add(f, -weight, g)
    m = add(turn(H1, _multiply(J, o1)), -1.0, turn(H0, _multiply(J, o0)))
    m = (m[0] / h, m[1] / h, m[2] / h)
    # with this arm the work equals the change of v . d(R s)/dt
    arm = add(first, 0.25 * h, cross(add(o1, -1.0, o0), first))
    m = add(m, 1.0, cross(mean_turn(H0, H1, arm), a))
    m = add(m, -1.0, cross(mean_turn(H0, H1, first), g))
    m = add(m, 1.0, cross(mean_turn(H0, H1, centre), f))
    local_f, local_m = turn_back(H1, f), turn_back(H1, m)
    for k in range(3):
        total[k], total[3 + k] = f[k], m[k]
        out[k], out[3 + k] = local_f[k], local_m[k]


@subroutine
def momentum_tangent(
    mass: float, weight: float, s: FloatArray, J: FloatArray, c: FloatArray, H0: FloatArray,
    H1: FloatArray, phi: FloatArray, r0: FloatArray, r1: FloatArray, gravity: FloatArray,
    h: float, rate: float, out: FloatArray,
) -> None:  # fmt: skip
    """Derivative (6, 6) of :func:`momentum_force` along the node's local twist.

    ``phi`` is the Cayley vector of the step, ``rate`` the change of rates with increments.
    """
    first, centre, g = triple(s, 0), triple(c, 0), triple(gravity, 0)
    o0, o1 = triple(r0, 3), triple(r1, 3)
    total, local = np.empty(6), np.empty(6)
    momentum_force(mass, weight, s, J, c, H0, H1, r0, r1, gravity, h, total, local)
    f, a = triple(total, 0), add(triple(r1, 0), -1.0, triple(r0, 0))
    a = (a[0] / h, a[1] / h, a[2] / h)
    swing = add(first, 0.25 * h, cross(add(o1, -1.0, o0), first))
    for k in range(6):
        u, t = unit(k), unit(k - 3)
        da = turn(H1, add(u, 1.0, cross(t, centre)))
        da = (rate / h * da[0], rate / h * da[1], rate / h * da[2])
        do = increment_rate(triple(phi, 0), t)
        do = (rate * do[0], rate * do[1], rate * do[2])
        de = turn(H1, add(cross(do, first), 1.0, cross(t, cross(o1, first))))
        df = (mass * da[0] + de[0] / h, mass * da[1] + de[1] / h, mass * da[2] + de[2] / h)
        dm = turn(H1, add(_multiply(J, do), 1.0, cross(t, _multiply(J, o1))))
        dm = (dm[0] / h, dm[1] / h, dm[2] / h)
        darm = add((0.0, 0.0, 0.0), 0.5, turn(H1, cross(t, swing)))
        darm = add(darm, 0.25 * h, mean_turn(H0, H1, cross(do, first)))
        dm = add(dm, 1.0, cross(darm, a))
        dm = add(dm, 1.0, cross(mean_turn(H0, H1, swing), da))
        dm = add(dm, -0.5, cross(turn(H1, cross(t, first)), g))
        dm = add(dm, 0.5, cross(turn(H1, cross(t, centre)), f))
        dm = add(dm, 1.0, cross(mean_turn(H0, H1, centre), df))
        df = add(turn_back(H1, df), -1.0, cross(t, triple(local, 0)))
        dm = add(turn_back(H1, dm), -1.0, cross(t, triple(local, 3)))
        for i in range(3):
            out[i, k], out[3 + i, k] = df[i], dm[i]
