# SPDX-License-Identifier: LGPL-3.0-or-later
"""The family of elastic bodies in floating frames: every body is one element.

Its nodes are the frame, the interfaces, which are frames of their own in space, and nodes whose
positions are three amplitudes each. So joints, loads and contacts attach to interfaces as they do
to nodes of beams (absolute interface coordinates; Ellenbroek and Schilder, Multibody Syst. Dyn. 43
(2018) 193).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from flexfem._types import BoolArray, FloatArray, IndexArray, IntArray
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.core.runs import starts
from flexfem.families.floating.elastic import find_strains
from flexfem.families.floating.inertia import BodyData, Room, room_for
from flexfem.families.floating.loops import (
    add_motion,
    add_residual,
    coordinates_into,
    energies_into,
    tangents_into,
)
from flexfem.layout.tangent_request import EXACT, TangentRequest
from flexfem.reduction.elastic_polynomial import ElasticPolynomial

__all__ = ["FloatingBodies", "FloatingGroup"]

#: Ratio of squared distances below which interfaces count as coincident.
_COINCIDE = 1e-10


@dataclass(frozen=True)
class FloatingGroup:
    """Bodies of this rank with the same integrals.

    Attributes:
        data: the integrals.
        nodes: (m, N) local nodes: the frame if it has one, interfaces, amplitudes.
        body: (m,) number of each body in the model.
        polynomial: nonlinear elastic forces; None of linear bodies.
    """

    data: BodyData
    nodes: IndexArray
    body: IntArray
    polynomial: ElasticPolynomial | None = None

    @cached_property
    def room(self) -> Room:
        """Work space of the compiled loops."""
        return room_for(self.data, self.nodes.shape[1])

    def only(self, number: int) -> "FloatingGroup":
        """A group of the one body with this number."""
        mine = self.body == number
        return replace(self, nodes=self.nodes[mine], body=self.body[mine])

    def coordinates(
        self, frames: FloatArray, velocity: FloatArray, acceleration: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Frames with twists and their rates (m, 24), coordinates with derivatives (m, n, 3)."""
        count = len(self.nodes)
        base, eta = np.empty((count, 24)), np.empty((count, len(self.data.stiffness), 3))
        data, room = self.data.memory, self.room.memory
        coordinates_into(data, room, self.nodes, frames, velocity, acceleration, base, eta)
        return base, eta

    def strains(self, coordinates: FloatArray) -> FloatArray:
        """The part of the coordinates (m, n) that causes stress.

        A body with geometric stiffening gets shorter when it bends, which moves its interfaces
        without axial strain; see ``elastic.add_elastic``.
        """
        strained = coordinates.copy()
        if len(self.data.pulling):
            for own in strained:
                _, strains = find_strains(self.data.memory, own)
                own[: len(strains)] = strains
        return strained

    def stretches(self, coordinates: FloatArray) -> FloatArray:
        """Least distance (m,) of two interfaces along their line at rest, relative to that at rest.

        Args:
            coordinates: (m, n, 3), with derivatives.
        """
        k = len(self.data.rest)
        moved = coordinates[:, : 6 * k, 0].reshape(len(coordinates), k, 6)[:, :, :3]
        rest = self.data.rest
        if not len(self.data.conditions):  # the frame is that of an interface
            rest = np.concatenate([np.zeros((1, 3)), rest])
            moved = np.concatenate([np.zeros((len(moved), 1, 3)), moved], axis=1)
        first, second = np.triu_indices(len(rest), 1)
        apart = rest[second] - rest[first]
        squares = np.einsum("pc,pc->p", apart, apart)
        apart_by = squares > _COINCIDE * squares.max(initial=0.0)
        first, second, apart, squares = (a[apart_by] for a in (first, second, apart, squares))
        change = np.einsum("mpc,pc->mp", moved[:, second] - moved[:, first], apart)
        stretched: FloatArray = 1.0 + (change / squares).min(axis=1, initial=np.inf)
        return stretched

    def missing(
        self, block: FrameBlock, gravity: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Displacements (m,) that the bodies miss, and their own, see ``Family.missing``.

        Args:
            block: nodes with their motion.
            gravity: (3,) acceleration in inertial axes.
        """
        if self.polynomial is None:
            none = np.zeros(len(self.nodes))
            return none, none, none
        base, coordinates = self.coordinates(block.frames, block.velocity, block.acceleration)
        fields = _field_amplitudes(base, gravity)
        missing, moved = self.polynomial.displacements(
            coordinates[:, :, 0], np.hstack([fields, coordinates[:, :, 2]])
        )
        return missing, moved, np.full(len(moved), self.polynomial.unit_strain[0])

    @cached_property
    def _mean_squares(self) -> tuple[FloatArray, float]:
        """Products (n, n) of displacements, their mean over the mass, and the size squared.

        The size is the length of a uniform rod with the same polar moment about the mass centre.
        """
        data, n = self.data, len(self.data.stiffness)
        products = data.products.reshape(3, 3, -1, data.products.shape[1])
        traces = np.einsum("aaij->ij", products) / data.mass
        centre = data.moments[:, 0] / data.mass
        size = 12.0 * float(traces[0, 0] - centre @ centre)
        return traces[1 : n + 1, 1 : n + 1], size or 1.0  # a point has none

    def deflections(self, coordinates: FloatArray) -> FloatArray:
        """How far each body (m,) bends in its frame, see ``Family.deflections``, rad.

        Args:
            coordinates: (m, n, 3), with derivatives.
        """
        if self.polynomial is not None:
            return np.zeros(len(coordinates))
        matrix, size = self._mean_squares
        eta = coordinates[:, :, 0]
        squares = np.einsum("mi,ij,mj->m", eta, matrix, eta, optimize=True)
        k = len(self.data.rest)
        rotations = eta[:, : 6 * k].reshape(len(eta), k, 6)[:, :, 3:]
        largest = np.sqrt(np.einsum("mki,mki->mk", rotations, rotations))
        bent: FloatArray = np.maximum(
            3.0 * np.sqrt(np.maximum(squares, 0.0) / size), largest.max(axis=1, initial=0.0)
        )
        return bent


class FloatingBodies:
    """Residual, tangent and energies of all bodies in floating frames of this rank.

    The methods of :class:`flexfem.layout.elements.ElementFamily` are described there.

    Attributes:
        groups: bodies with the same integrals.
        body: number of each body in the model, group after group.
    """

    law_owner: str | None = None
    chained = False
    thin = False
    stressed = False

    def __init__(self, groups: Sequence[FloatingGroup]) -> None:
        """Store the bodies."""
        self.groups, self._gravity = list(groups), np.zeros(3)
        self._actions: dict[int, tuple[list[FloatArray], FloatArray]] = {}
        none = np.empty(0, dtype=np.int64)
        self.body: IntArray = np.concatenate([none, *(group.body for group in groups)])
        ends = starts([len(group.body) for group in groups])
        self._parts = [slice(a, b) for a, b in pairwise(ends)]

    @property
    def couplings(self) -> list[tuple[IndexArray, IndexArray]]:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        return [(group.nodes, group.nodes) for group in self.groups]

    @property
    def viscous(self) -> bool:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        return any(bool(group.data.damping.any()) for group in self.groups)

    def add_residual(
        self, block: FrameBlock, gravity: FloatArray, scale: float, request: TangentRequest = EXACT
    ) -> None:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        self._gravity = gravity.copy()
        for group in self.groups:
            data, room = group.data.memory, group.room.memory
            add_residual(data, room, group.nodes, block.nodes.memory, gravity, scale)

    def values(
        self, block: FrameBlock, gravity: FloatArray, shifts: FloatArray, scale: float,
        request: TangentRequest = EXACT,
    ) -> FloatArray:  # fmt: skip
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        inertial = block.inertial_rates(shifts) and not request.local
        matrices = [self._matrices(g, block, gravity, shifts, scale, inertial) for g in self.groups]
        return np.concatenate([np.empty(0), *(matrix.ravel() for matrix in matrices)])

    def _matrices(
        self, group: FloatingGroup, block: FrameBlock, gravity: FloatArray, shifts: FloatArray,
        scale: float, inertial: bool,
    ) -> FloatArray:  # fmt: skip
        """Matrices (m, 6 N, 6 N) of a group."""
        count, size = group.nodes.shape
        out = np.empty((count, 6 * size, 6 * size))
        tangents_into(
            group.data.memory, group.room.memory, group.nodes, block.nodes.memory, gravity, shifts,
            inertial, out,
        )  # fmt: skip
        out *= scale
        return out

    def add_action(
        self, block: FrameBlock, gravity: FloatArray, shifts: FloatArray, scale: float,
        request: TangentRequest = EXACT,
    ) -> None:  # fmt: skip
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        inertial = block.inertial_rates(shifts) and not request.local
        for number, group in enumerate(self.groups):
            count, size = group.nodes.shape
            matrices = self._kept(number, block, gravity, shifts, inertial)
            steps = block.step[group.nodes].reshape(count, 6 * size, 1)
            action = scale * (matrices @ steps).reshape(count, size, 6)
            np.add.at(block.residual, group.nodes, action)

    def _kept(
        self, number: int, block: FrameBlock, gravity: FloatArray, shifts: FloatArray,
        inertial: bool,
    ) -> FloatArray:  # fmt: skip
        """Matrices of a group for :meth:`add_action`; those of nonlinear bodies are kept.

        A linear solve applies them a dozen times, and they take 200 microseconds with 24
        coordinates.
        """
        group = self.groups[number]
        if group.polynomial is None:
            return self._matrices(group, block, gravity, shifts, 1.0, inertial)
        at = group.nodes.ravel()
        nodes = block.frames, block.velocity, block.acceleration, block.increment
        key = [gravity, shifts, np.array([inertial]), *(values[at] for values in nodes)]
        kept = self._actions.get(number)
        if kept is not None and all(map(np.array_equal, kept[0], key)):
            return kept[1]
        matrices = self._matrices(group, block, gravity, shifts, 1.0, inertial)
        self._actions[number] = [values.copy() for values in key], matrices
        return matrices

    def continued_strains(self, frames: FloatArray, steps: FloatArray) -> None:
        """Stresses are not continued."""

    def unstressed(self) -> None:
        """None: the matrices have no geometric stiffness of stresses."""

    def accept(self, block: FrameBlock) -> None:
        """Nothing is remembered."""

    def resultants(
        self, frames: FloatArray, chosen: IntArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Zeros: a body has no section resultants; stresses are recovered from the coordinates."""
        count = len(self.body) if chosen is None else len(chosen)
        return np.zeros((count, 6)), np.zeros((count, 6))

    def stretches(self, frames: FloatArray) -> FloatArray:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        parts = [group.stretches(eta) for group, eta in self._at_rest(frames)]
        return np.concatenate([np.empty(0), *parts])

    def deflections(self, frames: FloatArray) -> FloatArray:
        """How far each body bends in its frame, see ``Family.deflections``, rad."""
        parts = [group.deflections(eta) for group, eta in self._at_rest(frames)]
        return np.concatenate([np.empty(0), *parts])

    def missing(self, block: FrameBlock) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Displacement that each body misses, and its own, see ``Family.missing``.

        Gravity is that of the last residual.
        """
        parts = [group.missing(block, self._gravity) for group in self.groups]
        missing, moved, unit = (np.concatenate(of) for of in zip(*parts, strict=True))
        return missing, moved, unit

    def missing_of(self, body: int, block: FrameBlock) -> tuple[float, float]:
        """Displacement that one body misses, and its own; zeros on other ranks."""
        for group in self.groups:
            if body in group.body:
                missing, moved, _ = group.only(body).missing(block, self._gravity)
                return float(missing[0]), float(moved[0])
        return 0.0, 0.0

    def _at_rest(self, frames: FloatArray) -> Iterator[tuple[FloatingGroup, FloatArray]]:
        """Groups with the coordinates (m, n, 3) of their bodies in frames without velocities."""
        still = np.zeros((len(frames), 6))
        for group in self.groups:
            yield group, group.coordinates(frames, still, still)[1]

    def energies(self, frames: FloatArray) -> FloatArray:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        out = np.empty(len(self.body))
        for part, group in zip(self._parts, self.groups, strict=True):
            data, room = group.data.memory, group.room.memory
            energies_into(data, room, group.nodes, frames, out[part])
        return out

    def viscosity(self, block: FrameBlock) -> tuple[FloatArray, FloatArray]:
        """Forces of damping and the coordinates, six at a time."""
        forces, coordinates = [np.empty((0, 6))], [np.empty((0, 6))]
        for group in self.groups:
            _, eta = group.coordinates(block.frames, block.velocity, block.acceleration)
            for all_of, values in (
                (forces, eta[:, :, 1] @ group.data.damping), (coordinates, eta[:, :, 0])
            ):  # fmt: skip
                padded = np.zeros((len(values), 6 * _sixes(group)))
                padded[:, : values.shape[1]] = values
                all_of.append(padded.reshape(-1, 6))
        return np.concatenate(forces), np.concatenate(coordinates)

    @property
    def viscous_at(self) -> tuple[IntArray, FloatArray]:
        """Body of each row of :meth:`viscosity`, and ones: forces are those of whole bodies."""
        cells = [
            np.repeat(np.arange(part.start, part.stop), _sixes(group))
            for part, group in zip(self._parts, self.groups, strict=True)
        ]
        rows = np.concatenate([np.empty(0, dtype=np.int64), *cells])
        return rows, np.ones(len(rows))

    def add_motion(self, block: FrameBlock, chosen: BoolArray, motion: FloatArray) -> None:
        """See :class:`flexfem.layout.elements.ElementFamily`."""
        for part, group in zip(self._parts, self.groups, strict=True):
            add_motion(
                group.data.memory, group.room.memory, group.nodes, chosen[part], block.frames,
                block.velocity, motion,
            )  # fmt: skip


def _field_amplitudes(base: FloatArray, gravity: FloatArray) -> FloatArray:
    """Acceleration less gravity (m, 12) of points fixed to frames, in fields of ``ReducedBody``.

    Args:
        base: (m, 24) frames with twists and the rates of these.
        gravity: (3,) in inertial axes.
    """
    R = base[:, 3:12].reshape(-1, 3, 3)
    V, spin, dV, rate = (base[:, i : i + 3] for i in range(12, 24, 3))
    uniform = dV + np.cross(spin, V) - np.einsum("mij,i->mj", R, gravity)
    unit = np.eye(3)
    turned = np.cross(rate[:, np.newaxis], unit) + np.cross(
        spin[:, np.newaxis], np.cross(spin[:, np.newaxis], unit)
    )  # of the point r = e_b: (m, b, a)
    return np.hstack([uniform, turned.swapaxes(1, 2).reshape(-1, 9)])


def _sixes(group: FloatingGroup) -> int:
    """Number of rows of six for the coordinates of a body."""
    return -(-len(group.data.stiffness) // 6)
