# SPDX-License-Identifier: LGPL-3.0-or-later
"""Serial data of a model: nodes numbered, frames at the start, markers resolved."""

from collections.abc import Iterable
from functools import cached_property
from typing import Any

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.core.inertia import point_inertia
from flexfem.core.joint import Joint
from flexfem.core.marker import (
    Attachment,
    Carrier,
    Ground,
    Marker,
    Observed,
    ShellLine,
    SurfaceMarker,
)
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.core.pose import Pose
from flexfem.layout.family import Family, registry
from flexfem.layout.lines import ElementPlace, Line, LinePoint
from flexfem.layout.node_key import NodeKey
from flexfem.layout.surface_places import SurfacePlace
from flexfem.lie import se3
from flexfem.model.bodies.basic import Beam, PointMass
from flexfem.model.model import Model
from flexfem.model.structure.place import Place

__all__ = ["NumberedModel"]

#: Advice on a node at a point inside an element, by the formulation of the beam.
_MORE_NODES = {
    "nurbs": "insert a knot of multiplicity p there (NurbsCurve.insert)",
    "se3": "choose elements so that a node is there",
}


class NumberedModel:
    """Serial data of a model in the order of its nodes, the same on every rank.

    Attributes:
        model: the validated model.
        kernels: "fast" for the hand-written kernels of elements that have them, "ufl" for their UFL
            forms.
        families: families of the model's bodies by their numbers, in the order of the nest.
    """

    def __init__(self, model: Model, kernels: str = "fast") -> None:
        """Number the nodes of all beams and compute all frames at the start."""
        self.model, self.kernels = model, kernels
        self._places: dict[Observed, Place | None] = {}
        self._lines: dict[str | Carrier, Line] = {}
        self.families: dict[int, Family] = {}
        for kind, family in enumerate(registry(model)):
            if family.members(model):
                self.families[kind] = family(self, kind)
        self._kind = {b.name: k for k, family in self.families.items() for b in family.own}

    @cached_property
    def joints(self) -> list[Joint]:
        """Those between bodies, then ties of nodes that move with other bodies.

        Raises:
            ValueError: as of :attr:`body_joints`.
        """
        ties = [joint for family in self.families.values() for joint in family.ties()]
        return self.body_joints + ties

    @cached_property
    def body_joints(self) -> list[Joint]:
        """The model's joints, those of lines as their parts, then those that bodies need.

        Raises:
            ValueError: two lines do not fit.
        """
        parts: list[Joint] = []
        for joint in self.model.joints:
            lines = [
                self.model.node_row(marker) if isinstance(marker, ShellLine) else None
                for marker in joint.markers
            ]
            own = joint.parts(lines)
            if own[0].element is not None:
                law, _ = own[0].element
                law.place(at_nodes=all(map(self._at_node, joint.markers)))
            parts += own
        needed = [joint for family in self.families.values() for joint in family.joints()]
        return parts + needed

    def _at_node(self, marker: Attachment) -> bool:
        """True if a marker is on the ground or fixed to one node with axes."""
        return not isinstance(marker, Carrier) and (
            self.surface_place(marker) is None and self.point(marker) is None
        )

    @property
    def nodes(self) -> FloatArray:
        """Points (n, 3) about which the box is that of all nodes of flexible bodies, m."""
        return _spread(family for family in self.families.values() if not family.follows)

    @property
    def points(self) -> FloatArray:
        """Points (n, 3) about which the box is that of all nodes, of rigid bodies as well, m."""
        return _spread(self.families.values())

    def family[F: Family](self, kind: type[F]) -> F | None:
        """Family of a class; None if the model has none of its bodies."""
        return next((own for own in self.families.values() if isinstance(own, kind)), None)

    def line(self, name: str) -> Line:
        """Elements of a beam in order, found once.

        Raises:
            ValueError: the model has no such beam, or it branches or is disconnected.
        """
        if not isinstance(self.model.get(name), Beam):
            raise ValueError(f'{self.model!r} has no beam "{name}"')
        return self.carrier_line(Carrier(name))

    def carrier_line(self, carrier: Carrier) -> Line:
        """Line of a carrier, found once for each.

        Raises:
            ValueError: it is that of a beam that branches or is disconnected.
        """
        key = carrier.body if carrier.line is None else carrier  # a beam has one line
        if key not in self._lines:
            self._lines[key] = self.family_of(carrier.body).line(carrier)
        return self._lines[key]

    def family_of(self, name: str) -> Family:
        """Family of a body.

        Raises:
            ValueError: the model has no such body.
        """
        if name not in self._kind:
            raise ValueError(f'{self.model!r} has no body "{name}"')
        return self.families[self._kind[name]]

    def point(self, marker: Observed) -> LinePoint | None:
        """A marker inside an element as a point of its line, None for the others."""
        place = self._place_of(marker)
        if place is None or place.node is not None:
            return None
        assert isinstance(marker, Marker)
        return LinePoint(self.line(marker.body), place.element, place.xi)

    def key(self, marker: Observed) -> NodeKey | None:
        """Node that carries a marker, None for the ground.

        Raises:
            ValueError: the marker is inside an element, see :meth:`place`.
        """
        if not isinstance(marker, Marker) or isinstance(
            marker, (Carrier, ShellLine, SurfaceMarker)
        ):
            return None
        place = self._place_of(marker)
        if place is not None and place.node is None:
            raise ValueError(
                f'Marker on "{marker.body}": point {marker.point} lies inside an element, not at a '
                f"node; {_MORE_NODES[self.model[marker.body].formulation]}"
            )
        family = self.family_of(marker.body)
        return family.kind, family.node(marker, place)

    def place(self, marker: Observed) -> ElementPlace | None:
        """Place of a marker that is not fixed to a single node; None for all others."""
        if not isinstance(marker, Marker):
            return None
        place = self._place_of(marker)
        if place is None or place.node is not None:
            return None
        return ElementPlace.on(self.line(marker.body), place.element, place.xi)

    def _place_of(self, marker: Observed) -> Place | None:
        """Place of a marker in the model, cached since systems use it many times."""
        if marker not in self._places:
            self._places[marker] = self.model.marker_place(marker)
        return self._places[marker]

    def surface_place(self, marker: Attachment) -> SurfacePlace | None:
        """Place of a marker on nodes without axes of their own, None for the others."""
        if not isinstance(marker, Marker) or isinstance(marker, (Carrier, ShellLine)):
            return None
        return self.family_of(marker.body).surface_place(marker)

    def with_axes(self, marker: Marker, place: SurfacePlace) -> SurfacePlace:
        """The place of a marker on three or more nodes that define its axes."""
        return self.family_of(marker.body).with_axes(marker, place)

    def local_node(self, marker: Observed, kind: int, block: FrameBlock) -> int:
        """Local index of a marker's node in the block of a kind, -1 if it is not owned there.

        Also -1 for markers inside elements.
        """
        key = None if self.place(marker) else self.key(marker)
        if key is None or key[0] != kind:
            return -1
        return int(block.owned_index(np.array([key[1]]))[0])

    def bodies(self, kind: int, nodes: IntArray) -> IntArray:
        """Numbers of the bodies, among those of their family, that nodes belong to."""
        return self.families[kind].bodies_of(nodes)

    def clusters(self, kind: int, nodes: IntArray) -> IntArray:
        """Numbers of the clusters of bodies with common nodes that nodes belong to."""
        return self.families[kind].clusters_of(nodes)

    def body(self, kind: int, number: int) -> Any:
        """Body of a family by its number."""
        return self.families[kind].bodies[number]

    def node_frames(self, kind: int) -> FloatArray:
        """Frames (n, 12) of all nodes of a family at the start."""
        return self.families[kind].frames

    def mass_inertia(self, mass: PointMass, origin: FloatArray) -> FloatArray:
        """Inertia matrix (6, 6) of a point mass at the start about a frame (12,)."""
        place = self.marker_pose(mass.marker).position
        return point_inertia(origin, place[np.newaxis], np.array([mass.mass]))

    def carrier_frame(self, marker: Marker) -> FloatArray:
        """Frame (12,) at the start of the carrier of a marker: its node, or its point on a line."""
        place = self.place(marker)
        if place is not None:
            return place.frame(self.node_frames(place.kind)[place.nodes])
        key = self.key(marker)
        assert key is not None
        frame: FloatArray = self.node_frames(key[0])[key[1]]
        return frame

    def marker_frame(self, marker: Observed) -> FloatArray:
        """Frame (12,) of a marker relative to its carrier; absolute for the ground."""
        if isinstance(marker, Ground):
            return se3.frame(marker.position, marker.rotation)
        if not isinstance(marker, Marker) or isinstance(marker, Carrier):
            return se3.frame(np.zeros(3), np.eye(3))  # the section itself
        turn = se3.rotation(self.carrier_frame(marker)).T @ marker.rotation
        return se3.frame(marker.offset, turn)

    def marker_pose(self, marker: Observed) -> Pose:
        """Pose of a marker at the start."""
        if isinstance(marker, SurfaceMarker):
            place = self.surface_place(marker)
            assert place is not None
            x = place.position(self.node_frames(place.kind)[:, :3])
            return Pose(x + marker.offset, marker.rotation)
        frame = self.marker_frame(marker)
        if isinstance(marker, Marker):
            frame = se3.compose(self.carrier_frame(marker), frame)
        return Pose(se3.position(frame), se3.rotation(frame))


def _spread(families: Iterable[Family]) -> FloatArray:
    return np.concatenate([np.empty((0, 3)), *(family.spread for family in families)])
