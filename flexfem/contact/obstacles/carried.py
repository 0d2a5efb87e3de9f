# SPDX-License-Identifier: LGPL-3.0-or-later
"""Points fixed to nodes, and points between them.

A point at the arm a in the axes of a node with the frame (x, R) is at ``x + R a``. With local steps
(u, theta) of the node it moves by ``R (u + theta x a)``; a force f on it acts on the node with
``g = R^T f`` and the moment ``a x g``, which change by ``g x theta`` as the node rotates. Nodes
with three unknowns have no arms and do not rotate. Points between others are their weighted means.
"""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.core.nodes.frame_kernels import Nodes
from flexfem.kernels.compiled import inlined, kernel
from flexfem.kernels.records import Float2D, Int1D, Memory, Record, unpack
from flexfem.lie import so3

__all__ = [
    "Carried",
    "add_carried",
    "add_couples",
    "add_over_cayley_step",
    "add_over_step",
    "add_turned",
    "carried_into",
    "compliances_into",
    "moved_into",
    "rates_into",
    "spins_into",
    "spread_means",
    "turned_into",
    "weigh_means",
]


class Carried(Record):
    """Points fixed to nodes of one block.

    Attributes:
        turns: True if the nodes have rotations.
        rows: Numbers of the points among all points, shape (k,).
        local: Their nodes, shape (k,).
        arms: Shape (k, 3), metres.
        loads: Forces at the last evaluation in the axes of the nodes, shape (k, 3), newtons.
    """

    turns: bool
    rows: Int1D
    local: Int1D
    arms: Float2D
    loads: Float2D


@inlined
def _cross(a: FloatArray, b: FloatArray, k: int) -> float:
    """Component k of a vector product."""
    i, j = (k + 1) % 3, (k + 2) % 3
    return float(a[i] * b[j] - a[j] * b[i])


@kernel
def carried_into(nodes: Memory, carried: Memory, points: FloatArray) -> None:
    """Write the positions of points (k,) fixed to nodes into their rows of (n, 3)."""
    frames, own = unpack(Nodes, nodes).frames, unpack(Carried, carried)
    local, arms, rows = own.local, own.arms, own.rows
    for k in range(local.size):
        H, arm = frames[local[k]], arms[k]
        for a in range(3):
            turned = H[3 + 3 * a] * arm[0] + H[4 + 3 * a] * arm[1] + H[5 + 3 * a] * arm[2]
            points[rows[k], a] = H[a] + turned


@kernel
def moved_into(nodes: Memory, carried: Memory, out: FloatArray) -> None:
    """Write the inertial steps of points (k,) into their rows of (n, 3)."""
    state, own, way = unpack(Nodes, nodes), unpack(Carried, carried), np.empty(3)
    frames, steps, turns = state.frames, state.step, own.turns
    local, arms, rows = own.local, own.arms, own.rows
    for k in range(local.size):
        H, step = frames[local[k]], steps[local[k]]
        for a in range(3):
            way[a] = step[a] + (_cross(step[3:], arms[k], a) if turns else 0.0)
        for a in range(3):
            out[rows[k], a] = H[3 + 3 * a] * way[0] + H[4 + 3 * a] * way[1] + H[5 + 3 * a] * way[2]


@kernel
def compliances_into(
    nodes: Memory, carried: Memory, compliances: FloatArray, out: FloatArray
) -> None:
    """Write the compliances of points (k,) in inertial axes into their rows of (n, 9).

    Those of the nodes, (m, 36) or (m, 9), are in the axes of their steps.
    """
    frames, own = unpack(Nodes, nodes).frames, unpack(Carried, carried)
    local, arms, rows, width = own.local, own.arms, own.rows, 6 if own.turns else 3
    P, Q = np.empty((3, 6)), np.empty((3, 6))
    for k in range(local.size):
        H, C, arm = frames[local[k]], compliances[local[k]], arms[k]
        for a in range(3):
            x, y, z = H[3 + 3 * a], H[4 + 3 * a], H[5 + 3 * a]
            P[a, 0], P[a, 1], P[a, 2] = x, y, z
            P[a, 3] = arm[1] * z - arm[2] * y
            P[a, 4] = arm[2] * x - arm[0] * z
            P[a, 5] = arm[0] * y - arm[1] * x
        for a in range(3):
            for j in range(width):
                Q[a, j] = 0.0
                for i in range(width):
                    Q[a, j] += P[a, i] * C[width * i + j]
        for a in range(3):
            for b in range(3):
                total = 0.0
                for j in range(width):
                    total += Q[a, j] * P[b, j]
                out[rows[k], 3 * a + b] = total


