# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled frames at points of surfaces as functions of nodal positions, with derivatives.

A point has the position ``x = sum N_I x_I`` with constant weights N_I, which are area coordinates
in a triangle and those of an interpolation along an edge. Its carrier has the axes

- of two sides ``a = sum p_I x_I`` and ``b = sum q_I x_I`` with constant weights whose sums vanish,
  by side alignment (Shi, Liu, Hong 2018): e1 along a, e3 along a x b, e2 = e3 x e1. Those of a
  triangle are ``a = x_1 - x_0`` and ``b = x_2 - x_0``; those of a patch of nodes are the images of
  two directions under the affine map fitted to its nodes, see ``layout.surface_places``; or
- inertial axes, where the nodes do not define a rotation.

With ``a = (l, 0, 0)`` and ``b = (b_1, b_2, 0)`` in these axes, and changes da and db of the sides
in the same axes, they rotate by
``theta = ((db_3 - b_1 da_3 / l) / b_2, -da_3 / l, da_2 / l) = sum W_I R^T dx_I``. Nodes have
frames: ``dx_I = R_I u_I`` with their local twists (u_I, theta_I), and rotations of nodes move
nothing.
"""

import numpy as np

from flexfem._types import FloatArray
from flexfem.kernels.compiled import inlined, on_demand, subroutine

__all__ = [
    "add_surface_second",
    "fixed_jacobian",
    "fixed_pose",
    "sides_jacobian",
    "sides_pose",
]


@inlined
def _position(frames: FloatArray, shape: FloatArray, H: FloatArray) -> None:
    for i in range(3):
        H[i] = 0.0
        for node in range(frames.shape[0]):
            H[i] += shape[node, 0] * frames[node, i]


@subroutine
def fixed_pose(frames: FloatArray, shape: FloatArray, H: FloatArray) -> None:
    """Frame (12,) of a point with inertial axes; arguments as in ``sides_pose``."""
    _position(frames, shape, H)
    for i in range(9):
        H[3 + i] = 1.0 if i % 4 == 0 else 0.0


@inlined
def _axes(frames: FloatArray, shape: FloatArray, H: FloatArray) -> tuple[float, float, float]:
    """Axes of two sides in ``H`` (12,); l, b_1 and b_2."""
    a0, a1, a2, b0, b1, b2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for node in range(frames.shape[0]):
        x0, x1, x2 = frames[node, 0], frames[node, 1], frames[node, 2]
        p, q = shape[node, 1], shape[node, 2]
        a0, a1, a2 = a0 + p * x0, a1 + p * x1, a2 + p * x2
        b0, b1, b2 = b0 + q * x0, b1 + q * x1, b2 + q * x2
    n0, n1, n2 = a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0
    side, area = np.sqrt(a0 * a0 + a1 * a1 + a2 * a2), np.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
    a0, a1, a2 = a0 / side, a1 / side, a2 / side
    n0, n1, n2 = n0 / area, n1 / area, n2 / area
    H[3], H[6], H[9] = a0, a1, a2
    H[4], H[7], H[10] = n1 * a2 - n2 * a1, n2 * a0 - n0 * a2, n0 * a1 - n1 * a0
    H[5], H[8], H[11] = n0, n1, n2
    return side, a0 * b0 + a1 * b1 + a2 * b2, area / side


@on_demand
def sides_pose(frames: FloatArray, shape: FloatArray, H: FloatArray) -> None:
    """Frame of a point with the axes of two sides.

    Args:
        frames: (k, 12) frames of the nodes, at least three.
        shape: (k, k) weights of the nodes in the point and in the two sides, in columns 0 to 2.
        H: (12,) result.
    """
    _position(frames, shape, H)
    _axes(frames, shape, H)


@inlined
def _back(frames: FloatArray, node: int, H: FloatArray, B: FloatArray) -> None:
    """``B = R^T R_I`` (3, 3)."""
    for i in range(3):
        for j in range(3):
            B[i, j] = (
                H[3 + i] * frames[node, 3 + j]
                + H[6 + i] * frames[node, 6 + j]
                + H[9 + i] * frames[node, 9 + j]
            )


@subroutine
def fixed_jacobian(frames: FloatArray, shape: FloatArray, H: FloatArray, J: FloatArray) -> None:
    """Frame of a point with inertial axes and its twist; arguments as in ``sides_jacobian``."""
    fixed_pose(frames, shape, H)
    J[:] = 0.0
    for node in range(frames.shape[0]):
        for i in range(3):
            for j in range(3):
                J[i, 6 * node + j] = shape[node, 0] * frames[node, 3 + 3 * i + j]


@on_demand
def sides_jacobian(frames: FloatArray, shape: FloatArray, H: FloatArray, J: FloatArray) -> None:
    """Frame ``H`` (12,) of a point with the axes of two sides, its local twist ``J`` (6, 6k + 1).

    The columns are those of the nodes' local twists; the last one is zero: the place is fixed. The
    other arguments are those of ``sides_pose``.
    """
    _position(frames, shape, H)
    side, b1, b2 = _axes(frames, shape, H)
    J[:] = 0.0
    B = np.empty((3, 3))
    for node in range(frames.shape[0]):
        _back(frames, node, H, B)
        p, q = shape[node, 1], shape[node, 2]
        for j in range(3):
            at = 6 * node + j
            for i in range(3):
                J[i, at] = shape[node, 0] * B[i, j]
            J[3, at] = (q - p * b1 / side) / b2 * B[2, j]
            J[4, at] = -p / side * B[2, j]
            J[5, at] = p / side * B[1, j]


@inlined
def _node_forces(
    shape: FloatArray, g: FloatArray, side: float, b1: float, b2: float, h: FloatArray
) -> None:
    """Forces ``h`` (k, 3) on the nodes in the axes of the point from force and moment ``g``."""
    along, first, second = g[5] / side, -(g[3] * b1 / b2 + g[4]) / side, g[3] / b2
    for node in range(h.shape[0]):
        for i in range(3):
            h[node, i] = shape[node, 0] * g[i]
        h[node, 1] += shape[node, 1] * along
        h[node, 2] += shape[node, 1] * first + shape[node, 2] * second


@inlined
def _side_changes(
    g: FloatArray, side: float, b1: float, b2: float, dl: float, db1: float, db2: float
) -> tuple[float, float, float]:
    """Changes of these forces with the sides: those along e2 and e3 of p, and along e3 of q."""
    along = -g[5] * dl / (side * side)
    slope = g[3] * b1 / b2
    first = -(g[3] * db1 / b2 - slope * db2 / b2) / side + (slope + g[4]) * dl / (side * side)
    second = -g[3] * db2 / (b2 * b2)
    return along, first, second


@inlined
def _add_turns(frames: FloatArray, forces: FloatArray, out: FloatArray) -> None:
    """Add the change of inertial ``forces`` (k, 3) in the axes of rotating nodes."""
    f = np.empty(3)
    for node in range(frames.shape[0]):
        for j in range(3):
            f[j] = 0.0
            for i in range(3):
                f[j] += frames[node, 3 + 3 * i + j] * forces[node, i]
        at = 6 * node
        for i in range(3):
            out[at + i, at + 3 + (i + 1) % 3] -= f[(i + 2) % 3]
            out[at + i, at + 3 + (i + 2) % 3] += f[(i + 1) % 3]


@on_demand
def add_surface_second(
    turning: bool, frames: FloatArray, shape: FloatArray, g: FloatArray, out: FloatArray
) -> None:
    """Add to ``out`` (6k + 1, 6k + 1) the derivative of ``J^T g`` at a constant ``g`` (6,).

    Args:
        turning: the axes are those of two sides, not inertial ones.
        frames: (k, 12) frames of the nodes.
        shape: (k, k) weights as in ``sides_pose``; with inertial axes those in the first column.
        g: force and moment at the point in its axes.
        out: result; columns are directions.
    """
    k = frames.shape[0]
    forces = np.empty((k, 3))
    if not turning:
        for node in range(k):
            for i in range(3):
                forces[node, i] = shape[node, 0] * g[i]
        _add_turns(frames, forces, out)
        return
    H, J, B = np.empty(12), np.empty((6, 6 * k + 1)), np.empty((3, 3))
    h, dh = np.empty((k, 3)), np.empty((k, 3))
    sides_jacobian(frames, shape, H, J)
    side, b1, b2 = _axes(frames, shape, H)
    _node_forces(shape, g, side, b1, b2, h)
    for node in range(k):
        for i in range(3):
            a = 3 + 3 * i
            forces[node, i] = H[a] * h[node, 0] + H[a + 1] * h[node, 1] + H[a + 2] * h[node, 2]
    _add_turns(frames, forces, out)
    for moved in range(k):
        _back(frames, moved, H, B)
        p, q = shape[moved, 1], shape[moved, 2]
        for j in range(3):
            c = 6 * moved + j
            w0, w1, w2 = J[3, c], J[4, c], J[5, c]
            db1, db2 = q * B[0, j] + w2 * b2, q * B[1, j] - w2 * b1
            along, first, second = _side_changes(g, side, b1, b2, p * B[0, j], db1, db2)
            for node in range(k):
                dh[node, 0] = w1 * h[node, 2] - w2 * h[node, 1]
                dh[node, 1] = w2 * h[node, 0] - w0 * h[node, 2] + shape[node, 1] * along
                dh[node, 2] = w0 * h[node, 1] - w1 * h[node, 0]
                dh[node, 2] += shape[node, 1] * first + shape[node, 2] * second
            _add_column(frames, H, dh, c, out)


@inlined
def _add_column(
    frames: FloatArray, H: FloatArray, dh: FloatArray, column: int, out: FloatArray
) -> None:
    """Add changes ``dh`` (k, 3) of forces in the axes of the point, carried to the nodes' axes."""
    B = np.empty((3, 3))
    for node in range(frames.shape[0]):
        _back(frames, node, H, B)
        for i in range(3):
            for j in range(3):
                out[6 * node + i, column] += B[j, i] * dh[node, j]
