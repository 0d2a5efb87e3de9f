# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact of nodes with one rigid surface of a simple shape."""

from dataclasses import dataclass

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.contact.law.closed_contacts import ClosedContacts, ContactLaw
from flexfem.contact.law.data import FORCE, NORMAL, PLACE, RIGID_FIELDS, Found, Slaves
from flexfem.contact.law.stiffening import stiffen
from flexfem.contact.obstacles import shapes as rigid
from flexfem.contact.obstacles.contacts import Lagged, ObstacleContacts

__all__ = ["RigidContact", "Shape"]


@dataclass(frozen=True)
class Shape:
    """A rigid surface in the axes of its frame; see ``rigid.ShapeKind``.

    Attributes:
        kind: Of the surface.
        radius: Metres.
        length: Along the axis, metres.
    """

    kind: rigid.ShapeKind
    radius: float = 0.0
    length: float = np.inf


class RigidContact(ObstacleContacts):
    """Contacts of slaves with a rigid surface at the trial state.

    Attributes:
        slaves, shape: Nodes and surface.
        found: Contacts at the trial state.
        closed: Closed contacts, on which friction and damping act.
        lagged: Where they were.
        stiffer: Largest slope of the force over that at contact, see ``stiffening``.
    """

    def __init__(self, slaves: Slaves, shape: Shape, law: ContactLaw | None = None) -> None:
        """Store nodes and surface."""
        self.slaves, self.shape, count = slaves, shape, len(slaves.nodes)
        self.stiffer = 1.0
        self.found = Found(
            closed=np.zeros(1, np.int64), ends=np.empty((count, 1), np.int64),
            numbers=np.empty((count, RIGID_FIELDS)),
        )  # fmt: skip
        self._surface = rigid.RigidShape(
            frame=np.zeros(12), kind=int(shape.kind), radius=shape.radius, length=shape.length
        )
        self._law = ContactLaw() if law is None else law
        self.closed = ClosedContacts.none(self._law)
        self.lagged = Lagged.none(1, 3)

    def distances(self, points: FloatArray, frame: FloatArray) -> FloatArray:
        """Gaps of all slaves (s,), m."""
        values = np.empty(len(self.slaves.nodes))
        rigid.distances_into(points[self.slaves.nodes], frame, self._surface.memory, values)
        return values - self.slaves.offsets

    def evaluate(self, points: FloatArray, frame: FloatArray, h: float = 0.0) -> None:
        """Find the contacts at a trial state, with the surface's frame (12,)."""
        self._surface.frame[:] = frame
        rigid.find_rigid_contacts(
            points, self.slaves.memory, self._surface.memory, self.found.memory
        )
        stiffen(self.found.memory, self.stiffer)
        if len(self.closed.slaves):
            nodes, arms, start = self.lagged
            self.closed.evaluate(self._beside(points, nodes, arms) - start, h)

    def accept(self, points: FloatArray) -> None:
        """End a step: friction now acts on the contacts of the last evaluation."""
        if not self._law.elastic:
            self.closed, self.lagged = self.following(points)

    def following(self, points: FloatArray) -> tuple[ClosedContacts, Lagged]:
        """The contacts on which friction acts in the next step, from those of the last evaluation.

        Returns:
            See the attributes ``closed`` and ``lagged``.
        """
        c, slaves, R = self.contacts, self.ends[:, 0], self._rotation
        stiffness = self.slaves.stiffness[slaves]
        normals = c[:, NORMAL : NORMAL + 3] @ R.T
        closed = self.closed.follow(slaves.copy(), normals, -stiffness * c[:, FORCE], stiffness)
        arms = c[:, PLACE : PLACE + 3].copy()
        return closed, self._lagged(points, slaves, arms)

    def memory(self) -> FloatArray:
        """State of the closed contacts, a row for each slave."""
        return self.closed.packed(len(self.slaves.nodes), self.lagged.places)

    def recall(self, points: FloatArray, frame: FloatArray, memory: FloatArray) -> None:
        """Restore the return value of :meth:`memory`, at the same positions."""
        self._surface.frame[:] = frame
        self.closed, arms = ClosedContacts.unpacked(self._law, memory, self.slaves.stiffness)
        self.lagged = self._lagged(points, self.closed.slaves, arms)

    def _lagged(self, points: FloatArray, slaves: IntArray, arms: FloatArray) -> Lagged:
        """Where contacts of slaves are, by their places in the axes of the surface."""
        nodes = self.slaves.nodes[slaves][:, np.newaxis]
        return Lagged(nodes, arms, self._beside(points, nodes, arms))

    def _beside(self, points: FloatArray, nodes: IntArray, arms: FloatArray) -> FloatArray:
        """Positions (c, 3) of nodes (c, 1) relative to places in the axes of the surface."""
        places = self._surface.frame[:3] + arms @ self._rotation.T
        return points[nodes[:, 0]] - places

    @property
    def _rotation(self) -> FloatArray:
        return self._surface.frame[3:].reshape(3, 3)

    @property
    def forces(self) -> FloatArray:
        """Normal forces of the contacts on the slaves, inertial axes, (count, 3), newtons."""
        c = self.contacts
        sizes = -self.slaves.stiffness[self.ends[:, 0]] * c[:, FORCE]
        return sizes[:, None] * (c[:, NORMAL : NORMAL + 3] @ self._rotation.T)

    def add_forces(self, residual: FloatArray, wrench: FloatArray, scale: float = 1.0) -> None:
        """Add ``scale`` times the forces.

        Args:
            residual: Of all nodes, inertial axes, shape (n, 3).
            wrench: Of the surface's frame, force and moment in its axes, shape (6,).
            scale: Factor.
        """
        slaves, surface, found = self.slaves.memory, self._surface.memory, self.found.memory
        rigid.add_rigid_forces(slaves, surface, found, scale, residual, wrench)
        if len(self.closed.slaves):
            self._add_closed(scale * self.closed.forces, residual, wrench)

    def add_actions(
        self, steps: FloatArray, twist: FloatArray, residual: FloatArray, wrench: FloatArray,
        scale: float = 1.0,
    ) -> None:  # fmt: skip
        """Add ``scale`` times the tangent applied to steps (n, 3) and a local twist (6,)."""
        slaves, surface, found = self.slaves.memory, self._surface.memory, self.found.memory
        rigid.add_rigid_actions(slaves, surface, found, scale, steps, twist, residual, wrench)
        if len(self.closed.slaves):
            moved = (twist[:3] - _cross(self.lagged.places) @ twist[3:]) @ self._rotation.T
            slips = steps[self.slaves.nodes[self.closed.slaves]] - moved
            forces = np.einsum("cij,cj->ci", self.closed.tangents, slips)
            self._add_closed(scale * forces, residual, wrench)
            # forces keep their inertial axes, while those of the frame rotate
            back = scale * self.closed.forces @ self._rotation
            self._add_reaction(_cross(back) @ twist[3:], wrench)

    def blocks(self, scale: float = 1.0) -> tuple[IntArray, FloatArray]:
        """Nodes (c,) and ``scale`` times the tangents (c, 9, 9): node, then twist of the frame."""
        s, closed = self.slaves, self.closed
        blocks = np.empty((self.count, 9, 9))
        rigid.rigid_blocks_into(s.memory, self._surface.memory, self.found.memory, scale, blocks)
        nodes = s.nodes[self.ends[:, 0]]
        if not len(closed.slaves):
            return nodes, blocks
        return (
            np.concatenate([nodes, s.nodes[closed.slaves]]),
            np.concatenate([blocks, scale * self._closed_blocks()]),
        )

    def _closed_blocks(self) -> FloatArray:
        """Tangents (c, 9, 9) of friction and damping."""
        count, R = len(self.closed.slaves), self._rotation
        J = np.zeros((count, 3, 9))
        arms, forces = _cross(self.lagged.places), _cross(self.closed.forces @ R)
        J[:, :, :3], J[:, :, 3:6], J[:, :, 6:] = np.eye(3), -R, R @ arms
        blocks = J.swapaxes(1, 2) @ self.closed.tangents @ J
        blocks[:, 3:6, 6:] -= forces
        blocks[:, 6:, 6:] -= arms @ forces
        return blocks

    def _add_closed(self, forces: FloatArray, residual: FloatArray, wrench: FloatArray) -> None:
        """Add forces (c, 3) on the nodes, and their reaction on the frame."""
        np.add.at(residual, self.slaves.nodes[self.closed.slaves], forces)
        self._add_reaction(forces @ self._rotation, wrench)

    def _add_reaction(self, forces: FloatArray, wrench: FloatArray) -> None:
        """Subtract forces (c, 3) at the arms, in the axes of the frame, from its wrench."""
        wrench[:3] -= forces.sum(0)
        wrench[3:] -= np.einsum("cab,cb->a", _cross(self.lagged.places), forces)


def _cross(vectors: FloatArray) -> FloatArray:
    """Matrices (c, 3, 3) of the vector products with vectors (c, 3)."""
    zero = np.zeros(len(vectors))
    x, y, z = vectors.T
    rows = [zero, -z, y, z, zero, -x, -y, x, zero]
    return np.stack(rows, axis=1).reshape(-1, 3, 3)
