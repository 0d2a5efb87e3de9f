# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies of a model as rigid bodies: one frame and one inertia matrix for each."""

from collections.abc import Iterable
from functools import cached_property

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.core.marker import Attachment, Ground
from flexfem.kinematics.body_inertia import body_inertia
from flexfem.layout.numbered_model import NumberedModel
from flexfem.lie import se3
from flexfem.model.bodies.base import Body
from flexfem.model.bodies.basic import Beam, RigidBody
from flexfem.model.bodies.floating_body import FloatingBody
from flexfem.model.bodies.shell import Shell

__all__ = ["RigidParts"]


class RigidParts:
    """Parts that move as one: rigid bodies, flexible ones as unstrained, some with common nodes.

    Attributes:
        names: of the bodies of each part; beams or shells that share nodes are one.
        number: part of each body by its name.
        frames: (n, 12) frames at the start: those of rigid bodies and of bodies in floating frames;
            of others inertial axes in the middle of their nodes.
    """

    def __init__(self, serial: NumberedModel) -> None:
        """Find the parts of a model."""
        model = serial.model
        self._serial = serial
        whole: list[RigidBody | FloatingBody] = [*model.rigid_bodies, *model.floating_bodies]
        self.names: list[tuple[str, ...]] = [(body.name,) for body in whole]
        frames = [np.empty((0, 12)), *(se3.frame(b.position, b.rotation)[None] for b in whole)]
        bodies: list[Beam | Shell | Body] = [
            *model.beams, *model.shells, *model.other_bodies
        ]  # fmt: skip
        nodes = {body.name: _nodes(serial, body) for body in bodies}
        for names in _clusters(nodes):
            self.names.append(names)
            middle = np.concatenate([nodes[name][0] for name in names]).mean(axis=0)
            frames.append(se3.frame(middle, np.eye(3))[np.newaxis])
        self.frames: FloatArray = np.concatenate(frames)
        self.number = {name: i for i, names in enumerate(self.names) for name in names}

    @cached_property
    def inertia(self) -> FloatArray:
        """Inertia matrices (n, 6, 6) about these frames, in their axes, translation first.

        Rotation-free shells have no rotary inertia of their thickness.
        """
        serial, model = self._serial, self._serial.model
        matrices = np.zeros((len(self), 6, 6))
        for i, names in enumerate(self.names):
            for name in names:
                body = model[name]
                if isinstance(body, (RigidBody, FloatingBody)):
                    matrices[i] = body.inertia_matrix
                else:
                    matrices[i] += body_inertia(serial, body, self.frames[i])
        for mass in model.point_masses:
            i = self.number[mass.marker.body]
            matrices[i] += body_inertia(serial, mass, self.frames[i])
        return matrices

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


def _nodes(
    serial: NumberedModel, body: Beam | Shell | Body
) -> tuple[FloatArray, list[tuple[object, ...]]]:
    """Positions (k, 3) of the nodes of a body, and keys that are equal where bodies share nodes."""
    model = serial.model
    if isinstance(body, Body):
        return body.points, [(body.name,)]
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
    """Names of the connected bodies, in the order of the first of each."""
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
