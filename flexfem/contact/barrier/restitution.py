# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pulls of contacts with restitution at the end of a step, see ``dissipation.restitution``."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from mpi4py import MPI

import numpy as np

from flexfem._types import BoolArray, FloatArray
from flexfem.contact.barrier.grouped import GroupedPairs
from flexfem.contact.barrier.spins import Spins
from flexfem.contact.carriers import Carriers
from flexfem.contact.dissipation.restitution import compliances

__all__ = ["Pulls", "Solve"]

#: Steps ``M^-1 r`` of the blocks for their residuals; False if it is impossible (collective).
Solve = Callable[[], bool]

#: Relative error of the speeds after the pulls, and number of solves that find them.
_ACCURACY, _MOST = 1e-11, 200
#: Number of times that pulls are limited, and what counts as beyond a limit, in parts of it.
_CAPS, _ABOVE = 10, 1.0 + 1e-9


class _SingularError(Exception):
    """The masses cannot be inverted; on all ranks."""


@dataclass(frozen=True)
class _Dampers:
    """Dampers of the groups of all contacts, one row for each group, (g,).

    Attributes:
        pushes: forces over the step, N.
        soft: compliances c, infinite where there is no damper, m/(N s).
        sizes: those with approximate diagonals of D, for all dampers, m/(N s).
        respond: changes of speeds D f by forces (collective).
    """

    pushes: FloatArray
    soft: FloatArray
    sizes: FloatArray
    respond: Callable[[FloatArray], FloatArray]

    @property
    def acting(self) -> BoolArray:
        """Groups (g,) with a damper."""
        return np.isfinite(self.soft)