@kernel
def add_carried(nodes: Memory, carried: Memory, forces: FloatArray, loads: FloatArray) -> None:
    """Add inertial forces (n, 3) on points (k,) to the residuals of nodes.

    ``loads`` (k, 3) gets the forces in the axes of the nodes.
    """
    state, own = unpack(Nodes, nodes), unpack(Carried, carried)
    frames, residual, turns = state.frames, state.residual, own.turns
    local, arms, rows = own.local, own.arms, own.rows
    for k in range(local.size):
        H, f = frames[local[k]], forces[rows[k]]
        for a in range(3):
            loads[k, a] = H[3 + a] * f[0] + H[6 + a] * f[1] + H[9 + a] * f[2]
        for a in range(3):
            residual[local[k], a] += loads[k, a]
            if turns:
                residual[local[k], 3 + a] += _cross(arms[k], loads[k], a)


@kernel
def add_over_step(nodes: Memory, carried: Memory, forces: FloatArray) -> None:
    """Add inertial forces (n, 3) on points (k,) over a step to the residuals of nodes.

    With the increments (u, theta) of a node over the step, its frame at the start (x0, R0), and the
    left tangent operator S, a point moves by ``R0 S (u + theta x a)``, and by ``u + R0 S theta x
    a`` where u is in inertial axes. The work of the residual along the increments is hence exactly
    that of the force along the way of the point, with ``g = S^T R0^T f`` in the place of ``R^T f``.
    """
    state, own, g, x = unpack(Nodes, nodes), unpack(Carried, carried), np.empty(3), np.empty(3)
    residual, loads = state.residual, own.loads
    local, arms, rows = own.local, own.arms, own.rows
    for k in range(local.size):
        node = local[k]
        H0, H, n, f = (
            state.frames0[node],
            state.frames[node],
            state.increment[node],
            forces[rows[k]],
        )
        for a in range(3):
            x[a] = H0[3 + a] * f[0] + H0[6 + a] * f[1] + H0[9 + a] * f[2]
            loads[k, a] = H[3 + a] * f[0] + H[6 + a] * f[1] + H[9 + a] * f[2]
        if not own.turns:
            for a in range(3):
                residual[node, a] += loads[k, a]
            continue
        theta = n[3:]
        angle = np.sqrt(theta[0] * theta[0] + theta[1] * theta[1] + theta[2] * theta[2])
        if angle > 1e-3:
            first, second = (1.0 - np.cos(angle)) / angle**2, (angle - np.sin(angle)) / angle**3
        else:
            first, second = 0.5 - angle**2 / 24.0, 1.0 / 6.0 - angle**2 / 120.0
        along = theta[0] * x[0] + theta[1] * x[1] + theta[2] * x[2]
        for a in range(3):
            # theta x (theta x x) without the inner product
            twice = theta[a] * along - angle * angle * x[a]
            g[a] = x[a] - first * _cross(theta, x, a) + second * twice
        for a in range(3):
            residual[node, a] += loads[k, a] if state.inertial else g[a]
            residual[node, 3 + a] += _cross(arms[k], g, a)


@kernel
def add_over_cayley_step(nodes: Memory, carried: Memory, forces: FloatArray) -> None:
    """The same for nodes that rotate by Cayley vectors, see ``core.nodes.step_kernels``.

    The way of a point is that of its node and the Cayley vector times its mean arm.
    """
    state, own, arm, m = unpack(Nodes, nodes), unpack(Carried, carried), np.empty(3), np.empty(3)
    residual, loads = state.residual, own.loads
    local, arms, rows = own.local, own.arms, own.rows
    for k in range(local.size):
        node = local[k]
        H0, H, f, s = state.frames0[node], state.frames[node], forces[rows[k]], arms[k]
        for a in range(3):
            j = 3 + 3 * a
            arm[a] = 0.5 * (
                (H0[j] + H[j]) * s[0]
                + (H0[j + 1] + H[j + 1]) * s[1]
                + (H0[j + 2] + H[j + 2]) * s[2]
            )
        for a in range(3):
            m[a] = _cross(arm, f, a)
        for a in range(3):
            loads[k, a] = H[3 + a] * f[0] + H[6 + a] * f[1] + H[9 + a] * f[2]
            residual[node, a] += loads[k, a]
            residual[node, 3 + a] += H[3 + a] * m[0] + H[6 + a] * m[1] + H[9 + a] * m[2]


