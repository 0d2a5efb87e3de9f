# SPDX-License-Identifier: LGPL-3.0-or-later
"""The family of rotation-free shells: all of them on one triangle mesh.

Patches of six nodes and of twelve are groups of their own. The matrices of the triangles are summed
up for pairs of nodes at once: those of single triangles would fill the memory of large shells.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import overload

from mpi4py import MPI

import numpy as np

from flexfem._types import BoolArray, FloatArray, IndexArray, IntArray
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.families.common.corotating_axes import CorotatingAxes
from flexfem.families.common.corotating_loops import (
    add_consistent_inertia,
    add_consistent_masses,
    add_lumped_inertia,
    add_lumped_masses,
    add_motion,
    add_rotations,
    add_to_nodes,
    inertial_into,
    positions_into,
    turn_blocks,
)
from flexfem.families.common.node_pairs import NodePairs
from flexfem.families.common.shell_rest import RestStrains
from flexfem.families.shell_rotation_free.rate_changes import add_pairs
from flexfem.families.shell_rotation_free.rates import rate_changes
from flexfem.families.shell_rotation_free.triangles import RotationFreeTriangles
from flexfem.layout.elements import one_width
from flexfem.layout.tangent_request import EXACT, Strains, TangentRequest

__all__ = ["RotationFreeShells", "ShellCells"]


class _ContinuedStrains(Sequence[FloatArray]):
    """Strains (m, 6) of each group at points, continued along steps.

    They are computed where they are asked for: iterations with kept factors rarely do.
    """

    def __init__(
        self, groups: list[RotationFreeTriangles], points: FloatArray, steps: FloatArray
    ) -> None:
        """Store positions (n, 3) and steps (n, 3), inertial axes."""
        self._groups, self._points, self._steps = groups, points, steps
        self._found: dict[int, FloatArray] = {}

    def __len__(self) -> int:
        return len(self._groups)

    @overload
    def __getitem__(self, k: int) -> FloatArray: ...

    @overload
    def __getitem__(self, k: slice) -> list[FloatArray]: ...

    def __getitem__(self, k: int | slice) -> FloatArray | list[FloatArray]:
        if isinstance(k, slice):
            return [self[i] for i in range(*k.indices(len(self)))]
        if k not in self._found:
            group = self._groups[k]
            self._found[k] = group.strains(self._points)
            self._found[k] += group.strain_rates(self._points, self._steps)
        return self._found[k]


@dataclass(frozen=True)
class ShellCells:
    """Triangles of this rank with patches of equally many nodes.

    Attributes:
        triangles: their mechanics.
        body: (m,) number of the shell; mass: (m,) kg.
        consistent: (m,) True for consistent masses, False for lumped ones.
        rest: their strains without stress.
    """

    triangles: RotationFreeTriangles
    body: IntArray
    mass: FloatArray
    consistent: BoolArray
    rest: RestStrains

    @property
    def corners(self) -> IndexArray:
        """(m, 3) own nodes of the triangles."""
        return np.ascontiguousarray(self.triangles.patches.nodes[:, :3])


class RotationFreeShells:
    """Residual, tangent and stress resultants of all rotation-free shells of this rank.

    Attributes:
        groups: the triangles.
        corners: (m, 3) corners of all triangles; body: (m,) their shells.
        lumped, masses: see :class:`flexfem.layout.elements.LumpedElements`.
        strained, timed: see :class:`flexfem.layout.elements.StrainedElements`.

    The methods of :class:`flexfem.layout.elements.ElementFamily` are described there. With damping,
    the tangent neglects the change of strain rates by the rotation of the triangles, see
    :meth:`rate_changes`.
    """

    law_owner: str | None = None
    chained = False
    thin = True
    stressed = True

    def __init__(self, groups: Sequence[ShellCells], block: FrameBlock) -> None:
        """Prepare pairs of nodes and masses (collective).

        Args:
            groups: the triangles that this rank owns.
            block: their nodes, at the start.
        """
        self.groups = list(groups)
        none = np.empty(0, dtype=np.int64)
        self.corners = np.concatenate([none.reshape(0, 3), *(g.corners for g in groups)])
        self.body = np.concatenate([none, *(g.body for g in groups)])
        self._mass = np.concatenate([np.empty(0), *(g.mass for g in groups)])
        self._consistent = np.concatenate([np.empty(0, np.bool_), *(g.consistent for g in groups)])
        # masses of the triangles that are not lumped, None without any on this rank
        spread = np.where(self._consistent, self._mass, 0.0)
        self._spread = spread if spread.any() else None
        self.lumped = not block.comm.allreduce(self._spread is not None, op=MPI.LOR)
        areas = [g.triangles.patches.areas for g in groups]
        self.areas = np.concatenate([np.empty(0), *areas])
        count = len(block.frames)
        self.masses = _lumped(block, self.corners, self._mass - spread)
        self._pairs = NodePairs(count, [g.triangles.patches.nodes for g in groups])
        self._points, self._forces = np.empty((count, 3)), np.empty((count, 3))
        self._vectors = np.empty((count, 3))
        self._axes = CorotatingAxes(block)
        self.viscous = any(g.triangles.viscous for g in groups)
        self.strained = any(g.rest.strained for g in groups)
        self.timed = any(g.rest.timed for g in groups)
        self.set_initial_strains(0.0)

    def set_initial_strains(self, t: float, fraction: float = 1.0) -> None:
        """See :class:`flexfem.layout.elements.StrainedElements`."""
        if self.strained:
            for group in self.groups:
                group.triangles.set_starts(group.rest.at(t, fraction))

    def eigenstates(self, frames: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See :class:`flexfem.layout.elements.StrainedElements`."""
        positions_into(frames, self._points)
        parts = [g.triangles for g in self.groups]
        stresses = [part.stresses(part.strains(self._points)) for part in parts]
        initial = [part.patches.areas[:, np.newaxis] * part.starts for part in parts]
        nothing = np.empty((0, 6))
        return np.concatenate([nothing, *stresses]), np.concatenate([nothing, *initial])

    @property
    def carriers(self) -> IndexArray:
        """Nodes (m, 3) of the triangles on which loads act."""
        return self.corners

    @property
    def support(self) -> IntArray:
        """See :class:`flexfem.layout.elements.ResultantElements`."""
        return one_width([g.triangles.patches.nodes for g in self.groups])

    @property
    def couplings(self) -> list[tuple[IndexArray, IndexArray]]:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        return self._pairs.couplings

    def _velocities(self, block: FrameBlock) -> FloatArray | None:
        """Inertial velocities (n, 3) of the nodes where there is damping."""
        if not self.viscous:
            return None
        velocities = np.empty_like(self._points)
        inertial_into(block.frames, block.velocity, velocities)
        return velocities

    def add_residual(
        self, block: FrameBlock, gravity: FloatArray, scale: float,
        request: TangentRequest = EXACT,
    ) -> None:  # fmt: skip
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        points, forces = self._points, self._forces
        positions_into(block.frames, points)
        velocities = self._velocities(block)
        forces[:] = 0.0
        for k, group in enumerate(self.groups):
            group.triangles.add_present_forces(points, velocities, request.of_group(k), forces)
        if self._spread is not None:
            inertial_into(block.frames, block.acceleration, self._vectors)
            add_consistent_inertia(self.corners, self._spread, self._vectors, gravity, forces)
        add_to_nodes(block.frames, forces, scale, block.residual)
        add_lumped_inertia(
            self.masses, block.frames, block.acceleration, gravity, scale, block.residual
        )

    def values(
        self, block: FrameBlock, gravity: FloatArray, shifts: FloatArray, scale: float,
        request: TangentRequest = EXACT,
    ) -> FloatArray:  # fmt: skip
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        pairs, mass = self._pairs, scale * float(shifts[1])
        blocks = np.zeros((len(pairs.rows), 3, 3))
        if shifts[2] != 0.0 or shifts[0] != 0.0:
            self._add_tangents(block, shifts, scale, request, blocks)
        if self._spread is not None:
            for group, index in zip(self.groups, pairs.index, strict=True):
                spread = np.where(group.consistent, group.mass, 0.0)
                add_consistent_masses(spread, index, mass, blocks)
        turn_blocks(pairs.rows, pairs.columns, block.frames, blocks)
        add_lumped_masses(self.masses, mass, pairs.diagonal, blocks)
        return blocks.ravel()

    def _add_tangents(
        self, block: FrameBlock, shifts: FloatArray, scale: float, request: TangentRequest,
        blocks: FloatArray,
    ) -> None:  # fmt: skip
        """Add the derivatives of the internal forces to the blocks (k, 3, 3), inertial axes."""
        positions_into(block.frames, self._points)
        velocities = self._velocities(block)
        factors, rate = (scale * float(shifts[2]), scale * float(shifts[0])), _rate(shifts)
        for k, (group, index) in enumerate(zip(self.groups, self._pairs.index, strict=True)):
            response = group.triangles.response(
                self._points, velocities, request.of_group(k), rate,
                drop_compression=request.drop_compression,
            )  # fmt: skip
            group.triangles.add_tangents(self._points, index, blocks, factors, response)

    def rate_changes(
        self, block: FrameBlock, shifts: FloatArray, scale: float, *, local: bool = False
    ) -> FloatArray:
        """See :class:`flexfem.layout.elements.TurningElements`: axes of nodes do not turn."""
        pairs, found = self._pairs, np.zeros((2, len(self._pairs.rows), 3, 3))
        positions_into(block.frames, self._points)
        velocities = self._velocities(block)
        if velocities is None:
            return found.reshape(2, -1)
        for group, index in zip(self.groups, pairs.index, strict=True):
            if group.triangles.viscous:
                own = rate_changes(group.triangles, self._points, velocities)
                places = [(node, 0) for node in range(index.shape[1])]
                add_pairs(scale * float(shifts[2]) * own, index, places, found[0])
        turn_blocks(pairs.rows, pairs.columns, block.frames, found[0])
        return found.reshape(2, -1)

    def add_action(
        self, block: FrameBlock, gravity: FloatArray, shifts: FloatArray, scale: float,
        request: TangentRequest = EXACT,
    ) -> None:  # fmt: skip
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        points, forces, steps = self._points, self._forces, self._vectors
        positions_into(block.frames, points)
        inertial_into(block.frames, block.step, steps)
        velocities = self._velocities(block)
        forces[:] = 0.0
        factors, rate = (float(shifts[2]), float(shifts[0])), _rate(shifts)
        if any(factors):
            for k, group in enumerate(self.groups):
                triangles = group.triangles
                response = triangles.response(
                    points, velocities, request.of_group(k), rate,
                    drop_compression=request.drop_compression,
                )  # fmt: skip
                triangles.add_action(points, steps, forces, factors, response)
        mass = float(shifts[1])
        still = np.zeros(3)
        if self._spread is not None:
            add_consistent_inertia(self.corners, mass * self._spread, steps, still, forces)
        add_to_nodes(block.frames, forces, scale, block.residual)
        add_lumped_inertia(
            self.masses, block.frames, block.step, still, scale * mass, block.residual
        )

    def continued_strains(self, frames: FloatArray, steps: FloatArray) -> Strains:
        """See :class:`flexfem.layout.elements.ElementFamily`: strains (m, 6) of each group.

        Newton's method for the mixed form, in which stresses are unknowns: large rotations then
        leave no membrane stress of second order in the tangent (Magisano, Leonetti, Garcea, Int.
        J. Numer. Methods Eng. 109 (2017) 1237-1262).
        """
        points, vectors = np.empty_like(self._points), np.empty_like(self._vectors)
        positions_into(frames, points)
        inertial_into(frames, steps, vectors)
        return _ContinuedStrains([group.triangles for group in self.groups], points, vectors)

    def strain_products(self, strains: Strains, chosen: BoolArray) -> tuple[Strains, Strains]:
        """See :class:`flexfem.layout.elements.DampedElements`."""
        ends = np.cumsum([len(own) for own in strains])[:-1]
        parts = zip(strains, np.split(chosen, ends), strict=True)
        kept = [own * cells[:, np.newaxis] for own, cells in parts]
        triangles = (group.triangles for group in self.groups)
        pairs = zip(triangles, kept, strict=True)
        return kept, [t.patches.areas[:, np.newaxis] * t.stresses(own) for t, own in pairs]

    def unstressed(self) -> Strains:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        return [np.zeros((len(group.triangles.starts), 6)) for group in self.groups]

    def accept(self, block: FrameBlock) -> None:
        """Rotate the axes of the nodes with the shell (collective)."""
        positions_into(block.frames, self._points)
        self._axes.turn(block, self._add_rotations)

    def _add_rotations(self, sums: FloatArray) -> None:
        """Add the rotations of the triangles, times their areas, to their nodes (n, 9)."""
        for group in self.groups:
            patches = group.triangles.patches
            add_rotations(
                patches.nodes, patches.gradients, patches.areas, patches.axes, self._points, sums
            )

    def resultants(
        self, frames: FloatArray, chosen: IntArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        positions_into(frames, self._points)
        strains = [g.triangles.strains(self._points) for g in self.groups]
        stresses = [
            g.triangles.stresses(strain) for g, strain in zip(self.groups, strains, strict=True)
        ]
        # an energy w^2 D k^2 / 2 beside clamps corresponds to curvatures w^2 k, moments w^2 D k
        for group, *values in zip(self.groups, strains, stresses, strict=True):
            for part in values:
                part[:, 3:] *= group.triangles.patches.weights[:, np.newaxis]
        nothing = np.empty((0, 6))
        both = np.concatenate([nothing, *strains]), np.concatenate([nothing, *stresses])
        return both if chosen is None else (both[0][chosen], both[1][chosen])

    def stretches(self, frames: FloatArray) -> FloatArray:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        return np.ones(len(self.body))

    def energies(self, frames: FloatArray) -> FloatArray:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        positions_into(frames, self._points)
        parts = [g.triangles.total_energies(self._points) for g in self.groups]
        return np.concatenate([np.empty(0), *parts])

    def energy_parts(self, frames: FloatArray) -> FloatArray:
        """Strain energies (m, 3) of membrane, bending and shear, J; the last are zero."""
        positions_into(frames, self._points)
        parts = [g.triangles.energies(self._points) for g in self.groups]
        energies = np.concatenate([np.empty((0, 3)), *parts])
        energies[:, 2] = 0.0
        return energies

    def viscosity(self, block: FrameBlock) -> tuple[FloatArray, FloatArray]:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        positions_into(block.frames, self._points)
        inertial_into(block.frames, block.velocity, self._vectors)
        stresses, strains = [np.empty((0, 6))], [np.empty((0, 6))]
        for own in (group.triangles for group in self.groups):
            since_start = own.strains(self._points)
            rates = own.strain_rates(self._points, self._vectors)
            stresses.append(own.viscous_stresses(since_start, rates))
            strains.append(since_start + own.starts)
        return np.concatenate(stresses), np.concatenate(strains)

    @property
    def viscous_at(self) -> tuple[IntArray, FloatArray]:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        return np.arange(len(self.areas)), self.areas

    def add_motion(self, block: FrameBlock, chosen: BoolArray, motion: FloatArray) -> None:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        positions_into(block.frames, self._points)
        inertial_into(block.frames, block.velocity, self._vectors)
        add_motion(
            self.corners, self._mass, self._consistent, chosen, self._points, self._vectors, motion
        )


def _rate(shifts: FloatArray) -> float:
    """Change of velocities with positions, 1/s; zero without stiffness in the iteration matrix."""
    return float(shifts[0] / shifts[2]) if shifts[2] != 0.0 else 0.0


def _lumped(block: FrameBlock, corners: IndexArray, mass: FloatArray) -> FloatArray:
    """Masses (n,) of the owned nodes, a third of each triangle's (collective)."""
    from dolfinx import la

    vector = la.vector(block.index_map, 1)
    np.add.at(vector.array, corners, np.repeat(mass[:, np.newaxis] / 3.0, 3, axis=1))
    vector.scatter_reverse(la.InsertMode.add)
    masses: FloatArray = vector.array.copy()
    masses[block.owned :] = 0.0
    return masses
