# SPDX-License-Identifier: LGPL-3.0-or-later
"""Serial data of a model: nodes numbered, frames at the start, markers resolved."""

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.core.frame_block import FrameBlock
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
from flexfem.core.pose import Pose
from flexfem.elements.se3_beam import BeamCells, node_frames
from flexfem.lie import se3
from flexfem.materials.section import Section
from flexfem.mesh.line_mesh import section_frames
from flexfem.mesh.topology import trace_lines
from flexfem.model.bodies import Beam, RigidBody
from flexfem.model.floating_body import FloatingBody
from flexfem.model.model import Model
from flexfem.model.place import Place
from flexfem.model.shell import Shell
from flexfem.system.body_lines import floating_line, rigid_line
from flexfem.system.director_surface import shell_surface
from flexfem.system.floating_nodes import FloatingNodes
from flexfem.system.lines import ElementPlace, Line, LinePoint, se3_line
from flexfem.system.nurbs_lines import NurbsLines, initial_velocities
from flexfem.system.placement import BEAMS, FLOATING, NURBS, RIGID, SHELLS, NodeKey
from flexfem.system.surface_places import SurfacePlace

__all__ = ["Assembly"]

#: What makes a node at a place inside an element, by the formulation of the beam.
_MORE_NODES = {
    "nurbs": "a knot of multiplicity p there makes one (NurbsCurve.insert)",
    "se3": "choose elements so that one is there",
}


