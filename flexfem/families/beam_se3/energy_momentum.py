# SPDX-License-Identifier: LGPL-3.0-or-later
"""SE(3) beams of linear material over a step that conserves energy.

The physics is in ``flexfem.forms.beam_energy``; here is its data per cell and the calls of the
compiled loops.
"""

from mpi4py import MPI

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.nodes.step_kernels import StepNodes
from flexfem.families.beam_se3.energy_momentum_inertia import StepCells
from flexfem.families.beam_se3.energy_momentum_loops import add_force, add_tangent, relative_frames
from flexfem.families.beam_se3.group import BeamGroup
from flexfem.forms.beam_energy import beam_energy_forms
from flexfem.kernels.ffcx import compile_kernel
from flexfem.lie import se3

__all__ = ["EnergyBeams"]


class EnergyBeams:
    """Mean forces of all beams of this rank over a step and their derivatives.

    Attributes:
        centres: (n, 3) mass centres of the sections at the nodes, node axes, m; the rates of a
            step are the centres'.
        offset: a cell's centre lies elsewhere, since its section is turned against the node.
    """

    def __init__(self, comm: MPI.Intracomm, beams: BeamGroup, count: int) -> None:
        """Compile the kernels (collective) and prepare the cells at ``count`` nodes."""
        own = beams.cells
        constants, ends = np.zeros((len(own.nodes), 14)), np.zeros((len(own.nodes), 2, 16))
        constants[:, :6], constants[:, 12:] = own.own[:, :6], own.own[:, 6:]
        arms, rotary = _ends(beams)
        self.centres = np.zeros((count, 3))
        self.centres[own.nodes] = beams.centres[own.section][:, np.newaxis]
        arms -= self.centres[own.nodes]
        self.offset = bool(np.any(np.abs(arms) > 1e-12 * np.abs(beams.centres).max(initial=0.0)))
        ends[:, :, :3], ends[:, :, 7:] = arms, rotary.reshape(-1, 2, 9)
        forms = beam_energy_forms()
        coefficients = tuple(forms.coefficients.values())
        force = compile_kernel(comm, forms.residual, coefficients)
        stiffness = compile_kernel(comm, forms.tangent, coefficients)
        self._cells = StepCells(
            force=force.address, stiffness=stiffness.address, offsets=force.offsets,
            nodes=own.nodes, turned=own.turned, turns=own.turns, constants=constants,
            section=own.section, sections=own.sections, ends=ends,
        )  # fmt: skip

    def twists(self, frames: FloatArray) -> FloatArray:
        """Relative twists (m, 6) of all cells."""
        out = np.empty((len(self._cells.nodes), 12))
        relative_frames(self._cells.memory, frames, out)
        return se3.log(out)

    @property
    def last_change(self) -> FloatArray:
        """Change (m, 6) of the relative twists over the last step; to be written to."""
        return self._cells.constants[:, 6:12]

    def add_force(self, state: StepNodes, scale: float) -> None:
        """Add ``scale`` times the mean force over the step to the residual of the nodes."""
        add_force(self._cells.memory, state.memory, scale)

    def tangent(self, state: StepNodes, scale: float) -> FloatArray:
        """``scale`` times the derivatives (m, 12, 12) along local twists at the end."""
        values = np.empty((len(self._cells.nodes), 144))
        add_tangent(self._cells.memory, state.memory, scale, values)
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
