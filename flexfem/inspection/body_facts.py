# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mass, mass centre, inertia, size and unknowns of the bodies of a model."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from flexfem._fields import Renamed
from flexfem._types import FloatArray, IntArray
from flexfem.kinematics.body_inertia import body_inertia
from flexfem.layout.numbered_model import NumberedModel
from flexfem.lie import se3
from flexfem.model.bodies.base import Body
from flexfem.model.bodies.basic import Beam, PointMass, RigidBody
from flexfem.model.bodies.floating_body import FloatingBody
from flexfem.model.bodies.shapes import Box, CompoundShape, Shape, Sphere, SurfaceShape
from flexfem.model.bodies.shell import Shell

__all__ = ["AnyBody", "BodyFacts", "MassFacts", "body_facts", "total"]

AnyBody = Beam | Shell | RigidBody | FloatingBody | Body | PointMass

#: Names of the kinds of bodies, in the order of the summary.
KINDS: dict[type, str] = {
    Beam: "beam",
    Shell: "shell",
    RigidBody: "rigid body",
    FloatingBody: "floating body",
    Body: "element body",
    PointMass: "point mass",
}


@dataclass(frozen=True)
class MassFacts:
    """Mass properties at the start.

    Attributes:
        mass: kg.
        centre: mass centre in inertial axes, (3,), m; without mass the middle.
        inertia: about the mass centre in inertial axes, (3, 3), kg m^2.
    """

    mass: float
    centre: FloatArray
    inertia: FloatArray


@dataclass(frozen=True)
class BodyFacts:
    """A body in numbers.

    Attributes:
        body: the body of the model.
        kind: "beam", "shell", "rigid body", "floating body", "element body" or
            "point mass".
        masses: its mass properties; flexible bodies as they are unstrained.
        size: edges of its box along the inertial axes, (3,), m.
        elements: number of its finite elements.
        nodes: number of its nodes; nodes that shells share count for the first of them.
        unknowns: of these nodes.
        fixed: number of fixed unknowns.
    """

    body: AnyBody
    kind: str
    masses: MassFacts
    size: FloatArray
    elements: int = 0
    nodes: int = 0
    unknowns: int = 0
    fixed: int = 0

    @property
    def name(self) -> str:
        """Name of the body."""
        return self.body.name

    @property
    def degrees_of_freedom(self) -> int:
        """Unknowns that are not fixed."""
        return self.unknowns - self.fixed

    freedoms = Renamed("degrees_of_freedom")
    held = Renamed("fixed")


def body_facts(serial: NumberedModel) -> list[BodyFacts]:
    """Bodies of a model kind by kind, point masses last."""
    model = serial.model
    facts = [_beam(serial, beam) for beam in model.beams]
    facts += [_shell(serial, number, shell) for number, shell in enumerate(model.shells)]
    facts += [_rigid(serial, body) for body in model.rigid_bodies]
    facts += [_floating(serial, number, body) for number, body in enumerate(model.floating_bodies)]
    facts += [_energy(serial, body) for body in model.other_bodies]
    for mass in model.point_masses:
        at = serial.marker_pose(mass.marker).position
        facts.append(BodyFacts(mass, KINDS[PointMass], _masses(serial, mass, at), np.zeros(3)))
    return facts


def total(facts: Sequence[MassFacts]) -> MassFacts:
    """Mass properties of several bodies together."""
    mass = sum(one.mass for one in facts)
    centres = np.array([one.centre for one in facts]).reshape(-1, 3)
    weights = np.array([one.mass for one in facts]) if mass > 0.0 else np.ones(len(facts))
    centre = weights @ centres / max(weights.sum(), 1e-300)
    inertia = np.zeros((3, 3))
    for one in facts:
        arm = one.centre - centre
        inertia += one.inertia + one.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return MassFacts(mass, centre, inertia)


def _masses(serial: NumberedModel, body: AnyBody, near: FloatArray) -> MassFacts:
    """Mass properties of a body; ``near`` (3,) is a point near its mass centre."""
    matrix = body_inertia(serial, body, se3.frame(near, np.eye(3)))
    mass = float(matrix[0, 0])
    if mass <= 0.0:
        return MassFacts(0.0, near, np.zeros((3, 3)))
    arm = np.array([matrix[1, 5], matrix[2, 3], matrix[0, 4]]) / mass  # of -m skew(arm)
    inertia = matrix[3:, 3:] - mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return MassFacts(mass, near + arm, 0.5 * (inertia + inertia.T))


