# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled forces and moments at points inside elements of beams.

As ``node_forces``, but the point is carried by all nodes of its element, with the frame ``offset``
relative to that of the section. With J the local twist of the point by those of the nodes and ``g``
the wrench in the axes of the point, the nodes feel ``J^T g``.
"""

import numpy as np

from flexfem._types import FloatArray
from flexfem.bodies.node_forces import Wrenches
from flexfem.core.nodes.frame_kernels import Nodes
from flexfem.core.places.line_points import (
    add_line_second,
    line_jacobian,
    offset_jacobian,
    turn_columns,
    turn_frames,
    turn_second,
)
from flexfem.kernels.compiled import inlined, kernel
from flexfem.kernels.records import Float1D, Float3D, Int2D, Memory, Record, unpack
from flexfem.lie.se3 import compose_into

__all__ = ["Places", "add_line_forces", "line_force_states", "line_force_tangent", "line_twists"]


class Places(Record):
    """Places in elements of one kind with k nodes each.

    Attributes:
        element: kind of the elements, see ``core.places.line_points``.
        nodes: (n, k) nodes of the element.
        shape: (n, k, k) coefficients of the shape functions, see
            ``core.places.line_points.line_pose``.
        xi: (n,) place in the element.
        turns: (n, k, 9) rotations of the sections against the nodes; (n, 0, 9) for none.
    """

    element: int
    nodes: Int2D
    shape: Float3D
    xi: Float1D
    turns: Float3D


@inlined
def _gather(places: Places, n: int, frames: FloatArray, out: FloatArray) -> None:
    """Frames of the sections at the nodes of an element."""
    nodes, turns = places.nodes[n], places.turns[n]
    for i in range(nodes.size):
        for j in range(12):
            out[i, j] = frames[nodes[i], j]
    if turns.shape[0] > 0:
        turn_frames(out, turns, out)


@inlined
def _wrench(wrenches: Wrenches, n: int, point: FloatArray, factor: float, g: FloatArray) -> None:
    """Force and moment in the axes of the point."""
    force, moment = wrenches.forces[n], wrenches.moments[n]
    for i in range(3):
        if wrenches.follower[n]:
            g[i], g[3 + i] = factor * force[i], factor * moment[i]
        else:
            g[i], g[3 + i] = 0.0, 0.0
            for j in range(3):
                g[i] += factor * point[3 + 3 * j + i] * force[j]
                g[3 + i] += factor * point[3 + 3 * j + i] * moment[j]


@kernel
def add_line_forces(
    places: Memory, wrenches: Memory, nodes: Memory, factors: FloatArray, scale: float
) -> None:
    """Subtract ``scale * factors[load]`` times every wrench from the residuals of its nodes.

    Args:
        places: :class:`Places` that carry the points.
        wrenches: ``Wrenches``.
        nodes: ``Nodes`` of the block.
        factors: amplitudes of the loads.
        scale: see above.
    """
    at, own, state = unpack(Places, places), unpack(Wrenches, wrenches), unpack(Nodes, nodes)
    k, residual = at.nodes.shape[1], state.residual
    F, J = np.empty((k, 12)), np.empty((6, 6 * k + 1))
    H, g = np.empty(12), np.empty(6)
    for n in range(at.nodes.shape[0]):
        _gather(at, n, state.frames, F)
        line_jacobian(at.element, F, at.shape[n], at.xi[n], H, J)
        turn_columns(at.turns[n], J)
        offset_jacobian(own.offsets[n], J)
        compose_into(H, own.offsets[n], H)
        _wrench(own, n, H, scale * factors[own.load[n]], g)
        for a in range(k):
            for j in range(6):
                total = 0.0
                for i in range(6):
                    total += J[i, 6 * a + j] * g[i]
                residual[at.nodes[n, a], j] -= total


@inlined
def _back(offset: FloatArray, g: FloatArray, out: FloatArray) -> None:
    """The same wrench at the frame that carries the point."""
    for i in range(3):
        out[i], out[3 + i] = 0.0, 0.0
        for j in range(3):
            out[i] += offset[3 + 3 * i + j] * g[j]
            out[3 + i] += offset[3 + 3 * i + j] * g[3 + j]
    out[3] += offset[1] * out[2] - offset[2] * out[1]
    out[4] += offset[2] * out[0] - offset[0] * out[2]
    out[5] += offset[0] * out[1] - offset[1] * out[0]


@kernel
def line_force_tangent(
    places: Memory, wrenches: Memory, nodes: Memory, factors: FloatArray, scale: float,
    out: FloatArray,
) -> None:  # fmt: skip
    """Write the derivatives of :func:`add_line_forces` to ``out`` (n, 6k, 6k)."""
    at, own = unpack(Places, places), unpack(Wrenches, wrenches)
    frames = unpack(Nodes, nodes).frames
    k = at.nodes.shape[1]
    size = 6 * k
    F, J = np.empty((k, 12)), np.empty((6, size + 1))
    S, change = np.empty((size + 1, size + 1)), np.empty(6)
    H, g, carried = np.empty(12), np.empty(6), np.empty(6)
    for n in range(at.nodes.shape[0]):
        _gather(at, n, frames, F)
        line_jacobian(at.element, F, at.shape[n], at.xi[n], H, J)
        turn_columns(at.turns[n], J)
        offset_jacobian(own.offsets[n], J)
        compose_into(H, own.offsets[n], H)
        _wrench(own, n, H, -scale * factors[own.load[n]], g)
        _back(own.offsets[n], g, carried)
        S[:] = 0.0
        add_line_second(at.element, F, at.shape[n], at.xi[n], carried, S)
        turn_second(at.turns[n], S)
        for c in range(size):
            if not own.follower[n]:  # d(R^T f) = (R^T f) x theta
                for half in range(0, 6, 3):
                    for i in range(3):
                        p, q = (i + 1) % 3, (i + 2) % 3
                        change[half + i] = g[half + p] * J[3 + q, c] - g[half + q] * J[3 + p, c]
                for r in range(size):
                    for i in range(6):
                        S[r, c] += J[i, r] * change[i]
            for r in range(size):
                out[n, r, c] = S[r, c]


@kernel
def line_twists(
    places: Memory, frames: FloatArray, velocity: FloatArray, points: FloatArray, twists: FloatArray
) -> None:
    """Write frames (n, 12) and local twists (n, 6) of places in elements, offsets left out."""
    at = unpack(Places, places)
    k, nodes = at.nodes.shape[1], at.nodes
    F, J = np.empty((k, 12)), np.empty((6, 6 * k + 1))
    for n in range(nodes.shape[0]):
        _gather(at, n, frames, F)
        line_jacobian(at.element, F, at.shape[n], at.xi[n], points[n], J)
        turn_columns(at.turns[n], J)
        for i in range(6):
            twists[n, i] = 0.0
            for a in range(k):
                for j in range(6):
                    twists[n, i] += J[i, 6 * a + j] * velocity[nodes[n, a], j]


@kernel
def line_force_states(
    points: FloatArray, twists: FloatArray, wrenches: Memory, factors: FloatArray, out: FloatArray
) -> None:
    """Write force, moment, place and angular velocity of every wrench to ``out`` (n, 12).

    All are inertial components; ``points`` and ``twists`` are those of :func:`line_twists`.
    """
    own, H = unpack(Wrenches, wrenches), np.empty(12)
    forces, moments = own.forces, own.moments
    for n in range(points.shape[0]):
        factor, state, P = factors[own.load[n]], out[n], points[n]
        compose_into(P, own.offsets[n], H)
        for i in range(3):
            at = 3 + 3 * i
            state[6 + i] = H[i]
            state[9 + i] = 0.0
            state[i], state[3 + i] = factor * forces[n, i], factor * moments[n, i]
            for j in range(3):
                state[9 + i] += P[at + j] * twists[n, 3 + j]
            if own.follower[n]:
                state[i], state[3 + i] = 0.0, 0.0
                for j in range(3):
                    state[i] += factor * H[at + j] * forces[n, j]
                    state[3 + i] += factor * H[at + j] * moments[n, j]
