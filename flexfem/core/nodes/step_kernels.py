# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loops over nodes whose step lies between two states: kinematics and lumped inertia.

A node rotates by the Cayley map, ``R_1 = R_0 cay(phi)``, with which
``R_1 - R_0 = skew(R_1 phi) (R_0 + R_1)/2`` holds exactly: every product of positions and rotations
has an exact discrete derivative made of averages. Inertial velocities of mass centres and angular
velocities in node axes follow from the increments by one law (see
:mod:`flexfem.integrators.energy_momentum.scheme`).

The balance of spin momentum in this form is that of Simo and Wong, Int. J. Numer. Methods Eng. 31
(1991) 19-52: ``R_1 J Omega_1 - R_0 J Omega_0 = h m`` with ``phi = h (Omega_0 + Omega_1)/2`` keeps
energy and angular momentum.
"""

import numpy as np

from flexfem._types import FloatArray
from flexfem.kernels.compiled import inlined, kernel, subroutine
from flexfem.kernels.records import Float1D, Float2D, Memory, Record, unpack
from flexfem.lie._blocks import cross, dot, triple
from flexfem.lie._coefficients import Triple

__all__ = [
    "StepNodes",
    "add",
    "correct",
    "mean_acceleration",
    "mean_turn",
    "momentum_force",
    "momentum_tangent",
    "start",
    "turn",
    "turn_back",
    "unit",
]


class StepNodes(Record):
    """Nodes of a block over a step, whose rates are those of points fixed to them, their centres.

    Rates are the inertial velocity of the centre and the angular velocity in node axes.

    Attributes:
        frames0, frames: (n, 12) at both ends of the step.
        increments: (n, 6) translation of the node in inertial axes and Cayley vector.
        rates0, rates: (n, 6) at both ends.
        centres: (n, 3) in node axes, m.
        jumps: (n, 6) last change of the rates, for a step as long as this one.
        base: (n, 6) rates at the end without the part proportional to the increments.
        velocity: (n, 6) local twists of the nodes at the end.
        step, residual: (n, 6) Newton step and right-hand side.
        gravity: (3,) in inertial axes, m/s^2.
        law: (3,) half the dissipation, 1/h and the change of rates with increments.
    """

    frames0: Float2D
    frames: Float2D
    increments: Float2D
    rates0: Float2D
    rates: Float2D
    centres: Float2D
    jumps: Float2D
    base: Float2D
    velocity: Float2D
    step: Float2D
    residual: Float2D
    gravity: Float1D
    law: Float1D


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
def _spin_momentum(lump: FloatArray, v: Triple) -> Triple:
    """``J v`` with the rotary inertia J of a lump (13,)."""
    return (
        lump[4] * v[0] + lump[5] * v[1] + lump[6] * v[2],
        lump[7] * v[0] + lump[8] * v[1] + lump[9] * v[2],
        lump[10] * v[0] + lump[11] * v[1] + lump[12] * v[2],
    )


@inlined
def _increment_rate(phi: Triple, theta: Triple) -> Triple:
    """Change of the Cayley vector ``phi`` of a node that rotates by ``theta`` in its own axes."""
    c, d = cross(phi, theta), 0.25 * dot(phi, theta)
    return (
        theta[0] + 0.5 * c[0] + d * phi[0],
        theta[1] + 0.5 * c[1] + d * phi[1],
        theta[2] + 0.5 * c[2] + d * phi[2],
    )


@inlined
def _configure(nodes: StepNodes, i: int) -> None:
    """Frame, rates and local twist of node ``i`` from its increment."""
    H0, H1, c = nodes.frames0[i], nodes.frames[i], triple(nodes.centres[i], 0)
    n, base, rates, velocity = nodes.increments, nodes.base, nodes.rates, nodes.velocity
    phi, rate = triple(n[i], 3), nodes.law[2]
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
def start(memory: Memory, law: FloatArray) -> None:
    """Start a step of ``StepNodes`` with the increments predicted from the rates.

    ``law`` (4,) holds the factors of ``rates0`` and ``jumps`` in the prediction, and those in
    ``base``.
    """
    nodes = unpack(StepNodes, memory)
    n, base, rates0, jumps = nodes.increments, nodes.base, nodes.rates0, nodes.jumps
    for i in range(n.shape[0]):
        for k in range(6):
            n[i, k] = law[0] * rates0[i, k] + law[1] * jumps[i, k]
            base[i, k] = law[2] * rates0[i, k] + law[3] * jumps[i, k]
        # rates are those of the centre: the node's own increment lacks the rotation of its arm
        phi, c = triple(n[i], 3), triple(nodes.centres[i], 0)
        arm = turn(nodes.frames0[i], cross(phi, c))
        for k in range(3):
            n[i, k] -= arm[k]
        _configure(nodes, i)


@kernel
def correct(memory: Memory, sign: float) -> float:
    """Move by the local twists ``sign * step`` and return the largest entry of the step.

    Increments follow to first order; at the solution this is exact.
    """
    nodes, largest = unpack(StepNodes, memory), 0.0
    n, step = nodes.increments, nodes.step
    for i in range(n.shape[0]):
        u = turn(nodes.frames[i], triple(step[i], 0))
        w = _increment_rate(triple(n[i], 3), triple(step[i], 3))
        for k in range(3):
            n[i, k] += sign * u[k]
            n[i, 3 + k] += sign * w[k]
        for k in range(6):
            size = abs(step[i, k])
            if size > largest or size != size:  # a NaN stays the largest
                largest = size
        _configure(nodes, i)
    return largest


@kernel
def mean_acceleration(memory: Memory, h: float, out: FloatArray) -> None:
    """Rates of the local twists from the mean accelerations over the step, in ``out`` (n, 6)."""
    nodes = unpack(StepNodes, memory)
    frames, rates0, rates, velocity = nodes.frames, nodes.rates0, nodes.rates, nodes.velocity
    for i in range(len(out)):
        c, v, omega = triple(nodes.centres[i], 0), triple(velocity[i], 0), triple(velocity[i], 3)
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
    lump: FloatArray, nodes: StepNodes, node: int, h: float, out: FloatArray
) -> None:
    """Mean inertia force minus weight of a mass at one node over the step.

    Args:
        lump: (13,) mass (kg), first moment (kg m) and rotary inertia (kg m^2, row by row) about
            the centre of the node, in its axes.
        nodes: over the step.
        node: its number.
        h: step size, s.
        out: (12,) becomes the force and the moment about the node in inertial axes, and the same
            in the node's axes at the end.
    """
    H0, H1, r0, r1 = nodes.frames0[node], nodes.frames[node], nodes.rates0[node], nodes.rates[node]
    mass, first, centre = lump[0], triple(lump, 1), triple(nodes.centres[node], 0)
    g, o0, o1 = triple(nodes.gravity, 0), triple(r0, 3), triple(r1, 3)
    a = add(triple(r1, 0), -1.0, triple(r0, 0))
    a = (a[0] / h, a[1] / h, a[2] / h)
    e = add(turn(H1, cross(o1, first)), -1.0, turn(H0, cross(o0, first)))
    f = (mass * a[0] + e[0] / h, mass * a[1] + e[1] / h, mass * a[2] + e[2] / h)
    f = add(f, -mass, g)
    m = add(turn(H1, _spin_momentum(lump, o1)), -1.0, turn(H0, _spin_momentum(lump, o0)))
    m = (m[0] / h, m[1] / h, m[2] / h)
    # with this arm the work equals the change of v . d(R s)/dt
    arm = add(first, 0.25 * h, cross(add(o1, -1.0, o0), first))
    m = add(m, 1.0, cross(mean_turn(H0, H1, arm), a))
    m = add(m, -1.0, cross(mean_turn(H0, H1, first), g))
    m = add(m, 1.0, cross(mean_turn(H0, H1, centre), f))
    local_f, local_m = turn_back(H1, f), turn_back(H1, m)
    for k in range(3):
        out[k], out[3 + k] = f[k], m[k]
        out[6 + k], out[9 + k] = local_f[k], local_m[k]


@subroutine
def momentum_tangent(
    lump: FloatArray, nodes: StepNodes, node: int, h: float, out: FloatArray
) -> None:
    """Derivative (6, 6) of :func:`momentum_force` along the node's local twist."""
    H0, H1, r0, r1 = nodes.frames0[node], nodes.frames[node], nodes.rates0[node], nodes.rates[node]
    mass, first, centre = lump[0], triple(lump, 1), triple(nodes.centres[node], 0)
    g, o0, o1 = triple(nodes.gravity, 0), triple(r0, 3), triple(r1, 3)
    phi, rate, force = nodes.increments[node], nodes.law[2], np.empty(12)
    momentum_force(lump, nodes, node, h, force)
    f, a = triple(force, 0), add(triple(r1, 0), -1.0, triple(r0, 0))
    a = (a[0] / h, a[1] / h, a[2] / h)
    swing = add(first, 0.25 * h, cross(add(o1, -1.0, o0), first))
    for k in range(6):
        u, t = unit(k), unit(k - 3)
        da = turn(H1, add(u, 1.0, cross(t, centre)))
        da = (rate / h * da[0], rate / h * da[1], rate / h * da[2])
        do = _increment_rate(triple(phi, 3), t)
        do = (rate * do[0], rate * do[1], rate * do[2])
        de = turn(H1, add(cross(do, first), 1.0, cross(t, cross(o1, first))))
        df = (mass * da[0] + de[0] / h, mass * da[1] + de[1] / h, mass * da[2] + de[2] / h)
        dm = turn(H1, add(_spin_momentum(lump, do), 1.0, cross(t, _spin_momentum(lump, o1))))
        dm = (dm[0] / h, dm[1] / h, dm[2] / h)
        darm = add((0.0, 0.0, 0.0), 0.5, turn(H1, cross(t, swing)))
        darm = add(darm, 0.25 * h, mean_turn(H0, H1, cross(do, first)))
        dm = add(dm, 1.0, cross(darm, a))
        dm = add(dm, 1.0, cross(mean_turn(H0, H1, swing), da))
        dm = add(dm, -0.5, cross(turn(H1, cross(t, first)), g))
        dm = add(dm, 0.5, cross(turn(H1, cross(t, centre)), f))
        dm = add(dm, 1.0, cross(mean_turn(H0, H1, centre), df))
        df = add(turn_back(H1, df), -1.0, cross(t, triple(force, 6)))
        dm = add(turn_back(H1, dm), -1.0, cross(t, triple(force, 9)))
        for i in range(3):
            out[i, k], out[3 + i, k] = df[i], dm[i]
