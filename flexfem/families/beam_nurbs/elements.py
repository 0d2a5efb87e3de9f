# SPDX-License-Identifier: LGPL-3.0-or-later
"""The family of NURBS beams: all beams of a model that follow a NURBS curve.

The physics is in ``flexfem.forms.nurbs_beam``. Elements are grouped by degree, interpolation and
material, those whose section varies apart; one call of a compiled loop treats all elements of a
group. Cells of the family are counted group by group.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

from mpi4py import MPI

import numpy as np

from flexfem._types import BoolArray, FloatArray, IndexArray, IntArray
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.core.runs import starts
from flexfem.families.beam_nurbs.group import NurbsGroup, NurbsKernels
from flexfem.families.beam_nurbs.points import AlongBeam, NurbsCells, PointSet
from flexfem.families.common.section_groups import materials
from flexfem.layout.elements import one_width
from flexfem.layout.tangent_request import EXACT, Strains, TangentRequest
from flexfem.materials.section import Section

__all__ = ["NurbsBeams", "NurbsCells", "NurbsPoints"]


class NurbsBeams:
    """Residual, tangent and stress resultants of all NURBS beams of this rank.

    Attributes:
        groups: the elements of each degree and material.
        rows: (m,) number of each cell in ``data``, the degrees one after the other.
        connectivity: (m_g, k_g) nodes of the cells of each group.
        body: (m,) number of each cell's beam.
        lengths: (m,) arc lengths at the start, m.
        strained, timed: see :class:`flexfem.layout.elements.StrainedElements`.
        law_owner: name, in messages, of the first section with a user-defined law; None without
            one.
    """

    chained = True
    thin = False
    stressed = True

    def __init__(
        self,
        comm: MPI.Intracomm,
        data: Sequence[NurbsCells],
        sections: Sequence[Section],
        owners: Sequence[str],
        start: FloatArray,
        along: Mapping[int, AlongBeam] | None = None,
    ) -> None:
        """Compile the kernels (collective) and prepare the elements.

        Args:
            comm: communicator.
            data: constant data of this rank's elements, one object for each degree and
                interpolation, and for sections that vary; the same ones on all ranks.
            sections: the sections of the model.
            owners: names of the sections in messages.
            start: (n, 12) frames of this rank's nodes at the start.
            along: what varies along beams, by their numbers, the same on all ranks; nothing by
                default.

        Raises:
            ValueError: a section's law is not usable; on all ranks.
        """
        named = zip(sections, owners, strict=True)
        self.law_owner = next((owner for s, owner in named if s.law is not None), None)
        some = comm.allreduce(any(np.any(d.damping > 0.0) for d in data), op=MPI.LOR)
        damped = data[0].damping.shape[1] if some else 0
        # all laws are checked before the long compilation of the first
        kinds = sorted({cells.vectors for cells in data})
        found = [
            (numbers, material, {kind: NurbsKernels(comm, material, kind) for kind in kinds})
            for numbers, material in materials(comm, sections, owners, damped)
        ]
        self.groups: list[NurbsGroup] = []
        beams = dict(along or {})
        self.strained = any(beam.strained for beam in beams.values())
        self.timed = any(beam.timed for beam in beams.values())
        rows, first = [np.empty(0, dtype=np.int64)], 0
        for cells in data:
            for numbers, material, kernels in found:
                at = np.flatnonzero(np.isin(cells.section, numbers))
                part = _part(cells, at, numbers)
                self.groups.append(NurbsGroup(kernels[cells.vectors], part, material, start, beams))
                rows.append(first + at)
            first += len(cells.nodes)
        self.rows: IntArray = np.concatenate(rows)
        self._count()

    def _count(self) -> None:
        """Number the cells of all groups consecutively."""
        none = np.empty(0, dtype=np.int64)
        self.body: IntArray = np.concatenate([none, *(g.data.body for g in self.groups)])
        self.lengths: FloatArray = np.concatenate([np.empty(0), *(g.lengths for g in self.groups)])
        ends = starts([len(group.data.nodes) for group in self.groups])
        self._parts = [slice(a, b) for a, b in pairwise(ends)]

    def set_initial_strains(self, t: float, fraction: float = 1.0) -> None:
        """See :class:`flexfem.layout.elements.StrainedElements`."""
        for group in self.groups:
            group.set_initial_strains(t, fraction)

    def eigenstates(self, frames: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See :class:`flexfem.layout.elements.StrainedElements`."""
        found = [np.empty((2, 0, 6)), *(np.stack(g.eigenstate(frames)) for g in self.groups)]
        stress, rest = np.concatenate(found, axis=1)
        return stress, rest

    @property
    def connectivity(self) -> list[IndexArray]:
        """See the class."""
        return [group.data.nodes for group in self.groups]

    @property
    def support(self) -> IntArray:
        """See :class:`flexfem.layout.elements.ResultantElements`."""
        return one_width(self.connectivity)

    @property
    def couplings(self) -> list[tuple[IndexArray, IndexArray]]:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        return [(group.data.nodes, group.data.nodes) for group in self.groups]

    def add_residual(
        self, block: FrameBlock, gravity: FloatArray, scale: float,
        request: TangentRequest = EXACT,
    ) -> None:  # fmt: skip
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        for k, group in enumerate(self.groups):
            group.add_residual(block, gravity, scale, request.of_group(k))

    def values(
        self, block: FrameBlock, gravity: FloatArray, shifts: FloatArray, scale: float,
        request: TangentRequest = EXACT,
    ) -> FloatArray:  # fmt: skip
        """See :class:`flexfem.layout.elements.ElementFamily`; one cell after the other."""
        shapes = [(len(g.data.nodes), 36 * g.data.nodes.shape[1] ** 2) for g in self.groups]
        values, first = np.empty(sum(m * width for m, width in shapes)), 0
        for k, (group, (m, width)) in enumerate(zip(self.groups, shapes, strict=True)):
            own = values[first : first + m * width].reshape(m, width)
            group.tangent_into(
                block, gravity, shifts, scale, own, request.of_group(k), local=request.local
            )
            first += m * width
        return values

    def continued_strains(self, frames: FloatArray, steps: FloatArray) -> Strains:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        return [group.continued_strains(frames, steps) for group in self.groups]

    def strain_products(self, strains: Strains, chosen: BoolArray) -> tuple[Strains, Strains]:
        """See :class:`flexfem.layout.elements.DampedElements`."""
        ends = np.cumsum([len(own) for own in strains])[:-1]
        parts = zip(strains, np.split(chosen, ends), strict=True)
        kept = [own * cells[:, np.newaxis, np.newaxis] for own, cells in parts]
        pairs = zip(self.groups, kept, strict=True)
        return kept, [group.integrated_stresses(own) for group, own in pairs]

    def unstressed(self) -> Strains:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        return [group.unstressed() for group in self.groups]

    def accept(self, block: FrameBlock) -> None:
        """Nothing is remembered."""

    def add_action(
        self, block: FrameBlock, gravity: FloatArray, shifts: FloatArray, scale: float,
        request: TangentRequest = EXACT,
    ) -> None:  # fmt: skip
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        for k, group in enumerate(self.groups):
            group.add_action(
                block, gravity, shifts, scale, request.of_group(k), local=request.local
            )

    def resultants(
        self, frames: FloatArray, chosen: IntArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Strains and stress resultants (m, 6) at the centres of the cells, in section axes.

        Damping is left out.

        Args:
            frames: (n, 12) frames of the nodes.
            chosen: (m,) cells, all of them when None.
        """
        strain, resultant = self.points_at(np.array([0.5]), chosen).resultants(frames)
        return strain[:, 0], resultant[:, 0]

    def points_at(self, xi: FloatArray, chosen: IntArray | None = None) -> "NurbsPoints":
        """Points whose strains and resultants are asked for, also several times.

        Args:
            xi: (q,) or (m, q) coordinates of points in the chosen cells, 0 to 1.
            chosen: (m,) cells, all of them when None.

        Raises:
            TypeError: a function of the section fails there as :meth:`AlongBeam.stiffness` does.
            ValueError: as above.
        """
        cells = np.arange(len(self.lengths)) if chosen is None else chosen
        places = np.broadcast_to(xi, (len(cells), xi.shape[-1]))
        found = []
        for part, group in zip(self._parts, self.groups, strict=True):
            to = np.flatnonzero((part.start <= cells) & (cells < part.stop))
            found.append((to, group, group.points_at(cells[to] - part.start, places[to])))
        return NurbsPoints(places.shape, found)

    def stretches(self, frames: FloatArray) -> FloatArray:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        return np.concatenate([np.empty(0), *(g.stretches(frames) for g in self.groups)])

    def energies(self, frames: FloatArray) -> FloatArray:
        """Strain energies (m,) of all cells, J."""
        return np.concatenate([np.empty(0), *(g.energies(frames) for g in self.groups)])

    @property
    def viscous(self) -> bool:
        """True if the material of any cells is viscous."""
        return any(group.viscous for group in self.groups)

    def viscosity(self, block: FrameBlock) -> tuple[FloatArray, FloatArray]:
        """Viscous stress resultants and strains (j, 6) at the points of :attr:`viscous_at`."""
        both = [np.empty((2, 0, 6)), *(np.stack(g.viscosity(block)) for g in self.groups)]
        stress, strain = np.concatenate(both, axis=1)
        return stress, strain

    @property
    def viscous_at(self) -> tuple[IntArray, FloatArray]:
        """Cell (j,) of each point of :meth:`viscosity`, and the length (j,) it stands for, m."""
        lengths = [group.point_lengths for group in self.groups]
        cells = [
            np.repeat(np.arange(p.start, p.stop), one.shape[1])
            for p, one in zip(self._parts, lengths, strict=True)
        ]
        return np.concatenate(cells), np.concatenate([one.ravel() for one in lengths])

    def add_motion(self, block: FrameBlock, chosen: BoolArray, motion: FloatArray) -> None:
        """Add energy and momenta of the chosen (m,) cells, see ``flexfem.core.nodes.motion``."""
        for part, group in zip(self._parts, self.groups, strict=True):
            group.add_motion(block, chosen[part], motion)


class NurbsPoints:
    """Points in some cells at which strains and stress resultants are evaluated."""

    def __init__(
        self, shape: tuple[int, ...], parts: Sequence[tuple[IntArray, NurbsGroup, PointSet]]
    ) -> None:
        """Take points of groups, each with the numbers of their cells among the m chosen ones."""
        self._shape, self._parts = shape, parts

    def resultants(self, frames: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Strains and stress resultants (m, q, 6), see :meth:`NurbsBeams.resultants`."""
        strain, resultant = np.empty((2, *self._shape, 6))
        for to, group, points in self._parts:
            strain[to], resultant[to] = group.response(frames, points)
        return strain, resultant


def _part(data: NurbsCells, rows: IntArray, numbers: Sequence[int]) -> NurbsCells:
    """Some elements, with sections counted within the given ones."""
    part = data.take(rows)
    return replace(part, section=np.searchsorted(numbers, part.section))