class Assembly:
    """Serial data of a model in the order of its nodes, the same on every rank.

    Attributes:
        model: the validated model.
        cells: all SE(3) cells with their frames; node numbers count the nodes used by them.
        points, frames, velocities: of those nodes, (n, 3), (n, 12), (n, 6).
        sections: the different sections of the SE(3) beams, by the numbers in ``cells``.
        curves: all NURBS beams, None without any.
        surface: all shells, None without any.
        floating: bodies in floating frames, None without any.
        rigid_frames: (n, 12) frames of the rigid bodies.
    """

    def __init__(self, model: Model) -> None:
        """Number the nodes of all beams and compute all frames at the start."""
        self.model = model
        self._places: dict[Observed, Place | None] = {}
        self._lines: dict[str, Line] = {}
        self._carried: dict[Carrier, Line] = {}
        self._rigid_index = {b.name: i for i, b in enumerate(model.rigid_bodies)}
        self.points, self.frames = np.empty((0, 3)), np.empty((0, 12))
        self.sections: list[Section] = []
        if beams := model.beams_of("se3"):
            self._beams(beams)
        self.curves = NurbsLines.of(model) if model.beams_of("nurbs") else None
        self.surface = shell_surface(model) if model.shells else None
        self.floating = FloatingNodes(model.floating_bodies) if model.floating_bodies else None
        self.rigid_frames = np.array(
            [se3.frame(b.position, b.rotation) for b in model.rigid_bodies]
        ).reshape(-1, 12)

    def _beams(self, beams: list[Beam]) -> None:
        model, mesh = self.model, self.model.mesh
        assert mesh is not None  # checked by validate()
        rows = [_along(model, beam) for beam in beams]
        used, cells = np.unique(np.concatenate([mesh.cells[r] for r in rows]), return_inverse=True)
        self._node_of_mesh = {int(node): i for i, node in enumerate(used)}
        self.points = mesh.points[used]
        counts = [len(r) for r in rows]
        ends = np.concatenate(
            [
                section_frames(mesh.points, mesh.cells[r], beam.orientation)
                for r, beam in zip(rows, beams, strict=True)
            ]
        )
        cells = cells.reshape(-1, 2).astype(np.int64)
        sections = list({id(b.section): b.section for b in beams}.values())
        number = {id(s): i for i, s in enumerate(sections)}
        self.sections = sections
        self.cells = BeamCells(
            cells=cells,
            body=np.repeat([model.beams.index(b) for b in beams], counts),
            section=np.repeat([number[id(b.section)] for b in beams], counts),
            frames=se3.frame(self.points[cells], ends),
            damping=np.repeat([b.damping for b in beams], counts),
        )
        self._body_of_node = np.empty(len(used), dtype=np.int64)
        self._body_of_node[cells] = self.cells.body[:, np.newaxis]
        self.frames = node_frames(cells, self.cells.frames, len(used))
        self.velocities = np.zeros((len(used), 6))
        for beam in beams:
            nodes = np.unique(cells[self.cells.body == model.beams.index(beam)])
            self.velocities[nodes] = initial_velocities(beam, self.frames[nodes])

    @cached_property
    def joints(self) -> list[Joint]:
        """The model's joints, those of lines as their parts, then locks of elastic coordinates.

        Raises:
            ValueError: two lines do not fit.
        """
        parts: list[Joint] = []
        for joint in self.model.joints:
            lines = [
                self.model.node_row(marker) if isinstance(marker, ShellLine) else None
                for marker in joint.markers
            ]
            parts += joint.parts(lines)
        return parts if self.floating is None else [*parts, *self.floating.locks]

    @property
    def nodes(self) -> FloatArray:
        """Positions (n, 3) of all nodes of flexible bodies at the start, m."""
        nothing = np.empty((0, 12))
        curves = nothing if self.curves is None else self.curves.frames
        surface = nothing if self.surface is None else self.surface.frames
        floating = nothing if self.floating is None else self.floating.placed
        frames = np.concatenate([curves, surface, floating])
        return np.concatenate([self.points, se3.position(frames)])

    def line(self, name: str) -> Line:
        """Elements of a beam in order, found once.

        Raises:
            ValueError: the model has no such beam, or it branches or falls apart.
        """
        if name not in self._lines:
            self._lines[name] = self._line(name)
        return self._lines[name]

    def carrier_line(self, carrier: Carrier) -> Line:
        """Line of a carrier, found once for each.

        Raises:
            ValueError: it is that of a beam that branches or falls apart.
        """
        body = self.model[carrier.body]
        if isinstance(body, Beam):
            return self.line(carrier.body)
        if carrier not in self._carried:
            if isinstance(body, RigidBody):
                number = self._rigid_index[body.name]
                self._carried[carrier] = rigid_line(RIGID, number, carrier)
            else:
                assert self.floating is not None
                first = int(self.floating.first[self.model.floating_bodies.index(body)])
                self._carried[carrier] = floating_line(FLOATING, first, body, carrier)
        return self._carried[carrier]

    def _line(self, name: str) -> Line:
        beam = self.model.get(name)
        if not isinstance(beam, Beam):
            raise ValueError(f'{self.model!r} has no beam "{name}"')
        if beam.formulation == "nurbs":
            assert self.curves is not None
            return self.curves.line(self.curves.index(name))
        cells = np.flatnonzero(self.cells.body == self.model.beams.index(beam))
        nodes = self.cells.cells[cells].astype(np.int64)
        order = _chain(nodes)
        if order is None:
            raise ValueError(f'Beam "{name}": group "{beam.group}" branches or falls apart')
        cells = cells[order]
        return se3_line(
            BEAMS, cells, self.cells.cells[cells], self.cells.frames[cells], self.frames
        )

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
        if place is None:
            return RIGID, self._rigid_index[marker.body]
        if place.node is None:
            raise ValueError(
                f'Marker on "{marker.body}": point {marker.point} lies inside an element, where no '
                f"node is; {_MORE_NODES[self.model[marker.body].formulation]}"
            )
        body = self.model[marker.body]
        if isinstance(body, Shell):
            return SHELLS, place.node
        if isinstance(body, FloatingBody):
            assert self.floating is not None
            first = self.floating.first[self.model.floating_bodies.index(body)]
            return FLOATING, int(first) + place.node
        if body.formulation == "nurbs":
            assert self.curves is not None
            return NURBS, int(self.curves.first_node[self.curves.index(marker.body)]) + place.node
        return BEAMS, self._node_of_mesh[place.node]

    def place(self, marker: Observed) -> ElementPlace | None:
        """Place of a marker that no single node carries; None for all others."""
        if not isinstance(marker, Marker):
            return None
        place = self._place_of(marker)
        if place is None or place.node is not None:
            return None
        return ElementPlace.on(self.line(marker.body), place.element, place.xi)

    def _place_of(self, marker: Observed) -> Place | None:
        """Place of a marker in the model, found once: systems ask for it many times."""
        if marker not in self._places:
            self._places[marker] = self.model.marker_place(marker)
        return self._places[marker]

    def surface_place(self, marker: Attachment) -> SurfacePlace | None:
        """Place of a marker on a shell, None for the others."""
        if isinstance(marker, SurfaceMarker):
            return SurfacePlace(SHELLS, marker.nodes, marker.weights)
        if not isinstance(marker, Marker) or not isinstance(self.model.get(marker.body), Shell):
            return None
        key = self.key(marker)
        assert key is not None  # lines are no single places
        return SurfacePlace(SHELLS, (key[1],), (1.0,))

    def on_triangle(self, marker: Marker, place: SurfacePlace) -> SurfacePlace:
        """The place of a marker in a triangle of its shell."""
        assert self.surface is not None
        mesh = self.surface.mesh
        return place.on_triangle(mesh, mesh.bodies[self.model[marker.body].body])

    def mesh_nodes(self, nodes: Sequence[int]) -> IntArray:
        """Numbers of the beams' nodes given by their numbers in the mesh."""
        return np.array([self._node_of_mesh[node] for node in nodes], dtype=np.int64)

    def local_node(self, marker: Observed, kind: int, block: FrameBlock) -> int:
        """Local index of a marker's node in the block of a kind, -1 if it is not owned there.

        Also -1 for markers inside elements.
        """
        key = None if self.place(marker) else self.key(marker)
        if key is None or key[0] != kind:
            return -1
        return int(block.owned_index(np.array([key[1]]))[0])

    def bodies(self, kind: int, nodes: IntArray) -> IntArray:
        """Numbers of the bodies, among those of their kind, that nodes belong to."""
        if kind == BEAMS:
            return self._body_of_node[nodes]
        if kind == SHELLS:
            assert self.surface is not None
            return self.surface.body_of_node[nodes]
        if kind == NURBS:
            assert self.curves is not None
            return self.curves.body_of_node[nodes]
        if kind == FLOATING:
            assert self.floating is not None
            return self.floating.body_of_node[nodes]
        return nodes

    def clusters(self, kind: int, nodes: IntArray) -> IntArray:
        """Numbers of the clusters of bodies with common nodes that nodes belong to."""
        if kind == SHELLS:
            assert self.surface is not None
            return self.surface.cluster_of_node[nodes]
        return self.bodies(kind, nodes)

    def body(self, kind: int, number: int) -> Beam | Shell | RigidBody | FloatingBody:
        """Body of a kind by its number."""
        model = self.model
        kinds: dict[int, Sequence[Beam | Shell | RigidBody | FloatingBody]] = {
            RIGID: model.rigid_bodies, SHELLS: model.shells, FLOATING: model.floating_bodies,
        }  # fmt: skip
        return kinds.get(kind, model.beams)[number]

    def owner(self, kind: int) -> str:
        """What messages call the first body of a kind."""
        if kind == RIGID:
            return f'RigidBody "{self.model.rigid_bodies[0].name}"'
        if kind == SHELLS:
            return f'Shell "{self.model.shells[0].name}"'
        if kind == FLOATING:
            return f'FloatingBody "{self.model.floating_bodies[0].name}"'
        return f'Beam "{self.model.beams_of("se3" if kind == BEAMS else "nurbs")[0].name}"'

    def node_frames(self, kind: int) -> FloatArray:
        """Frames (n, 12) of all nodes of a kind at the start."""
        if kind == NURBS:
            assert self.curves is not None
            return self.curves.frames
        if kind == SHELLS:
            assert self.surface is not None
            return self.surface.frames
        if kind == FLOATING:
            assert self.floating is not None
            return self.floating.frames
        return self.frames if kind == BEAMS else self.rigid_frames

    def carrier_frame(self, marker: Marker) -> FloatArray:
        """Frame (12,) at the start of what carries a marker: its node, or its place in a line."""
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
            place = SurfacePlace(SHELLS, marker.nodes, marker.weights)
            x = place.position(self.node_frames(SHELLS)[:, :3])
            return Pose(x + marker.offset, marker.rotation)
        frame = self.marker_frame(marker)
        if isinstance(marker, Marker):
            frame = se3.compose(self.carrier_frame(marker), frame)
        return Pose(se3.position(frame), se3.rotation(frame))


def _chain(cells: IntArray) -> IntArray | None:
    """Order of cells of one line, all in its direction; None where they branch or fall apart."""
    lines = trace_lines(cells)
    if len(lines) != 1 or lines[0].reversed.any():
        return None
    return lines[0].cells


def _along(model: Model, beam: Beam) -> IntArray:
    """Cells of a beam ordered along it, so that neighbours in number are neighbours in space."""
    rows = model.beam_cells(beam)
    assert model.mesh is not None
    assert beam.group is not None
    order = model.mesh.order(beam.group)
    if order is None:
        return rows
    rank = np.empty(len(model.mesh.points), dtype=np.int64)
    rank[order] = np.arange(len(order))
    return rows[np.argsort(rank[model.mesh.cells[rows]].min(axis=1), kind="stable")]
