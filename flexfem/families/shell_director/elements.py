# SPDX-License-Identifier: LGPL-3.0-or-later
"""The family of director shells: all of them on one triangle mesh with midside nodes.

The matrices of the triangles are summed up for pairs of nodes at once, as in
``families.shell_rotation_free.elements``.
"""

from dataclasses import dataclass

import numpy as np

from flexfem._types import BoolArray, FloatArray, IndexArray, IntArray
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.families.beam_nurbs.inertia import (
    NodalMasses,
    add_inertia,
    add_inertia_action,
    step_changes,
    step_rates,
)
from flexfem.families.common.corotating_axes import CorotatingAxes
from flexfem.families.common.node_pairs import NodePairs
from flexfem.families.common.shell_rest import RestStrains
from flexfem.families.shell_director.inertia import (
    PairMasses,
    add_inertia_blocks,
    add_motion,
    add_turns,
)
from flexfem.families.shell_director.law import Response
from flexfem.families.shell_director.rates import rate_changes
from flexfem.families.shell_director.triangles import UNKNOWNS, DirectorTriangles
from flexfem.families.shell_rotation_free.rate_changes import add_pairs
from flexfem.layout.tangent_request import EXACT, Strains, TangentRequest

__all__ = ["DirectorCells", "DirectorShells"]


@dataclass(frozen=True)
class DirectorCells:
    """Triangles of this rank.

    Attributes:
        triangles: their mechanics.
        body: number of the shell, (m,).
        masses: kg, (m, 6, 6).
        rods: inertia of the directors in the axes of their nodes, kg m^2, (m, 3, 3, 3).
        rest: their strains without stress.
    """

    triangles: DirectorTriangles
    body: IntArray
    masses: FloatArray
    rods: FloatArray
    rest: RestStrains


