# SPDX-License-Identifier: LGPL-3.0-or-later
"""A step of generalized-alpha with impulses of unilateral forces.

Forces F that are evaluated at the end of a step are the derivative of nothing over it, and make
energy in impacts. They are therefore taken out of the scheme, as an impulse over the step:

``M W + h G^T L = h J^T F``, ``G W = 0``, ``v_1 = v_s + W``, ``q_1 = q_s + (h/2) W``,

with F the discrete derivative of the energy that they store, and L the constraints' share. The
smooth part s is the step of the scheme without them, all residuals being those at q_1. With n the
whole increment its accelerations are ``a(n) - W/(2 beta h)``, so that the equations of the step are
the usual ones with ``b J^T F``, ``b = (1 - alpha_m)/(1 - alpha_f)/(2 beta)``, and multipliers ``l_s
+ b L``. W is found once the iteration has converged. For ``rho_inf = 1`` the work of F is the
change of the kinetic energy, exactly. Where elements have damping C, ``M + h C`` takes the place of
M in W, and the accepted accelerations are those that damping leaves, see ``stiff_damping``.

While all rows are within their limits, steps are those of the scheme without them; one at whose end
a row is beyond is solved again.

What stays closed is no impact. Forces of rows that have been closed for many steps, or since the
start, are those of the smooth scheme: their accelerations are added to the accepted ones, and
subtracted again before a step in which they end.

Discrete derivatives: Gonzalez, J. Nonlinear Sci. 6 (1996) 449-467; Laursen, Chawla, Int. J. Numer.
Methods Eng. 40 (1997) 863-886. Splitting of impulses from a smooth scheme: Chen, Acary, Virlez,
Brüls, Int. J. Numer. Methods Eng. 96 (2013) 487-511.
"""

from collections.abc import Callable, Sequence

from mpi4py import MPI

import numpy as np

from flexfem.contact.barrier.contacts import BarrierContacts
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.core.nodes.prediction import Prediction
from flexfem.core.state import State
from flexfem.core.status import Status
from flexfem.integrators.split.impulse import Impulse
from flexfem.integrators.split.stiff_damping import StiffDamping
from flexfem.integrators.split.unilateral import (
    Unilateral,
    UnilateralContacts,
    UnilateralRows,
)
from flexfem.system.mechanics import EndPoint
from flexfem.system.system import PartStrains, Shifts, System

__all__ = ["Split"]


