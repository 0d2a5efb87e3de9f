# SPDX-License-Identifier: LGPL-3.0-or-later
"""The equations of a mechanism as functions of numbers: residuals, matrices, constraints."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from flexfem._types import FloatArray
from flexfem.research.formalisms.compiled import CompiledBody, CompiledJoint, energies_of
from flexfem.research.formalisms.coordinates import Coordinates
from flexfem.research.formalisms.description.joints import (
    AppliedForce,
    Constraint,
    End,
    evaluate_motion,
)
from flexfem.research.formalisms.description.mechanism import EnergyBody, Mechanism
from flexfem.research.formalisms.nodes import BodyNodes

__all__ = ["MechanismEquations"]


class MechanismEquations:
    """Equations of motion in the coordinates q of all bodies.

    The coordinates are, body after body, those of the frame and the free elastic ones. Arrays of
    coordinates have n entries; matrices are dense, since frames couple to every elastic coordinate.

    Attributes:
        mechanism: its declaration.
        size: number n of coordinates.
        constraints: number m of constraints, Euler parameters included.
        start: (q, q') as declared, not yet consistent with the constraints.
        nodes: meshes of the bodies and the places of their nodes among the coordinates, by name.
        bodies: their cells and kernels.
        of_frames: (n,) which coordinates are those of frames.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        """Make the meshes and compile what all formalisms need (collective).

        Raises:
            ValueError: a mistake in the mechanism.
        """
        mechanism.validate()
        self.mechanism = mechanism
        self.nodes: dict[str, BodyNodes] = {}
        self._declared: dict[str, EnergyBody] = {body.name: body for body in mechanism.bodies}
        first, blocks, rates = 0, [], []
        for body in mechanism.bodies:
            nodes = BodyNodes(body, first)
            self.nodes[body.name] = nodes
            first += nodes.size
            g, gd = body.start()
            elastic = np.zeros(nodes.size - body.frame.count)
            blocks += [g, elastic]
            rates += [gd, elastic]
        self.size = first
        self.start = np.concatenate(blocks), np.concatenate(rates)
        self.of_frames = np.zeros(first, dtype=bool)
        for nodes in self.nodes.values():
            self.of_frames[nodes.first : nodes.first + nodes.body.frame.count] = True
        gravity = np.array(mechanism.gravity, dtype=np.float64)
        self.bodies = [self._compile_body(body, gravity) for body in mechanism.bodies]
        self._joints = [(j, self._compile_joint(j)) for j in self._all_joints()]
        self._forces = [(f, self._compile_joint(f)) for f in mechanism.forces]
        self.constraints = sum(joint.count for _, joint in self._joints)
        self._state = Coordinates.zeros(self.size)

    def _all_joints(self) -> list[Constraint]:
        """Joints, and constraints of frames: prescribed motions or norms of Euler parameters."""
        held = []
        for body in self.mechanism.bodies:
            end = (End(body.name),)
            if body.motion is not None:
                name = f"motion of {body.name}"
                held.append(Constraint(name, end, _coordinates, motion=body.prescribed))
            elif body.frame.constraints:
                held.append(Constraint(f"unit norm of {body.name}", end, _norm))
        return [*self.mechanism.joints, *held]

    def _compile_body(self, body: EnergyBody, gravity: FloatArray) -> CompiledBody:
        nodes = self.nodes[body.name]
        numbers = {**body.matter.parameters, "damping": body.matter.damping}
        entries = np.where(nodes.cells < 0, self.size, nodes.cells)
        energies = energies_of(body.matter, body.frame)
        return CompiledBody(energies, entries, nodes.points, numbers, gravity)

    def _compile_joint(self, joint: Constraint | AppliedForce) -> CompiledJoint:
        ends, places, entries = [], [], []
        for end in joint.ends:
            body, nodes = self._declared[end.body], self.nodes[end.body]
            own, place = nodes.end(joint.owner, end.point)
            ends.append((body.frame, body.matter, len(own) - body.frame.count))
            places.append(place)
            entries.append(np.where(own < 0, self.size, own))
        return CompiledJoint(joint, ends, np.array(places), np.concatenate(entries), self.size)

    @property
    def elements(self) -> int:
        """Number of cells of all bodies."""
        return sum(len(body.entries) for body in self.bodies)

    def _at(self, *parts: FloatArray) -> Coordinates:
        """The state (q, q', q'') or the first of these."""
        self._state.put(*parts)
        return self._state

    def vector(self, name: str, *state: FloatArray) -> FloatArray:
        """Vector of a form of the bodies at a state (q, q', q'') or the first of these."""
        return self._added(name, (), state, 1)[:-1, 0]

    def matrix(self, name: str, weights: Sequence[float], *state: FloatArray) -> FloatArray:
        """Matrix of a form of the bodies with these weights."""
        return self._added(name, weights, state, self.size + 1)[:-1, :-1]

    def _added(
        self, name: str, weights: Sequence[float], state: Sequence[FloatArray], columns: int
    ) -> FloatArray:
        """Vector or matrix of a form of the bodies with the rows of what is held."""
        fields, out = self._at(*state), np.zeros((self.size + 1, columns))
        for body in self.bodies:
            body.add(name, weights, fields, out)
        return out

    def energy(self, q: FloatArray, qd: FloatArray) -> tuple[float, float]:
        """Kinetic and potential energy."""
        state = self._at(q, qd)
        parts = ((1.0, 0.0), (0.0, 1.0))
        kinetic, potential = (
            sum(body.value("energy", part, state) for body in self.bodies) for part in parts
        )
        return kinetic, potential

    def forces(self, q: FloatArray, t: float) -> FloatArray:
        """Applied forces Q on all coordinates."""
        state, out = self._at(q), np.zeros(self.size + 1)
        for force, joint in self._forces:
            given = np.broadcast_to(np.asarray(force.force(t), dtype=np.float64), (joint.count,))
            np.add.at(out, joint.entries, given @ joint.jacobian(state))
        return out[:-1]

    def gaps(self, q: FloatArray, t: float) -> FloatArray:
        """Constraints Phi(q, t), (m,)."""
        state = self._at(q)
        parts = [joint.values(state) - self._target(c, joint, t)[0] for c, joint in self._joints]
        return np.concatenate([np.zeros(0), *parts])

    def jacobian(self, q: FloatArray) -> FloatArray:
        """G = dPhi/dq, (m, n)."""
        state, out, row = self._at(q), np.zeros((self.constraints, self.size + 1)), 0
        for _, joint in self._joints:
            block, rows = joint.jacobian(state), slice(row, row + joint.count)
            if joint.distinct:
                out[rows, joint.entries] = block
            else:  # two ends share a frame
                np.add.at(out[rows].T, joint.entries, block.T)
            row += joint.count
        return out[:, :-1].copy()

    def prescribed_rates(self, t: float) -> FloatArray:
        """Rates that the constraints prescribe: G q' equals them, (m,)."""
        parts = [self._target(c, joint, t)[1] for c, joint in self._joints]
        return np.concatenate([np.zeros(0), *parts])

    def prescribed_accelerations(self, q: FloatArray, qd: FloatArray, t: float) -> FloatArray:
        """Accelerations that the constraints prescribe: G q'' equals them, (m,)."""
        state = self._at(q, qd)
        parts = [self._target(c, joint, t)[2] - joint.bias(state) for c, joint in self._joints]
        return np.concatenate([np.zeros(0), *parts])

    def add_constraint_stiffness(
        self, q: FloatArray, t: float, multipliers: FloatArray, out: FloatArray
    ) -> None:
        """Add to ``out`` (n, n) the derivative of G^T lambda - Q."""
        state, row = self._at(q), 0
        given = []
        for _, joint in self._joints:
            given.append((joint, multipliers[row : row + joint.count]))
            row += joint.count
        for force, joint in self._forces:
            value = np.broadcast_to(np.asarray(force.force(t), dtype=np.float64), (joint.count,))
            given.append((joint, -value))
        for joint, value in given:
            free = joint.entries < self.size
            rows = joint.entries[free]
            block = joint.stiffness(state, np.ascontiguousarray(value))[np.ix_(free, free)]
            np.add.at(out, (rows[:, None], rows[None, :]), block)

    def projected(self, q: FloatArray) -> FloatArray:
        """The coordinates with Euler parameters of unit norm."""
        q = q.copy()
        for body in self.mechanism.bodies:
            own = slice(self.nodes[body.name].first, self.nodes[body.name].first + body.frame.count)
            q[own] = body.frame.projected(q[own])
        return q

    def position(self, end: End, q: FloatArray) -> FloatArray:
        """Position (3) of an end of which the point is a node, or of a frame's origin."""
        return self.nodes[end.body].position(end.point, q)

    @staticmethod
    def _target(joint: Any, compiled: CompiledJoint, t: float) -> tuple[FloatArray, ...]:
        return evaluate_motion(joint, t, compiled.count)


def _norm(end: Any, data: Any) -> list[Any]:
    """Constraint of the coordinates of a spatial frame."""
    result: list[Any] = end.frame.norm(end.g)
    return result


def _coordinates(end: Any, data: Any) -> list[Any]:
    """All coordinates of a frame."""
    return [end.g[i] for i in range(end.frame.count)]
