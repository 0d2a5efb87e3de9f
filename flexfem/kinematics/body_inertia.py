# SPDX-License-Identifier: LGPL-3.0-or-later
"""Inertia matrices of bodies at the start."""

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.places.line_points import find_jacobian
from flexfem.layout.numbered_model import NumberedModel
from flexfem.lie import se3
from flexfem.materials.shell_section import ShellSection
from flexfem.model.bodies.base import Body
from flexfem.model.bodies.basic import Beam, PointMass, RigidBody
from flexfem.model.bodies.floating_body import FloatingBody
from flexfem.model.bodies.shell import Shell

__all__ = ["body_inertia", "carried"]

#: Gauss points in a cell of a beam, relative to its length
_POINTS = 0.5 + 0.5 / np.sqrt(3.0) * np.array([-1.0, 1.0])
#: Coordinates and weights of seven points in a triangle, exact for degree five (Radon 1948).
_NEAR, _FAR = (6.0 - np.sqrt(15.0)) / 21.0, (6.0 + np.sqrt(15.0)) / 21.0
_TRIANGLE = np.array(
    [(1.0 / 3.0, 1.0 / 3.0, 9.0 / 40.0)]
    + [
        (r, s, (155.0 - sign * np.sqrt(15.0)) / 1200.0)
        for a, sign in ((_NEAR, 1.0), (_FAR, -1.0))
        for r, s in ((a, a), (a, 1.0 - 2.0 * a), (1.0 - 2.0 * a, a))
    ]
)


def body_inertia(
    serial: NumberedModel, body: Beam | Shell | RigidBody | FloatingBody | Body | PointMass,
    origin: FloatArray,
) -> FloatArray:  # fmt: skip
    """Inertia matrix (6, 6) of a body at the start, translation first.

    Flexible bodies count as they are unstrained; rotation-free shells have no rotary inertia of
    their thickness.

    Args:
        serial: serial data of the model.
        body: of the model.
        origin: frame (12,) about whose origin and in whose axes it is.
    """
    if isinstance(body, (RigidBody, FloatingBody)):
        frame = se3.frame(body.position, body.rotation)
        return carried(origin, frame[np.newaxis], body.inertia_matrix)
    if isinstance(body, PointMass):
        at = se3.frame(serial.marker_pose(body.marker).position, np.eye(3))
        return carried(origin, at[np.newaxis], np.diag([body.mass] * 3 + [0.0] * 3))
    if isinstance(body, Body):
        points, weights = body.masses
        frames = se3.frame(points, np.tile(np.eye(3), (len(points), 1, 1)))
        return carried(origin, frames, np.diag([1.0] * 3 + [0.0] * 3), weights)
    if isinstance(body, Shell):
        return _shell_inertia(serial, body, origin)
    if body.formulation == "nurbs":
        return _curve_inertia(serial, body, origin)
    return _beam_inertia(serial, body, origin)


def carried(
    origin: FloatArray, frames: FloatArray, inertia: FloatArray, weights: FloatArray | None = None
) -> FloatArray:
    """Sum of inertia matrices (6, 6) in frames (k, 12), times weights, about an origin (12,)."""
    A = se3.adjoint(se3.inverse(se3.compose(se3.inverse(origin), frames)))
    w = np.ones(len(frames)) if weights is None else weights
    A = A.reshape(-1, 6)
    weighted = (inertia @ A.reshape(-1, 6, 6)) * w[:, np.newaxis, np.newaxis]
    total: FloatArray = A.T @ weighted.reshape(-1, 6)
    return total


def _beam_inertia(serial: NumberedModel, body: Beam, origin: FloatArray) -> FloatArray:
    cells = serial.cells.frames[serial.cells.body == serial.model.beams.index(body)]
    twists = se3.log(se3.compose(se3.inverse(cells[:, 0]), cells[:, 1]))
    weights = 0.5 * np.linalg.norm(twists[:, :3], axis=1)
    total = np.zeros((6, 6))
    for xi in _POINTS:
        sections = se3.retract(cells[:, 0], xi * twists)
        total += carried(origin, sections, body.section.inertia, weights)
    return total


def _curve_inertia(serial: NumberedModel, body: Beam, origin: FloatArray) -> FloatArray:
    curves = serial.curves
    assert curves is not None
    index = curves.index(body.name)
    xi, lengths = curves.gauss(index, fine=True)
    nodes, shape = curves.nodes(index), curves.parts[index].shape
    element = curves.element(index)
    sections = np.empty((len(nodes), len(xi), 12))
    jacobian = np.empty((6, 6 * nodes.shape[1] + 1))
    for e, q in np.ndindex(len(nodes), len(xi)):
        frames = np.ascontiguousarray(curves.frames[nodes[e]])
        find_jacobian(element, frames, shape[e], float(xi[q]), sections[e, q], jacobian)
    return carried(origin, sections.reshape(-1, 12), body.section.inertia, lengths.ravel())


def _shell_inertia(serial: NumberedModel, body: Shell, origin: FloatArray) -> FloatArray:
    """Midpoint rule of the edges, exact for integrands quadratic in a triangle."""
    surface = serial.surface
    assert surface is not None
    rows = np.flatnonzero(surface.body == serial.model.shells.index(body))
    if surface.directors is not None:
        x = surface.frames[surface.directors.nodes[rows], :3]
        return _director_inertia(x, body.section, origin)
    x = surface.mesh.points[surface.mesh.triangles[rows]]
    midpoints = (0.5 * (x + np.roll(x, 1, axis=1))).reshape(-1, 3)
    points = se3.frame(midpoints, np.broadcast_to(np.eye(3), (len(midpoints), 3, 3)))
    mass = np.diag([body.section.mass] * 3 + [0.0] * 3)
    return carried(origin, points, mass, np.repeat(surface.mesh.areas[rows] / 3.0, 3))


def _director_inertia(x: FloatArray, section: ShellSection, origin: FloatArray) -> FloatArray:
    """Curved triangles with corners and midpoints of the opposite edges x (m, 6, 3)."""
    r, s = _TRIANGLE[:, :2].T
    t = 1.0 - r - s
    nothing = np.zeros_like(r)
    shape = [t * (2 * t - 1), r * (2 * r - 1), s * (2 * s - 1), 4 * r * s, 4 * s * t, 4 * t * r]
    by_r = [1 - 4 * t, 4 * r - 1, nothing, 4 * s, -4 * s, 4 * (t - r)]
    by_s = [1 - 4 * t, nothing, 4 * s - 1, 4 * r, 4 * (t - s), -4 * r]
    points, along, other = (
        np.einsum("iq,mia->mqa", np.array(values), x).reshape(-1, 3)
        for values in (shape, by_r, by_s)
    )
    normal = np.cross(along, other)
    size = np.linalg.norm(normal, axis=1)
    e3, e1 = normal / size[:, None], along / np.linalg.norm(along, axis=1)[:, None]
    frames = se3.frame(points, np.stack([e1, np.cross(e3, e1), e3], axis=2))
    rotary = section.mass * section.thickness**2 / 12.0
    inertia = np.diag([section.mass] * 3 + [rotary, rotary, 0.0])
    return carried(origin, frames, inertia, 0.5 * size * np.tile(_TRIANGLE[:, 2], len(x)))