def _flexible(
    serial: NumberedModel, body: Beam | Shell | Body, points: FloatArray, elements: int,
    unknowns: tuple[int, int, int],
) -> BodyFacts:  # fmt: skip
    nodes, width, fixed = unknowns
    masses = _masses(serial, body, points.mean(axis=0))
    size = np.ptp(points, axis=0)
    kind = next(word for kind, word in KINDS.items() if isinstance(body, kind))
    return BodyFacts(body, kind, masses, size, elements, nodes, nodes * width, fixed)


def _beam(serial: NumberedModel, beam: Beam) -> BodyFacts:
    if beam.formulation == "nurbs":
        curves = serial.curves
        assert curves is not None
        index = curves.index(beam.name)
        nodes = curves.frames[curves.first_node[index] : curves.first_node[index + 1]]
        points, elements = se3.position(nodes), len(curves.parts[index].nodes)
    else:
        cells = serial.cells.cells[serial.cells.body == serial.model.beams.index(beam)]
        points, elements = serial.points[np.unique(cells)], len(cells)
    return _flexible(serial, beam, points, elements, (len(points), 6, 0))


def _shell(serial: NumberedModel, number: int, shell: Shell) -> BodyFacts:
    surface = serial.surface
    assert surface is not None
    own: IntArray = np.flatnonzero(surface.body_of_node == number)
    held = surface.held[own]
    points = surface.mesh.points[surface.mesh.body_nodes(shell.body)]
    count = int((surface.body == number).sum())
    return _flexible(
        serial, shell, points, count, (len(own), surface.held.shape[1], int(held.sum()))
    )


def _energy(serial: NumberedModel, body: Body) -> BodyFacts:
    points = body.points
    return _flexible(serial, body, points, body.elements, (len(points), body.width, body.holds))


def _rigid(serial: NumberedModel, body: RigidBody) -> BodyFacts:
    near = body.position + body.rotation @ body.centre
    size = np.abs(body.rotation) @ _shape_size(body.shape)
    return BodyFacts(body, KINDS[RigidBody], _masses(serial, body, near), size, 0, 1, 6)


def _shape_size(shape: Shape | None) -> FloatArray:
    """Edges of the box about a shape in body axes, (3,), m."""
    if shape is None:
        return np.zeros(3)
    size: FloatArray = np.ptp(_shape_points(shape), axis=0)
    return size


def _shape_points(shape: Shape) -> FloatArray:
    """Points (n, 3) in body axes with the same box about them as a shape, m."""
    if isinstance(shape, CompoundShape):
        parts = [
            _shape_points(part) @ pose.rotation.T + pose.position for part, pose in shape.parts
        ]
        return np.concatenate(parts)
    if isinstance(shape, SurfaceShape):
        return shape.points
    if isinstance(shape, Box):
        edges = np.array(shape.sizes)
    elif isinstance(shape, Sphere):
        edges = np.full(3, 2.0 * shape.radius)
    else:
        axis = np.abs(shape.axis) / np.linalg.norm(shape.axis)
        across = 2.0 * shape.radius * np.sqrt(np.clip(1.0 - axis**2, 0.0, 1.0))
        edges = shape.length * axis + across
    corners: FloatArray = 0.5 * edges * np.array(list(product((-1.0, 1.0), repeat=3)))
    return corners


def _floating(serial: NumberedModel, number: int, body: FloatingBody) -> BodyFacts:
    floating = serial.floating
    assert floating is not None
    own = floating.body_of_node == number
    held = floating.held[own]
    near = body.position + body.rotation @ body.reduced.mass_centre
    points = np.array([one.position for one in body.reduced.interfaces]).reshape(-1, 3)
    size = np.ptp(points @ body.rotation.T, axis=0) if len(points) else np.zeros(3)
    masses, nodes = _masses(serial, body, near), int(own.sum())
    return BodyFacts(body, KINDS[FloatingBody], masses, size, 0, nodes, 6 * nodes, int(held.sum()))
