# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loops over nodes that carry frames: prediction, correction, acceptance of a step."""

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.nodes.prediction import Misses
from flexfem.kernels.compiled import inlined, kernel, subroutine
from flexfem.kernels.records import Float1D, Float2D, Int1D, Memory, Record, unpack
from flexfem.lie import so3
from flexfem.lie._blocks import cross, triple
from flexfem.lie.se3 import (
    inverse_tangent_apply,
    inverse_tangent_into,
    retract_into,
    tangent_apply,
)

__all__ = [
    "Nodes",
    "accept",
    "along_velocity_into",
    "correct",
    "kick",
    "orthonormalise",
    "predict",
    "shift",
    "shifts",
    "slow",
    "step_changes",
    "step_rates",
    "step_rates_into",
    "to_inertial",
]


class Nodes(Record):
    """State of the nodes of a block, see ``FrameBlock``.

    Attributes:
        inertial: translations are integrated in inertial axes.
        unturned: (n,) axis, see ``FrameBlock``.
        frames, velocity, acceleration: (n, 12) and (n, 6) trial state, local axes.
        increment: (n, 6) increment over the step.
        step, residual: (n, 6) Newton step and right-hand side.
        frames0: (n, 12) accepted frames.
        velocity0, auxiliary0, acceleration0: (n, 6) accepted rates of the increments, the
            integrator's acceleration-like variable, and accelerations.
        velocity_base, acceleration_base: (n, 6) rates at zero increment.
        rates: (2,) dv/dn and dw/dn.
        offset: (n, 6) part of the increments that is not integrated from rates, see :func:`shift`.
        turn, velocity_change, acceleration_change: (n, 6) along the step, see :func:`step_changes`.
    """

    inertial: bool
    unturned: Int1D
    frames: Float2D
    velocity: Float2D
    acceleration: Float2D
    increment: Float2D
    step: Float2D
    residual: Float2D
    frames0: Float2D
    velocity0: Float2D
    auxiliary0: Float2D
    acceleration0: Float2D
    velocity_base: Float2D
    acceleration_base: Float2D
    rates: Float1D
    offset: Float2D
    turn: Float2D
    velocity_change: Float2D
    acceleration_change: Float2D


@inlined
def _configure(nodes: Nodes, turn: FloatArray, i: int) -> None:
    """Configuration, local velocity and acceleration of node ``i`` from its increment.

    ``turn`` (9,) is work space.
    """
    n, v, w = nodes.increment[i], nodes.velocity[i], nodes.acceleration[i]
    for k in range(6):
        v[k] = nodes.velocity_base[i, k] + nodes.rates[0] * n[k]
        w[k] = nodes.acceleration_base[i, k] + nodes.rates[1] * n[k]
    H0, H = nodes.frames0[i], nodes.frames[i]
    if not nodes.inertial:
        retract_into(H0, n, H)
        return
    so3.exp_into(n[3:], turn)
    for k in range(3):
        H[k] = H0[k] + n[k]
        r0, r1, r2 = H0[3 + 3 * k], H0[4 + 3 * k], H0[5 + 3 * k]
        for m in range(3):
            H[3 + 3 * k + m] = r0 * turn[m] + r1 * turn[3 + m] + r2 * turn[6 + m]
    _to_local(H, v, w)


@inlined
def _to_local(H: FloatArray, v: FloatArray, w: FloatArray) -> None:
    """Convert inertial velocity and acceleration of a node's origin to its local twist and rate."""
    x0, x1, x2, a0, a1, a2 = v[0], v[1], v[2], w[0], w[1], w[2]
    for k in range(3):
        v[k] = H[3 + k] * x0 + H[6 + k] * x1 + H[9 + k] * x2
        w[k] = H[3 + k] * a0 + H[6 + k] * a1 + H[9 + k] * a2
    w[0] -= v[4] * v[2] - v[5] * v[1]
    w[1] -= v[5] * v[0] - v[3] * v[2]
    w[2] -= v[3] * v[1] - v[4] * v[0]


@kernel
def to_inertial(frames: FloatArray, v: FloatArray, w: FloatArray) -> None:
    """Convert local twists and their rates to inertial velocities and accelerations, in place."""
    a = np.empty(3)
    for i in range(frames.shape[0]):
        H = frames[i]
        for k in range(3):
            p, q = (k + 1) % 3, (k + 2) % 3
            a[k] = w[i, k] + v[i, 3 + p] * v[i, q] - v[i, 3 + q] * v[i, p]
        x0, x1, x2 = v[i, 0], v[i, 1], v[i, 2]
        for k in range(3):
            j = 3 + 3 * k
            v[i, k] = H[j] * x0 + H[j + 1] * x1 + H[j + 2] * x2
            w[i, k] = H[j] * a[0] + H[j + 1] * a[1] + H[j + 2] * a[2]


