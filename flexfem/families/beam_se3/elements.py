# SPDX-License-Identifier: LGPL-3.0-or-later
"""The family of SE(3) beams: all beams of a model on one interval mesh.

The physics is in ``flexfem.forms.beam``. Cells are grouped by material; each group has kernels of
its own, and one call of a compiled loop treats all its cells.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from mpi4py import MPI

import numpy as np

from flexfem._types import BoolArray, FloatArray, IndexArray, IntArray
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.families.beam_se3.energy_momentum import EnergyBeams
from flexfem.families.beam_se3.group import BeamCells, BeamGroup
from flexfem.families.common.section_groups import materials
from flexfem.kernels.driver import add_forces
from flexfem.kernels.sequence import Call, Number
from flexfem.layout.tangent_request import EXACT, Strains, TangentRequest
from flexfem.materials.section import Section

__all__ = ["BeamCells", "InitialStrain", "SE3Beams", "node_frames"]

#: Mean initial strains (m, 6) of cells between arc lengths (m, 2), m, at a time, s.
InitialStrain = Callable[[FloatArray, float], FloatArray]


def node_frames(cells: IndexArray, frames: FloatArray, count: int) -> FloatArray:
    """One frame per node: that of the first cell end there (others are rotated relative to it)."""
    result = np.zeros((count, 12))
    ends, first = np.unique(cells.ravel(), return_index=True)
    result[ends] = frames.reshape(-1, 12)[first]
    return result


class SE3Beams:
    """Residual, tangent and stress resultants of all beams of this rank.

    Attributes:
        data: constant data of the cells.
        groups: numbers of the cells of each material, and their :class:`BeamGroup`.
        lengths: (m,) arc lengths at the start, m.
        strained, timed: see :class:`flexfem.layout.elements.StrainedElements`.
        law_owner: name, in messages, of the first section with a user-defined law; None without
            one.

    The methods of :class:`flexfem.layout.elements.ElementFamily` are described there.
    """

    chained = True
    thin = False
    stressed = True

    def __init__(
        self,
        comm: MPI.Intracomm,
        data: BeamCells,
        sections: Sequence[Section],
        owners: Sequence[str],
        start: FloatArray,
        strains: Mapping[int, InitialStrain] | None = None,
    ) -> None:
        """Compile the kernels (collective) and prepare the cells.

        Args:
            comm: communicator.
            data: constant data of this rank's cells.
            sections: the sections of the model.
            owners: names of the sections in messages.
            start: (n, 12) frames of this rank's nodes at the start.
            strains: by the number of the beam, functions of the arc lengths (m, 2) of the ends of
                cells and the time that return the mean initial strains (m, 6); none by default.

        Raises:
            ValueError: a section's law is not usable; on all ranks.
        """
        self.data = data
        named = zip(sections, owners, strict=True)
        self.law_owner = next((owner for s, owner in named if s.law is not None), None)
        some = comm.allreduce(bool(np.any(data.damping > 0.0)), op=MPI.LOR)
        damped = data.damping.shape[1] if some else 0
        self.groups: list[tuple[IntArray, BeamGroup]] = []
        self.lengths = np.empty(len(data.cells))
        # all laws are checked before the long compilation of the first
        for numbers, material in materials(comm, sections, owners, damped):
            rows = np.flatnonzero(np.isin(data.section, numbers))
            group = BeamGroup(comm, _part(data, rows, numbers), material, start)
            self.groups.append((rows, group))
            self.lengths[rows] = group.lengths
        self._strains = dict(strains or {})
        #: relative twists of each group's cells without stress, but for what changes with time
        self._rest = [group.rest.copy() for _, group in self.groups]
        self.timed, strained = bool(self._strains), bool(data.strained.any())
        self.strained = self.timed or comm.allreduce(strained, op=MPI.LOR)
        self.set_initial_strains(0.0)

    def set_initial_strains(self, t: float, fraction: float = 1.0) -> None:
        """See :class:`flexfem.layout.elements.StrainedElements`."""
        for (_, group), rest in zip(self.groups, self._rest, strict=True):
            group.rest[:] = rest
            for body, strain in self._strains.items():
                rows = np.flatnonzero(group.data.body == body)
                change = strain(group.data.arcs[rows], t)
                group.rest[rows] += group.lengths[rows, np.newaxis] * change
            if fraction != 1.0:
                group.rest[:] = group.start + fraction * (group.rest - group.start)

    def eigenstates(self, frames: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See :class:`flexfem.layout.elements.StrainedElements`."""
        rest = np.empty((len(self.lengths), 6))
        for rows, group in self.groups:
            rest[rows] = group.rest
        return self.resultants(frames)[1], rest

    @property
    def couplings(self) -> list[tuple[IndexArray, IndexArray]]:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        return [(self.data.cells, self.data.cells)]

    @property
    def support(self) -> IntArray:
        """See :class:`flexfem.layout.elements.ResultantElements`."""
        return self.data.cells.astype(np.int64)

    @property
    def body(self) -> IntArray:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        return self.data.body

    @property
    def linear(self) -> BeamGroup:
        """The cells of linear material, all of them unless :attr:`law_owner` is given."""
        return self.groups[0][1]

    @property
    def turned(self) -> int:
        """Number of cells whose section axes differ from the axes of their nodes."""
        return sum(int(group.turned.sum()) for _, group in self.groups)

    def add_residual(
        self, block: FrameBlock, gravity: FloatArray, scale: float,
        request: TangentRequest = EXACT,
    ) -> None:  # fmt: skip
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        strains = request.strains
        for k, (_, group) in enumerate(self.groups):
            cells = group.cells if strains is None else group.cells_at(block, strains[k])
            add_forces(
                group.residual.memory, cells.memory, block.nodes.memory, gravity, scale,
                block.residual,
            )  # fmt: skip

    def residual_calls(self, block: FrameBlock, gravity: FloatArray, scale: Number) -> list[Call]:
        """See :class:`flexfem.layout.elements.SequencedElements`."""
        return [
            Call(
                add_forces, group.residual.memory, group.cells.memory, block.nodes.memory, gravity,
                scale, block.residual,
            )
            for _, group in self.groups
        ]  # fmt: skip

    def tangent(
        self, block: FrameBlock, gravity: FloatArray, shifts: FloatArray, scale: float,
        request: TangentRequest = EXACT,
    ) -> FloatArray:  # fmt: skip
        """Matrices (m, 12, 12) of :meth:`values`."""
        matrices = [
            group.tangent(block, gravity, shifts, scale, request.of_group(k), local=request.local)
            for k, (_, group) in enumerate(self.groups)
        ]
        if len(matrices) == 1:
            return matrices[0]
        values = np.empty((len(self.data.cells), 12, 12))
        for (rows, _), own in zip(self.groups, matrices, strict=True):
            values[rows] = own
        return values

    def values(
        self, block: FrameBlock, gravity: FloatArray, shifts: FloatArray, scale: float,
        request: TangentRequest = EXACT,
    ) -> FloatArray:  # fmt: skip
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        return self.tangent(block, gravity, shifts, scale, request).ravel()

    def step_values(
        self, block: FrameBlock, gravity: FloatArray, shifts: FloatArray, scale: float,
        out: FloatArray,
    ) -> None:  # fmt: skip
        """See :class:`flexfem.layout.elements.StepMatrices`."""
        every = out.reshape(3, -1, 144)
        for rows, group in self.groups:
            if len(self.groups) == 1:
                group.step_matrices(block, gravity, shifts, scale, every)
                continue
            own = np.empty((3, len(rows), 144))
            group.step_matrices(block, gravity, shifts, scale, own)
            every[:, rows] = own

    def continued_strains(self, frames: FloatArray, steps: FloatArray) -> Strains:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        return [group.continued_strains(frames, steps) for _, group in self.groups]

    def strain_products(self, strains: Strains, chosen: BoolArray) -> tuple[Strains, Strains]:
        """See :class:`flexfem.layout.elements.DampedElements`."""
        kept = [
            own * chosen[rows, np.newaxis]
            for (rows, _), own in zip(self.groups, strains, strict=True)
        ]
        pairs = zip(self.groups, kept, strict=True)
        return kept, [group.stresses_of_changes(own) for (_, group), own in pairs]

    def unstressed(self) -> Strains:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        return [np.zeros((len(group.data.cells), 6)) for _, group in self.groups]

    def accept(self, block: FrameBlock) -> None:
        """Nothing is remembered."""

    def add_action(
        self, block: FrameBlock, gravity: FloatArray, shifts: FloatArray, scale: float,
        request: TangentRequest = EXACT,
    ) -> None:  # fmt: skip
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        for k, (_, group) in enumerate(self.groups):
            group.add_action(
                block, gravity, shifts, scale, request.of_group(k), local=request.local
            )

    def resultants(
        self, frames: FloatArray, chosen: IntArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Strains and stress resultants (m, 6) in section axes (damping left out).

        Args:
            frames: (n, 12) frames of the nodes.
            chosen: (m,) cells, all of them when None.
        """
        strain, resultant, _ = self._response(frames, chosen)
        return strain, resultant

    def stretches(self, frames: FloatArray) -> FloatArray:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        found = np.empty(len(self.data.cells))
        for rows, group in self.groups:
            found[rows] = group.stretches(frames)
        return found

    def elongations(self, frames: FloatArray) -> FloatArray:
        """Changes (m,) of the lengths of all cells along the normal of the section, m."""
        found = np.empty(len(self.data.cells))
        for rows, group in self.groups:
            found[rows] = group.elongations(frames)
        return found

    def energies(self, frames: FloatArray) -> FloatArray:
        """Strain energies (m,) of all cells, J."""
        return self._response(frames)[2]

    def _response(
        self, frames: FloatArray, chosen: IntArray | None = None
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        if len(self.groups) == 1:
            return self.groups[0][1].response(frames, chosen)
        cells = np.arange(len(self.data.cells)) if chosen is None else chosen
        count = len(cells)
        strain, resultant, energy = np.empty((count, 6)), np.empty((count, 6)), np.empty(count)
        for rows, group in self.groups:
            to = np.flatnonzero(np.isin(cells, rows))
            at = np.searchsorted(rows, cells[to])
            strain[to], resultant[to], energy[to] = group.response(frames, at)
        return strain, resultant, energy

    @property
    def viscous(self) -> bool:
        """True if any material is viscous."""
        return any(group.viscous for _, group in self.groups)

    def viscosity(self, block: FrameBlock) -> tuple[FloatArray, FloatArray]:
        """Viscous stress resultants and strains (m, 6) of all cells."""
        if len(self.groups) == 1:
            return self.groups[0][1].viscosity(block)
        stress, strain = np.empty((2, len(self.data.cells), 6))
        for rows, group in self.groups:
            stress[rows], strain[rows] = group.viscosity(block)
        return stress, strain

    def step_forces(self, comm: MPI.Intracomm, count: int, dissipates: bool) -> EnergyBeams:
        """See :class:`flexfem.layout.elements.SteppedElements`."""
        return EnergyBeams(comm, self.linear, count)

    def losses(self, before: FloatArray, after: FloatArray, h: float) -> FloatArray:
        """See :class:`flexfem.layout.elements.SteppedElements`."""
        change = self.resultants(after)[0] - self.resultants(before)[0]
        found = np.empty(len(change))
        for rows, group in self.groups:
            found[rows] = group.losses(change[rows], h)
        return found

    @property
    def viscous_at(self) -> tuple[IntArray, FloatArray]:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        return np.arange(len(self.lengths)), self.lengths

    def add_motion(self, block: FrameBlock, chosen: BoolArray, motion: FloatArray) -> None:
        """Add energy and momenta of the chosen (m,) cells, see ``flexfem.core.nodes.motion``."""
        for rows, group in self.groups:
            group.add_motion(block, chosen[rows], motion)


def _part(data: BeamCells, rows: IntArray, numbers: Sequence[int]) -> BeamCells:
    """Some cells, with sections counted within the given ones."""
    part = data.take(rows)
    return replace(part, section=np.searchsorted(numbers, part.section))
