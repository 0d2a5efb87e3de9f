# SPDX-License-Identifier: LGPL-3.0-or-later
"""SE(3) beams of linear material over a step that conserves energy.

The physics is in ``flexfem.forms.beam_energy``; here is its data per cell and the calls of the
compiled loops.
"""

from dataclasses import dataclass

from mpi4py import MPI

import numpy as np

from flexfem._types import FloatArray
from flexfem.elements.beam_group import BeamGroup
from flexfem.elements.energy_loops import add_force, add_tangent, relative_frames
from flexfem.forms.beam_energy import beam_energy_forms
from flexfem.la.kernel import compile_kernel
from flexfem.lie import se3

__all__ = ["EnergyBeams", "StepState"]


@dataclass
class StepState:
    """What the loops over a step read of the nodes of one block.

    Attributes:
        frames0, frames: (n, 12) at both ends of the step.
        increments: (n, 6) translation in inertial axes and Cayley vector.
        rates0, rates: (n, 6) inertial velocity of the centre and local angular velocity.
        gravity: (3,) in inertial axes, m/s^2.
        law: (3,) half the dissipation, 1/h and the change of rates with increments.
    """

    frames0: FloatArray
    frames: FloatArray
    increments: FloatArray
    rates0: FloatArray
    rates: FloatArray
    gravity: FloatArray
    law: FloatArray


class EnergyBeams:
    """Mean forces of all beams of this rank over a step and their derivatives.

    Attributes:
        centres: (n, 3) mass centres of the sections at the nodes, node axes, m; the rates of a
            step are the centres'.
        offset: a cell's centre lies elsewhere, since its section is turned against the node.
    """

    def __init__(self, comm: MPI.Intracomm, beams: BeamGroup, count: int) -> None:
        """Compile the kernels (collective) and prepare the cells at ``count`` nodes."""
        cells, sections = beams.cells.nodes, beams.cells.section
        self._cells = (cells, beams.cells.turned, beams.cells.turns)
        self._sections, self._laws = sections, beams.cells.sections
        self._constants = np.zeros((len(cells), 14))
        own = beams.cells.own
        self._constants[:, :6], self._constants[:, 12:] = own[:, :6], own[:, 6:]
        arms, rotary = _ends(beams)
        self.centres = np.zeros((count, 3))
        self.centres[cells] = beams.centres[sections][:, np.newaxis]
        arms -= self.centres[cells]
        self.offset = bool(np.any(np.abs(arms) > 1e-12 * np.abs(beams.centres).max(initial=0.0)))
        self._lumps = np.concatenate([arms, rotary.reshape(-1, 2, 9)], axis=2)
        forms = beam_energy_forms()
        coefficients = tuple(forms.coefficients.values())
        self._force = compile_kernel(comm, forms.residual, coefficients)
        self._tangent = compile_kernel(comm, forms.tangent, coefficients)

    def twists(self, frames: FloatArray) -> FloatArray:
        """Relative twists (m, 6) of all cells."""
        out = np.empty((len(self._constants), 12))
        relative_frames(*self._cells, frames, out)
        return se3.log(out)

    @property
    def last_change(self) -> FloatArray:
        """Change (m, 6) of the relative twists over the last step; to be written to."""
        return self._constants[:, 6:12]

    def add_force(self, state: StepState, scale: float, residual: FloatArray) -> None:
        """Add ``scale`` times the mean force over the step to the residual (n, 6)."""
        add_force(
            self._force.address, self._force.offsets, state.law, *self._cells, self._constants,
            self._sections, self._laws, self._lumps, self.centres, state.frames0, state.frames,
            state.rates0, state.rates, state.gravity, scale, residual,
        )  # fmt: skip

    def tangent(self, state: StepState, scale: float) -> FloatArray:
        """``scale`` times the derivatives (m, 12, 12) along local twists at the end."""
        values = np.empty((len(self._constants), 144))
        add_tangent(
            self._force.address, self._tangent.address, self._force.offsets, state.law,
            *self._cells, self._constants, self._sections, self._laws, self._lumps, self.centres,
            state.frames0, state.frames, state.increments, state.rates0, state.rates,
            state.gravity, scale, values,
        )  # fmt: skip
        return values.reshape(-1, 12, 12)


def _ends(beams: BeamGroup) -> tuple[FloatArray, FloatArray]:
    """Of the ends of all cells, in node axes: mass centre (m, 2, 3), rotary inertia (m, 2, 3, 3).

    The latter is about the centre, and that of half a cell.
    """
    own, lengths = beams.cells, beams.lengths
    cells, turned, turns, sections = own.nodes, own.turned, own.turns, own.section
    at = np.where(turned, np.arange(len(cells)), 0)
    Q = turns.reshape(-1, 2, 3, 3)[at]
    half = 0.5 * lengths[:, np.newaxis, np.newaxis] * beams.rotary[sections]
    arms = np.einsum("csij,cj->csi", Q, beams.centres[sections])
    return arms, np.einsum("csij,cjk,cslk->csil", Q, half, Q)