class DirectorShells:
    """Residual, tangent and stress resultants of all director shells of this rank.

    Attributes:
        triangles: their mechanics.
        body: (m,) number of the shell.
        areas: of the triangles at the start, m^2, (m,).
        strained, timed: see :class:`flexfem.layout.elements.StrainedElements`.

    The methods of :class:`flexfem.layout.elements.ElementFamily` are described there. With damping,
    the tangent neglects the change of strain rates by the rotation of the triangles, see
    :meth:`rate_changes`.
    """

    law_owner: str | None = None
    chained = False
    thin = True
    stressed = True

    def __init__(self, cells: DirectorCells, block: FrameBlock) -> None:
        """Prepare pairs of nodes and masses (collective).

        Args:
            cells: the triangles that this rank owns.
            block: their nodes.
        """
        self.triangles, self.body = cells.triangles, cells.body
        self.areas = cells.triangles.areas
        self._masses, self._rods = cells.masses, cells.rods
        self.viscous = self.triangles.viscous
        nodes = self.triangles.nodes
        self._cells: IndexArray = np.ascontiguousarray(nodes[:, :6])
        used = np.unique(nodes).astype(np.int64)
        lumps = np.zeros((len(used), 6, 6))
        np.add.at(lumps[:, 3:, 3:], np.searchsorted(used, nodes[:, 6:]), self._rods)
        self._inertia = NodalMasses(
            nodes=used, lumps=lumps, cells=self._cells.astype(np.int64), masses=self._masses
        )
        self._pairs = NodePairs(len(block.frames), [nodes])
        (self._index,) = self._pairs.index
        rows, at = self._pairs.rows, self._index[:, :6, :6].ravel()
        self._pair_masses = PairMasses(
            rows=rows, columns=self._pairs.columns, diagonal=self._pairs.diagonal,
            masses=np.bincount(at, self._masses.ravel(), len(rows)).astype(np.float64),
        )  # fmt: skip
        self._axes = CorotatingAxes(block)
        self._rest = cells.rest
        self.strained, self.timed = cells.rest.strained, cells.rest.timed
        self.set_initial_strains(0.0)

    def set_initial_strains(self, t: float, fraction: float = 1.0) -> None:
        """See :class:`flexfem.layout.elements.StrainedElements`."""
        if self.strained:
            self.triangles.set_starts(self._rest.at(t, fraction))

    def eigenstates(self, frames: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See :class:`flexfem.layout.elements.StrainedElements`; both are covariant."""
        stresses = self.triangles.elastic_stresses(frames)
        return stresses.reshape(-1, 6), self.triangles.starts.reshape(-1, 6)

    @property
    def carriers(self) -> IndexArray:
        """Nodes (m, 6) of the triangles on which loads act, corners first."""
        return self._cells

    @property
    def facets(self) -> tuple[IntArray, IntArray]:
        """Nodes of the four flat triangles that draw each triangle, and the number of that."""
        parts = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2], [3, 4, 5]])
        nodes = self.triangles.nodes.astype(np.int64)
        return nodes[:, parts].reshape(-1, 3), np.repeat(np.arange(len(nodes)), 4)

    @property
    def support(self) -> IntArray:
        """See :class:`flexfem.layout.elements.ResultantElements`."""
        return self.triangles.nodes.astype(np.int64)

    @property
    def couplings(self) -> list[tuple[IndexArray, IndexArray]]:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        return self._pairs.couplings

    def _starts(self, block: FrameBlock, strains: FloatArray | None) -> FloatArray:
        """Strains at the start, less the effect of rates and given strains on the present ones."""
        triangles, starts = self.triangles, self.triangles.starts
        if triangles.damping.any():
            rates = triangles.rates(block.frames, block.velocity)
            starts = starts - triangles.damping[:, np.newaxis] * rates
        if strains is not None:
            starts = starts + triangles.changes(block.frames) - strains
        return starts

    def _response(self, block: FrameBlock, starts: FloatArray, rate: float = 0.0) -> Response:
        """Stresses and stiffness; with strain rates for laws that depend on them."""
        triangles, rates = self.triangles, None
        if self.viscous and triangles.laws:
            rates = triangles.rates(block.frames, block.velocity)
        return triangles.response(block.frames, starts, rates, rate)

    def add_residual(
        self, block: FrameBlock, gravity: FloatArray, scale: float,
        request: TangentRequest = EXACT,
    ) -> None:  # fmt: skip
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        starts = self._starts(block, request.of_group(0))
        response = self._response(block, starts)
        self.triangles.add_forces(block.frames, block.residual, scale, starts, response)
        add_inertia(self._inertia.memory, block.nodes.memory, gravity, scale)

    def values(
        self, block: FrameBlock, gravity: FloatArray, shifts: FloatArray, scale: float,
        request: TangentRequest = EXACT,
    ) -> FloatArray:  # fmt: skip
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        pairs = self._pairs
        blocks = np.zeros((len(pairs.rows), 6, 6))
        factors = scale * float(shifts[2]), scale * float(shifts[0])
        if factors[0] != 0.0 or (self.viscous and factors[1] != 0.0):
            starts = self._starts(block, request.of_group(0))
            response = self._response(block, starts, _rate(shifts))
            self.triangles.add_tangents(
                block.frames, self._index, blocks, factors, starts, response
            )
        rates, nodes = np.empty((2, len(block.frames), 6, 6)), block.nodes.memory
        inertial = block.inertial_rates(shifts) and not request.local
        step_rates(self._inertia.nodes, nodes, shifts, inertial, rates)
        add_inertia_blocks(
            self._inertia.memory, self._pair_masses.memory, nodes, gravity, rates,
            np.array([shifts[2], scale]), blocks,
        )  # fmt: skip
        return blocks.ravel()

    def rate_changes(
        self, block: FrameBlock, shifts: FloatArray, scale: float, *, local: bool = False
    ) -> FloatArray:
        """See :class:`flexfem.layout.elements.TurningElements`."""
        found = np.zeros((2, len(self._pairs.rows), 6, 6))
        changes = rate_changes(self.triangles, block, self._starts(block, None), local=local)
        for blocks, own, factor in zip(found, changes, (shifts[2], shifts[0]), strict=True):
            add_pairs(scale * float(factor) * own, self._index, UNKNOWNS.tolist(), blocks)
        return found.reshape(2, -1)

    def add_action(
        self, block: FrameBlock, gravity: FloatArray, shifts: FloatArray, scale: float,
        request: TangentRequest = EXACT,
    ) -> None:  # fmt: skip
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        inertial = block.inertial_rates(shifts) and not request.local
        step_changes(self._inertia.nodes, block.nodes.memory, shifts, inertial)
        factors = scale * float(shifts[2]), scale * float(shifts[0])
        if factors[0] != 0.0 or (self.viscous and factors[1] != 0.0):
            starts = self._starts(block, request.of_group(0))
            response = self._response(block, starts, _rate(shifts))
            self.triangles.add_action(
                block.frames, block.step, block.residual, factors, starts, response
            )
        add_inertia_action(self._inertia.memory, block.nodes.memory, gravity, scale)

    def continued_strains(self, frames: FloatArray, steps: FloatArray) -> Strains:
        """See :class:`flexfem.layout.elements.ElementFamily`: changes of strains (m, 24)."""
        return [self.triangles.changes(frames) + self.triangles.rates(frames, steps)]

    def strain_products(self, strains: Strains, chosen: BoolArray) -> tuple[Strains, Strains]:
        """See :class:`flexfem.layout.elements.DampedElements`."""
        (own,) = strains
        kept = own * chosen[:, np.newaxis]
        return [kept], [self.triangles.linear_stresses(kept)]

    def unstressed(self) -> Strains:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        return [np.zeros_like(self.triangles.starts)]

    def accept(self, block: FrameBlock) -> None:
        """Rotate the axes of corners by the rotation of the directors around them (collective)."""

        def add(sums: FloatArray) -> None:
            add_turns(self.triangles.nodes, block.start_frames, block.frames, sums)

        self._axes.turn(block, add)

    def resultants(
        self, frames: FloatArray, chosen: IntArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """See :class:`flexfem.layout.elements.ElementFamily`; the shear is left out."""
        strains = self.triangles.strains(frames)
        both = strains[:, :6], self.triangles.stresses(strains)[:, :6]
        return both if chosen is None else (both[0][chosen], both[1][chosen])

    def stretches(self, frames: FloatArray) -> FloatArray:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        return self.triangles.facing(frames).min(axis=1, initial=np.inf)

    def energies(self, frames: FloatArray) -> FloatArray:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        return self.triangles.total_energies(frames)

    def energy_parts(self, frames: FloatArray) -> FloatArray:
        """Strain energies (m, 3) of membrane, bending and shear, J."""
        return self.triangles.energies(frames)[:, :3]

    def viscosity(self, block: FrameBlock) -> tuple[FloatArray, FloatArray]:
        """See :class:`flexfem.layout.elements.ElementFamily`.

        Strains are covariant, and stresses are those of the areas of their points.
        """
        own, frames = self.triangles, block.frames
        stresses = own.viscous_stresses(frames, own.rates(frames, block.velocity))
        strains = own.changes(frames) + own.starts
        return stresses.reshape(-1, 6), strains.reshape(-1, 6)

    @property
    def viscous_at(self) -> tuple[IntArray, FloatArray]:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        count = len(self.triangles.areas)
        return np.repeat(np.arange(count), 4), np.ones(4 * count)

    def add_motion(self, block: FrameBlock, chosen: BoolArray, motion: FloatArray) -> None:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        add_motion(
            self.triangles.nodes, self._masses, self._rods, chosen, block.frames, block.velocity,
            motion,
        )  # fmt: skip


def _rate(shifts: FloatArray) -> float:
    """Change of velocities with positions, 1/s; zero without stiffness in the iteration matrix."""
    return float(shifts[0] / shifts[2]) if shifts[2] != 0.0 else 0.0