@inlined
def step_rates_into(
    inertial: bool, n: FloatArray, v: FloatArray, w: FloatArray, rates: FloatArray,
    by_v: FloatArray, by_w: FloatArray,
) -> None:  # fmt: skip
    """Change of a node's local velocity and its rate along its local twist, 6x6 row by row.

    On SE(3) both are multiples of the inverse tangent operator of the increment. With inertial
    translations ``dV = v' u + V x theta`` and ``dW = w' u + A x theta - dOmega x V - Omega x dV``,
    W being the rate of V, A the acceleration in local axes, v' and w' the ``rates`` (2,).
    """
    if not inertial:
        inverse_tangent_into(n, by_w)
        for k in range(36):
            by_v[k] = rates[0] * by_w[k]
            by_w[k] *= rates[1]
        return
    by_v[:] = 0.0
    by_w[:] = 0.0
    T = np.empty(9)
    so3.inverse_tangent_into(n[3:], T)
    for i in range(3):
        for j in range(3):
            by_v[6 * (3 + i) + 3 + j] = rates[0] * T[3 * i + j]
            by_w[6 * (3 + i) + 3 + j] = rates[1] * T[3 * i + j]
    for k in range(3):
        p, q = (k + 1) % 3, (k + 2) % 3
        by_v[7 * k] = rates[0]
        by_w[7 * k] = rates[1]
        # V x theta
        by_v[6 * k + 3 + q] += v[p]
        by_v[6 * k + 3 + p] -= v[q]
        # A x theta, A = dV/dt + Omega x V
        a_p = w[p] + v[3 + q] * v[k] - v[3 + k] * v[q]
        a_q = w[q] + v[3 + k] * v[p] - v[3 + p] * v[k]
        by_w[6 * k + 3 + q] += a_p
        by_w[6 * k + 3 + p] -= a_q
    for k in range(3):
        p, q = (k + 1) % 3, (k + 2) % 3
        for j in range(6):
            # V x dOmega - Omega x dV
            by_w[6 * k + j] += v[p] * by_v[6 * (3 + q) + j] - v[q] * by_v[6 * (3 + p) + j]
            by_w[6 * k + j] -= v[3 + p] * by_v[6 * q + j] - v[3 + q] * by_v[6 * p + j]


@inlined
def along_velocity_into(
    inertial: bool, n: FloatArray, v: FloatArray, rate: float, g: FloatArray, T: FloatArray,
    out: FloatArray,
) -> None:  # fmt: skip
    """``g . dV`` along a node's local twist, ``dV`` as in :func:`step_rates_into`.

    ``rate`` is v'; ``T`` (36,) is work space.
    """
    if not inertial:
        inverse_tangent_into(n, T)
        for j in range(6):
            out[j] = 0.0
            for i in range(6):
                out[j] += rate * g[i] * T[6 * i + j]
        return
    so3.inverse_tangent_into(n[3:], T)
    moments = cross(triple(g, 0), triple(v, 0))
    for j in range(3):
        out[j] = rate * g[j]
        out[3 + j] = moments[j] + rate * (g[3] * T[j] + g[4] * T[3 + j] + g[5] * T[6 + j])


@kernel
def step_rates(memory: Memory, shifts: FloatArray, inertial: bool, out: FloatArray) -> None:
    """Write both results of :func:`step_rates_into` of all nodes to ``out`` (n, 2, 36)."""
    nodes = unpack(Nodes, memory)
    v, w = nodes.velocity, nodes.acceleration
    for i in range(v.shape[0]):
        step_rates_into(inertial, nodes.increment[i], v[i], w[i], shifts, out[i, 0], out[i, 1])


@kernel
def step_changes(memory: Memory, shifts: FloatArray, inertial: bool) -> None:
    """Write the changes of the nodes along their steps, for the action of tangents.

    ``shifts`` holds dv/dn, dw/dn and k, the factor of the stiffness and so of the rotations.
    """
    nodes, by_v, by_w = unpack(Nodes, memory), np.empty(36), np.empty(36)
    v, w, step = nodes.velocity, nodes.acceleration, nodes.step
    for n in range(step.shape[0]):
        step_rates_into(inertial, nodes.increment[n], v[n], w[n], shifts, by_v, by_w)
        for i in range(6):
            nodes.turn[n, i] = shifts[2] * step[n, i]
            dv, dw = 0.0, 0.0
            for j in range(6):
                dv += by_v[6 * i + j] * step[n, j]
                dw += by_w[6 * i + j] * step[n, j]
            nodes.velocity_change[n, i], nodes.acceleration_change[n, i] = dv, dw


