# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact points and the nodes that carry them over a step: motions, forces and their derivatives.

A point at the arm a in the axes R of its node moves by ``R (u + theta x a)`` with local twists (u,
theta) of the node, at both ends of the step. Forces f over a step act as ``g = P(n) R0^T f`` and
``a x g``, see ``contact.obstacles.carried``, with the rotation n of the step,

``P x = x - c1 n x x + c2 n x (n x x)``, ``c1 = (1 - cos|n|)/|n|^2``, ``c2 = (|n| - sin|n|)/|n|^3``,

and depend on both ends. With T the tangent operator, ``dn = T^-1 theta_1 - T^-T theta_0``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexfem._types import FloatArray
from flexfem.contact.carriers import CarriedPoints
from flexfem.gradients.equations.node_maps import applied, rotations, transposed
from flexfem.lie import so3

__all__ = ["END", "START", "NodePoints"]

#: Ends of a step.
START, END = 0, 1
#: Angle below which coefficients are power series: beyond it closed forms lose few digits.
_SMALL = 0.3


@dataclass(frozen=True)
class NodePoints:
    """Points of this rank on the nodes of one block, over a step.

    Attributes:
        carried: the points.
        turns: rotation matrices (2, k, 3, 3) of the nodes at both ends.
        rotation: (k, 3) rotation vectors of the step.
        by_twists: (2, k, 3, 3) their changes by local rotations of both ends.
    """

    carried: CarriedPoints
    turns: FloatArray
    rotation: FloatArray
    by_twists: FloatArray

    @classmethod
    def of(cls, carried: CarriedPoints) -> NodePoints:
        """Those of a block at the trial state of a step."""
        block, local = carried.block, carried.local
        rotation = block.increment[local, 3:] * carried.turns
        inverse = np.linalg.inv(so3.tangent(rotation).reshape(-1, 3, 3))
        turns = np.stack([rotations(one[local]) for one in (block.frames0, block.frames)])
        return cls(carried, turns, rotation, np.stack([-inverse.swapaxes(1, 2), inverse]))

    def _arms(self, vectors: FloatArray) -> FloatArray:
        """Vectors ``a x f`` (k, 3)."""
        return np.cross(self.carried.arms, vectors) * self.carried.turns

    def motions(self, twists: FloatArray, end: int) -> FloatArray:
        """Steps (k, 3) of the points by local twists (n, 6) of the nodes at one end."""
        own = twists[self.carried.local]
        return applied(self.turns[end], own[:, :3] - self._arms(own[:, 3:]))

    def add_forces(self, forces: FloatArray, end: int, out: FloatArray) -> None:
        """Add the transposed :meth:`motions` of forces (k, 3) to (n, 6)."""
        local = transposed(self.turns[end], forces)
        np.add.at(out, self.carried.local, np.concatenate([local, self._arms(local)], axis=1))

    def spins(self, twists: FloatArray, end: int) -> FloatArray:
        """Changes (k, 3) of the rotation vectors of the step in inertial axes, as motions."""
        own = twists[self.carried.local, 3:] * self.carried.turns
        changes = applied(self.by_twists[end], own)
        if end == START:
            changes += np.cross(own, self.rotation)
        return applied(self.turns[START], changes)

    def add_couples(self, couples: FloatArray, end: int, out: FloatArray) -> None:
        """Add the transposed :meth:`spins` of couples (k, 3) to (n, 6)."""
        local = transposed(self.turns[START], couples)
        changes = transposed(self.by_twists[end], local)
        if end == START:
            changes += np.cross(self.rotation, local)
        np.add.at(out[:, 3:], self.carried.local, changes * self.carried.turns)

    def _over_step(self) -> FloatArray:
        """P (k, 3, 3)."""
        n, first, second = so3.skew(self.rotation), *_coefficients(self.rotation)[:2]
        found: FloatArray = np.eye(3) - first * n + second * (n @ n)
        return found

    def add_loads(self, forces: FloatArray, couples: FloatArray, out: FloatArray) -> None:
        """Add forces and couples (k, 3) over the step to loads (n, 6) of nodes."""
        moments = self._moments(self._pulls(forces))
        moments += self._mean(couples)
        every = np.concatenate([self._translational(forces), moments], axis=1)
        np.add.at(out, self.carried.local, every)

    def _pulls(self, forces: FloatArray) -> FloatArray:
        return applied(self._over_step(), transposed(self.turns[START], forces))

    def _moments(self, pulls: FloatArray) -> FloatArray:
        return self._arms(pulls)

    def _mean(self, couples: FloatArray) -> FloatArray:
        turned = transposed(self.turns[START] + self.turns[END], couples)
        mean: FloatArray = 0.5 * self.carried.turns * turned
        return mean

    @property
    def _follows(self) -> bool:
        """True if translations have the axes of the mean force: on SE(3)."""
        return self.carried.turns and not self.carried.block.inertial

    def _translational(self, forces: FloatArray) -> FloatArray:
        return self._pulls(forces) if self._follows else transposed(self.turns[END], forces)

    def ways(self, twists: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Transposed :meth:`add_loads`: motions and spins (k, 3) for factors (n, 6) of loads."""
        own, P = twists[self.carried.local], self._over_step()
        pulls = -self._arms(own[:, 3:])
        if self._follows:
            pulls = pulls + own[:, :3]
        ways = applied(self.turns[START], transposed(P, pulls))
        if not self._follows:
            ways += applied(self.turns[END], own[:, :3])
        turned = applied(self.turns[START] + self.turns[END], own[:, 3:])
        return ways, 0.5 * self.carried.turns * turned

    def turning(self, forces: FloatArray, couples: FloatArray) -> FloatArray:
        """Changes (2, k, 6, 3) of the loads by local rotations of both ends, of fixed forces."""
        found = np.zeros((2, len(forces), 6, 3))
        if not self.carried.turns:
            return found
        local = [transposed(turns, forces) for turns in self.turns]
        x, n = so3.skew(local[START]), so3.skew(self.rotation)
        first, second, of_first, of_second = _coefficients(self.rotation)
        once = applied(n, local[START])
        twice, along = applied(n, once), self.rotation[:, np.newaxis]
        by_rotation = first * x - of_first * once[:, :, np.newaxis] * along
        by_rotation -= second * (so3.skew(once) + n @ x)
        by_rotation += of_second * twice[:, :, np.newaxis] * along
        arms = so3.skew(self.carried.arms)
        for end in (START, END):
            pulls = by_rotation @ self.by_twists[end]
            if end == START:
                pulls = pulls + self._over_step() @ x
            if self._follows:
                found[end, :, :3] = pulls
            elif end == END:
                found[end, :, :3] = so3.skew(local[END])
            found[end, :, 3:] = arms @ pulls
            found[end, :, 3:] += 0.5 * so3.skew(transposed(self.turns[end], couples))
        return found

    def rates(self, twists: FloatArray, rates: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Changes (k, 3) of velocities and angular velocities of the points at the start.

        Args:
            twists: local twists (n, 6) of the nodes there.
            rates: changes (n, 6) of the rates of their increments.
        """
        (point, spin), own = self._present_rates(), twists[self.carried.local, 3:]
        change = rates[self.carried.local]
        turned = applied(self.turns[START], np.cross(own, point) - self._arms(change[:, 3:]))
        moved = change[:, :3]
        if not self.carried.block.inertial:
            moved = applied(self.turns[START], moved)
        spins = applied(self.turns[START], np.cross(own, spin) + change[:, 3:])
        return turned + moved, spins * self.carried.turns

    def add_rates(
        self, velocities: FloatArray, spins: FloatArray, twists: FloatArray, rates: FloatArray
    ) -> None:
        """Add the transposed :meth:`rates` of (k, 3) each to (n, 6) each."""
        (point, spin), local = self._present_rates(), self.carried.local
        v, w = (
            transposed(self.turns[START], one) for one in (velocities, spins * self.carried.turns)
        )
        np.add.at(twists[:, 3:], local, np.cross(point, v) + np.cross(spin, w))
        moved = velocities if self.carried.block.inertial else v
        np.add.at(rates, local, np.concatenate([moved, self._arms(v) + w], axis=1))

    def _present_rates(self) -> tuple[FloatArray, FloatArray]:
        """What turns of the velocities with the nodes, and angular velocities (k, 3), local."""
        own = self.carried.block.state()["velocity"][self.carried.local]
        spin = own[:, 3:] * self.carried.turns
        point = -self._arms(spin)
        if not self.carried.block.inertial:
            point = point + own[:, :3]
        return point * self.carried.turns, spin


def _coefficients(rotation: FloatArray) -> tuple[FloatArray, ...]:
    """c1, c2 and their derivatives by the angle over it, (k, 1, 1), of rotation vectors (k, 3)."""
    square = np.einsum("ka,ka->k", rotation, rotation)[:, np.newaxis, np.newaxis]
    a = np.sqrt(square)
    large = a > _SMALL
    b = np.where(large, a, 1.0)
    sine, rest = np.sin(b), 1.0 - np.cos(b)
    closed = (
        rest / b**2, (b - sine) / b**3, (b * sine - 2.0 * rest) / b**4,
        (b * rest - 3.0 * (b - sine)) / b**5,
    )  # fmt: skip
    series = (
        (1 / 2, -1 / 24, 1 / 720, -1 / 40320), (1 / 6, -1 / 120, 1 / 5040, -1 / 362880),
        (-1 / 12, 1 / 180, -1 / 6720, 1 / 453600), (-1 / 60, 1 / 1260, -1 / 60480, 1 / 4989600),
    )  # fmt: skip
    return tuple(
        np.where(large, one, sum(c * square**p for p, c in enumerate(own)))
        for one, own in zip(closed, series, strict=True)
    )
