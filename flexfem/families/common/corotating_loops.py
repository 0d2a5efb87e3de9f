# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loops over the nodes of shells, whose translations are counted in corotating axes.

The axes of a node rotate with the shell around it from step to step, so that the matrices of a
shell in motion change little. Sums over triangles are made in inertial axes and rotated into the
axes of each node.
"""

import numpy as np

from flexfem._types import BoolArray, FloatArray, IndexArray, IntArray
from flexfem.kernels.compiled import inlined, kernel

__all__ = [
    "add_blocks",
    "add_consistent_inertia",
    "add_consistent_masses",
    "add_lumped_inertia",
    "add_lumped_masses",
    "add_motion",
    "add_rotations",
    "add_to_nodes",
    "inertial_into",
    "positions_into",
    "turn_blocks",
    "turn_nodes",
]

#: Iterations of a polar decomposition, which doubles the digits in each, and the change after which
#: none is left to be found: half of its square remains.
_POLAR, _SAME = 30, 1e-8


@kernel
def positions_into(frames: FloatArray, points: FloatArray) -> None:
    """Positions (n, 3) of frames (n, 12)."""
    for i in range(len(frames)):
        for a in range(3):
            points[i, a] = frames[i, a]


@kernel
def inertial_into(frames: FloatArray, vectors: FloatArray, out: FloatArray) -> None:
    """Inertial components (n, 3) of vectors (n, 6) in node axes, of which the first three count."""
    for i in range(len(frames)):
        for a in range(3):
            r0, r1, r2 = frames[i, 3 + 3 * a], frames[i, 4 + 3 * a], frames[i, 5 + 3 * a]
            out[i, a] = r0 * vectors[i, 0] + r1 * vectors[i, 1] + r2 * vectors[i, 2]


@kernel
def add_to_nodes(
    frames: FloatArray, forces: FloatArray, scale: float, residual: FloatArray
) -> None:
    """Add ``scale`` times inertial forces (n, 3) to residuals (n, 6) in node axes."""
    for i in range(len(frames)):
        for a in range(3):
            residual[i, a] += scale * (
                frames[i, 3 + a] * forces[i, 0]
                + frames[i, 6 + a] * forces[i, 1]
                + frames[i, 9 + a] * forces[i, 2]
            )


@kernel
def add_lumped_inertia(
    masses: FloatArray, frames: FloatArray, acceleration: FloatArray, gravity: FloatArray,
    scale: float, residual: FloatArray,
) -> None:  # fmt: skip
    """Add ``scale m (a - R^T g)`` of all nodes with masses (n,)."""
    for i in range(len(masses)):
        for a in range(3):
            weight = (
                frames[i, 3 + a] * gravity[0]
                + frames[i, 6 + a] * gravity[1]
                + frames[i, 9 + a] * gravity[2]
            )
            residual[i, a] += scale * masses[i] * (acceleration[i, a] - weight)


@kernel
def add_consistent_inertia(
    triangles: IndexArray, masses: FloatArray, acceleration: FloatArray, gravity: FloatArray,
    forces: FloatArray,
) -> None:  # fmt: skip
    """Add inertia and weight of triangles of masses (m,) to inertial forces (n, 3).

    ``acceleration`` (n, 3) is inertial and interpolated linearly.
    """
    for m in range(len(triangles)):
        for a in range(3):
            total = -4.0 * gravity[a]
            for k in range(3):
                total += acceleration[triangles[m, k], a]
            for k in range(3):
                to = triangles[m, k]
                forces[to, a] += masses[m] / 12.0 * (total + acceleration[to, a])


@kernel
def add_blocks(tangents: FloatArray, index: IndexArray, first: int, blocks: FloatArray) -> None:
    """Add matrices (r, 3 p, 3 p) to those (k, 3, 3) of pairs of nodes.

    ``index`` (m, p, p) are the numbers of the pairs, -1 for missing nodes; that of the first matrix
    is at ``first``.
    """
    count = index.shape[1]
    for m in range(len(tangents)):
        K, at = tangents[m], index[first + m]
        for i in range(count):
            for j in range(count):
                to = at[i, j]
                if to >= 0:
                    for a in range(3):
                        for b in range(3):
                            blocks[to, a, b] += K[3 * i + a, 3 * j + b]


@kernel
def add_consistent_masses(
    masses: FloatArray, index: IndexArray, factor: float, blocks: FloatArray
) -> None:
    """Add ``factor`` times the mass matrices of triangles, linear velocities, to blocks."""
    for m in range(len(masses)):
        for i in range(3):
            for j in range(3):
                value = factor * masses[m] / (6.0 if i == j else 12.0)
                for a in range(3):
                    blocks[index[m, i, j], a, a] += value


@kernel
def turn_blocks(
    rows: IndexArray, columns: IndexArray, frames: FloatArray, blocks: FloatArray
) -> None:
    """``R_i^T K R_j`` of the matrices (k, 3, 3) of pairs of nodes, in place."""
    T = np.empty((3, 3))
    for k in range(len(rows)):
        R, Q, K = frames[rows[k]], frames[columns[k]], blocks[k]
        for a in range(3):
            for b in range(3):
                T[a, b] = K[a, 0] * Q[3 + b] + K[a, 1] * Q[6 + b] + K[a, 2] * Q[9 + b]
        for a in range(3):
            for b in range(3):
                K[a, b] = R[3 + a] * T[0, b] + R[6 + a] * T[1, b] + R[9 + a] * T[2, b]


@kernel
def add_lumped_masses(
    masses: FloatArray, factor: float, diagonal: IntArray, blocks: FloatArray
) -> None:
    """Add ``factor`` times masses (n,) to the blocks that ``diagonal`` (n,) numbers."""
    for i in range(len(masses)):
        for a in range(3):
            blocks[diagonal[i], a, a] += factor * masses[i]


@kernel
def add_motion(
    triangles: IndexArray, masses: FloatArray, consistent: BoolArray, chosen: BoolArray,
    points: FloatArray, velocities: FloatArray, motion: FloatArray,
) -> None:  # fmt: skip
    """Add energy and momenta of chosen triangles (m,), see ``flexfem.core.nodes.motion``."""
    x, v = np.empty(3), np.empty(3)
    for m in range(len(triangles)):
        if not chosen[m]:
            continue
        # consistent: sum over nodes, and once more for their sum, of a twelfth; lumped: of a third
        own = masses[m] / (12.0 if consistent[m] else 3.0)
        x[:] = 0.0
        v[:] = 0.0
        for k in range(3):
            node = triangles[m, k]
            _add_point(own, points[node], velocities[node], motion)
            for a in range(3):
                x[a] += points[node, a]
                v[a] += velocities[node, a]
        if consistent[m]:
            _add_point(own, x, v, motion)
        motion[1] += masses[m]
        for a in range(3):
            motion[2 + a] += masses[m] / 3.0 * x[a] if consistent[m] else own * x[a]
            motion[5 + a] += masses[m] / 3.0 * v[a] if consistent[m] else own * v[a]


@inlined
def _add_point(mass: float, x: FloatArray, v: FloatArray, motion: FloatArray) -> None:
    """Add kinetic energy and angular momentum of a point."""
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        motion[0] += 0.5 * mass * v[a] * v[a]
        motion[8 + a] += mass * (x[b] * v[c] - x[c] * v[b])


@kernel
def add_rotations(
    triangles: IndexArray, gradients: FloatArray, areas: FloatArray, axes: FloatArray,
    points: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    """Add the rotations of triangles since the start, times their areas, to their nodes (n, 9).

    Args:
        triangles: own nodes in the first three columns.
        gradients: (m, 2, 3) derivatives of the shape functions.
        areas: (m,) areas at the start, m^2.
        axes: (m, 3, 3) axes at the start, as rows.
        points: (n, 3) present positions.
        out: sums.
    """
    for m in range(len(triangles)):
        t0 = t1 = t2 = b0 = b1 = b2 = 0.0
        for k in range(3):
            x, c, d = points[triangles[m, k]], gradients[m, 0, k], gradients[m, 1, k]
            t0, t1, t2 = t0 + c * x[0], t1 + c * x[1], t2 + c * x[2]
            b0, b1, b2 = b0 + d * x[0], b1 + d * x[1], b2 + d * x[2]
        over = 1.0 / np.sqrt(t0 * t0 + t1 * t1 + t2 * t2)
        t0, t1, t2 = over * t0, over * t1, over * t2
        along = t0 * b0 + t1 * b1 + t2 * b2
        b0, b1, b2 = b0 - along * t0, b1 - along * t1, b2 - along * t2
        over = 1.0 / np.sqrt(b0 * b0 + b1 * b1 + b2 * b2)
        b0, b1, b2 = over * b0, over * b1, over * b2
        n0, n1, n2 = t1 * b2 - t2 * b1, t2 * b0 - t0 * b2, t0 * b1 - t1 * b0
        A, size = axes[m], areas[m]
        for j in range(3):
            c, d, e = size * A[0, j], size * A[1, j], size * A[2, j]
            x, y, z = c * t0 + d * b0 + e * n0, c * t1 + d * b1 + e * n1, c * t2 + d * b2 + e * n2
            for k in range(3):
                row = out[triangles[m, k]]
                row[j] += x
                row[3 + j] += y
                row[6 + j] += z


@inlined
def _polar(M: FloatArray, R: FloatArray, X: FloatArray) -> bool:
    """Rotation (9,) nearest to a matrix (9,), by Newton's iteration; False if it has none.

    Higham, SIAM J. Sci. Stat. Comput. 7 (1986) 1160. ``X`` (9,) is work space.
    """
    total = 0.0
    for k in range(9):
        total += M[k] * M[k]
    size = np.sqrt(total / 3.0)
    if not size > 0.0:
        return False
    for k in range(9):
        R[k] = M[k] / size
    for _ in range(_POLAR):
        for i in range(3):
            p, q = (i + 1) % 3, (i + 2) % 3
            for j in range(3):
                r, s = (j + 1) % 3, (j + 2) % 3
                X[3 * i + j] = R[3 * p + r] * R[3 * q + s] - R[3 * p + s] * R[3 * q + r]
        determinant = R[0] * X[0] + R[1] * X[1] + R[2] * X[2]
        if not determinant > 1e-6:
            return False
        change, half = 0.0, 0.5 / determinant
        for k in range(9):
            new = 0.5 * R[k] + half * X[k]
            change = max(change, abs(new - R[k]))
            R[k] = new
        if change < _SAME:
            break
    return True


@kernel
def turn_nodes(
    sums: FloatArray, start: FloatArray, fixed: BoolArray, frames0: FloatArray, frames: FloatArray,
    velocity: FloatArray, acceleration: FloatArray,
) -> None:  # fmt: skip
    """Rotate the axes of nodes by the rotation of the shell around them, save those fixed (n,).

    Args:
        sums: (n, 9) of ``add_rotations``; where they determine no rotation, the axes stay.
        start: (n, 12) frames at the start.
        fixed: (n,) nodes whose axes stay.
        frames0: (n, 12) accepted frames; frames: (n, 12) trial ones.
        frames: (n, 12) trial frames.
        velocity: (n, 6) in node axes, of which the first three are rotated into the new axes;
            acceleration likewise.
        acceleration: (n, 6).
    """
    R, X, Q, T = np.empty(9), np.empty(9), np.empty(9), np.empty(9)
    v = np.empty(3)
    for n in range(len(frames)):
        if fixed[n] or not _polar(sums[n], R, X):
            continue
        H = frames[n]
        for i in range(3):
            for j in range(3):
                Q[3 * i + j] = 0.0
                for k in range(3):
                    Q[3 * i + j] += R[3 * i + k] * start[n, 3 + 3 * k + j]
        # from the old to the new axes: T = Q^T H
        for i in range(3):
            for j in range(3):
                T[3 * i + j] = Q[i] * H[3 + j] + Q[3 + i] * H[6 + j] + Q[6 + i] * H[9 + j]
        for vectors in (velocity, acceleration):
            for i in range(3):
                v[i] = (
                    T[3 * i] * vectors[n, 0] + T[3 * i + 1] * vectors[n, 1]
                    + T[3 * i + 2] * vectors[n, 2]
                )  # fmt: skip
            for i in range(3):
                vectors[n, i] = v[i]
        for k in range(9):
            H[3 + k] = Q[k]
            frames0[n, 3 + k] = Q[k]
