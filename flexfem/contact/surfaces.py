# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact of nodes with one rigid surface of a simple shape."""

from dataclasses import dataclass

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.contact import rigid
from flexfem.contact.held_contacts import ContactLaw, HeldContacts
from flexfem.contact.stiffening import stiffen
from flexfem.contact.triangles import Slaves

__all__ = ["RigidContact", "Shape"]

#: Rigid surfaces of simple shapes have no triangles, and so none that are thick.
_NO_TRIANGLES: IntArray = np.zeros(0, np.int64)
_NO_THICKNESS: FloatArray = np.zeros(0)


@dataclass(frozen=True)
class Shape:
    """A rigid surface in the axes of its frame; see ``rigid.ShapeKind``.

    Attributes:
        kind: Which shape.
        radius: Metres.
        length: Along the axis, metres.
    """

    kind: rigid.ShapeKind
    radius: float = 0.0
    length: float = np.inf


class RigidContact:
    """Contacts of slaves with a rigid surface at the trial state.

    Attributes:
        slaves, shape: What touches.
        count: Contacts at the trial state.
        ends: Slave of each, shape (count,) used.
        contacts: Numbers of each, see ``rigid``, shape (count, RIGID_FIELDS) used.
        held: What friction and damping act on.
        stiffer: Largest slope of the force over that at contact, see ``stiffening``.
    """

    def __init__(self, slaves: Slaves, shape: Shape, law: ContactLaw | None = None) -> None:
        """Describe what touches."""
        self.slaves, self.shape, self.count = slaves, shape, 0
        self.stiffer = 1.0
        self.ends = np.empty(len(slaves.nodes), np.int64)
        self.contacts = np.empty((len(slaves.nodes), rigid.RIGID_FIELDS))
        self._frame = np.zeros(12)
        self._law = ContactLaw() if law is None else law
        self.held = HeldContacts.none(self._law)
        self._arms, self._start = np.zeros((0, 3)), np.zeros((0, 3))

    def distances(self, points: FloatArray, frame: FloatArray) -> FloatArray:
        """Gaps of all slaves (s,), m."""
        values, shape = np.empty(len(self.slaves.nodes)), self.shape
        rigid.distances_into(
            points[self.slaves.nodes], frame, int(shape.kind), shape.radius, shape.length, values
        )
        return values - self.slaves.offsets

    def evaluate(self, points: FloatArray, frame: FloatArray, h: float = 0.0) -> None:
        """Find the contacts at a trial state, with the surface's frame (12,)."""
        self._frame, s, shape = frame.copy(), self.slaves, self.shape
        self.count = rigid.find_rigid_contacts(
            points, s.nodes, s.offsets, self._frame, int(shape.kind), shape.radius, shape.length,
            self.ends, self.contacts,
        )  # fmt: skip
        stiffen(
            self.count, self.contacts, 0, 15, self.ends, s.offsets, _NO_TRIANGLES, _NO_THICKNESS,
            self.stiffer,
        )  # fmt: skip
        if len(self.held.slaves):
            places = frame[:3] + self._arms @ frame[3:].reshape(3, 3).T
            nodes = s.nodes[self.held.slaves]
            self.held.evaluate(points[nodes] - places - self._start, h)

    def accept(self, points: FloatArray) -> None:
        """End a step: the contacts evaluated last are those that friction acts on now."""
        if self._law.elastic:
            return
        c, ends, R = self.contacts[: self.count], self.ends[: self.count], self._rotation
        stiffness = self.slaves.stiffness[ends]
        self.held = self.held.follow(ends.copy(), c[:, 1:4] @ R.T, -stiffness * c[:, 15], stiffness)
        self._arms = c[:, 12:15].copy()
        places = self._frame[:3] + self._arms @ R.T
        self._start = points[self.slaves.nodes[ends]] - places

    def memory(self) -> FloatArray:
        """The contacts that are held, a row for each slave."""
        return self.held.packed(len(self.slaves.nodes), self._arms)

    def recall(self, points: FloatArray, frame: FloatArray, memory: FloatArray) -> None:
        """Take back what :meth:`memory` returned, at the same positions."""
        self._frame = frame.copy()
        self.held, self._arms = HeldContacts.unpacked(self._law, memory, self.slaves.stiffness)
        places = frame[:3] + self._arms @ self._rotation.T
        self._start = points[self.slaves.nodes[self.held.slaves]] - places

    @property
    def _rotation(self) -> FloatArray:
        return self._frame[3:].reshape(3, 3)

    @property
    def energy(self) -> float:
        """Energy stored, J."""
        value: float = rigid.rigid_energy(
            self.count, self.ends, self.contacts, self.slaves.stiffness
        )
        return value

    @property
    def deepest(self) -> float:
        """Largest penetration, m."""
        return float(-self.contacts[: self.count, 0].min(initial=0.0))

    @property
    def forces(self) -> FloatArray:
        """Normal forces of the contacts on the slaves, inertial axes, (count, 3), newtons."""
        c = self.contacts[: self.count]
        sizes = -self.slaves.stiffness[self.ends[: self.count]] * c[:, 15]
        return sizes[:, None] * (c[:, 1:4] @ self._rotation.T)

    def add_forces(self, residual: FloatArray, wrench: FloatArray, scale: float = 1.0) -> None:
        """Add ``scale`` times the forces.

        Args:
            residual: Of all nodes, inertial axes, shape (n, 3).
            wrench: Of the surface's frame, force and moment in its axes, shape (6,).
            scale: Factor.
        """
        s = self.slaves
        rigid.add_rigid_forces(
            self.count, s.nodes, self.ends, self.contacts, s.stiffness, self._frame, scale,
            residual, wrench,
        )  # fmt: skip
        if len(self.held.slaves):
            self._add_held(scale * self.held.forces, residual, wrench)

    def add_actions(
        self, steps: FloatArray, twist: FloatArray, residual: FloatArray, wrench: FloatArray,
        scale: float = 1.0,
    ) -> None:  # fmt: skip
        """Add ``scale`` times the tangent applied to steps (n, 3) and a local twist (6,)."""
        s = self.slaves
        rigid.add_rigid_actions(
            self.count, s.nodes, self.ends, self.contacts, s.stiffness, self._frame, scale, steps,
            twist, residual, wrench,
        )  # fmt: skip
        if len(self.held.slaves):
            moved = (twist[:3] + np.cross(twist[3:], self._arms)) @ self._rotation.T
            slips = steps[s.nodes[self.held.slaves]] - moved
            forces = np.einsum("cij,cj->ci", self.held.tangents, slips)
            self._add_held(scale * forces, residual, wrench)
            # forces keep their inertial axes, while those of the frame turn
            back = scale * self.held.forces @ self._rotation
            turned = np.cross(back, twist[3:])
            wrench[:3] -= turned.sum(0)
            wrench[3:] -= np.cross(self._arms, turned).sum(0)

    def blocks(self, scale: float = 1.0) -> tuple[IntArray, FloatArray]:
        """Nodes (c,) and ``scale`` times the tangents (c, 9, 9): node, then twist of the frame."""
        s, held = self.slaves, self.held
        blocks = np.empty((self.count, 9, 9))
        rigid.rigid_blocks_into(
            self.count, self.ends, self.contacts, s.stiffness, self._frame, scale, blocks
        )
        nodes = s.nodes[self.ends[: self.count]]
        if not len(held.slaves):
            return nodes, blocks
        return (
            np.concatenate([nodes, s.nodes[held.slaves]]),
            np.concatenate([blocks, scale * self._held_blocks()]),
        )

    def _held_blocks(self) -> FloatArray:
        """Tangents (c, 9, 9) of friction and damping."""
        count, R = len(self._arms), self._rotation
        J = np.zeros((count, 3, 9))
        arms, forces = _cross(self._arms), _cross(self.held.forces @ R)
        J[:, :, :3], J[:, :, 3:6], J[:, :, 6:] = np.eye(3), -R, R @ arms
        blocks = J.swapaxes(1, 2) @ self.held.tangents @ J
        blocks[:, 3:6, 6:] -= forces
        blocks[:, 6:, 6:] -= arms @ forces
        return blocks

    def _add_held(self, forces: FloatArray, residual: FloatArray, wrench: FloatArray) -> None:
        """Add forces (c, 3) on the nodes, and what they do to the frame."""
        np.add.at(residual, self.slaves.nodes[self.held.slaves], forces)
        back = forces @ self._rotation
        wrench[:3] -= back.sum(0)
        wrench[3:] -= np.cross(self._arms, back).sum(0)


def _cross(vectors: FloatArray) -> FloatArray:
    """Matrices (c, 3, 3) of the vector products with vectors (c, 3)."""
    zero = np.zeros(len(vectors))
    x, y, z = vectors.T
    rows = [zero, -z, y, z, zero, -x, -y, x, zero]
    return np.stack(rows, axis=1).reshape(-1, 3, 3)
