# SPDX-License-Identifier: LGPL-3.0-or-later
"""Energies of a system or of some of its bodies, and the work done on them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexfem._types import BoolArray, FloatArray
from flexfem.constraints.rows.step_laws import step_forces
from flexfem.core.laws import STORING_FUNCTIONS, LawKind
from flexfem.core.nodes import motion
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.kernels.compiled import kernel
from flexfem.layout.elements import (
    HistoryElements,
    SteppedElements,
    StrainedElements,
    TimedElements,
)
from flexfem.model.model import Model
from flexfem.system.measure.momenta import ChosenBodies
from flexfem.system.modal_dampers import row_of
from flexfem.system.system import System

__all__ = ["Energies", "EnergyMeter", "refresh_rows", "work_of_loads"]

#: Factors with which rows are evaluated at a state, not as part of a time step.
_UNSCALED = np.array([1.0, 1.0])
#: Laws of a row's value, without those of friction and of elements.
_OF_VALUES = (LawKind.SPRING, LawKind.LIMIT, LawKind.FUNCTION, *STORING_FUNCTIONS)
#: Part of the stored energy below which its change over a step is round-off.
_ROUND = 1e-9
_NONE = np.zeros(0)


@dataclass(frozen=True)
class Energies:
    """Energies, J: the columns of :class:`flexfem.EnergyProbe`."""

    kinetic: float
    strain: float
    gravity: float
    work: float
    dissipation: float
    balance: float


@dataclass(frozen=True)
class _State:
    """Quantities at one instant from which work is computed.

    Attributes:
        loads: (k, 12) force, moment, position and angular velocity of each load, inertial axes.
        viscous, strains: (j, 6) viscous stress of the elements, and their strain; of none where
            forces are means over a step.
        frames: (n, 12) of damped elements where forces are means over a step, an array for each.
        elastic, initial: (j, 6) stress and initial strain of elements where the latter changes.
        forces: (r,) of all rows, without impulses.
        impulses: (r,) means over the last step of forces besides.
        rates: (r,) rates of the rows that do work, by the motion of their working sides.
        sprung, pulls: (r,) energy stored in rows, and the elastic part of their forces.
        all_rates: (r,) of all rows; of none if there are no dampers.
        values: (r,) sums less targets, of dampers, moved springs and forces that are quotients, or
            none.
        targets: (r,) of all rows.
        stiffness: (r,) of all rows, N/m or N m/rad.
        own_rates: (r,) rates of the targets that dampers see.
        modal, shares: (k,) rates of damped modes, and this rank's share in chosen elements of their
            amplitudes, of the rates where initial strains change.
        power: of masses that change, W.
    """

    loads: FloatArray
    viscous: FloatArray
    strains: FloatArray
    frames: list[FloatArray]
    elastic: FloatArray
    initial: FloatArray
    forces: FloatArray
    impulses: FloatArray
    rates: FloatArray
    sprung: FloatArray
    pulls: FloatArray
    all_rates: FloatArray
    values: FloatArray
    targets: FloatArray
    stiffness: FloatArray
    own_rates: FloatArray
    modal: FloatArray
    shares: FloatArray
    power: float


def refresh_rows(system: System) -> None:
    """Evaluate gradients of all rows at the accepted state, not at the last iterate."""
    system.constraints.evaluate(_UNSCALED)


class EnergyMeter:
    """Meter of energies on this rank; work and dissipation are summed from call to call.

    It is created at the start, and :meth:`update` is called after every accepted step. The work of
    a step is the mean of a force before and after times its displacement, and what damping takes
    the mean of viscous stresses, or of forces of dampers, times the change of strains or values; of
    moments, drives and friction it is the mean times the mean rate times the step. All are of
    second order. Mean rates are not what steps with ``rho_inf < 1`` take in modes whose damping
    they do not resolve: with 0 a tenth to a quarter of the energy was counted too much. Where
    forces of rows are means over the step (``Constraints.mean_forces``), they count as such, and
    damping takes the mean stress along the change of strain, exactly what the step says.

    Forces of rows are the multipliers of the integrator, not ``System.reported_forces``: they
    belong to the velocities of the kinetic energy. A body rotated by 10 rad in 20 steps gains 4395
    J; its balance is off by 25 J with them, by 100 J with the reported ones (stabilised index
    2: 0.6 and 28 J), and where rates of drives jump, their impulses are in these forces alone.

    Attributes:
        SHARES: length of :meth:`state`.
        whole: True for all bodies.
        inside: (r,) rows that act on the bodies alone, whose energy is theirs.
        latest: (6,) last result of :meth:`update`; zero before.
    """

    SHARES = 7

    def __init__(self, system: System, model: Model, bodies: Sequence[str] | None = None) -> None:
        """Choose the bodies and read the accepted state they start from.

        Args:
            system: the system.
            model: its model.
            bodies: names of beams, shells and rigid bodies, None for all.
        """
        self._system = system
        self._chosen = ChosenBodies(system, model, bodies)
        self.whole = bodies is None
        self.latest = np.zeros(6)
        self._lost = self._lost_beside()
        self._loads = [
            (forces, part.block, None if mask.all() else mask)
            for i, part in enumerate(system.parts)
            for forces, mask in self._chosen.loads(i)
            if mask.any()
        ]
        rows, sides = system.constraints, self._chosen.sides
        # rows that also act on a body that is not chosen
        crossing = np.bincount(rows.row_of_term, ~sides.all(axis=1), rows.size) > 0.0
        owned = rows.owned > 0.0
        self._moved = owned & rows.storing & ~crossing
        self._moves = bool(self._moved.any())
        driven = rows.working & ~self._moved
        # a drive works on all its sides, any row works on a chosen body against another one
        self._working = sides & (owned & (driven | crossing))[rows.row_of_term][:, np.newaxis]
        self.inside = ~crossing
        self._springs = owned & self.inside
        # rows whose forces may be the change of what they store over that of their value
        stores = np.isin(rows.elastic[:, 0], (LawKind.LIMIT, *STORING_FUNCTIONS))
        self._quotients = self._springs & (
            (rows.unilateral & rows.split) | (stores & rows.mean_forces)
        )
        self._held = self._quotients & ~self._moved  # their rest does not move
        self._dampers = self._springs & (rows.elastic[:, 0] != LawKind.RIGID) & ~driven
        # dampers of what has a value are measured along its change, others by their rates
        valued = np.isin(rows.elastic[:, 0], _OF_VALUES)
        self._valued = self._dampers & valued & ~self._moved
        self._damped, self._exact = bool(self._dampers.any()), bool(self._quotients.any())
        # strain energies and viscous stresses, with the weights of the chosen elements in sums
        self._elastic, self._viscous = [], []
        self._stepped: list[tuple[SteppedElements, FrameBlock, FloatArray]] = []
        self._timed: list[tuple[StrainedElements, FrameBlock]] = []
        self._growing: list[tuple[TimedElements, FrameBlock, FloatArray]] = []
        self._wearing: list[tuple[HistoryElements, FloatArray]] = []
        timed, lengths = [np.zeros(0)], [np.zeros(0)]
        for part, cells in zip(system.parts, self._chosen.cells, strict=True):
            if part.elements is None:
                continue
            weights = cells.astype(np.float64)
            self._elastic.append((part.elements, part.block, weights))
            if isinstance(part.elements, HistoryElements):
                self._wearing.append((part.elements, weights))
            if isinstance(part.elements, TimedElements):
                self._growing.append((part.elements, part.block, weights))
            if part.elements.viscous and rows.mean_forces:
                assert isinstance(part.elements, SteppedElements)
                self._stepped.append((part.elements, part.block, weights))
            elif part.elements.viscous:
                at, own = part.elements.viscous_at
                self._viscous.append((part.elements, part.block))
                lengths.append(cells[at] * own)
            if isinstance(part.elements, StrainedElements) and part.elements.timed:
                self._timed.append((part.elements, part.block))
                timed.append(weights[part.elements.viscous_at[0]])
        self._lengths, self._weights = np.concatenate(lengths), np.concatenate(timed)
        self._modal = [] if system.modal_dampers is None else [
            (own, own.products(self._chosen.cells[number]))
            for number, own in system.modal_dampers.parts.items()
        ]  # fmt: skip
        self._work = self._dissipation = 0.0
        self._worn = self._wear()
        self._time = system.time
        refresh_rows(system)
        self._state = self._read()
        self._gravity, self._growth = system.gravity.copy(), 0.0
        self._centre = self._start = self._first_moment()
        self._initial = float(self._stored(self._state.sprung).sum())

    def update(self) -> FloatArray:
        """Update for the accepted state and return this rank's share (6,) of :class:`Energies`."""
        system = self._system
        h, self._time = system.time - self._time, system.time
        refresh_rows(system)
        before, self._state = self._state, self._read()
        self._work += work_of_loads(before.loads, self._state.loads, h) + self._drive(
            before, self._state, h
        )
        self._work += 0.5 * h * (before.power + self._state.power)
        if self._timed:
            self._work += self._heat(before, self._state)
        self._dissipation += self._loss(before, self._state, h) + self._loss_beside()
        before_wear, self._worn = self._worn, self._wear()
        self._dissipation += self._worn - before_wear
        self._let_gravity_grow()
        stored = self._stored(self._state.sprung)
        balance = float(stored.sum()) - self._work + self._dissipation - self._initial
        self.latest = np.array([*stored, self._work, self._dissipation, balance])
        return self.latest

    def state(self) -> FloatArray:
        """(7,) this rank's shares of the sums and of the values at the start."""
        sums = self._work, self._dissipation, self._growth, self._initial
        return np.array([*sums, *self._start])

    def restore(self, shares: FloatArray) -> None:
        """Restore a result of :meth:`state`; only its sum over the ranks matters."""
        self._work, self._dissipation, self._growth, self._initial = shares[:4].tolist()
        self._start, self._worn = shares[4:].copy(), self._wear()

    def _wear(self) -> float:
        """Energy that internal variables of the chosen elements have dissipated, J."""
        return sum((float(elements.lost() @ cells) for elements, cells in self._wearing), 0.0)

    def total(self) -> Energies:
        """Update for the accepted state and sum over all ranks (collective)."""
        return Energies(*self._system.comm.allreduce(self.update()).tolist())

    def _read(self) -> _State:
        """The present state of all loads, viscous elements and rows."""
        system, rows = self._system, self._system.constraints
        change = rows.side_changes(system.interface.velocities)
        return _State(
            self.loads(), *self._viscosity(),
            [block.frames.copy() for _, block, _ in self._stepped],
            *self._eigenstates(), rows.forces.copy(),
            rows.impulses.copy(), rows.of_rows(change * self._working), *rows.stored(),
            rows.of_rows(change) if self._damped else _NONE,
            rows.sums() - rows.targets if self._damped or self._moves or self._exact else _NONE,
            rows.targets.copy(), rows.elastic[:, 1].copy(),
            rows.target_rates.copy(), *self._modal_rates(), self.power(),
        )  # fmt: skip

    def _modal_rates(self) -> tuple[FloatArray, FloatArray]:
        """(k,) rates of damped modes, and shares in the chosen elements (collective)."""
        dampers = self._system.modal_dampers
        if dampers is None:
            return _NONE, _NONE
        rates, timed = dampers.rates(), self._system.timed
        shares = 0.0 * rates
        for own, stress in self._modal:
            shares += stress @ (own.rates() if timed else row_of(own.present()))
        return rates, shares

    def power(self) -> float:
        """Power of masses of the chosen elements that change, W, on this rank."""
        gravity = self._system.gravity
        return sum((float(e.powers(b, gravity) @ cells) for e, b, cells in self._growing), 0.0)

    def _viscosity(self) -> tuple[FloatArray, FloatArray]:
        """(j, 6) viscous stress of the elements, and their strain."""
        found = [elements.viscosity(block) for elements, block in self._viscous]
        if len(found) == 1:
            return found[0]
        nothing = np.empty((0, 6))
        stress, strain = zip((nothing, nothing), *found, strict=True)
        return np.concatenate(stress), np.concatenate(strain)

    def _eigenstates(self) -> tuple[FloatArray, FloatArray]:
        """(j, 6) stresses and initial strains of the elements whose initial strain changes."""
        found = [np.stack(elements.eigenstates(block.frames)) for elements, block in self._timed]
        stress, initial = np.concatenate([np.empty((2, 0, 6)), *found], axis=1)
        return stress, initial

    def loads(self) -> FloatArray:
        """(k, 12) force, moment, position and angular velocity of each load, inertial axes."""
        factors = self._system.factors
        states = [
            forces.states(block, factors)[mask]
            if mask is not None
            else forces.states(block, factors)
            for forces, block, mask in self._loads
        ]
        return states[0] if len(states) == 1 else np.concatenate([np.empty((0, 12)), *states])

    def stored(self) -> FloatArray:
        """(3,) kinetic, strain and gravity's energy on this rank; the last less that at the start.

        Rows must be those of the accepted state, see :func:`refresh_rows` (collective).
        """
        return self._stored(self._system.constraints.stored()[0])

    def _stored(self, sprung: FloatArray) -> FloatArray:
        """The same with the energies (r,) stored in rows."""
        system, state = self._system, self._chosen.motion()
        strain = float(sprung @ self._springs)
        for elements, block, cells in self._elastic:
            strain += float(elements.energies(block.frames) @ cells)
        if self.whole:
            strain += sum(contacts.energy for contacts in system.contacts)
        way = state[motion.FIRST : motion.LINEAR] - self._start
        weight = self._growth - float(system.gravity @ way)
        return np.array([state[motion.KINETIC], strain, weight])

    def _first_moment(self) -> FloatArray:
        """(3,) of the mass of this rank, kg m."""
        return self._chosen.motion()[motion.FIRST : motion.LINEAR]

    def _let_gravity_grow(self) -> None:
        """Subtract the change of the potential with the growth of gravity, which is not work."""
        gravity, before = self._system.gravity, self._centre
        if not np.array_equal(gravity, self._gravity):
            self._centre = self._first_moment()
            way = 0.5 * (before + self._centre) - self._start
            self._growth += float((gravity - self._gravity) @ way)
            self._gravity = gravity.copy()

    def _loss(self, before: _State, after: _State, h: float) -> float:
        """Energy dissipated by dampers and by the damping of beams."""
        total, exact = 0.0, self._over_step
        if self._damped:
            rate = 0.5 * (before.all_rates + after.all_rates - before.own_rates - after.own_rates)
            others = self._dampers & ~exact & ~self._held
            way = after.values + after.targets - before.values - before.targets
            way = np.where(self._valued, way, h * rate)
            total = float((self._damping(before, after) * others) @ way)
        if self._exact:
            total += float(self._lost_over_step(before, after, h)[exact].sum())
            total += self._lost_by_way(before, after, h)
        if self._viscous:
            stress, change = before.viscous + after.viscous, after.strains - before.strains
            total += float(np.einsum("m,mi,mi->", 0.5 * self._lengths, stress, change))
        if h > 0.0:
            for (elements, _, cells), a, b in zip(
                self._stepped, before.frames, after.frames, strict=True
            ):
                total += float(elements.losses(a, b, h) @ cells)
        if self._system.modal_dampers is not None:
            rate, change = before.modal + after.modal, after.shares - before.shares
            if self._system.timed:
                change = 0.5 * h * (before.shares + after.shares)
            total += 0.5 * float((self._system.modal_dampers.factors * rate) @ change)
        return total

    @property
    def _over_step(self) -> BoolArray:
        """(r,) springs whose forces in the last step are the change of what they store."""
        rows = self._system.constraints
        return self._quotients & (rows.apart | rows.mean_forces)

    def _sprung_before(self, before: _State, after: _State) -> FloatArray:
        """(r,) energy stored at the start of a step with the stiffness that acts in it."""
        ratio = np.divide(
            after.stiffness, before.stiffness, where=before.stiffness > 0.0,
            out=np.ones(len(before.stiffness)),
        )  # fmt: skip
        return ratio * before.sprung

    def _lost_over_step(self, before: _State, after: _State, h: float) -> FloatArray:
        """(r,) energy that springs lose whose forces are the change of what they store.

        A damper that does not see the motion of a drive, or sees its rate at the end, loses the
        product of its force with what it sees.
        """
        way, gain = after.values - before.values, after.sprung - self._sprung_before(before, after)
        lost = self._mean_force(before, after) * way - gain
        if self._moves:
            moved, rows = after.targets - before.targets, self._system.constraints
            seen = np.where(after.own_rates != 0.0, moved, 0.0)
            if not rows.mean_forces:
                seen = h * after.own_rates
            pulls = 0.5 * (before.pulls + after.pulls)
            pulls = np.divide(gain, way, where=np.abs(gain) > _ROUND * after.sprung, out=pulls)
            lost += (self._mean_force(before, after) - pulls) * (moved - seen) * self._moved
        return lost

    def _lost_by_way(self, before: _State, after: _State, h: float) -> float:
        """Energy that springs lose by their ways, whose forces are those of the scheme.

        That of the force which is the change of what they store: it is not negative, as the mean
        of what dampers do at both ends of a coarse step may be, where rows turn.
        """
        rows = self._system.constraints
        chosen = np.flatnonzero(self._held & ~self._over_step)
        if not len(chosen) or h == 0.0:
            return 0.0
        way, found = after.values - before.values, np.zeros((len(chosen), 2))
        step_forces(
            rows.own.memory, chosen, before.values, after.values, way / h, h, found
        )  # fmt: skip
        return float(found[:, 0] @ way[chosen] - (after.sprung - before.sprung)[chosen].sum())

    def _drive_over_step(self, before: _State, after: _State, h: float) -> FloatArray:
        """(r,) work of drives on these springs: what is stored and lost but not given by bodies."""
        ways = after.values - before.values + after.targets - before.targets
        stored = after.sprung - before.sprung
        return (
            stored + self._lost_over_step(before, after, h) - self._mean_force(before, after) * ways
        )

    def _heat(self, before: _State, after: _State) -> float:
        """Work over a step of initial strains, against the stresses of the elements."""
        change = after.initial - before.initial
        mean = 0.5 * (before.elastic + after.elastic)
        return -float(np.einsum("m,mi,mi->", self._weights, mean, change))

    def _loss_beside(self) -> float:
        """Energy dissipated by contacts since the last call, less what damping has not taken.

        That of contacts is zero unless all bodies are chosen.
        """
        before, self._lost = self._lost, self._lost_beside()
        return self._lost - before

    def _lost_beside(self) -> float:
        withheld = zip(self._system.withheld, self._chosen.nodes, strict=True)
        lost = -sum(float(own @ nodes) for own, nodes in withheld)
        if self.whole:
            lost += sum(contacts.lost for contacts in self._system.contacts)
        return lost

    def _mean_force(self, before: _State, after: _State) -> FloatArray:
        """(r,) mean forces of all rows over a step."""
        if self._system.constraints.mean_forces:
            return after.forces
        rows = self._system.constraints
        entering = rows.entering if rows.split else before.forces
        return 0.5 * (entering + after.forces) + after.impulses

    def _damping(self, before: _State, after: _State) -> FloatArray:
        """(r,) mean forces of dampers over a step."""
        return self._mean_force(before, after) - 0.5 * (before.pulls + after.pulls)

    def _drive(self, before: _State, after: _State, h: float) -> float:
        """Work over a step of drives and of other bodies, by the forces and rates of rows.

        A drive that moves the rest of a spring changes its value by what the bodies do not; where
        it changes the stiffness, too, it changes the energy stored at the same value.
        """
        rate = 0.5 * (before.rates + after.rates)
        work = -h * float(self._mean_force(before, after) @ rate)
        exact = self._over_step
        if self._moves:
            moved = after.values - before.values - 0.5 * h * (before.all_rates + after.all_rates)
            ending = self._moved & ~exact
            work += 0.5 * float(((before.pulls + after.pulls) * ending) @ moved)
            stiff = ending & (before.stiffness > 0.0)
            k0, k1 = before.stiffness[stiff], after.stiffness[stiff]
            at_one = before.sprung[stiff] / k0 + after.sprung[stiff] / k1
            work += 0.5 * float((k1 - k0) @ at_one)
            work += float(self._drive_over_step(before, after, h)[self._moved & exact].sum())
        if before.own_rates.any() or after.own_rates.any():
            own = 0.5 * h * (before.own_rates + after.own_rates)
            work -= float((self._damping(before, after) * (self._springs & ~exact)) @ own)
        return work


@kernel
def work_of_loads(a: FloatArray, b: FloatArray, h: float) -> float:
    """Work over one step of size h (s) of loads in the states ``a`` and ``b``, (k, 12) each.

    Mean forces times displacements, and mean moments times mean rates times the step.
    """
    work = 0.0
    for k in range(len(a)):
        for i in range(3):
            work += 0.5 * (a[k, i] + b[k, i]) * (b[k, 6 + i] - a[k, 6 + i])
            work += 0.25 * h * (a[k, 3 + i] + b[k, 3 + i]) * (a[k, 9 + i] + b[k, 9 + i])
    return work
