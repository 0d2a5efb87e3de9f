# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loops over pairs of nodes of director shells: matrices, inertia, momenta.

The inertia is that of ``families.beam_nurbs.inertia``: masses ``m_IJ`` that move with the inertial
velocities of the nodes, constant, and rods that rotate with the directors, lumped at the midpoints
of the edges.
"""

import numpy as np

from flexfem._types import BoolArray, FloatArray, IndexArray
from flexfem.core.nodes.frame_kernels import Nodes
from flexfem.core.nodes.motion import ANGULAR, FIRST, KINETIC, LINEAR, MASS
from flexfem.families.beam_nurbs.inertia import NodalMasses, nodal_tangent
from flexfem.kernels.compiled import kernel
from flexfem.kernels.records import Float1D, Int1D, Memory, Record, unpack

__all__ = ["PairMasses", "add_inertia_blocks", "add_motion", "add_turns"]


class PairMasses(Record):
    """Consistent masses summed up for pairs of nodes.

    Attributes:
        rows, columns: (k,) nodes of each pair.
        diagonal: (n,) pair of each node with itself.
        masses: (k,) kg.
    """

    rows: Int1D
    columns: Int1D
    diagonal: Int1D
    masses: Float1D


@kernel
def add_inertia_blocks(
    masses: Memory, pairs: Memory, state: Memory, gravity: FloatArray, rates: FloatArray,
    factors: FloatArray, blocks: FloatArray,
) -> None:  # fmt: skip
    """Add ``s`` times the derivatives of inertia forces less weights to blocks (k, 6, 6).

    ``pairs`` are :class:`PairMasses`; see ``families.beam_nurbs.inertia.add_inertia_tangent`` for
    the rest.
    """
    of, between = unpack(NodalMasses, masses), unpack(PairMasses, pairs)
    nodes = unpack(Nodes, state)
    frames, rows, columns = nodes.frames, between.rows, between.columns
    scale, diagonal = factors[1], between.diagonal
    moved, own = np.zeros((len(frames), 3, 6)), np.zeros((len(of.nodes), 6, 6))
    nodal_tangent(of, nodes, gravity, rates, factors[0], moved, own)
    for k in range(len(rows)):
        mass = scale * between.masses[k]
        if mass == 0.0:
            continue
        H, P = frames[rows[k]], moved[columns[k]]
        for i in range(3):
            for j in range(6):
                turned = H[3 + i] * P[0, j] + H[6 + i] * P[1, j] + H[9 + i] * P[2, j]
                blocks[k, i, j] += mass * turned
    for u in range(len(of.nodes)):
        to = blocks[diagonal[of.nodes[u]]]
        for i in range(6):
            for j in range(6):
                to[i, j] += scale * own[u, i, j]


@kernel
def add_motion(
    cells: IndexArray, masses: FloatArray, rods: FloatArray, chosen: BoolArray, frames: FloatArray,
    velocity: FloatArray, motion: FloatArray,
) -> None:  # fmt: skip
    """Add energy and momenta of chosen triangles (m,), see ``flexfem.core.nodes.motion``.

    ``cells`` (m, 9) are their nodes, as in ``loops``.
    """
    v, p, x, spin = np.empty((6, 3)), np.empty(3), np.empty(3), np.empty(3)
    for m in range(len(cells)):
        if not chosen[m]:
            continue
        for i in range(6):
            H, w = frames[cells[m, i]], velocity[cells[m, i]]
            for a in range(3):
                j = 3 + 3 * a
                v[i, a] = H[j] * w[0] + H[j + 1] * w[1] + H[j + 2] * w[2]
        for i in range(6):
            p[:], x[:] = 0.0, 0.0
            for j in range(6):
                motion[MASS] += masses[m, i, j]
                for a in range(3):
                    p[a] += masses[m, i, j] * v[j, a]
                    x[a] += masses[m, i, j] * frames[cells[m, j], a]
            H = frames[cells[m, i]]
            for a in range(3):
                b, c = (a + 1) % 3, (a + 2) % 3
                motion[KINETIC] += 0.5 * v[i, a] * p[a]
                motion[FIRST + a] += x[a]
                motion[LINEAR + a] += p[a]
                motion[ANGULAR + a] += H[b] * p[c] - H[c] * p[b]
        for k in range(3):
            H, w = frames[cells[m, 6 + k]], velocity[cells[m, 6 + k]]
            for a in range(3):
                spin[a] = 0.0
                for b in range(3):
                    spin[a] += rods[m, k, a, b] * w[3 + b]
                motion[KINETIC] += 0.5 * w[3 + a] * spin[a]
            for a in range(3):
                j = 3 + 3 * a
                motion[ANGULAR + a] += H[j] * spin[0] + H[j + 1] * spin[1] + H[j + 2] * spin[2]


@kernel
def add_turns(cells: IndexArray, start: FloatArray, frames: FloatArray, sums: FloatArray) -> None:
    """Add the rotations since the start of nodes with directors to the corners nearby (n, 9)."""
    for m in range(len(cells)):
        for k in range(3):
            H, G = frames[cells[m, 6 + k]], start[cells[m, 6 + k]]
            for i in range(3):
                if i == k:
                    continue
                to = sums[cells[m, i]]
                for a in range(3):
                    for b in range(3):
                        for c in range(3):
                            to[3 * a + b] += H[3 + 3 * a + c] * G[3 + 3 * b + c]
