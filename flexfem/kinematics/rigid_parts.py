# SPDX-License-Identifier: LGPL-3.0-or-later
"""The bodies of a model as wholes: one frame and one inertia matrix for each."""

from collections.abc import Iterable

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.core.line_points import NURBS as NURBS_ELEMENT
from flexfem.core.line_points import line_jacobian
from flexfem.core.marker import Attachment, Ground
from flexfem.lie import se3
from flexfem.model.bodies import Beam, RigidBody
from flexfem.model.floating_body import FloatingBody
from flexfem.model.shell import Shell
from flexfem.system.assembly import Assembly

__all__ = ["RigidParts"]

#: Gauss points in a cell of a beam, and their weights
_POINTS = 0.5 + 0.5 / np.sqrt(3.0) * np.array([-1.0, 1.0])


class RigidParts:
    """What moves as one: a rigid body, or a flexible one as it is unstrained, or some with nodes.

    Attributes:
        names: of the bodies of each part; beams or shells that share nodes are one.
        number: part of each body by its name.
        frames: (n, 12) frames at the start: those of rigid bodies and of bodies in floating frames;
            of others inertial axes in the middle of their nodes.
        inertia: (n, 6, 6) inertia matrices about these frames, in their axes, translation first.
            Shells count as thin: without the rotary inertia of their thickness.
    """

    def __init__(self, serial: Assembly) -> None:
        """Find the parts of a model and sum up their masses."""
        model = serial.model
        self._serial = serial
        whole: list[RigidBody | FloatingBody] = [*model.rigid_bodies, *model.floating_bodies]
        self.names: list[tuple[str, ...]] = [(body.name,) for body in whole]
        frames = [np.empty((0, 12)), *(se3.frame(b.position, b.rotation)[None] for b in whole)]
        inertia = [body.inertia_matrix for body in whole]
        bodies: list[Beam | Shell] = [*model.beams, *model.shells]
        nodes = {body.name: _nodes(serial, body) for body in bodies}
        for names in _clusters(nodes):
            self.names.append(names)
            middle = np.concatenate([nodes[name][0] for name in names]).mean(axis=0)
            frames.append(se3.frame(middle, np.eye(3))[np.newaxis])
            inertia.append(sum((_inertia(serial, model[n], frames[-1][0]) for n in names), _none()))
        self.frames: FloatArray = np.concatenate(frames)
        self.number = {name: i for i, names in enumerate(self.names) for name in names}
        for mass in model.point_masses:
            i = self.number[mass.marker.body]
            at = se3.frame(serial.marker_pose(mass.marker).position, np.eye(3))
            point = np.diag([mass.mass] * 3 + [0.0] * 3)
            inertia[i] = inertia[i] + _carried(self.frames[i], at[np.newaxis], point)
        self.inertia: FloatArray = np.array(inertia).reshape(-1, 6, 6)

    def __len__(self) -> int:
        """Number of parts."""
        return len(self.names)

    def place(self, marker: Attachment) -> tuple[int, FloatArray]:
        """Part that carries a marker, -1 for the ground, and the marker's frame relative to it.

        Raises:
            ValueError: the model has no such body or point.
        """
        pose = self._serial.marker_pose(marker)
        frame = se3.frame(pose.position, pose.rotation)
        if isinstance(marker, Ground):
            return -1, frame
        part = self.number[marker.body]
        return part, se3.compose(se3.inverse(self.frames[part]), frame)


def _none() -> FloatArray:
    return np.zeros((6, 6))


def _nodes(serial: Assembly, body: Beam | Shell) -> tuple[FloatArray, list[tuple[object, ...]]]:
    """Positions (k, 3) of the nodes of a body, and keys that are equal where bodies share nodes."""
    model = serial.model
    if isinstance(body, Shell):
        assert model.surface is not None  # checked by validate()
        nodes = model.surface.body_nodes(body.body)
        return model.surface.points[nodes], [("surface", int(node)) for node in nodes]
    if body.formulation == "nurbs":
        return model.curve(body).points, [(body.name,)]
    assert model.mesh is not None
    nodes = np.unique(model.mesh.cells[model.beam_cells(body)])
    return model.mesh.points[nodes], [("mesh", int(node)) for node in nodes]


