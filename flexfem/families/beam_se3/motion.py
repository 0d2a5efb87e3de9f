# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loops over beam cells for twists, energies and momenta.

The kinetic energy is that of ``forms.beam``: masses that move with the linear field of the inertial
velocities of the nodes' mass centres, the rotary inertia about these lumped at the nodes.
"""

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.core.nodes.frame_kernels import Nodes
from flexfem.core.nodes.motion import ANGULAR, KINETIC, add_motion, centre_into
from flexfem.kernels.compiled import inlined, kernel
from flexfem.kernels.driver import Cells
from flexfem.kernels.records import Memory, unpack
from flexfem.lie.se3 import compose_into, inverse_into, inverse_tangent_apply, log_into

__all__ = ["add_cell_motion", "cell_rates", "cell_twists"]


@inlined
def _section_frame(cells: Cells, c: int, side: int, frame: FloatArray, H: FloatArray) -> None:
    """Frame of the section at one end of a cell, from that of its node."""
    turned = cells.turned[c]
    Q = cells.turns[c * turned, side]
    for i in range(3):
        H[i] = frame[i]
        k = 3 + 3 * i
        for j in range(3):
            if turned:
                H[k + j] = frame[k] * Q[j] + frame[k + 1] * Q[3 + j] + frame[k + 2] * Q[6 + j]
            else:
                H[k + j] = frame[k + j]


@inlined
def _section_state(
    cells: Cells, c: int, side: int, nodes: Nodes, H: FloatArray, v: FloatArray
) -> None:
    """Frame and local twist of the section at one end of a cell."""
    node, turned = cells.nodes[c, side], cells.turned[c]
    Q, velocity = cells.turns[c * turned, side], nodes.velocity[node]
    _section_frame(cells, c, side, nodes.frames[node], H)
    for half in range(0, 6, 3):
        for i in range(3):
            if turned:
                v[half + i] = (
                    Q[i] * velocity[half]
                    + Q[3 + i] * velocity[half + 1]
                    + Q[6 + i] * velocity[half + 2]
                )
            else:
                v[half + i] = velocity[half + i]


@kernel
def add_cell_motion(
    cells: Memory, inertias: FloatArray, chosen: BoolArray, nodes: Memory, motion: FloatArray
) -> None:
    """Add energy and momenta of the chosen cells to ``motion``, see ``flexfem.core.nodes.motion``.

    Args:
        cells: ``Cells`` of a ``BeamGroup``.
        inertias: (s, 6, 6) of the sections per length.
        chosen: (m,).
        nodes: ``Nodes`` of the block.
        motion: see above.
    """
    own, state = unpack(Cells, cells), unpack(Nodes, nodes)
    H, v, p = np.empty(12), np.empty(6), np.empty(6)
    x, u = np.empty((2, 3)), np.empty((2, 3))
    for c in range(own.nodes.shape[0]):
        if not chosen[c]:
            continue
        M, length = inertias[own.section[c]], own.own[c, 6]
        for side in range(2):
            _section_state(own, c, side, state, H, v)
            add_motion(H, v, M, 0.5 * length, p, motion)
            centre_into(H, v, M, x[side], u[side])
        # from masses at the ends to masses along the line
        mass = M[0, 0] * length / 6.0
        for i in range(3):
            p[i] = u[1, i] - u[0, i]
            motion[KINETIC] -= 0.5 * mass * p[i] * p[i]
        for i in range(3):
            i1, i2 = (i + 1) % 3, (i + 2) % 3
            arm1, arm2 = x[0, i1] - x[1, i1], x[0, i2] - x[1, i2]
            motion[ANGULAR + i] += mass * (arm1 * p[i2] - arm2 * p[i1])


@kernel
def cell_twists(cells: Memory, chosen: IntArray, frames: FloatArray, twists: FloatArray) -> None:
    """Relative twists (k, 6) of the sections at both ends of the chosen (k,) cells."""
    own = unpack(Cells, cells)
    H0, H1, back, between = np.empty(12), np.empty(12), np.empty(12), np.empty(12)
    for k in range(chosen.size):
        c = chosen[k]
        _section_frame(own, c, 0, frames[own.nodes[c, 0]], H0)
        _section_frame(own, c, 1, frames[own.nodes[c, 1]], H1)
        inverse_into(H0, back)
        compose_into(back, H1, between)
        log_into(between, twists[k])


@kernel
def cell_rates(cells: Memory, twists: FloatArray, nodes: Memory, rates: FloatArray) -> None:
    """Rates (m, 6) of the relative twists (m, 6) of all cells."""
    own, state = unpack(Cells, cells), unpack(Nodes, nodes)
    H, v, minus, back = np.empty(12), np.empty(6), np.empty(6), np.empty(6)
    for c in range(own.nodes.shape[0]):
        for i in range(6):
            minus[i] = -twists[c, i]
        _section_state(own, c, 0, state, H, v)
        inverse_tangent_apply(minus, v, back)
        _section_state(own, c, 1, state, H, v)
        inverse_tangent_apply(twists[c], v, rates[c])
        for i in range(6):
            rates[c, i] -= back[i]
