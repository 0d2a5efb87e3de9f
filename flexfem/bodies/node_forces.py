# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled forces and moments at points fixed to nodes.

A dead force keeps its inertial components, a follower force its components in the axes of the
point. The point is carried by its node as the frame ``offset`` (12 numbers relative to the node).
"""

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.lie._blocks import copy_entries
from flexfem.lie.compiled import kernel, subroutine
from flexfem.lie.se3 import compose_into

__all__ = ["add_forces", "force_states", "force_tangent"]


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
    nodes: IntArray, offsets: FloatArray, forces: FloatArray, moments: FloatArray,
    follower: BoolArray, load: IntArray, factors: FloatArray, frames: FloatArray, scale: float,
    residual: FloatArray,
) -> None:  # fmt: skip
    """Subtract ``scale * factors[load]`` times every wrench from the residual of its node."""
    wrench = np.empty(6)
    for k in range(nodes.size):
        node = nodes[k]
        _wrench(
            frames[node], offsets[k], forces[k], moments[k], follower[k], factors[load[k]], wrench
        )
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
    nodes: IntArray, offsets: FloatArray, forces: FloatArray, moments: FloatArray,
    follower: BoolArray, load: IntArray, factors: FloatArray, frames: FloatArray, scale: float,
    out: FloatArray,
) -> None:  # fmt: skip
    """Write ``scale`` times the derivative of every wrench's residual to ``out`` (k, 6, 6)."""
    wrench, arm = np.empty(6), np.zeros(12)
    turned = np.empty((3, 6))
    for k in range(nodes.size):
        out[k] = 0.0
        if follower[k]:
            continue
        node = nodes[k]
        # dead: d(R^T F) = skew(R^T F) theta, and the arm's moment follows
        _wrench(frames[node], arm, forces[k], moments[k], False, factors[load[k]], wrench)
        _add_turned(wrench[:3], 0, -scale, out[k])
        _add_turned(wrench[3:], 3, -scale, out[k])
        o = offsets[k]
        for i in range(3):
            copy_entries(out[k, i], turned[i])
        for i in range(3):
            i1, i2 = (i + 1) % 3, (i + 2) % 3
            for j in range(6):
                out[k, 3 + i, j] += o[i1] * turned[i2, j] - o[i2] * turned[i1, j]


@kernel
def force_states(
    nodes: IntArray, offsets: FloatArray, forces: FloatArray, moments: FloatArray,
    follower: BoolArray, load: IntArray, factors: FloatArray, frames: FloatArray,
    velocity: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    """Write force, moment, place and angular velocity of every wrench to ``out`` (k, 12).

    All are inertial components; the moment is that at the point itself.
    """
    point = np.empty(12)
    for k in range(nodes.size):
        H, v, factor, state = frames[nodes[k]], velocity[nodes[k]], factors[load[k]], out[k]
        compose_into(H, offsets[k], point)
        for i in range(3):
            at = 3 + 3 * i
            state[6 + i] = point[i]
            state[9 + i] = H[at] * v[3] + H[at + 1] * v[4] + H[at + 2] * v[5]
            state[i], state[3 + i] = factor * forces[k, i], factor * moments[k, i]
            if follower[k]:
                state[i], state[3 + i] = 0.0, 0.0
                for j in range(3):
                    state[i] += factor * point[at + j] * forces[k, j]
                    state[3 + i] += factor * point[at + j] * moments[k, j]
