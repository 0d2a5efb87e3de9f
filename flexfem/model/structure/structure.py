# SPDX-License-Identifier: LGPL-3.0-or-later
"""The mechanical part of a model, which contacts, probes, events and controllers refer to."""

from typing import Any

import numpy as np

from flexfem import _checks
from flexfem._types import IntArray
from flexfem.core.joint import Joint
from flexfem.core.load import Load
from flexfem.core.marker import Carrier, Marker, Observed, ShellLine, SurfaceMarker
from flexfem.core.node_row import NodeRow
from flexfem.loads.gravity import Gravity
from flexfem.mesh.geometry.topology import arc_length
from flexfem.mesh.line_mesh import LineMesh
from flexfem.mesh.nurbs.curve import NurbsCurve
from flexfem.mesh.surface_mesh import SurfaceMesh
from flexfem.model.bodies.base import Body
from flexfem.model.bodies.basic import Beam, PointMass, RigidBody
from flexfem.model.bodies.floating_body import FloatingBody
from flexfem.model.bodies.shell import Shell
from flexfem.model.structure.marker_places import (
    beam_place,
    curve_place,
    group_curve,
    node_row,
    shell_node,
)
from flexfem.model.structure.place import Place

__all__ = ["Structure"]


class Structure:
    """Meshes, bodies, joints and loads by name, and where markers are on them.

    Its attributes are described at :class:`~flexfem.Model`, which adds what refers to them.
    """

    def __init__(self, name: str, mesh: LineMesh | None, surface: SurfaceMesh | None) -> None:
        """Start without bodies.

        Raises:
            TypeError: An argument has the wrong type.
            ValueError: The name is empty.
        """
        self.name = _checks.text(type(self).__name__, "name", name)
        if mesh is not None:
            _checks.instance(repr(self), "mesh", mesh, LineMesh)
        if surface is not None:
            _checks.instance(repr(self), "surface", surface, SurfaceMesh)
        self.mesh, self.surface = mesh, surface
        self.gravity: Gravity | None = None
        self.beams: list[Beam] = []
        self.shells: list[Shell] = []
        self.rigid_bodies: list[RigidBody] = []
        self.floating_bodies: list[FloatingBody] = []
        self.other_bodies: list[Body] = []
        self.point_masses: list[PointMass] = []
        self.joints: list[Joint] = []
        self.loads: list[Load] = []
        self.released: list[str] = []
        self._named: dict[str, Any] = {}
        self._curves: dict[str, NurbsCurve] = {}

    def __getitem__(self, name: str) -> Any:
        """Return the object of the given name.

        Raises:
            ValueError: There is none.
        """
        if name not in self._named:
            known = _checks.show(", ".join(self._named), 200)
            raise ValueError(f'{self!r}: there is no "{name}"; it has {known}')
        return self._named[name]

    @property
    def things(self) -> tuple[Any, ...]:
        """All named objects in the order they were added."""
        return tuple(self._named.values())

    @property
    def bodies(self) -> tuple[Beam | Shell | RigidBody | FloatingBody | Body, ...]:
        """All bodies, kind by kind; point masses are none."""
        return (
            *self.beams, *self.shells, *self.rigid_bodies, *self.floating_bodies,
            *self.other_bodies,
        )  # fmt: skip

    def of[Thing](self, kind: type[Thing]) -> list[Thing]:
        """Return the named objects of a class in the order they were added."""
        things = self._named.values()
        kinds = {own for own in set(map(type, things)) if issubclass(own, kind)}
        return [thing for thing in things if type(thing) in kinds] if kinds else []

    def get(self, name: str) -> Any | None:
        """Return the object of the given name, or None."""
        return self._named.get(name)

    def marker_place(self, marker: Observed) -> Place | None:
        """Return where a marker is on a flexible body; None on rigid bodies and the ground.

        Raises:
            ValueError: The marker's body or point does not exist.
        """
        if not isinstance(marker, Marker) or isinstance(
            marker, (Carrier, ShellLine, SurfaceMarker)
        ):
            return None
        body = self.get(marker.body)
        if isinstance(body, RigidBody):
            if marker.point is not None:
                raise ValueError(
                    f'Marker on "{marker.body}": a rigid body has no point "{marker.point}"; '
                    "give an offset"
                )
            return None
        if isinstance(body, (FloatingBody, Body)):
            return Place(body.node(marker))
        if isinstance(body, Shell):
            assert self.surface is not None  # checked by validate()
            return Place(shell_node(self.surface, body, marker))
        if not isinstance(body, Beam):
            raise ValueError(f'Marker on "{marker.body}": {self!r} has no such body')
        if body.formulation == "nurbs":
            return curve_place(self.mesh, self.curve(body), body, marker)
        return beam_place(self._mesh(), body, marker)

    def node_row(self, line: ShellLine) -> NodeRow:
        """Return the nodes along a line of a shell.

        Raises:
            ValueError: The model has no such shell, the mesh no such line, or it is not on it.
        """
        shell = self.get(line.body)
        if not isinstance(shell, Shell) or self.surface is None:
            raise ValueError(f'ShellLine: {self!r} has no shell "{line.body}"')
        return node_row(self.surface, shell, line)

    def beams_of(self, formulation: str) -> list[Beam]:
        """Return the beams of a formulation in their order."""
        return [beam for beam in self.beams if beam.formulation == formulation]

    def beam_cells(self, beam: Beam) -> IntArray:
        """Return the mesh's cells along a group as row numbers, ascending; none along a curve.

        Raises:
            ValueError: The model has no mesh or the mesh no such group of lines.
        """
        if beam.group is None:
            return np.empty(0, dtype=np.int64)
        mesh = self._mesh()
        mesh.group_cells(beam.group)
        return mesh.line_groups[beam.group]

    def curve(self, beam: Beam) -> NurbsCurve:
        """Return the curve of a beam with the formulation "nurbs".

        Raises:
            ValueError: The group of the beam is not in the mesh, branches or falls apart, or has
                too few nodes for the degree.
        """
        if beam.curve is not None:
            return beam.curve
        if beam.name not in self._curves:
            self._curves[beam.name] = group_curve(self._mesh(), beam)
        return self._curves[beam.name]

    def beam_length(self, beam: Beam) -> float:
        """Return the arc length of a beam, m.

        Raises:
            ValueError: Its line branches or falls apart.
        """
        if beam.formulation == "nurbs":
            return self.curve(beam).length
        assert beam.group is not None
        mesh = self._mesh()
        nodes = mesh.order(beam.group)
        if nodes is None:
            raise ValueError(f'Beam "{beam.name}": group "{beam.group}" branches or falls apart')
        return float(arc_length(mesh.points[nodes])[-1])

    def weights(self) -> IntArray:
        """Return the numbers of elements of the beams, in their order.

        Raises:
            ValueError: The model has no mesh or the mesh no such group of lines.
        """
        counts = [
            len(self.curve(beam).elements.nodes)
            if beam.formulation == "nurbs"
            else len(self.beam_cells(beam))
            for beam in self.beams
        ]
        return np.array(counts, dtype=np.int64)

    def _mesh(self) -> LineMesh:
        """Return the mesh."""
        if self.mesh is None:
            raise ValueError(f"{self!r}: it has beams but no mesh, give Model(mesh=...)")
        return self.mesh

    def __repr__(self) -> str:
        """Return class and quoted name."""
        return f'{type(self).__name__} "{self.name}"'
