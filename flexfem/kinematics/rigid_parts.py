# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies of a model as rigid bodies: one frame and one inertia matrix for each."""

from collections.abc import Iterable, Sequence
from functools import cached_property

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.core.marker import Attachment, Ground
from flexfem.layout.numbered_model import NumberedModel
from flexfem.lie import se3
from flexfem.model.bodies.base import Body
from flexfem.model.bodies.basic import Beam, RigidBody, inertia_matrices
from flexfem.model.bodies.floating_body import FloatingBody
from flexfem.model.bodies.shell import Shell

__all__ = ["RigidParts"]

#: Singular values below this part of the largest count as zero.
_ZERO = 1e-9


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
        self._with_axes: list[RigidBody | FloatingBody] = [
            *model.rigid_bodies,
            *model.floating_bodies,
        ]
        positions = np.array([body.position for body in self._with_axes]).reshape(-1, 3)
        turns = np.array([body.rotation for body in self._with_axes]).reshape(-1, 3, 3)
        self.names: list[tuple[str, ...]] = [(body.name,) for body in self._with_axes]
        frames = [se3.frame(positions, turns)]
        others: list[Beam | Shell | Body] = [*model.beams, *model.shells, *model.other_bodies]
        for names in _clusters(serial, [body.name for body in others]):
            self.names.append(names)
            middle = self._outline(names).mean(axis=0)
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
        rigid = model.rigid_bodies
        matrices[: len(rigid)] = inertia_matrices(rigid)
        for i, body in enumerate(model.floating_bodies, start=len(rigid)):
            matrices[i] = body.inertia_matrix
        for i in range(len(self._with_axes), len(self)):
            for name in self.names[i]:
                matrices[i] += serial.family_of(name).inertia(model[name], self.frames[i])
        for mass in model.point_masses:
            i = self.number[mass.marker.body]
            matrices[i] += serial.mass_inertia(mass, self.frames[i])
        return matrices

    @cached_property
    def lines(self) -> dict[int, FloatArray]:
        """Directions (3,) of the parts, by number, whose nodes have no axes and are on one line."""
        found: dict[int, FloatArray] = {}
        for i in range(len(self._with_axes), len(self)):
            families = [self._serial.family_of(name) for name in self.names[i]]
            if any(family.axes for family in families):
                continue
            arms = self._outline(self.names[i]) - self.frames[i, :3]
            _, sizes, axes = np.linalg.svd(arms, full_matrices=False)
            if len(sizes) > 1 and sizes[1] <= _ZERO * sizes[0]:
                found[i] = axes[0]
        return found

    def _outline(self, names: Iterable[str]) -> FloatArray:
        """Points (k, 3) that outline some bodies, m."""
        serial = self._serial
        return np.concatenate([serial.family_of(n).outline(serial.model[n]) for n in names])

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


def _clusters(serial: NumberedModel, names: Sequence[str]) -> Iterable[tuple[str, ...]]:
    """Names of the bodies that share nodes, in the order of the first of each."""
    cluster = {name: [name] for name in names}
    for family in serial.families.values():
        for pair in family.links():
            a, b = (cluster[name] for name in pair)
            if a is not b:
                a += b
                cluster |= dict.fromkeys(b, a)
    place = {name: i for i, name in enumerate(names)}
    return dict.fromkeys(tuple(sorted(own, key=place.__getitem__)) for own in cluster.values())


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
