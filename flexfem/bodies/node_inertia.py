# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled inertia of rigid bodies and of masses fixed to nodes.

A node with frame ``H``, local twist ``v`` and inertia matrix ``M`` (6x6 about the node, in its
axes) obeys the Euler–Poincaré equation ``M dv/dt - ad_v^T (M v) - M (R^T g, 0) = f``.
"""

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.core.nodes.frame_kernels import Nodes, step_rates_into
from flexfem.core.nodes.motion import add_motion
from flexfem.kernels.compiled import kernel, subroutine
from flexfem.kernels.records import Memory, unpack

__all__ = ["add_inertia", "add_mass_motion", "inertia_tangent"]


@subroutine
def _gravity_in_node(frame: FloatArray, gravity: FloatArray, out: FloatArray) -> None:
    for i in range(3):
        out[i] = frame[3 + i] * gravity[0] + frame[6 + i] * gravity[1] + frame[9 + i] * gravity[2]


@kernel
def add_inertia(
    at: IntArray, masses: FloatArray, nodes: Memory, gravity: FloatArray, scale: float
) -> None:
    """Add ``scale`` times inertia forces less weights to the residual of the nodes.

    Args:
        at: (k,) node of each mass.
        masses: (k, 6, 6).
        nodes: ``Nodes`` of the block.
        gravity: acceleration in inertial axes.
        scale: see above.
    """
    own, p, q, a = unpack(Nodes, nodes), np.empty(6), np.empty(6), np.empty(6)
    acceleration, residual = own.acceleration, own.residual
    for k in range(at.size):
        node, M = at[k], masses[k]
        v = own.velocity[node]
        _gravity_in_node(own.frames[node], gravity, a)
        for i in range(6):
            q[i] = acceleration[node, i]
        for i in range(3):
            q[i] -= a[i]
        for i in range(6):
            p[i], a[i] = 0.0, 0.0
            for j in range(6):
                p[i] += M[i, j] * v[j]
                a[i] += M[i, j] * q[j]
        a[0] += v[4] * p[2] - v[5] * p[1]
        a[1] += v[5] * p[0] - v[3] * p[2]
        a[2] += v[3] * p[1] - v[4] * p[0]
        a[3] += v[4] * p[5] - v[5] * p[4] + v[1] * p[2] - v[2] * p[1]
        a[4] += v[5] * p[3] - v[3] * p[5] + v[2] * p[0] - v[0] * p[2]
        a[5] += v[3] * p[4] - v[4] * p[3] + v[0] * p[1] - v[1] * p[0]
        for i in range(6):
            residual[node, i] += scale * a[i]


@subroutine
def _gyroscopic(M: FloatArray, v: FloatArray, C: FloatArray) -> None:
    """Add the derivative of ``-ad_v^T (M v)`` with respect to ``v`` to ``C`` (6, 6)."""
    p = np.zeros(6)
    for i in range(6):
        for j in range(6):
            p[i] += M[i, j] * v[j]
    for i in range(3):
        i1, i2 = (i + 1) % 3, (i + 2) % 3
        for j in range(6):
            # Omega x dl, then Omega x dj + V x dl
            C[i, j] += v[3 + i1] * M[i2, j] - v[3 + i2] * M[i1, j]
            C[3 + i, j] += v[3 + i1] * M[3 + i2, j] - v[3 + i2] * M[3 + i1, j]
            C[3 + i, j] += v[i1] * M[i2, j] - v[i2] * M[i1, j]
        # dOmega x l, dOmega x j, dV x l
        C[i, 3 + i1] += p[i2]
        C[i, 3 + i2] -= p[i1]
        C[3 + i, 3 + i1] += p[3 + i2]
        C[3 + i, 3 + i2] -= p[3 + i1]
        C[3 + i, i1] += p[i2]
        C[3 + i, i2] -= p[i1]


@kernel
def inertia_tangent(
    at: IntArray, masses: FloatArray, nodes: Memory, gravity: FloatArray, inertial: bool,
    shifts: FloatArray, scale: float, out: FloatArray,
) -> None:  # fmt: skip
    """Write ``scale (k K + C dv + M dw)`` of every mass to ``out``.

    ``shifts`` holds dv/dn, dw/dn and k, see ``core.nodes.frame_kernels.step_rates_into`` for dv and
    dw.
    """
    own, g, K, C = unpack(Nodes, nodes), np.empty(3), np.empty((6, 3)), np.empty((6, 6))
    by_v, by_w = np.empty(36), np.empty(36)
    for k in range(at.size):
        node, M = at[k], masses[k]
        v, w = own.velocity[node], own.acceleration[node]
        _gravity_in_node(own.frames[node], gravity, g)
        step_rates_into(
            inertial and shifts[2] != 0.0, own.increment[node], v, w, shifts, by_v, by_w
        )
        C[:] = 0.0
        _gyroscopic(M, v, C)
        for i in range(6):  # -M (g x theta, 0)
            K[i, 0] = -(M[i, 1] * g[2] - M[i, 2] * g[1])
            K[i, 1] = -(M[i, 2] * g[0] - M[i, 0] * g[2])
            K[i, 2] = -(M[i, 0] * g[1] - M[i, 1] * g[0])
        for i in range(6):
            for j in range(6):
                total = shifts[2] * K[i, j - 3] if j > 2 else 0.0
                for m in range(6):
                    total += C[i, m] * by_v[6 * m + j] + M[i, m] * by_w[6 * m + j]
                out[k, i, j] = scale * total


@kernel
def add_mass_motion(
    nodes: IntArray, masses: FloatArray, chosen: BoolArray, frames: FloatArray,
    velocity: FloatArray, motion: FloatArray,
) -> None:  # fmt: skip
    """Add energy and momenta of the chosen masses (k, 6, 6), see ``flexfem.core.nodes.motion``."""
    p = np.empty(6)
    for k in range(nodes.size):
        if chosen[k]:
            add_motion(frames[nodes[k]], velocity[nodes[k]], masses[k], 1.0, p, motion)
