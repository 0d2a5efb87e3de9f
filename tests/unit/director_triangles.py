# SPDX-License-Identifier: LGPL-3.0-or-later
"""Meshes, matrices and Newton's method for the tests of director shells."""

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import spsolve
from scipy.spatial.transform import Rotation

from flexfem.families.shell_director.triangles import DirectorTriangles


def quadratic(points, triangles):
    """Points with the midside nodes, nodes (m, 6) of the triangles, and nodes of the edges."""
    sides = np.stack([np.roll(triangles, -1, 1), np.roll(triangles, -2, 1)], 2).reshape(-1, 2)
    edges, number = np.unique(np.sort(sides, 1), axis=0, return_inverse=True)
    nodes = np.concatenate([triangles, len(points) + number.reshape(-1, 3)], 1)
    return np.concatenate([points, points[edges].mean(1)]), nodes, edges


def upright(places, normals=None):
    """Frames (n, 12) at places (n, 3) with e3 along the normals, e_z without."""
    turns = np.tile(np.eye(3), (len(places), 1, 1))
    if normals is not None:
        e3 = normals / np.linalg.norm(normals, axis=1)[:, None]
        e1 = np.cross(np.eye(3)[np.argmin(abs(e3), 1)], e3)
        e1 /= np.linalg.norm(e1, axis=1)[:, None]
        turns = np.stack([e1, np.cross(e3, e1), e3], 2)
    return np.concatenate([places, turns.reshape(-1, 9)], 1)


def moved(frames, steps):
    """Frames after local twists (n, 6)."""
    turns = frames[:, 3:].reshape(-1, 3, 3)
    places = frames[:, :3] + np.einsum("nij,nj->ni", turns, steps[:, :3])
    turned = turns @ Rotation.from_rotvec(steps[:, 3:]).as_matrix()
    return np.concatenate([places, turned.reshape(-1, 9)], 1)


def rigidly(frames, turn, shift):
    """Frames moved as one body."""
    turns = turn @ frames[:, 3:].reshape(-1, 3, 3)
    return np.concatenate([frames[:, :3] @ turn.T + shift, turns.reshape(-1, 9)], 1)


def forces(made: DirectorTriangles, frames):
    """Internal forces (n, 6)."""
    residual = np.zeros((len(frames), 6))
    made.add_forces(frames, residual)
    return residual


def sparse_tangent(made: DirectorTriangles, frames, starts=None):
    """Tangent (6 n, 6 n)."""
    matrices = made.tangents(frames, starts=starts)
    moves, turns = 6 * made.nodes[:, :6, None], 6 * made.nodes[:, 6:, None] + 3
    places = np.concatenate([moves, turns], 1) + np.arange(3)
    places = places.reshape(-1, 27)
    rows, columns = np.broadcast_arrays(places[:, :, None], places[:, None, :])
    entries = (matrices.ravel(), (rows.ravel(), columns.ravel()))
    return sp.csr_matrix(entries, shape=(6 * len(frames),) * 2)


def flat_held(count, corners):
    """Unknowns (count, 6) without stiffness: rotations of the corners, drilling."""
    held = np.zeros((count, 6), dtype=bool)
    held[:corners, 3:] = True
    held[corners:, 5] = True
    return held


def equilibrium(made, frames, load, held, steps, tolerance=1e-8, iterations=30):
    """Frames under inertial forces ``load`` (n, 3), by Newton's method in equal steps at first.

    Steps that do not converge are halved. Held unknowns (n, 6) stay.
    """
    free, done, step = np.flatnonzero(~held), 0.0, 1.0 / steps
    while done < 1.0 - 1e-12:
        step = min(step, 1.0 - done)
        found = _newton(made, frames, (done + step) * load, free, tolerance, iterations)
        if found is None:
            step /= 2
            assert step > 1e-4, f"no equilibrium beyond {done}"
        else:
            frames, done = found, done + step
    return frames


def _newton(made, frames, load, free, tolerance, iterations):
    """Equilibrium, None if there is none nearby.

    The tangents take stresses continued linearly from the iteration before (Magisano, Leonetti,
    Garcea, Int. J. Numer. Methods Eng. 109 (2017) 1237-1262), which allows far larger steps.
    """
    starts = None
    for _ in range(iterations):
        turns = frames[:, 3:].reshape(-1, 3, 3)
        pull = np.einsum("nba,nb->na", turns, load)
        residual = forces(made, frames)
        residual[:, :3] -= pull
        K = sparse_tangent(made, frames, starts) + _turning(pull)
        step = np.zeros(frames.shape[0] * 6)
        step[free] = spsolve(K[free][:, free].tocsc(), -residual.ravel()[free])
        step = step.reshape(-1, 6)
        if not abs(step[:, 3:]).max() < 3.0:
            return None
        assumed = made.changes(frames) + made.rates(frames, step)
        frames = moved(frames, step)
        starts = made.starts + made.changes(frames) - assumed
        if abs(step).max() < tolerance:
            return frames
    return None


def _turning(pull):
    """Derivative of dead loads in local axes with the rotation of the nodes."""
    blocks = np.zeros((len(pull), 6, 6))
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        blocks[:, a, 3 + b], blocks[:, a, 3 + c] = pull[:, c], -pull[:, b]
    count = np.arange(len(pull) + 1)
    return sp.bsr_matrix((blocks, count[:-1], count), shape=(6 * len(pull),) * 2).tocsr()