@kernel
def add_turned(nodes: Memory, carried: Memory, scale: float) -> None:
    """Add ``scale`` times the change of the loads with the rotation of the nodes by their steps."""
    state, own, g = unpack(Nodes, nodes), unpack(Carried, carried), np.empty(3)
    steps, residual = state.step, state.residual
    local, arms, loads = own.local, own.arms, own.loads
    for k in range(local.size):
        for a in range(3):
            g[a] = scale * _cross(loads[k], steps[local[k], 3:], a)
        for a in range(3):
            residual[local[k], a] += g[a]
            residual[local[k], 3 + a] += _cross(arms[k], g, a)


@kernel
def weigh_means(parents: IntArray, weights: FloatArray, rows: IntArray, values: FloatArray) -> None:
    """Write the weighted means of ``parents`` (k, p) into their rows of (n, 3)."""
    for k in range(len(rows)):
        for a in range(3):
            total = 0.0
            for p in range(parents.shape[1]):
                total += weights[k, p] * values[parents[k, p], a]
            values[rows[k], a] = total


@kernel
def spread_means(
    parents: IntArray, weights: FloatArray, rows: IntArray, values: FloatArray
) -> None:
    """Distribute forces in ``rows`` of (n, 3) to the ``parents`` (k, p)."""
    for k in range(len(rows)):
        for a in range(3):
            for p in range(parents.shape[1]):
                values[parents[k, p], a] += weights[k, p] * values[rows[k], a]
            values[rows[k], a] = 0.0


@inlined
def _turn(H: FloatArray, v: FloatArray, out: FloatArray) -> None:
    """Write ``R v`` of a frame stored as 12 numbers."""
    for a in range(3):
        j = 3 + 3 * a
        out[a] = H[j] * v[0] + H[j + 1] * v[1] + H[j + 2] * v[2]


@kernel
def spins_into(nodes: Memory, carried: Memory, out: FloatArray) -> None:
    """Write the rotation vectors of a step of points (k,), inertial axes, into rows of (n, 3)."""
    state, own = unpack(Nodes, nodes), unpack(Carried, carried)
    if own.turns:
        for k in range(own.local.size):
            node = own.local[k]
            _turn(state.frames0[node], state.increment[node, 3:], out[own.rows[k]])


@kernel
def turned_into(nodes: Memory, carried: Memory, out: FloatArray) -> None:
    """Write the changes of :func:`spins_into` by the steps of nodes to rows of (n, 3)."""
    state, own = unpack(Nodes, nodes), unpack(Carried, carried)
    T, change = np.empty(9), np.empty(3)
    if own.turns:
        for k in range(own.local.size):
            node = own.local[k]
            so3.inverse_tangent_into(state.increment[node, 3:], T)
            for a in range(3):
                change[a] = 0.0
                for b in range(3):
                    change[a] += T[3 * a + b] * state.step[node, 3 + b]
            _turn(state.frames0[node], change, out[own.rows[k]])


@kernel
def rates_into(nodes: Memory, carried: Memory, rates: FloatArray, spins: FloatArray) -> None:
    """Write velocities and angular velocities of points (k,), inertial axes, to rows of (n, 3)."""
    state, own, v = unpack(Nodes, nodes), unpack(Carried, carried), np.empty(3)
    for k in range(own.local.size):
        node, row = own.local[k], own.rows[k]
        twist = state.velocity[node]
        for a in range(3):
            v[a] = twist[a] + (_cross(twist[3:], own.arms[k], a) if own.turns else 0.0)
        _turn(state.frames[node], v, rates[row])
        if own.turns:
            _turn(state.frames[node], twist[3:], spins[row])


@kernel
def add_couples(nodes: Memory, carried: Memory, couples: FloatArray) -> None:
    """Add inertial couples (n, 3) over a step on points (k,) to the residuals of nodes.

    Their axes are the mean ones, in which their work is that along the rotation vector.
    """
    state, own = unpack(Nodes, nodes), unpack(Carried, carried)
    if own.turns:
        for k in range(own.local.size):
            node, c = own.local[k], couples[own.rows[k]]
            H0, H = state.frames0[node], state.frames[node]
            for a in range(3):
                for b in range(3):
                    j = 3 + 3 * b + a
                    state.residual[node, 3 + a] += 0.5 * (H0[j] + H[j]) * c[b]