class Pulls:
    """Pulls of the contacts of a system that have restitution.

    Attributes:
        wanted: True if there is such a contact.
    """

    def __init__(
        self, comm: MPI.Intracomm, carriers: Carriers, spins: Spins,
        every: Sequence[GroupedPairs],
    ) -> None:  # fmt: skip
        """Store the points and all pairs."""
        self._comm, self._carriers, self._spins = comm, carriers, spins
        self._contacts = [one for one in every if one.restitution < 1.0]
        self.wanted = bool(self._contacts)
        self._rub = any(one.rubs for one in self._contacts)
        self._steps, self._forces, self._couples = np.zeros((3, len(carriers.serial.start), 3))

    def find(self, points: FloatArray, h: float, solve: Solve) -> bool | None:
        """Find the pulls at the end of a step; their ``M^-1 J^T f`` is left in the blocks' steps.

        Collective. The trial state is that at the end of the step, with its velocities.

        Args:
            points: positions (n, 3), m.
            h: size of the step, s.
            solve: of the masses.

        Returns:
            True for pulls, None for none, False if the masses are singular.
        """
        for one in self._contacts:
            one.place_ends(points)
        speeds, pushes = self._speeds(), self._pushes()
        if not self._any((speeds > 0.0) & (pushes > 0.0)):
            return None
        try:
            dampers = self._dampers(speeds, pushes, partial(self._respond, h, solve))
            return self._settle(speeds, self._within(speeds, dampers), h, solve)
        except _SingularError:
            return False

    def _dampers(
        self, speeds: FloatArray, pushes: FloatArray, respond: Callable[[FloatArray], FloatArray]
    ) -> _Dampers:
        """Dampers for the speeds (g,) after forces (g,) (collective)."""
        changes = respond(pushes)
        counts = [one.closed for one in self._contacts]
        part = np.repeat([one.restitution for one in self._contacts], counts)
        soft = compliances(speeds, changes, pushes, part)
        acts = np.isfinite(soft)
        own = np.divide(changes, pushes, out=np.ones(len(soft)), where=acts)
        return _Dampers(pushes, soft, np.where(acts, soft, 0.0) + own, respond)

    def _within(self, speeds: FloatArray, dampers: _Dampers) -> FloatArray:
        """Forces of the dampers (g,) between zero and those of the step (collective)."""
        acts, pushes = dampers.acting, dampers.pushes
        fixed, left, forces = np.zeros(len(speeds)), speeds, np.zeros(len(speeds))
        for _ in range(_CAPS):
            forces = self._forces_of(dampers, left, acts)
            over, under = acts & (forces > _ABOVE * pushes), acts & (forces < 0.0)
            if not self._any(over | under):
                break
            fixed, acts = np.where(over, pushes, fixed), acts & ~over & ~under
            left = speeds - dampers.respond(fixed)
        found: FloatArray = np.clip(fixed + forces, 0.0, pushes)
        return found

    def _forces_of(self, dampers: _Dampers, speeds: FloatArray, acts: BoolArray) -> FloatArray:
        """Forces f (g,) with (D + c) f = u where dampers act, by conjugate gradients (collective).

        They begin with those that are proportional to the forces of the step: where there are more
        contacts than a rigid body has motions, the forces are not unique.
        """
        soft, left = np.where(acts, dampers.soft, 0.0), np.where(acts, speeds, 0.0)
        forces, along = np.zeros(len(left)), left / dampers.sizes
        (size,) = self._sum(left @ left)
        for _ in range(_MOST):
            moved = np.where(acts, dampers.respond(along) + soft * along, 0.0)
            power, new = self._sum(along @ moved, along @ left)
            if not power > 0.0:
                break
            forces += new / power * along
            left -= new / power * moved
            scaled = left / dampers.sizes
            error, cross = self._sum(left @ left, scaled @ moved)
            if error <= _ACCURACY**2 * size:
                break
            along = scaled - cross / power * along
        return forces

    def _settle(
        self, speeds: FloatArray, forces: FloatArray, h: float, solve: Solve
    ) -> bool | None:
        """Take forces (g,), or the part of them that loses most energy (collective)."""
        power, lost = self._sum(forces @ speeds, forces @ self._respond(h, solve, forces))
        if power <= 0.0:
            return None
        part, start = min(1.0, power / lost) if lost > 0.0 else 1.0, 0
        for one in self._contacts:
            one.pulls, start = part * forces[start : start + one.closed], start + one.closed
        slips = self._slips(rates=True)
        changes, start = self._respond(h, solve, part * forces, eased=True), 0
        losses = h * part * forces * (speeds - 0.5 * changes)
        for one, slip, change in zip(self._contacts, slips, self._slips(rates=False), strict=True):
            one.pulled = float(losses[start : start + one.closed].sum())
            one.pulled += h * float((one.eased(one.pulls) * (slip - 0.5 * h * change)).sum())
            start += one.closed
        return True

    def _respond(
        self, h: float, solve: Solve, forces: FloatArray, *, eased: bool = False
    ) -> FloatArray:
        """Changes of speeds (g,) by forces (g,) over the step (collective).

        Args:
            h: size of the step, s.
            solve: of the masses.
            forces: along the normals, N.
            eased: True to take away the friction that the pulls take away, too.
        """
        self._push(forces, eased=eased)
        if not solve():
            raise _SingularError
        self._carriers.move(self._steps)
        return h * self._motions(self._steps)

    def _push(self, forces: FloatArray, *, eased: bool) -> None:
        """Make forces (g,) along the normals the blocks' residuals (collective)."""
        self._forces[:] = self._couples[:] = 0.0
        start = 0
        for one in self._contacts:
            own, start = forces[start : start + one.closed], start + one.closed
            one.push_ends(own, self._forces, self._couples)
            if eased and one.rubs:
                one.push(one.eased(one.pulls), self._forces, self._couples)
        self._spins.gather(self._couples, self._forces)
        self._carriers.gather(self._forces)
        for kind, points in self._carriers.by_kind.items():
            points.block.residual[:] = 0.0
            self._carriers.add_forces(kind, self._forces)
            self._spins.add_couples(kind, self._couples)

    def _pushes(self) -> FloatArray:
        """Normal forces (g,) over the step, N."""
        return np.concatenate([one.pushes for one in self._contacts])

    def _speeds(self) -> FloatArray:
        """Speeds of separation (g,) at the end of the step (collective)."""
        self._carriers.rates(self._steps, self._couples)
        self._carriers.share(self._steps)
        return self._motions(self._steps)

    def _motions(self, steps: FloatArray) -> FloatArray:
        """Relative motions (g,) along the normals for those of points (n, 3)."""
        return np.concatenate([one.end_motions(steps) for one in self._contacts])

    def _slips(self, *, rates: bool) -> list[FloatArray]:
        """Motions of the points where friction acts, for rates or the blocks' steps (collective).

        One array (g, 3) for each contact; zeros without friction.
        """
        if not self._rub:
            return [np.zeros((one.closed, 3)) for one in self._contacts]
        if rates:
            steps, spins = self._spins.rates()
        else:
            steps, spins = self._steps, self._spins.of_steps(self._steps)
        return [one.slips(steps, spins) for one in self._contacts]

    def _any(self, flags: BoolArray) -> bool:
        """True if a flag is set on any rank (collective)."""
        return bool(self._sum(float(flags.any()))[0])

    def _sum(self, *values: float | FloatArray) -> list[float]:
        """Sums over all ranks (collective)."""
        total = np.array(values, dtype=np.float64)
        if self._comm.size > 1:
            self._comm.Allreduce(MPI.IN_PLACE, total, op=MPI.SUM)
        return [float(value) for value in total]
