# SPDX-License-Identifier: LGPL-3.0-or-later
"""SE(3) beams of linear material over a step that conserves energy.

The physics is in ``flexfem.forms.beam_energy``; here is its data per cell and the calls of the
driver of kernels.
"""

from mpi4py import MPI

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.nodes.step_kernels import StepNodes
from flexfem.families.beam_se3.group import BeamGroup
from flexfem.forms.beam_energy import beam_energy_forms
from flexfem.kernels.driver import (
    ALL_COLUMNS,
    CellKernel,
    Nodal,
    add_forces,
    add_products,
    cell_kernel,
    evaluate,
    plain_cells,
)
from flexfem.kernels.form_kernels import compile_forms

__all__ = ["EnergyBeams"]

#: Nodal data of the forms in the record of the nodes.
_NODAL = {
    "position": (Nodal.POSITION, StepNodes.word("frames")),
    "rotation": (Nodal.ROTATION, StepNodes.word("frames")),
    "start_position": (Nodal.POSITION, StepNodes.word("frames0")),
    "start_rotation": (Nodal.ROTATION, StepNodes.word("frames0")),
    "increments": (Nodal.TWIST, StepNodes.word("increments")),
    "rates": (Nodal.TWIST, StepNodes.word("rates")),
    "start_rates": (Nodal.TWIST, StepNodes.word("rates0")),
    "centres": (Nodal.POSITION, StepNodes.word("centres")),
}
#: Columns of the change over the last step in the data of cells.
_LAST = slice(6, 12)
#: First column and number of columns of each of these data.
_OWN = {
    "relative_twist": (0, 6), "last_change": (6, 6), "length": (12, 1), "damping": (13, 1),
    "turn": (14, 18),
}  # fmt: skip
#: The same of the data of sections.
_SECTION = {"inertia": (0, 21), "stiffness": (21, 21)}


class EnergyBeams:
    """Mean forces of all beams of this rank over a step and their derivatives.

    Attributes:
        centres: (n, 3) mass centres of the sections at the nodes, node axes, m; the rates of a
            step are the centres'.
        offset: True if the centre of a cell differs, since its section is rotated relative to the
            node.
    """

    def __init__(self, comm: MPI.Intracomm, beams: BeamGroup, count: int) -> None:
        """Compile the kernels (collective) and prepare the cells at ``count`` nodes."""
        own, self._beams = beams.cells, beams
        # one row of rotations for all cells if none is rotated
        turns = np.broadcast_to(own.turns.reshape(-1, 2, 3, 3), (len(own.nodes), 2, 3, 3))
        centres = beams.centres[own.section]
        self.centres = np.zeros((count, 3))
        self.centres[own.nodes] = centres[:, np.newaxis]
        arms = np.einsum("csij,cj->csi", turns, centres) - self.centres[own.nodes]
        self.offset = bool(np.any(np.abs(arms) > 1e-12 * np.abs(beams.centres).max(initial=0.0)))
        last = np.zeros((len(own.nodes), 6))
        data = np.column_stack([own.own[:, :6], last, own.own[:, 6:], turns.reshape(-1, 18)])
        self._cells = plain_cells(data, own.nodes, section=own.section, sections=own.sections)
        kernels = compile_forms(comm, beam_energy_forms, (), {"residual": True, "tangent": False})

        def placed(form: str, size: int) -> CellKernel:
            return cell_kernel(kernels[form], size, kernels.names, _NODAL, _OWN, _SECTION)

        self._force, self._stiffness = placed("residual", 12), placed("tangent", 144)
        self._latest: FloatArray | None = None

    def begin(self, state: StepNodes, before: FloatArray, share: float) -> None:
        """See :class:`flexfem.layout.elements.StepForces`."""
        change = self._beams.twists(state.frames0) - self._beams.twists(before)
        self._cells.own[:, _LAST] = share * change

    def by_last(
        self, state: StepNodes, before: FloatArray, share: float, scale: float
    ) -> tuple[FloatArray, FloatArray]:
        """See :class:`flexfem.layout.elements.StepForces`; forces are linear in these strains."""
        own, count = self._cells.own, len(self._cells.nodes)
        kept, found = own[:, _LAST].copy(), np.empty((7, count, 12))
        for k, change in enumerate(np.eye(7, 6, -1)):
            own[:, _LAST] = change
            memories = self._force.memory, self._cells.memory, state.memory
            evaluate(*memories, _constants(state), found[k])
        own[:, _LAST] = kept
        slopes = share * scale * (found[1:] - found[0]).transpose(1, 2, 0)
        return (
            slopes @ self._beams.twist_derivatives(state.frames0),
            -slopes @ self._beams.twist_derivatives(before),
        )

    def exchange(self, state: StepNodes) -> None:
        """See :class:`flexfem.layout.elements.StepForces`."""
        self._cells.own[:, _LAST] *= -1.0

    def add_force(self, state: StepNodes, scale: float) -> None:
        """Add ``scale`` times the mean force over the step to the residual of the nodes."""
        self._latest = None
        memories = self._force.memory, self._cells.memory, state.memory
        add_forces(*memories, _constants(state), scale, state.residual)

    def add_action(self, state: StepNodes, scale: float) -> None:
        """See :class:`flexfem.layout.elements.StepForces`."""
        if self._latest is None:
            self._latest = self.tangent(state, 1.0).reshape(-1, 144)
        steps, forces = state.step, state.residual
        add_products(ALL_COLUMNS, self._cells.memory, self._latest, steps, scale, False, forces)

    def tangent(self, state: StepNodes, scale: float) -> FloatArray:
        """``scale`` times the derivatives (m, 12, 12) along local twists at the end."""
        values = np.empty((len(self._cells.nodes), 144))
        memories = self._stiffness.memory, self._cells.memory, state.memory
        evaluate(*memories, _constants(state), values)
        values *= scale
        return values.reshape(-1, 12, 12)


def _constants(state: StepNodes) -> FloatArray:
    """Constants of the kernels."""
    return np.concatenate([state.law, state.gravity])