class Split(EndPoint):
    """Equilibrium at the end of a step with unilateral forces over it.

    Attributes:
        acting: True if there were forces in the last step that was solved.
        kicking: True if velocities have changed by impulses in it.
    """

    @classmethod
    def of(cls, system: System) -> "Split | None":
        """The unilateral forces of a system; None if it has none on any rank."""
        forces: list[Unilateral] = [
            UnilateralContacts(contacts)
            for contacts in system.contacts
            if isinstance(contacts, BarrierContacts)
        ]
        if system.constraints.has_unilateral:
            forces.append(UnilateralRows(system))
        return cls(system, forces) if forces else None

    def __init__(self, system: System, forces: Sequence[Unilateral]) -> None:
        """Store the forces of the system, which act by impulses from now on."""
        self._system, self._forces = system, forces
        self._impulse = Impulse(system, damped=True)
        self._damping = StiffDamping(system) if self._impulse.damped else None
        self._h, self._spread, self._weight, self._start = 1.0, 1.0, 1.0, system.time
        self._plain = self._holding = False  # a step without forces; some in the accepted state
        self.acting = self.kicking = False
        # impulses of rows, those of forces over the step and those of restitution, over h
        self._means, self._pulls = np.zeros((2, system.constraints.size))
        self._jumps = [np.zeros_like(part.block.step) for part in system.parts]
        self._last_jumps = [jumps.copy() for jumps in self._jumps]
        self._steady = False
        self._restituting = [
            contacts
            for contacts in system.contacts
            if isinstance(contacts, BarrierContacts) and contacts.restitutes
        ]
        self._touching = any(isinstance(one, UnilateralContacts) for one in forces)
        self.limited = [one for one in forces if isinstance(one, UnilateralRows)]
        rows, comm = system.constraints, system.comm
        self._rubbing: bool = comm.allreduce(bool(len(rows.coupled)), op=MPI.LOR)
        rows.split, self._apart = True, rows.unilateral

    def begin(self, h: float, weight: float, unseen: float) -> bool:
        """Start a step of size ``h`` (s) from the accepted state; False if masses are singular.

        Collective. In the equations the forces are multiplied by ``weight``, and velocities have
        the share ``unseen`` of impulses less: b and k of ``stiff_damping``.
        """
        self._h, self._weight, self._start = h, weight, self._system.time
        self.acting = self.kicking = False
        self._spread = h * (1.0 - unseen / weight)
        if self._damping is not None:
            self._damping.begin(weight - 1.0 + unseen)
        self._plain = self._system.constraints.slack and not (self._touching or self.lacking)
        return self._plain or self._begin()

    def _begin(self) -> bool:
        """Start a step with forces (collective)."""
        self._system.constraints.own.excess[:] = 0.0
        self._system.interface.update()
        if self._system.constraints.consistent:
            for rows in self.limited:
                rows.let_go(self._h)
        return self._divide()

    def _divide(self) -> bool:
        """Start with forces either in the accepted accelerations, or by impulses (collective)."""
        if self._any([forces.pressing for forces in self._forces]) and not self._separate():
            return False
        for forces in self._forces:
            forces.begin(self._h, self._weight)
        self._apart = self._system.constraints.apart
        return True

    def _separate(self) -> bool:
        """Take forces out of the accepted accelerations, or into them; False if impossible.

        Collective; the trial state is the accepted one.
        """
        system, rows = self._system, self._system.constraints
        rows.multipliers[:] = rows.forces
        rows.evaluate(_UNSCALED)
        impulses = np.zeros(rows.size)
        self._clear()
        for forces in self._forces:
            forces.add_pressing()
            forces.read_pressing(impulses)
        found = self._impulse.solve(self._h)
        if found is None:
            return False
        impulses += found * rows.rigid
        for part in system.parts:
            part.block.owned_step[:] *= -1.0
            part.block.slow()
        if self._damping is not None:
            self._damping.leave(self._h)
        system.reset()
        system.interface.update()
        rows.impulses += impulses
        rows.forces -= impulses
        return True

    def solve(
        self, shifts: Shifts, attempt: Callable[[], Status], predict: Callable[[], None],
        kick: Callable[[FrameBlock], None],
    ) -> Status:  # fmt: skip
        """Solve a step and find its impulses (collective).

        Where a force of the scheme ends in the step, it acts by an impulse, and the step is solved
        again. So it is where impulses change the normal forces of friction.

        Args:
            shifts: factors of the scheme.
            attempt: solves from the present trial state.
            predict: makes a predicted trial state.
            kick: changes the velocities of a block by its steps.
        """
        if self._plain:
            status = attempt()
            if status is Status.OK and not self._any([one.met for one in self.limited]):
                return status
            self._plain = False
            if not self._return(self._begin):
                return Status.SINGULAR
            predict()
        releases = 0
        for _ in range(_SOLUTIONS):
            status = attempt()
            if status is not Status.OK:
                return status
            if self._look():
                if not self._release(every=releases > 0):
                    return Status.SINGULAR
                releases += 1
            else:
                status = self._finish(shifts, kick)
                if status is not Status.OK or not self._rubs_otherwise(shifts):
                    return status
            predict()
        return Status.NOT_CONVERGED

    def _look(self) -> bool:
        """True if forces of the scheme have ended; find whether others act (collective)."""
        self._system.interface.update()
        opened = [forces.opened for forces in self._forces]  # each finds its own
        found = _OPENED * any(opened) + _ACTING * any(forces.acting for forces in self._forces)
        found += _HOLDING * any(rows.holding for rows in self.limited)
        comm = self._system.comm
        found = comm.allreduce(found, op=MPI.BOR) if comm.size > 1 else found
        ended, self._holding = bool(found & _OPENED), bool(found & _HOLDING)
        self.acting = bool(found & _ACTING) and not ended
        return ended

    def _release(self, *, every: bool) -> bool:
        """Return to the accepted state, without forces that have ended in its accelerations."""

        def divide() -> bool:
            for forces in self._forces:
                forces.release(every=every)
            return self._divide()

        return self._return(divide)

    def _return(self, begin: Callable[[], bool]) -> bool:
        """Return to the accepted state and begin the step there; the result of ``begin``."""
        system, end = self._system, self._system.time
        system.set_time(self._start)
        system.reset()
        system.interface.update()
        done = begin()
        system.set_time(end)
        return done

    def _rubs_otherwise(self, shifts: Shifts) -> bool:
        """True if normal forces of friction are not those of the solution (collective).

        Multipliers have ``weight`` times the impulses in them, normal forces have them once.
        """
        rows, comm = self._system.constraints, self._system.comm
        if not self._rubbing:
            return False
        pressing = rows.coupled[:, 1]
        excess = (self._weight - 1.0) * shifts.scale * self._means[pressing]
        change = np.abs(excess - rows.own.excess[pressing]).max(initial=0.0)
        size = np.abs(rows.multipliers[pressing]).max(initial=0.0)
        rows.own.excess[pressing] = excess
        found = np.array([change, size])
        if comm.size > 1:
            comm.Allreduce(MPI.IN_PLACE, found, op=MPI.MAX)
        return bool(found[0] > _ALIKE * found[1])

    def evaluate(self, system: System, shifts: Shifts, strains: PartStrains | None = None) -> None:
        """See :class:`EndPoint`."""
        super().evaluate(system, shifts, strains)
        if self._damping is not None:
            self._damping.give_back(shifts.scale)

    @property
    def spread(self) -> float:
        """Part of the present step, s, in which damping spreads its impulses."""
        return self._spread

    def recall_damping(self, h: float, *, lacking: bool) -> None:
        """Find what damping lacks at an accepted state, see ``StiffDamping.recall``."""
        if self._damping is not None:
            self._damping.recall(h, lacking=lacking)

    @property
    def lacking(self) -> bool:
        """True if accepted accelerations lack a part of damping."""
        return self._damping is not None and self._damping.lacking

    def evaluate_rows(self, system: System, shifts: Shifts) -> None:
        """See :class:`EndPoint`."""
        super().evaluate_rows(system, shifts)
        if self._plain:
            return
        for forces in self._forces:
            forces.evaluate(shifts)

    def predict(self, shifts: Shifts) -> None:
        """Multipliers of a predicted trial state: those of the last step."""
        rows = self._system.constraints
        if self._plain:
            np.multiply(rows.forces, shifts.scale, out=rows.multipliers)
            return
        rows.multipliers[:] = shifts.scale * (rows.forces + self._weight * rows.impulses)

    def continue_impulses(self, share: float) -> None:
        """Move the predicted trial state by a share of what lasting impulses move (collective)."""
        for part, jumps in zip(self._system.parts, self._jumps, strict=True):
            part.block.step[:] = 0.5 * self._h * self._h * share * jumps
            part.block.correct(1.0)

    @property
    def steady(self) -> bool:
        """True if the impulses of the last steps are alike: bodies rest, roll or slide."""
        return self._steady

    def state(self) -> State:
        """Impulses of the last step, by which the next one is predicted, and what it is to do."""
        blocks = [part.block.name for part in self._system.parts]
        rows = {name: {"jumps": own} for name, own in zip(blocks, self._last_jumps, strict=True)}
        own = State({"steady": np.array([float(self._steady)])}, rows)
        return own if self._damping is None else own | self._damping.state()

    def restore(self, state: State) -> None:
        """Restore a result of :meth:`state`."""
        self._steady = bool(state.values["steady"][0])
        if self._damping is not None:
            self._damping.restore(state)
        for part, now, last in zip(
            self._system.parts, self._jumps, self._last_jumps, strict=True
        ):  # fmt: skip
            now[:] = last[:] = state.rows[part.block.name]["jumps"]

    def _lasts(self) -> bool:
        """True if the impulses of the step are those of the last one, about (collective)."""
        squares = np.zeros(2)
        jumps = zip(self._system.parts, self._jumps, self._last_jumps, strict=True)
        for part, now, last in jumps:
            own = slice(part.block.owned)  # ghosts count once, on the rank that owns them
            squares += np.sum((now[own] - last[own]) ** 2), np.sum(now[own] ** 2)
            last[:] = now
        if self._system.comm.size > 1:
            self._system.comm.Allreduce(MPI.IN_PLACE, squares)
        return bool(squares[0] < _LASTING**2 * squares[1])

    def _finish(self, shifts: Shifts, kick: Callable[[FrameBlock], None]) -> Status:
        """Find the impulses of a step that has been solved (collective)."""
        system, rows = self._system, self._system.constraints
        self._means[:] = self._pulls[:] = 0.0
        self.kicking = self.acting or self.lacking
        if not self.kicking:
            return Status.OK
        multipliers = rows.multipliers.copy()
        self.evaluate_rows(system, shifts)
        if self._damping is not None:
            self._damping.lead(self._h, self._weight)
        else:
            self._clear()
        for forces in self._forces:
            forces.add_means(shifts)
            forces.read_means(shifts, self._means)
        found = self._impulse.solve(self._spread)
        rows.multipliers[:] = multipliers
        if found is None:
            return Status.SINGULAR
        self._means += found * rows.rigid
        for part, jumps in zip(system.parts, self._jumps, strict=True):
            part.block.owned_step[:] *= -self._h
            kick(part.block)
            np.divide(part.block.step, self._h, out=jumps)
        done = self._restitute()
        rows.multipliers[:] = multipliers
        return Status.OK if done else Status.SINGULAR

    def _restitute(self) -> bool:
        """Slow down what leaves contacts with restitution; False if impossible (collective)."""
        for contacts in self._restituting:
            found = self._impulse.restitute(contacts, self._h, self._pulls)
            if found is None:
                continue
            if not found:
                return False
            for part, jumps in zip(self._system.parts, self._jumps, strict=True):
                part.block.kick(0.0)
                np.add(jumps, part.block.step / self._h, out=jumps)
        return True

    def accept(self, shifts: Shifts) -> None:
        """Set the accepted forces of all rows, before the trial state is accepted."""
        rows = self._system.constraints
        rows.entering[:] = rows.forces
        np.divide(rows.multipliers, shifts.scale, out=rows.forces)
        if self.kicking:
            rows.forces -= self._weight * self._means
        np.copyto(rows.forces, 0.0, where=self._apart)
        rows.span += self._h
        if self._plain:
            rows.impulses[:] = 0.0
            return
        rows.impulses[:] = self._means + self._pulls
        rows.passed += self._h * rows.impulses
        for forces in self._forces:
            forces.accept()
        rows.slack = not (self.acting or self._holding)

    def accepted(self) -> None:
        """Complete the accepted state of a step with impulses.

        Reported accelerations include those of unilateral forces. Those from which the next step
        goes on do not, and may be huge where these hold a stiff body: a prediction with them turns
        nodes by whole turns, unless they last.
        """
        system = self._system
        if self._damping is not None:
            self._damping.end(self._h, acting=self.acting)
        if self._plain:
            return
        if not self.acting:
            self._steady = False
            for last in self._last_jumps:
                last[:] = 0.0
            return
        self._steady = self._touching and self._lasts()
        for part, jumps in zip(system.parts, self._jumps, strict=True):
            part.block.acceleration += jumps
        if self._steady:
            system.prediction = Prediction.ACCELERATION
        elif system.prediction is Prediction.ACCELERATION:
            system.prediction = Prediction.VELOCITY

    def _clear(self) -> None:
        for part in self._system.parts:
            part.block.residual[:] = 0.0

    def _any(self, flags: list[bool]) -> bool:
        """True if one of the flags is set on any rank (collective)."""
        comm = self._system.comm
        return comm.allreduce(any(flags), op=MPI.LOR) if comm.size > 1 else any(flags)


#: What is found of the forces of a step, see ``Split._look``.
_ACTING, _OPENED, _HOLDING = 1, 2, 4
#: Relative change of impulses from step to step below which they last.
_LASTING = 0.1
#: Number of solutions of a step, and relative change of normal forces that ends them.
_SOLUTIONS, _ALIKE = 12, 1e-6
#: Factors with which rows are evaluated at a state, not as part of a time step.
_UNSCALED = np.array([1.0, 1.0])