@kernel
def predict(memory: Memory, law: FloatArray) -> None:
    """Start a step of ``Nodes``: ``n = law . (v0, a0)`` and the affine laws ``v(n)``, ``w(n)``.

    ``law`` (7,) holds the factors of v0 and a0 in the predicted increment, of v0 and a0 in
    ``velocity_base``, and of v0, a0 and w0 in ``acceleration_base``. With ``inertial`` the
    translations of all of these are in inertial axes; v and w are local always.
    """
    nodes, turn = unpack(Nodes, memory), np.empty(9)
    n, v_base, w_base = nodes.increment, nodes.velocity_base, nodes.acceleration_base
    v0, a0, w0 = nodes.velocity0, nodes.auxiliary0, nodes.acceleration0
    for i in range(n.shape[0]):
        for k in range(6):
            n[i, k] = law[0] * v0[i, k] + law[1] * a0[i, k]
            v_base[i, k] = law[2] * v0[i, k] + law[3] * a0[i, k]
            w_base[i, k] = law[4] * v0[i, k] + law[5] * a0[i, k] + law[6] * w0[i, k]
        _configure(nodes, turn, i)


@inlined
def _change_into(nodes: Nodes, i: int, step: FloatArray, change: FloatArray, T: FloatArray) -> None:
    """Change of the increment of node ``i`` along its local twist ``step``.

    ``T`` (9,) is work space. Increments about an axis that is not to turn stay as they are, by a
    rotation about this axis besides the twist, which does not move directors along it.
    """
    H, n, axis, turn = nodes.frames[i], nodes.increment[i], nodes.unturned[i], 0.0
    if not nodes.inertial:
        inverse_tangent_apply(n, step, change)
        return
    so3.inverse_tangent_into(n[3:], T)
    if axis >= 0:
        for m in range(3):
            turn -= T[3 * axis + m] * step[3 + m]
        turn /= T[4 * axis]
    for k in range(3):
        j = 3 + 3 * k
        change[k], change[3 + k] = 0.0, 0.0
        for m in range(3):
            change[k] += H[j + m] * step[m]
            change[3 + k] += T[3 * k + m] * step[3 + m]
        if axis >= 0:
            change[3 + k] += T[3 * k + axis] * turn
    if axis >= 0:
        change[3 + axis] = 0.0


@inlined
def _larger(largest: float, step: FloatArray) -> float:
    """The largest entry so far, of a step (6,) as well; a NaN stays the largest."""
    for k in range(6):
        size = abs(step[k])
        if size > largest or size != size:
            largest = size
    return largest


@kernel
def correct(memory: Memory, sign: float) -> float:
    """Move by the local twists ``sign * step`` and return the largest entry of the step.

    Increments follow to first order: ``Tinv(n) sign step`` on SE(3), ``R u`` for inertial
    translations. At the solution this is exact.
    """
    nodes, largest, change, T = unpack(Nodes, memory), 0.0, np.empty(6), np.empty(9)
    n, step = nodes.increment, nodes.step
    for i in range(n.shape[0]):
        _change_into(nodes, i, step[i], change, T)
        for k in range(6):
            n[i, k] += sign * change[k]
        largest = _larger(largest, step[i])
        _configure(nodes, T, i)
    return largest


@kernel
def shift(memory: Memory, sign: float) -> float:
    """Move by the local twists ``sign * step`` at constant rates of the increments.

    The parts of the increments that are not integrated from rates collect in ``offset``.
    Returns the largest entry of the step.
    """
    nodes, largest, change, T = unpack(Nodes, memory), 0.0, np.empty(6), np.empty(9)
    n, step, rates = nodes.increment, nodes.step, nodes.rates
    for i in range(n.shape[0]):
        _change_into(nodes, i, step[i], change, T)
        for k in range(6):
            n[i, k] += sign * change[k]
            nodes.offset[i, k] += sign * change[k]
            nodes.velocity_base[i, k] -= sign * rates[0] * change[k]
            nodes.acceleration_base[i, k] -= sign * rates[1] * change[k]
        largest = _larger(largest, step[i])
        _configure(nodes, T, i)
    return largest


@kernel
def shifts(memory: Memory) -> None:
    """Write the offsets, as local twists at the trial state, to the steps."""
    nodes, T = unpack(Nodes, memory), np.empty(9)
    for i in range(nodes.step.shape[0]):
        n, offset, step, H = nodes.increment[i], nodes.offset[i], nodes.step[i], nodes.frames[i]
        if not nodes.inertial:
            tangent_apply(n, offset, step)
            continue
        so3.tangent_into(n[3:], T)
        for k in range(3):
            step[k], step[3 + k] = 0.0, 0.0
            for m in range(3):
                step[k] += H[3 + 3 * m + k] * offset[m]
                step[3 + k] += T[3 * k + m] * offset[3 + m]


