# SPDX-License-Identifier: LGPL-3.0-or-later
"""Monitor of all motions: energy balance, rotations, jumps, invalid states, not finite values.

The work of loads and drives is summed up in every step, by few numbers; energies are summed over
the model only at some of them, chosen by count and not by time, so that runs and ranks agree.
"""

from __future__ import annotations

from mpi4py import MPI

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.laws import LawKind
from flexfem.inspection.finding import owner_of
from flexfem.layout.elements import HistoryElements
from flexfem.layout.numbered_model import NumberedModel
from flexfem.simulation.watch.brief_contacts import BriefContacts
from flexfem.simulation.watch.inside_out import InsideOut
from flexfem.simulation.watch.passages import PassageWatch
from flexfem.simulation.watch.sagging import SagWatch
from flexfem.simulation.watch.shallow_contacts import ShallowContacts
from flexfem.simulation.watch.validity import ValidityWatch
from flexfem.simulation.watch.wraps import WrapWatch
from flexfem.system.bounding_box import diagonal, model_box
from flexfem.system.measure.drive_changes import DriveChanges
from flexfem.system.measure.energies import EnergyMeter, work_of_loads
from flexfem.system.system import System

__all__ = ["EnergyWatch"]

#: Number of steps between two evaluations of energies, fewer in the first ones.
_EVERY = 256
#: Admissible spurious energy over the largest energy, see ``energy_drift``, without drives and with
#: them. Their work is that of multipliers, which oscillate in coarse steps: the possible error of
#: it is added (``DriveChanges.work``), but for gains not more than the last part.
_GAIN, _DRIVEN_GAIN, _MOST_GAIN = 0.02, 0.05, 0.3
#: Admissible numerical dissipation over the largest energy in a conservative model. Half of the
#: work of a suddenly applied load goes into vibrations, which may all be dissipated if unresolved.
_LOSS = 0.75
#: Rotation of a node in a step, rad: see the check of models ``steps``.
_TURN = 0.5
#: Energy, J, below which a value is round-off.
_NOTHING = 1e-12
_SMALLER = "reduce dt or tolerance, or use smoother initial velocities, drives and contacts"
_DAMPED = "set rho_inf below 1 to damp what the steps do not resolve, or "