def _clusters(
    nodes: dict[str, tuple[FloatArray, list[tuple[object, ...]]]],
) -> Iterable[tuple[str, ...]]:
    """Names of the bodies that hang together, in the order of the first of each."""
    cluster: dict[str, list[str]] = {}
    owner: dict[tuple[object, ...], str] = {}
    for name, (_, keys) in nodes.items():
        members = [name]
        for other in {id(cluster[owner[key]]): owner[key] for key in keys if key in owner}.values():
            members = cluster[other] + members
        for member in members:
            cluster[member] = members
        owner |= dict.fromkeys(keys, name)
    return list(dict.fromkeys(tuple(members) for members in cluster.values()))


def _inertia(serial: Assembly, body: Beam | Shell, origin: FloatArray) -> FloatArray:
    """Inertia matrix (6, 6) of a flexible body at the start about a frame."""
    if isinstance(body, Shell):
        return _shell_inertia(serial, body, origin)
    if body.formulation == "nurbs":
        return _curve_inertia(serial, body, origin)
    cells = serial.cells.frames[serial.cells.body == serial.model.beams.index(body)]
    twists = se3.log(se3.compose(se3.inverse(cells[:, 0]), cells[:, 1]))
    weights = 0.5 * np.linalg.norm(twists[:, :3], axis=1)
    total = np.zeros((6, 6))
    for xi in _POINTS:
        sections = se3.retract(cells[:, 0], xi * twists)
        total += _carried(origin, sections, body.section.inertia, weights)
    return total


def _curve_inertia(serial: Assembly, body: Beam, origin: FloatArray) -> FloatArray:
    curves = serial.curves
    assert curves is not None
    index = curves.index(body.name)
    xi, lengths = curves.gauss(index)
    nodes, shape = curves.nodes(index), curves.parts[index].shape
    sections = np.empty((len(nodes), len(xi), 12))
    jacobian = np.empty((6, 6 * nodes.shape[1] + 1))
    for e, q in np.ndindex(len(nodes), len(xi)):
        frames = np.ascontiguousarray(curves.frames[nodes[e]])
        line_jacobian(NURBS_ELEMENT, frames, shape[e], float(xi[q]), sections[e, q], jacobian)
    return _carried(origin, sections.reshape(-1, 12), body.section.inertia, lengths.ravel())


def _shell_inertia(serial: Assembly, body: Shell, origin: FloatArray) -> FloatArray:
    """The rule of the edges' middles is exact for what is quadratic in a triangle."""
    mesh = serial.model.surface
    assert mesh is not None
    x = mesh.points[mesh.triangles[mesh.body_rows(body.body)]]
    area = 0.5 * np.linalg.norm(np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]), axis=1)
    middles = (0.5 * (x + np.roll(x, 1, axis=1))).reshape(-1, 3)
    points = se3.frame(middles, np.broadcast_to(np.eye(3), (len(middles), 3, 3)))
    mass = np.diag([body.section.mass] * 3 + [0.0] * 3)
    return _carried(origin, points, mass, np.repeat(area / 3.0, 3))


def _carried(
    origin: FloatArray, frames: FloatArray, inertia: FloatArray, weights: FloatArray | None = None
) -> FloatArray:
    """Sum of inertia matrices (6, 6) in frames (k, 12), times weights, about an origin (12,)."""
    A = se3.adjoint(se3.inverse(se3.compose(se3.inverse(origin), frames)))
    w = np.ones(len(frames)) if weights is None else weights
    total: FloatArray = np.einsum("k,kji,jl,klm->im", w, A, inertia, A, optimize=True)
    return total


def part_numbers(parts: RigidParts, names: Iterable[str], owner: str) -> IntArray:
    """Numbers of the parts that bodies belong to.

    Raises:
        ValueError: there is no such body.
    """
    found = []
    for name in names:
        if name not in parts.number:
            known = ", ".join(parts.number)
            raise ValueError(f'{owner}: there is no body "{name}"; there are {known}')
        found.append(parts.number[name])
    return np.array(sorted(set(found)), dtype=np.int64)