@inlined
def _turned(inertial: bool, H: FloatArray, step: FloatArray, out: FloatArray) -> None:
    """A local twist as a change of the rates of the increments."""
    for k in range(6):
        out[k] = step[k]
    if inertial:
        for k in range(3):
            j = 3 + 3 * k
            out[k] = H[j] * step[0] + H[j + 1] * step[1] + H[j + 2] * step[2]


@kernel
def kick(memory: Memory, h: float) -> None:
    """Change the velocities by the local twists ``step``, constant accelerations of a step.

    The increments over the step of size ``h`` have ``h/2`` times the changes in them already, which
    are no longer integrated from rates.
    """
    nodes, change, T = unpack(Nodes, memory), np.empty(6), np.empty(9)
    rates, step = nodes.rates, nodes.step
    for i in range(step.shape[0]):
        _turned(nodes.inertial, nodes.frames[i], step[i], change)
        for k in range(6):
            part = 0.5 * h * change[k]
            nodes.offset[i, k] += part
            nodes.velocity_base[i, k] += change[k] - rates[0] * part
            nodes.acceleration_base[i, k] -= rates[1] * part
        _configure(nodes, T, i)


@kernel
def slow(memory: Memory) -> None:
    """Subtract the local twists ``step`` from the accepted accelerations."""
    nodes, change = unpack(Nodes, memory), np.empty(6)
    for i in range(nodes.step.shape[0]):
        _turned(nodes.inertial, nodes.frames0[i], nodes.step[i], change)
        for k in range(6):
            nodes.acceleration0[i, k] -= change[k]
            nodes.auxiliary0[i, k] -= change[k]


@subroutine
def _orthonormalise(H: FloatArray) -> None:
    """``R <- R (3 I - R^T R) / 2``: keeps round-off from adding up over millions of steps."""
    c00 = H[3] * H[3] + H[6] * H[6] + H[9] * H[9]
    c11 = H[4] * H[4] + H[7] * H[7] + H[10] * H[10]
    c22 = H[5] * H[5] + H[8] * H[8] + H[11] * H[11]
    c01 = H[3] * H[4] + H[6] * H[7] + H[9] * H[10]
    c02 = H[3] * H[5] + H[6] * H[8] + H[9] * H[11]
    c12 = H[4] * H[5] + H[7] * H[8] + H[10] * H[11]
    for k in (3, 6, 9):
        a, b, c = H[k], H[k + 1], H[k + 2]
        H[k] = 0.5 * (a * (3.0 - c00) - b * c01 - c * c02)
        H[k + 1] = 0.5 * (b * (3.0 - c11) - a * c01 - c * c12)
        H[k + 2] = 0.5 * (c * (3.0 - c22) - a * c02 - b * c12)


@kernel
def orthonormalise(frames: FloatArray) -> None:
    """Remove the rounding errors of the rotations of all frames (n, 12)."""
    for i in range(len(frames)):
        _orthonormalise(frames[i])


@kernel
def accept(memory: Memory, law: FloatArray, h: float, owned: int) -> Misses:
    """End a step: the trial state becomes the state; ``law`` (3,) gives a from n, v0, a0.

    Returns the largest distances of the increments of the owned nodes from zero, from ``h v0`` and
    from ``h v0 + h^2/2 a0``.
    """
    nodes, whole, first, second = unpack(Nodes, memory), 0.0, 0.0, 0.0
    n, rates = nodes.increment, nodes.rates
    v0, a0, w0 = nodes.velocity0, nodes.auxiliary0, nodes.acceleration0
    for i in range(n.shape[0]):
        for k in range(6):
            if i < owned:
                miss = n[i, k] - h * v0[i, k]
                whole = max(whole, abs(n[i, k]))
                first = max(first, abs(miss))
                second = max(second, abs(miss - 0.5 * h * h * a0[i, k]))
            a0[i, k] = law[0] * n[i, k] + law[1] * v0[i, k] + law[2] * a0[i, k]
            v0[i, k] = nodes.velocity_base[i, k] + rates[0] * n[i, k]
            w0[i, k] = nodes.acceleration_base[i, k] + rates[1] * n[i, k]
            n[i, k] = 0.0
        _orthonormalise(nodes.frames[i])
        for k in range(12):
            nodes.frames0[i, k] = nodes.frames[i, k]
    return whole, first, second
