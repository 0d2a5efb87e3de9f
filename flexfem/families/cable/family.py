# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cables with mass: points at their guides, which are kept there, and the inertia between them."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import override

from mpi4py import MPI

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.core.inertia import point_inertia
from flexfem.core.joint import Joint, unit
from flexfem.core.marker import Attachment, Ground, Marker, SurfaceMarker
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.core.runs import starts
from flexfem.families.cable.elements import CableMasses, HeavyCable
from flexfem.joints.cable import Cable
from flexfem.joints.cable_guides import Guide, Sheave, marker_of
from flexfem.joints.cable_path import Path, course
from flexfem.joints.spherical import Spherical
from flexfem.layout.elements import one_width
from flexfem.layout.family import Family
from flexfem.layout.numbered_model import NumberedModel
from flexfem.layout.surface_places import SurfacePlace
from flexfem.lie import se3
from flexfem.mesh.distributed.nodes import distributed
from flexfem.model.model import Model

__all__ = ["CableFamily"]

#: Step of time, s, for the velocity of a place inside an element.
_STEP = 1e-5
#: Approximate cost of a guide relative to a beam element.
_COST = 2


class CableFamily(Family):
    """See :class:`flexfem.layout.family.Family`.

    A node is a guide, or a point on the axis of a sheave; a joint keeps it at the marker there.
    """

    axes = False
    noun = "cable"

    serial: NumberedModel

    @classmethod
    def members(cls, model: Model) -> list[Cable]:
        """Cables of a model with mass."""
        return [j for j in model.joints if isinstance(j, Cable) and j.mass_per_length]

    def __init__(self, serial: NumberedModel, kind: int) -> None:
        """Number the nodes cable after cable.

        Raises:
            ValueError: a cable is released, or by an event.
        """
        super().__init__(serial, kind)
        self._cables = self.members(serial.model)
        model = serial.model
        switched = {*model.released, *(name for event in model.events for name in event.joints)}
        for cable in self._cables:
            if cable.name in switched:
                raise ValueError(
                    f"{cable.owner}: one with mass_per_length cannot be released, nor by an event"
                )
        self.first = starts([len(c.path) + sum(map(_is_sheave, c.path)) for c in self._cables])

    @property
    @override
    def bodies(self) -> list[Cable]:
        return self._cables

    @cached_property
    def _markers(self) -> list[list[Attachment]]:
        """Markers of the nodes of each cable; only now the families of all bodies are known.

        Raises:
            ValueError: a sheave is on a body without axes.
        """
        return [_markers(self.serial, cable) for cable in self._cables]

    @cached_property
    def _starts(self) -> list[FloatArray]:
        """Places (n, 3) of the nodes of each cable, m."""
        return [
            np.array([self.serial.marker_pose(marker).position for marker in markers])
            for markers in self._markers
        ]

    @cached_property
    def _paths(self) -> list[Path]:
        """The cables at the start."""
        return [
            cable.shape([self.serial.marker_pose(marker) for marker in cable.markers])
            for cable in self._cables
        ]

    @property
    @override
    def frames(self) -> FloatArray:
        places = np.concatenate(self._starts)
        return se3.frame(places, np.tile(np.eye(3), (len(places), 1, 1)))

    @property
    @override
    def velocities(self) -> FloatArray:
        rates = [_velocity(self.serial, marker) for own in self._markers for marker in own]
        return np.pad(np.array(rates), ((0, 0), (0, 3)))

    @property
    @override
    def held(self) -> BoolArray:
        ground = [isinstance(marker, Ground) for own in self._markers for marker in own]
        return np.repeat(np.array(ground)[:, np.newaxis], 3, axis=1)

    @property
    @override
    def bound(self) -> BoolArray:
        return np.ones_like(self.held)

    @property
    @override
    def body_of_node(self) -> IntArray:
        return np.repeat(np.arange(len(self._cables)), np.diff(self.first))

    @override
    def ties(self) -> Sequence[Joint]:
        return [
            CableTie(f"{cable.name} node {k}", SurfaceMarker(cable.name, [k], [1.0]), marker)
            for cable, markers in zip(self._cables, self._markers, strict=True)
            for k, marker in enumerate(markers)
            if not isinstance(marker, Ground)
        ]

    @override
    def node(self, marker: Marker, place: object) -> int:
        raise ValueError(f'Marker on "{marker.body}": a cable has no markers')

    @override
    def surface_place(self, marker: Marker) -> SurfacePlace:
        assert isinstance(marker, SurfaceMarker)
        number = [cable.name for cable in self._cables].index(marker.body)
        return SurfacePlace(self.kind, (int(self.first[number]) + marker.nodes[0],), (1.0,))

    @override
    def elements(self, body: Cable) -> int:
        return len(body.path) - 1

    @override
    def outline(self, body: Cable) -> FloatArray:
        return self._course(body)

    @override
    def inertia(self, body: Cable, origin: FloatArray) -> FloatArray:
        points, number = self._course(body), self._cables.index(body)
        lines = np.diff(points, axis=0)
        lengths = np.linalg.norm(lines, axis=1)
        rest = body.rest_with_rates(self._paths[number].length, 0.0)[0]
        masses = body.mass_per_length * rest * lengths / lengths.sum()
        # the points of Gauss have the inertia of a line
        places = [points[:-1] + part * lines for part in 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3.0)]
        return point_inertia(origin, np.concatenate(places), np.tile(0.5 * masses, 2))

    def _course(self, body: Cable) -> FloatArray:
        """Points along a cable at the start."""
        number = self._cables.index(body)
        poses = [self.serial.marker_pose(marker) for marker in body.markers]
        angles = {wrap.guide: wrap.angle for wrap in self._paths[number].wraps}
        return course(body.owner, body.path, False, poses, poses, angles).points

    @override
    def patches(self) -> IntArray:
        pairs = zip(self.first[:-1], self.first[1:], strict=True)
        return one_width([np.arange(a, b)[np.newaxis] for a, b in pairs])

    @override
    def costs(self) -> dict[str, tuple[int, int]]:
        return {cable.name: (1, _COST * len(cable.path)) for cable in self._cables}

    @override
    def block(self, comm: MPI.Intracomm, ranks: IntArray) -> tuple[FrameBlock, CableMasses]:
        none = np.empty(0, dtype=np.int64)
        ids, index_map = distributed(comm, ranks[self.body_of_node], none)
        held = self.held
        block = FrameBlock(
            "cables", comm, self.frames[ids], self.velocities[ids], ids, index_map,
            inertial=True, width=3, dirichlet=held[ids] if held.any() else None,
        )  # fmt: skip
        own = np.flatnonzero(ranks == comm.rank)
        return block, CableMasses([self._described(int(k), block) for k in own], len(ids))

    def _described(self, k: int, block: FrameBlock) -> HeavyCable:
        """Data of a cable for its elements."""
        cable, path = self._cables[k], self._paths[k]
        lowest = np.zeros(len(cable.path))
        for wrap in path.wraps:
            lowest[wrap.guide] = wrap.lowest
        winch = cable.rest_length if callable(cable.rest_length) else cable.paid_out
        return HeavyCable(
            cable.owner, k, block.local_index(np.arange(*self.first[k : k + 2])),
            np.array([guide.radius if isinstance(guide, Sheave) else 0.0 for guide in cable.path]),
            lowest, cable.mass_per_length, partial(cable.rest_with_rates, path.length), winch,
        )  # fmt: skip


