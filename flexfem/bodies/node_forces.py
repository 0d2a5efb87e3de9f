# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled forces and moments at points fixed to nodes.

A dead force keeps its inertial components, a follower force its components in the axes of the
point. The point is carried by its node as the frame ``offset`` (12 numbers relative to the node).
"""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.core.nodes.frame_kernels import Nodes
from flexfem.kernels.compiled import kernel, subroutine
from flexfem.kernels.records import Bool1D, Float2D, Int1D, Memory, Record, unpack
from flexfem.lie._blocks import copy_entries
from flexfem.lie.se3 import compose_into

__all__ = ["Wrenches", "add_forces", "force_states", "force_tangent"]


class Wrenches(Record):
    """Forces and moments at points, each scaled by the amplitude of its load.

    Attributes:
        offsets: (k, 12) frame of each point relative to its carrier.
        forces, moments: (k, 3) N and N m, in inertial axes, or in those of the point.
        follower: (k,) the latter.
        load: (k,) number of the load.
    """

    offsets: Float2D
    forces: Float2D
    moments: Float2D
    follower: Bool1D
    load: Int1D


@subroutine
def _wrench(
    frame: FloatArray, offset: FloatArray, force: FloatArray, moment: FloatArray, follower: bool,
    factor: float, out: FloatArray,
) -> None:  # fmt: skip
    """Force and moment on the node in its own axes."""
    for i in range(3):
        f, m = 0.0, 0.0
        for j in range(3):
            r = offset[3 + 3 * i + j] if follower else frame[3 + 3 * j + i]
            f += r * force[j]
            m += r * moment[j]
        out[i], out[3 + i] = factor * f, factor * m
    out[3] += offset[1] * out[2] - offset[2] * out[1]
    out[4] += offset[2] * out[0] - offset[0] * out[2]
    out[5] += offset[0] * out[1] - offset[1] * out[0]


@kernel
def add_forces(
    at: IntArray, wrenches: Memory, nodes: Memory, factors: FloatArray, scale: float
) -> None:
    """Subtract ``scale * factors[load]`` times every wrench from the residual of its node.

    Args:
        at: (k,) node of each wrench.
        wrenches: :class:`Wrenches`.
        nodes: ``Nodes`` of the block.
        factors: amplitudes of the loads.
        scale: see above.
    """
    own, state, wrench = unpack(Wrenches, wrenches), unpack(Nodes, nodes), np.empty(6)
    frames, residual = state.frames, state.residual
    for k in range(at.size):
        node, factor = at[k], factors[own.load[k]]
        _wrench(
            frames[node], own.offsets[k], own.forces[k], own.moments[k], own.follower[k], factor,
            wrench,
        )  # fmt: skip
        for i in range(6):
            residual[node, i] -= scale * wrench[i]


@subroutine
def _add_turned(vector: FloatArray, row: int, sign: float, out: FloatArray) -> None:
    """Add ``sign skew(vector)`` to the rotation columns of three rows of ``out`` (6, 6)."""
    for i in range(3):
        i1, i2 = (i + 1) % 3, (i + 2) % 3
        out[row + i, 3 + i2] += sign * vector[i1]
        out[row + i, 3 + i1] -= sign * vector[i2]


@kernel
def force_tangent(
    at: IntArray, wrenches: Memory, nodes: Memory, factors: FloatArray, scale: float,
    out: FloatArray,
) -> None:  # fmt: skip
    """Write the derivatives of :func:`add_forces` along local twists to ``out`` (k, 6, 6)."""
    own, frames = unpack(Wrenches, wrenches), unpack(Nodes, nodes).frames
    wrench, arm, turned = np.empty(6), np.zeros(12), np.empty((3, 6))
    for k in range(at.size):
        out[k] = 0.0
        if own.follower[k]:
            continue
        # dead: d(R^T F) = skew(R^T F) theta, and the arm's moment follows
        factor = factors[own.load[k]]
        _wrench(frames[at[k]], arm, own.forces[k], own.moments[k], False, factor, wrench)
        _add_turned(wrench[:3], 0, -scale, out[k])
        _add_turned(wrench[3:], 3, -scale, out[k])
        o = own.offsets[k]
        for i in range(3):
            copy_entries(out[k, i], turned[i])
        for i in range(3):
            i1, i2 = (i + 1) % 3, (i + 2) % 3
            for j in range(6):
                out[k, 3 + i, j] += o[i1] * turned[i2, j] - o[i2] * turned[i1, j]


@kernel
def force_states(
    at: IntArray, wrenches: Memory, nodes: Memory, factors: FloatArray, out: FloatArray
) -> None:
    """Write force, moment, place and angular velocity of every wrench to ``out`` (k, 12).

    All are inertial components; the moment is that at the point itself.
    """
    own, moving, point = unpack(Wrenches, wrenches), unpack(Nodes, nodes), np.empty(12)
    forces, moments = own.forces, own.moments
    for k in range(at.size):
        H, v, state = moving.frames[at[k]], moving.velocity[at[k]], out[k]
        factor = factors[own.load[k]]
        compose_into(H, own.offsets[k], point)
        for i in range(3):
            row = 3 + 3 * i
            state[6 + i] = point[i]
            state[9 + i] = H[row] * v[3] + H[row + 1] * v[4] + H[row + 2] * v[5]
            state[i], state[3 + i] = factor * forces[k, i], factor * moments[k, i]
            if own.follower[k]:
                state[i], state[3 + i] = 0.0, 0.0
                for j in range(3):
                    state[i] += factor * point[row + j] * forces[k, j]
                    state[3 + i] += factor * point[row + j] * moments[k, j]
