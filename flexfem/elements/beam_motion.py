# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loops over beam cells for twists, energies and momenta.

The kinetic energy is that of ``forms.beam``: masses that move with the linear field of the inertial
velocities of the nodes' mass centres, the rotary inertia about these lumped at the nodes.
"""

import numpy as np

from flexfem._types import BoolArray, FloatArray, IndexArray, IntArray
from flexfem.core.motion import ANGULAR, KINETIC, add_motion, centre_into
from flexfem.lie.compiled import inlined, kernel
from flexfem.lie.se3 import compose_into, inverse_into, inverse_tangent_apply, log_into

__all__ = ["add_cell_motion", "cell_rates", "cell_twists"]


@inlined
def _section_frame(frame: FloatArray, turned: bool, Q: FloatArray, H: FloatArray) -> None:
    """Frame of the section at one end of a cell; ``Q`` (9,) turns it."""
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
    frame: FloatArray, velocity: FloatArray, turned: bool, Q: FloatArray, H: FloatArray,
    v: FloatArray,
) -> None:  # fmt: skip
    """Frame and local twist of the section at one end of a cell; ``Q`` (9,) turns it."""
    _section_frame(frame, turned, Q, H)
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
    cells: IndexArray, chosen: BoolArray, turned: BoolArray, turns: FloatArray,
    lengths: FloatArray, sections: IntArray, inertias: FloatArray, frames: FloatArray,
    velocity: FloatArray, motion: FloatArray,
) -> None:  # fmt: skip
    """Add energy and momenta of the chosen cells to ``motion``, see ``flexfem.core.motion``."""
    H, v, p = np.empty(12), np.empty(6), np.empty(6)
    x, u = np.empty((2, 3)), np.empty((2, 3))
    for c in range(cells.shape[0]):
        if not chosen[c]:
            continue
        M, turn = inertias[sections[c]], c * turned[c]
        for side in range(2):
            node = cells[c, side]
            _section_state(frames[node], velocity[node], turned[c], turns[turn, side], H, v)
            add_motion(H, v, M, 0.5 * lengths[c], p, motion)
            centre_into(H, v, M, x[side], u[side])
        # from masses at the ends to masses along the line
        mass = M[0, 0] * lengths[c] / 6.0
        for i in range(3):
            p[i] = u[1, i] - u[0, i]
            motion[KINETIC] -= 0.5 * mass * p[i] * p[i]
        for i in range(3):
            i1, i2 = (i + 1) % 3, (i + 2) % 3
            arm1, arm2 = x[0, i1] - x[1, i1], x[0, i2] - x[1, i2]
            motion[ANGULAR + i] += mass * (arm1 * p[i2] - arm2 * p[i1])


@kernel
def cell_twists(
    chosen: IntArray, cells: IndexArray, turned: BoolArray, turns: FloatArray, frames: FloatArray,
    twists: FloatArray,
) -> None:  # fmt: skip
    """Relative twists (k, 6) of the sections at both ends of the chosen (k,) cells."""
    H0, H1, back, between = np.empty(12), np.empty(12), np.empty(12), np.empty(12)
    for k in range(chosen.size):
        c = chosen[k]
        turn = c * turned[c]
        _section_frame(frames[cells[c, 0]], turned[c], turns[turn, 0], H0)
        _section_frame(frames[cells[c, 1]], turned[c], turns[turn, 1], H1)
        inverse_into(H0, back)
        compose_into(back, H1, between)
        log_into(between, twists[k])


@kernel
def cell_rates(
    cells: IndexArray, turned: BoolArray, turns: FloatArray, twists: FloatArray,
    frames: FloatArray, velocity: FloatArray, rates: FloatArray,
) -> None:  # fmt: skip
    """Rates (m, 6) of the relative twists (m, 6) of all cells."""
    H, v, minus, back = np.empty(12), np.empty(6), np.empty(6), np.empty(6)
    for c in range(cells.shape[0]):
        turn = c * turned[c]
        for i in range(6):
            minus[i] = -twists[c, i]
        node = cells[c, 0]
        _section_state(frames[node], velocity[node], turned[c], turns[turn, 0], H, v)
        inverse_tangent_apply(minus, v, back)
        node = cells[c, 1]
        _section_state(frames[node], velocity[node], turned[c], turns[turn, 1], H, v)
        inverse_tangent_apply(twists[c], v, rates[c])
        for i in range(6):
            rates[c, i] -= back[i]
