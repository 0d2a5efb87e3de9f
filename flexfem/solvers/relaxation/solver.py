# SPDX-License-Identifier: LGPL-3.0-or-later
"""Dynamic relaxation: equilibrium as the end of a damped motion in fictitious time.

Steps have the unit size, ``v <- keep v - smooth M^-1 (r - r_before) - push M^-1 r`` and
``q <- q exp(v)``, with diagonal masses that are unrelated to those of the model;
``damping`` chooses the factors. No matrix is factorised, save the small one
``G M^-1 G^T`` of the rigid rows of joints, by which the steps are projected onto the constraints.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isfinite, sqrt

from mpi4py import MPI

import numpy as np

from flexfem._checks import InputError
from flexfem._types import FloatArray
from flexfem.contact.barrier.contacts import BarrierContacts
from flexfem.contact.contacts import ContactGroup, Contacts
from flexfem.core.state import State, counts
from flexfem.solvers.linear.tangent import TangentSolver
from flexfem.solvers.relaxation.apart import StepsApart
from flexfem.solvers.relaxation.damping import DAMPINGS, Damping, Motion
from flexfem.solvers.relaxation.fictitious_masses import REST, fictitious_masses, physical_masses
from flexfem.solvers.relaxation.kernels import SUMS, drive, largest_into, measure, measure_way, move
from flexfem.solvers.relaxation.row_projection import RowProjection
from flexfem.system.mechanics import END_POINT

__all__ = ["Progression", "Relaxation", "Scheme"]

#: Rayleigh's quotient, relative to the limit of stable steps, above which masses are too small.
_FAST = 0.25
#: The same with barriers, which are nearer to it at all times.
_FAST_APART = 0.5
#: Limit of stable steps of contacts, which damp the motion along their normals: of an eigenvalue x
#: there, x (push + 2 smooth) < 2 (1 + keep (1 - x)); bounds of row sums are sqrt(3) times as large.
_STABLE_DAMPED = 2.0
#: Number of successive steps after which too fast motions are stopped; a closing contact takes one.
_ROW = 3


@dataclass(frozen=True)
class Scheme:
    """Choice of fictitious masses and damping.

    Attributes:
        damping: "accelerated", "viscous" or "kinetic".
        margin: masses relative to the smallest that are certainly stable.
        least: smallest mass of a node relative to its largest, for translations and rotations.
        physical: masses of the model times one factor.
        renew: iterations after which masses are computed again.
    """

    damping: str = "accelerated"
    margin: float = 1.2
    least: float = 1.0
    physical: bool = False
    renew: int = 100


@dataclass(frozen=True)
class Progression:
    """Progress of a relaxation.

    Attributes:
        residual: root of the sum of squares of the forces that are not balanced, relative to that
            of the applied ones; moments count divided by the size of the model.
        step: largest translation of the last step relative to the size, or rotation (rad).
        energy: kinetic energy of the fictitious motion, J.
    """

    residual: float = inf
    step: float = inf
    energy: float = 0.0


class Relaxation:
    """Dynamic relaxation of a system to equilibrium.

    Attributes:
        iteration: number of steps taken.
        renewals: number of computations of the masses.
        progress: progress at the last evaluation.
    """

    def __init__(
        self, tangent: TangentSolver, size: float, scheme: Scheme, *, at_time: float = 0.0,
        fresh: bool = True,
    ) -> None:  # fmt: skip
        """Set all velocities to zero (collective).

        Args:
            tangent: exact matrix of the system, which is at its start.
            size: size of the model, m.
            scheme: masses and damping.
            at_time: time of loads and drives, s.
            fresh: True to choose masses; False if :meth:`restore` follows.
        """
        self.system, self._tangent, self._size, self._scheme = tangent.system, tangent, size, scheme
        self.iteration = self.renewals = self.stops = 0
        self._at_time = at_time
        self.progress = Progression()
        parts = self.system.parts
        shapes = [(p.block.owned, p.block.width) for p in parts]
        self._velocity = [np.zeros(shape) for shape in shapes]
        self._previous = [np.zeros(shape) for shape in shapes]
        # inverse masses, without barriers and with them
        self._free = [np.zeros(shape) for shape in shapes]
        # residuals where masses were computed, and sum of the steps since
        self._first_residual = [np.zeros(shape) for shape in shapes]
        self._way = [np.zeros(shape) for shape in shapes]
        self._sums = np.zeros(SUMS)
        self._damping: Damping = DAMPINGS[scheme.damping]()
        self._quick = 0  # successive steps with too fast a motion
        self._applied = self._first = 0.0  # norms of the applied forces and of the first residual
        self._started = self._evaluated = False  # for the present masses and positions
        for part in parts:
            part.block.velocity[:] = part.block.acceleration[:] = 0.0
            part.block.take()
        self.system.constraints.multipliers[:] = 0.0
        penalties = [c for c in self.system.contacts if isinstance(c, Contacts)]
        self._touching = [c for c in penalties if any(_remembers(g) for g in c.groups)]
        for contacts in self.system.contacts:
            contacts.prepare(0.0)
        self._apart = self._barriers()
        self._inverse = self._free
        if self._apart is not None:
            self._inverse = [np.zeros(shape) for shape in shapes]
        self._projection = RowProjection(self.system)
        self._physical = physical_masses(tangent) if scheme.physical else None
        if fresh:
            self.renew()

    def _barriers(self) -> StepsApart | None:
        """Barriers of the system, None without.

        Raises:
            InputError: they have friction, which relaxations do not follow.
        """
        limit = min(self._damping.stable, _STABLE_DAMPED) / self._scheme.margin
        for contacts in self.system.contacts:
            if isinstance(contacts, BarrierContacts):
                for one in contacts.contacts:
                    if one.rubs:
                        raise InputError(
                            f'Contact "{one.contact.name}": friction {one.contact.friction:g} of '
                            "barriers does not act in relaxations: leave it out, or give "
                            'law="penalty"'
                        )
                return StepsApart(self.system, contacts, limit)
        return None

    def renew(self) -> None:
        """Compute masses for the present stiffness; nodal axes rotate with shells (collective)."""
        system = self.system
        for part, velocity in zip(system.parts, self._velocity, strict=True):
            block = part.block
            block.take()
            if part.elements is not None:
                block.velocity[: block.owned, : block.width] = velocity
                part.elements.accept(block)
                velocity[:] = block.velocity[: block.owned, : block.width]
                block.velocity[:] = 0.0
        system.interface.update()
        system.constraints.accept()
        system.constraints.elements.settle(system.constraints, still=True)
        self._applied = self._forces()
        if self._apart is not None:
            self._apart.leave_out()
        END_POINT.evaluate(system, REST)
        masses = fictitious_masses(
            self._tangent, self._damping.stable / self._scheme.margin, self._scheme.least,
            self._physical,
        )  # fmt: skip
        if self._apart is not None:
            self._apart.leave_out(False)
        for part, mass, inverse in zip(system.parts, masses, self._free, strict=True):
            np.divide(1.0, mass, out=inverse)
            part.block.hold(inverse)
        for contacts in system.contacts:
            contacts.accept()
        self.renewals += 1
        self._started, self._evaluated = True, False

    def _forces(self) -> float:
        """Root of the sum of squares of all applied forces; 0 if there are none (collective)."""
        system, squares = self.system, np.zeros(2)
        nothing = np.zeros(3), np.zeros_like(system.factors)
        for part in system.parts:
            block = part.block
            part.add_residual(system.gravity, system.factors, 1.0)
            loads = block.owned_residual.copy()
            part.add_residual(*nothing, 1.0)
            loads -= block.owned_residual
            block.hold(loads)
            squares += (loads[:, :3] ** 2).sum(), (loads[:, 3:] ** 2).sum()
        system.comm.Allreduce(MPI.IN_PLACE, squares)
        return sqrt(squares[0] + squares[1] / self._size**2)

    def _evaluate(self) -> bool:
        """Residual at the present positions and sums over it; False if not finite (collective)."""
        system, sums = self.system, self._sums
        system.counters.residual_evaluations += 1
        for part in system.parts:
            part.add_residual(system.gravity, system.factors, REST.scale)
        system.interface.update()
        system.constraints.evaluate(REST.dynamics)
        self._projection.add_forces()
        if self._apart is not None:
            self._apart.add_masses(self._free, self._inverse)
        sums[:] = 0.0
        for part, previous, velocity, inverse in zip(
            system.parts, self._previous, self._velocity, self._inverse, strict=True
        ):
            measure(part.block.residual, previous, velocity, inverse, sums)
        if system.comm.size > 1:
            system.comm.Allreduce(MPI.IN_PLACE, sums)
        self._evaluated = True
        return isfinite(sums.sum())

    def advance(self) -> bool:
        """Evaluate and take one step; False where forces are not finite (collective)."""
        if not (self._evaluated or self._evaluate()):
            return False
        damping, (work, twice) = self._damping, self._sums[:2].tolist()
        fast = _FAST if self._apart is None else _FAST_APART
        quick = not self._started and work > fast * damping.stable * twice
        self._quick = self._quick + 1 if quick else 0
        fast = self._quick >= _ROW
        if fast or (self.iteration and self.iteration % self._scheme.renew == 0):
            if fast:  # a too fast vibration would soon grow without bounds
                self._stop()
            elif damping.slow:
                damping.learn(self._rayleigh())
            self.renew()
            if not self._evaluate():
                return False
        if self._started:
            self._begin_way()
        self._started = self._evaluated = False
        motion = Motion(energy=0.5 * float(self._sums[1]), uphill=float(self._sums[4]))
        self._step(*damping.factors(motion))
        self.iteration += 1
        return True

    def _stop(self) -> None:
        """Set all velocities to zero."""
        for velocity in self._velocity:
            velocity[:] = 0.0
        self._damping.stop()
        self._quick = 0
        self.stops += 1

    def _begin_way(self) -> None:
        """Store the present residuals, in new axes of the nodes, as reference values."""
        for part, previous, first, way in zip(
            self.system.parts, self._previous, self._first_residual, self._way, strict=True
        ):
            previous[:] = first[:] = part.block.owned_residual
            way[:] = 0.0

    def _rayleigh(self) -> float:
        """Rayleigh's quotient of the displacement since masses were computed (collective).

        Over many steps quick vibrations cancel: the quotient is that of the slow motion, by which
        viscous damping is chosen.
        """
        sums = np.zeros(2)
        for part, first, way, inverse in zip(
            self.system.parts, self._first_residual, self._way, self._inverse, strict=True
        ):
            measure_way(part.block.residual, first, way, inverse, sums)
        self.system.comm.Allreduce(MPI.IN_PLACE, sums)
        return max(float(sums[0] / sums[1]), 0.0) if sums[1] > 0.0 else 0.0

    def _step(self, keep: float, smooth: float, push: float) -> None:
        """Move all nodes."""
        parts = self.system.parts
        if self._apart is not None:
            self._apart.damp(self._velocity, self._inverse)
        for part, previous, velocity, inverse in zip(
            parts, self._previous, self._velocity, self._inverse, strict=True
        ):
            drive(
                part.block.residual, previous, inverse, keep, smooth, push, velocity,
                part.block.step,
            )  # fmt: skip
        self._projection.project(self._inverse, self._velocity, push)
        if self._apart is not None:
            self._apart.take_step(self._velocity)
        else:
            for part in parts:
                part.block.spread_step()
                move(part.block.frames, part.block.step, part.block.width)
        if self._damping.slow:
            for way, velocity in zip(self._way, self._velocity, strict=True):
                np.add(way, velocity, out=way)
        for contacts in self._touching:
            contacts.accept()

    def evaluate(self) -> bool:
        """Measure the progress; False where forces are not finite (collective).

        The next step does not evaluate again.
        """
        finite = self._evaluated or self._evaluate()
        _, twice, forces, moments, _ = self._sums.tolist()
        largest = np.zeros(2)
        for velocity in self._velocity:
            largest_into(velocity, largest)
        self.system.comm.Allreduce(MPI.IN_PLACE, largest, op=MPI.MAX)
        norm = sqrt(forces + moments / self._size**2) if finite else inf
        if self._first == 0.0:
            self._first = norm
        step = max(float(largest[0]) / self._size, float(largest[1]))
        self.progress = Progression(norm / (self._applied or self._first or 1.0), step, 0.5 * twice)
        return finite

    def settle(self) -> None:
        """Accept the present positions, for recording (collective)."""
        system, rows = self.system, self.system.constraints
        for part in system.parts:
            part.block.take()
        rows.forces[:] = rows.multipliers
        system.interface.update()
        rows.accept()
        system.time = float(self.iteration)

    def state(self) -> State:
        """State on which the next steps depend, with the positions accepted last."""
        numbers = [
            self.iteration, self.renewals, self._applied, self._first, self._started, self._quick,
            *self._damping.memory,
        ]  # fmt: skip
        values = {"relaxing": np.array(numbers, dtype=np.float64)}
        rows = {}
        for part, own in zip(self.system.parts, self._own(), strict=True):
            block = part.block
            padded = {name: np.zeros((len(block.frames), block.width)) for name in own}
            for name, array in own.items():
                padded[name][: block.owned] = array
            rows[block.name] = padded
        return self.system.state() | State(values, rows)

    def restore(self, state: State) -> None:
        """Restore the return value of :meth:`state` (collective)."""
        system = self.system
        system.restore(state)
        system.set_time(self._at_time)
        system.constraints.multipliers[:] = system.constraints.forces
        for part, own in zip(system.parts, self._own(), strict=True):
            for name, array in own.items():
                array[:] = state.rows[part.block.name][name][: part.block.owned]
        numbers = state.values["relaxing"].tolist()
        self.iteration, self.renewals = counts("relaxing", state.values["relaxing"][:2])
        self._applied, self._first = numbers[2:4]
        self._started, self._quick, self._evaluated = bool(numbers[4]), int(numbers[5]), False
        self._damping.memory = numbers[6:]

    def _own(self) -> list[dict[str, FloatArray]]:
        """Arrays (n_owned, width) of every block."""
        return [
            {
                "pseudo_velocity": v,
                "previous_residual": r,
                "inverse_mass": w,
                "first_residual": first,
                "way": way,
            }
            for v, r, w, first, way in zip(
                self._velocity,
                self._previous,
                self._free,
                self._first_residual,
                self._way,
                strict=True,
            )
        ]


def _remembers(group: ContactGroup) -> bool:
    """Return True if a contact is path-dependent: neighbour lists, friction."""
    return bool(group.triangles) or group.surfaces.contact.friction > 0.0