class EnergyWatch:
    """Monitor of the accepted states of one run, from its start or restart on."""

    def __init__(
        self, system: System, serial: NumberedModel, h: float, tolerance: float, *,
        probed: bool, fast: bool, undamped: bool = False,
    ) -> None:  # fmt: skip
        """Read the state at the start (collective).

        Args:
            system: at its consistent start.
            serial: serial data of its model.
            h: size of whole steps, s.
            tolerance: of steps, m or rad.
            probed: True if gains of energy are reported by an energy probe of the whole model.
            fast: True if fast rotations were reported at the start.
            undamped: True if the integrator dissipates nothing.
        """
        self._system, self._serial, self._h = system, serial, h
        self._probed, self._fast = probed, fast
        self._advice = f"{_DAMPED}{_SMALLER}" if undamped else _SMALLER
        model, rows = serial.model, system.constraints
        self._meter = EnergyMeter(system, model)
        box = model_box(serial)
        self._drives = DriveChanges(rows, diagonal(box))
        self._validity, self._wraps = ValidityWatch(serial, system, box), WrapWatch(system)
        self._sags, self._brief = SagWatch(system), BriefContacts(system, model)
        self._passages, self._shallow = PassageWatch(system), ShallowContacts(system, tolerance)
        mine = len(self._drives.rows) + len(self._drives.wrenches)
        self._driven = bool(system.comm.allreduce(mine))
        self._complete = not system.comm.allreduce(not self._drives.complete, op=MPI.LOR)
        steady = all(
            load.amplitude is None and not load.follower and not np.any(load.wrench[1])
            for load in model.loads
        )
        # the work of constant forces needs no sum
        self._varying = not steady
        driven = np.array([j.joint.driven for j in rows.joints], dtype=np.bool_)[rows.joint_of_row]
        spring = (rows.elastic[:, 0] == LawKind.SPRING) & ~driven & (rows.owned > 0.0)
        self._preload: FloatArray = np.where(spring, rows.elastic[:, 3], 0.0)
        self._losing = bool(system.comm.allreduce(self._may_lose(), op=MPI.LOR))
        self._loads, self._time = self._meter.loads(), system.time
        self._power = self._meter.power()
        self._work = 0.0
        # on this rank at all accepted states since the last sample: those of ranks may cancel
        self._works: list[float] = []
        self._count = self._events = 0
        self._base = np.nan
        self._largest = self._gain = self._most_gain = self._loss = 0.0
        self._turn: tuple[float, float, int, int] = (0.0, 0.0, 0, 0)
        self._bad: float | None = None
        self._inverted: tuple[float, InsideOut] | None = None
        self._sample()

    def _may_lose(self) -> bool:
        """Return True if dampers, friction, contacts or internal variables may dissipate energy.

        On this rank.
        """
        system, rows = self._system, self._system.constraints
        takes = bool(((rows.elastic[:, 2] != 0.0) | rows.frictional).any())
        viscous = any(p.elements is not None and p.elements.viscous for p in system.parts)
        modal = system.modal_dampers is not None
        wears = any(
            isinstance(p.elements, HistoryElements) and p.elements.remembering for p in system.parts
        )
        return takes or viscous or modal or wears or bool(system.contacts)

    def follow(self) -> None:
        """Sum the work up to an accepted state."""
        if not (self._driven or self._varying):
            return
        if self._driven:
            self._drives.follow()
        h, self._time = self._system.time - self._time, self._system.time
        given, self._power = self._power, self._meter.power()
        self._work += 0.5 * h * (given + self._power)
        if self._varying:
            before, self._loads = self._loads, self._meter.loads()
            self._work += work_of_loads(before, self._loads, h)
        self._works.append(self._done())

    def _done(self) -> float:
        """Work of loads and drives so far, on this rank, J."""
        return self._work + self._drives.work.item(0)

    def step(self, events: int, last: bool) -> None:
        """Evaluate the end of a whole step (collective at some).

        Args:
            events: number of events so far; the balance begins again after one.
            last: True for the last step.
        """
        self.follow()
        self._count += 1
        self._wraps.look()
        self._sags.look()
        self._passages.look()
        self._brief.look()
        self._shallow.look()
        if self._driven:
            self._drives.notice(self._system.time, self._h)
        if events != self._events:
            self._events, self._base = events, np.nan
            self._drives.forget()
        often = self._count & (self._count - 1) == 0
        if last or often or self._count % _EVERY == 0 or np.isnan(self._base):
            self._sample()

    def fail(self) -> None:
        """Evaluate the last accepted state of a run that fails (collective)."""
        self._sample(failed=True)

    def _sample(self, *, failed: bool = False) -> None:
        """Evaluate all energies and the fastest rotation (collective).

        Forces of a step that has ``failed`` are not used.
        """
        system, rows = self._system, self._system.constraints
        kinetic, strain, gravity = self._meter.stored().tolist()
        if self._preload.any():
            strain += float(self._preload @ rows.sums())
        work = self._done()
        if not self._varying and len(self._loads):
            work += work_of_loads(self._loads, self._meter.loads(), 0.0)
        finite = failed or np.isfinite(rows.forces).all()
        doubt, works = self._drives.work[1] if finite else np.nan, self._works
        shares, self._works = np.array([doubt, kinetic, strain, gravity, work, *works]), []
        if system.comm.size > 1:
            system.comm.Allreduce(MPI.IN_PLACE, shares)
        self._note_turns()
        self._validity.look()
        if self._inverted is None and (found := InsideOut.worst(system)):
            self._inverted = (system.time, found)
        self._note(shares)

    def _note(self, shares: FloatArray) -> None:
        """Compare energies with those at the start.

        Args:
            shares: the possible error of the work of drives; the kinetic energy, strain energy,
                that of gravity and the work; and works at earlier states, which may have been
                larger.
        """
        t = self._system.time
        if not np.isfinite(shares).all():
            self._bad = t if self._bad is None else self._bad
            return
        doubt, kinetic, strain, gravity, work = shares[:5].tolist()
        balance = kinetic + strain + gravity - work
        if np.isnan(self._base):
            self._base = balance
        self._largest = max(self._largest, float(np.abs(shares[1:]).max()))
        self._gain, self._most_gain = (
            max(self._gain, balance - self._base - doubt),
            max(self._most_gain, balance - self._base),
        )
        self._loss = max(self._loss, self._base - balance - doubt)

    def _note_turns(self) -> None:
        """Update the largest rotation of a node of this rank in a step."""
        for part in self._system.parts:
            spins = part.block.velocity[: part.block.owned, 3:]
            if part.block.dirichlet is not None and part.block.width == 6:
                spins = spins * ~part.block.dirichlet[: part.block.owned, 3:]
            if not len(spins) or part.block.width < 6:
                continue
            turns = np.einsum("ni,ni->n", spins, spins)
            node = int(np.argmax(turns))
            turn = self._h * float(np.sqrt(turns[node]))
            if turn > self._turn[0]:
                self._turn = (turn, self._system.time, part.kind, int(part.node_body[node]))

    def texts(self) -> list[str]:
        """Return the warnings of the run, the same on every rank (collective)."""
        return [
            *self._not_finite(),
            *self._inside_out(),
            *self._validity.texts(),
            *self._wraps.texts(),
            *self._sags.texts(),
            *self._passages.texts(),
            *self._brief.texts(),
            *self._shallow.texts(),
            *self._turns(),
            *self._jumps(),
            *self._balance(),
        ]

    def _not_finite(self) -> list[str]:
        if self._bad is None:
            return []
        return [
            f"positions, velocities or forces are not finite at t = {self._bad:.6g} s or earlier; "
            "later results are invalid"
        ]

    def _inside_out(self) -> list[str]:
        every = [one for one in self._system.comm.allgather(self._inverted) if one is not None]
        if not every:
            return []
        t, found = min(every)
        return [
            f"{found.text(self._serial)} at t = {t:.6g} s or earlier; later results are invalid"
        ]

    def _turns(self) -> list[str]:
        every = self._system.comm.allgather(self._turn)
        turn, t, kind, body = max(every, key=lambda one: (float(f"{one[0]:.6g}"), -one[2], -one[3]))
        if turn <= _TURN or self._fast:
            return []
        return [
            f"{owner_of(self._serial.body(kind, body))}: it rotates by {turn:.3g} rad in the step "
            f"of {self._h:.3g} s to t = {t:.4g} s, which is not accurate; use steps of "
            f"{0.2 * _TURN * self._h / turn:.1g} s or less"
        ]

    def _jumps(self) -> list[str]:
        every = self._system.comm.allgather(self._drives.jumps())
        found = dict(one for ranks in every for one in ranks)
        return [
            f"{found[number]}, which gives forces that depend on the step; make it smooth "
            "(SmoothStep, Spline)"
            for number in sorted(found)
        ]

    def _balance(self) -> list[str]:
        largest, part = self._largest, _DRIVEN_GAIN if self._driven else _GAIN
        gained = self._gain > part * largest or self._most_gain > _MOST_GAIN * largest
        if not self._complete or largest <= _NOTHING:
            return []
        if gained and not self._probed:
            return [
                f"spurious energy: the balance has grown by {self._most_gain:.3g} J with energies "
                f"of at most {largest:.3g} J; {self._advice} (an EnergyProbe shows when)"
            ]
        if self._loss > _LOSS * largest and not self._losing:
            return [
                f"numerical dissipation: the balance has fallen by {self._loss:.3g} J with "
                f"energies of at most {largest:.3g} J in a model without dissipation; {_SMALLER} "
                "(an EnergyProbe shows when)"
            ]
        return []
