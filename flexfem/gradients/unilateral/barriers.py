# SPDX-License-Identifier: LGPL-3.0-or-later
"""Derivatives of the barriers of contacts in the equations of a step."""

from __future__ import annotations

import numpy as np

from flexfem._types import FloatArray
from flexfem.contact.barrier.contacts import BarrierContacts
from flexfem.gradients.equations.unilateral import StateChange, StateFactors
from flexfem.gradients.unilateral.cayley_points import CayleyPoints
from flexfem.gradients.unilateral.group_forces import (
    AFTER,
    BEFORE,
    RATES,
    SPIN_RATES,
    SPINS,
    Entries,
    GroupDerivatives,
)
from flexfem.gradients.unilateral.point_maps import END, START, NodePoints
from flexfem.gradients.unilateral.tilts import TiltDerivatives
from flexfem.system.system import Shifts, System

__all__ = ["Barriers"]


class Barriers:
    """Derivatives of the forces of barriers; see ``equations.unilateral.Unilateral``."""

    def __init__(self, system: System, contacts: BarrierContacts) -> None:
        """Store the contacts of a system, whose forces act over the steps."""
        self._system, self._contacts = system, contacts
        self._blocks = {
            part.kind: part.block for part in system.parts if part.kind in contacts.kinds
        }
        self._points: dict[int, NodePoints] = {}
        self._turning: dict[int, FloatArray] = {}
        self._matrices: dict[str, list[Entries]] = {}
        self._scale = 0.0
        # of couples on points without rotations, over the step, and of spins at its start
        self._tilts: TiltDerivatives | None = None
        self._tilts_before: TiltDerivatives | None = None
        self._couples = np.zeros((0, 3))

    def take(self, shifts: Shifts) -> None:
        """See ``Unilateral``."""
        contacts, carriers = self._contacts, self._contacts.carriers
        self._scale = -shifts.scale * contacts.factor
        kind = CayleyPoints if contacts.cayley else NodePoints
        self._points = {number: kind.of(one) for number, one in carriers.by_kind.items()}
        self._matrices = {}
        sums, couples = np.zeros((2, len(carriers.home), 3))
        for pairs in contacts.every:
            pairs.add_forces(1.0, sums, couples)
            for name, matrix in GroupDerivatives(pairs).matrices.items():
                self._matrices.setdefault(name, []).append(matrix)
        for values in (sums, couples):
            carriers.gather(values)
        self._couples = couples
        self._take_tilts()
        self._turning = {
            kind: own.turning(sums[own.carried.rows], couples[own.carried.rows])
            for kind, own in self._points.items()
        }

    def _take_tilts(self) -> None:
        """Tilts at the middle of the step and at its start, if there are any."""
        spins, carriers = self._contacts.spins, self._contacts.carriers
        self._tilts = self._tilts_before = None
        if len(spins.triangles):
            here = np.zeros(len(carriers.home), dtype=np.bool_)
            here[carriers.here] = True
            before, after = spins.motion.before, spins.motion.after
            self._tilts = TiltDerivatives(spins.triangles, here, 0.5 * (before + after))
            self._tilts_before = TiltDerivatives(spins.triangles, here, before)

    @property
    def _steps(self) -> FloatArray:
        """Steps (n, 3) of the points."""
        return self._contacts.spins.motion.after - self._contacts.spins.motion.before

    # -- Forwards -------------------------------------------------------------------------------

    def add(self) -> None:
        """See ``Unilateral``."""
        twists = {kind: block.step for kind, block in self._blocks.items()}
        moves = self._motions(twists, END)
        self._add_changes({AFTER: moves, SPINS: self._spins(twists, END, moves)})
        self._turn(twists, END)

    def add_start(self, change: StateChange) -> FloatArray:
        """See ``Unilateral``."""
        twists = self._of_kinds(change.twists)
        rates = [np.zeros((len(self._contacts.carriers.home), 3)) for _ in range(2)]
        if self._contacts.rubs:
            for kind, own in self._points.items():
                at = own.carried.rows
                rates[0][at], rates[1][at] = own.rates(
                    twists[kind], self._of_kinds(change.rates)[kind]
                )
            self._contacts.carriers.share(rates[0])
        moves = self._motions(twists, START)
        if (tilts := self._tilts_before) is not None:
            present = self._contacts.spins.motion.rates
            rates[1] += tilts.spins(rates[0]) + tilts.spin_changes(present, moves)
        self._contacts.carriers.share(rates[1])
        self._add_changes({
            BEFORE: moves, SPINS: self._spins(twists, START, moves),
            RATES: rates[0], SPIN_RATES: rates[1],
        })  # fmt: skip
        self._turn(twists, START)
        return np.zeros(self._system.constraints.size)

    def _of_kinds(self, every: list[FloatArray]) -> dict[int, FloatArray]:
        """Vectors (n_owned, w) of all blocks as (n_owned, 6) of those with points, by kind."""
        found = {}
        for part, own in zip(self._system.parts, every, strict=True):
            if part.kind in self._blocks:
                found[part.kind] = np.zeros((len(own), 6))
                found[part.kind][:, : own.shape[1]] = own
        return found

    def _motions(self, twists: dict[int, FloatArray], end: int) -> FloatArray:
        """Motions (n, 3) of the points here and nearby (collective)."""
        found = np.zeros((len(self._contacts.carriers.home), 3))
        for kind, own in self._points.items():
            found[own.carried.rows] = own.motions(twists[kind], end)
        self._contacts.carriers.share(found)
        return found

    def _spins(self, twists: dict[int, FloatArray], end: int, moves: FloatArray) -> FloatArray:
        """Changes (n, 3) of their spins as they move, zero without friction (collective)."""
        found = np.zeros((len(self._contacts.carriers.home), 3))
        if self._contacts.rubs:
            for kind, own in self._points.items():
                found[own.carried.rows] = own.spins(twists[kind], end)
            if self._tilts is not None:
                sign = 1.0 if end == END else -1.0
                found += self._tilts.spins(sign * moves)
                found += self._tilts.spin_changes(self._steps, 0.5 * moves)
            self._contacts.carriers.share(found)
        return found

    def _add_changes(self, motions: dict[str, FloatArray]) -> None:
        """Add the changes of forces by motions of points to the residuals (collective)."""
        changes = np.zeros((len(self._contacts.carriers.home), 6))
        for name, motion in motions.items():
            for matrix in self._matrices.get(name, ()):
                changes += matrix.apply(motion)
        forces, couples = (self._scale * np.ascontiguousarray(x) for x in np.hsplit(changes, 2))
        self._contacts.carriers.gather(couples)
        if self._tilts is not None:
            moves = motions[AFTER] if AFTER in motions else motions[BEFORE]
            forces += self._tilts.forces(couples)
            forces += self._tilts.force_changes(self._scale * self._couples, 0.5 * moves)
        self._contacts.carriers.gather(forces)
        for kind, own in self._points.items():
            at = own.carried.rows
            own.add_loads(forces[at], couples[at], self._blocks[kind].residual)

    def _turn(self, twists: dict[int, FloatArray], end: int) -> None:
        """Add the changes of the loads as nodes turn."""
        for kind, turning in self._turning.items():
            local = self._points[kind].carried.local
            loads = np.einsum("kij,kj->ki", turning[end], twists[kind][local, 3:])
            np.add.at(self._blocks[kind].residual, local, self._scale * loads)

    # -- Transposed -----------------------------------------------------------------------------

    def add_transposed(self) -> None:
        """See ``Unilateral``."""
        factors = self._factors({kind: block.step for kind, block in self._blocks.items()})
        for kind, block in self._blocks.items():
            self._add_back(kind, factors, END, block.step, block.residual)

    def start_transposed(self, z: list[FloatArray], mu: FloatArray) -> StateFactors:
        """See ``Unilateral``."""
        own_z = self._of_kinds(z)
        factors = self._factors(own_z)
        twists = [np.zeros((len(one), 6)) for one in z]
        rates = [np.zeros((len(one), 6)) for one in z]
        for part, out, out_rates in zip(self._system.parts, twists, rates, strict=True):
            if part.kind not in self._blocks:
                continue
            self._add_back(part.kind, factors, START, own_z[part.kind], out)
            if self._contacts.rubs:
                own = self._points[part.kind]
                at = own.carried.rows
                own.add_rates(factors[RATES][at], factors[SPIN_RATES][at], out, out_rates)
        widths = [one.shape[1] for one in z]
        return StateFactors(
            *([one[:, :w] for one, w in zip(own, widths, strict=True)] for own in (twists, rates))
        )

    def _factors(self, twists: dict[int, FloatArray]) -> dict[str, FloatArray]:
        """Factors (n, 3) of all motions of points by those (n, 6) of nodes' loads (collective)."""
        carriers = self._contacts.carriers
        ways, turns = np.zeros((2, len(carriers.home), 3))
        for kind, own in self._points.items():
            at = own.carried.rows
            ways[at], turns[at] = own.ways(twists[kind])
        carriers.share(ways)
        if self._tilts is not None:
            turns += self._tilts.spins(ways)
        carriers.share(turns)
        every, found = self._scale * np.concatenate([ways, turns], axis=1), {}
        for name in (SPINS, SPIN_RATES, AFTER, BEFORE, RATES):
            found[name] = np.zeros(ways.shape)
            for matrix in self._matrices.get(name, ()):
                found[name] += matrix.apply_transposed(every)
        for name in (SPINS, SPIN_RATES):
            carriers.gather(found[name])
        self._add_tilts(found, self._scale * ways)
        for name in (AFTER, BEFORE, RATES):
            carriers.gather(found[name])
        return found

    def _add_tilts(self, factors: dict[str, FloatArray], ways: FloatArray) -> None:
        """Add the factors of motions by those of spins, and of forces of couples (n, 3)."""
        if self._tilts is None or self._tilts_before is None:
            return
        spins, rates = factors[SPINS], factors[SPIN_RATES]
        moved = self._tilts.gradient(spins, self._steps)
        moved += self._tilts.gradient(self._couples, ways)
        turned = self._tilts.forces(spins)
        factors[AFTER] += 0.5 * moved + turned
        factors[BEFORE] += 0.5 * moved - turned
        factors[BEFORE] += self._tilts_before.gradient(rates, self._contacts.spins.motion.rates)
        factors[RATES] += self._tilts_before.forces(rates)

    def _add_back(
        self, kind: int, factors: dict[str, FloatArray], end: int, twists: FloatArray,
        out: FloatArray,
    ) -> None:  # fmt: skip
        """Add the factors of the twists (n, 6) of the nodes of a block at one end."""
        own, name = self._points[kind], AFTER if end == END else BEFORE
        at, local = own.carried.rows, own.carried.local
        own.add_forces(factors[name][at], end, out)
        if self._contacts.rubs:
            own.add_couples(factors[SPINS][at], end, out)
        turned = np.einsum("kij,ki->kj", self._turning[kind][end], twists[local])
        np.add.at(out[:, 3:], local, self._scale * turned)