class CableTie(Spherical):
    """Keeps a node of a cable at a marker."""

    @property
    def owner(self) -> str:
        """The cable."""
        assert isinstance(self.a, Marker)
        return f'Cable "{self.a.body}"'


def _is_sheave(guide: Guide) -> bool:
    return isinstance(guide, Sheave)


def _markers(serial: NumberedModel, cable: Cable) -> list[Attachment]:
    """Markers of the nodes of a cable: its guides, then points on the axes of its sheaves.

    Raises:
        ValueError: a sheave is on a body without axes.
    """
    tips = [
        _tip(serial, f"{cable.owner}: path[{k}]", guide)
        for k, guide in enumerate(cable.path)
        if isinstance(guide, Sheave)
    ]
    return [*map(marker_of, cable.path), *tips]


def _tip(serial: NumberedModel, owner: str, sheave: Sheave) -> Attachment:
    """Point on the axis of a sheave, as far from its centre as its radius.

    Raises:
        ValueError: the sheave is on a body without axes.
    """
    marker, arm = sheave.marker, sheave.radius * unit(sheave.axis)
    if isinstance(marker, Ground):
        return replace(marker, position=marker.position + arm)
    if serial.surface_place(marker) is not None:
        raise ValueError(
            f'{owner}: with mass_per_length a Sheave is on a rigid body or a beam, and not on "'
            f'{marker.body}", whose nodes have no axes'
        )
    turn = se3.rotation(serial.carrier_frame(marker))
    return replace(marker, offset=marker.offset + turn.T @ arm)


def _velocity(serial: NumberedModel, marker: Attachment) -> FloatArray:
    """Velocity (3,) of a marker at the start, m/s."""
    if isinstance(marker, Ground):
        return np.zeros(3)
    if (place := serial.surface_place(marker)) is not None:
        family, nodes = serial.families[place.kind], list(place.nodes)
        turns = se3.rotation(family.frames[nodes])
        found: FloatArray = np.array(place.weights) @ np.einsum(
            "nij,nj->ni", turns, family.velocities[nodes, :3]
        )
        return found
    offset, element = serial.marker_frame(marker)[:3], serial.place(marker)
    if element is None:
        key = serial.key(marker)
        assert key is not None
        family = serial.families[key[0]]
        twist, turn = family.velocities[key[1]], se3.rotation(family.frames[key[1]])
        return np.asarray(turn @ (twist[:3] + np.cross(twist[3:], offset)))
    family = serial.families[element.kind]
    frames, twists = family.frames[element.nodes], family.velocities[element.nodes]
    ends = []
    for step in (-_STEP, _STEP):
        frame = element.frame(se3.compose(frames, se3.exp(step * twists)))
        ends.append(se3.position(frame) + se3.rotation(frame) @ offset)
    return np.asarray((ends[1] - ends[0]) / (2.0 * _STEP))
