# SPDX-License-Identifier: LGPL-3.0-or-later
"""Energy-momentum equations of a step, whose forces do exactly the work of energy changes.

The residuals are momentum balances over the step multiplied by ``h (1 + chi)/2 h``, so that the
iteration matrix is that of Newmark's method, ``M + h^2 (1 + chi)^2/4 K``; multipliers are scaled
likewise. Scheme and proofs: :class:`flexfem.integrators.energy_momentum.scheme.EnergyMomentum`.
"""

from collections.abc import Callable, Mapping
from copy import copy

from mpi4py import MPI

import numpy as np

from flexfem._checks import InputError
from flexfem._types import FloatArray, IntArray
from flexfem.bodies.step_forces import add_step_forces, step_force_tangent
from flexfem.bodies.step_inertia import (
    add_step_inertia,
    lump,
    moved_lumps,
    step_inertia_tangent,
)
from flexfem.contact.barrier.contacts import BarrierContacts
from flexfem.contact.contacts import Contacts
from flexfem.core.nodes.prediction import Misses, Prediction
from flexfem.core.nodes.step_kernels import StepNodes, correct, mean_acceleration, start
from flexfem.core.state import State
from flexfem.integrators.energy_momentum.constraints import StepRows
from flexfem.integrators.split.impulse import Impulse
from flexfem.layout.elements import StepForces, SteppedElements
from flexfem.layout.node_loads import NodeForces
from flexfem.layout.tangent_request import TangentRequest
from flexfem.lie import se3
from flexfem.system.mechanics import Mechanics, SolveAgain
from flexfem.system.moving_apart import Moved, move_apart, predict_apart
from flexfem.system.system import BlockPart, PartStrains, Shifts, System

__all__ = ["StepMechanics", "StepPart"]

#: Factors with which rows are evaluated at a state, not as part of a time step.
_UNSCALED = np.array([1.0, 1.0])


class StepPart:
    """State of one block over the step.

    Attributes:
        state: both ends of the step.
        h: its size, s; chi: numerical dissipation.
        elements: mean forces of the elements; None without elements.
        before: (n, 12) frames at the start of the last step.
        inner: forces inside elements, which are means of both ends.
        lumps: (k, 13) mass, first moment and rotary inertia about the centres of the nodes;
            nodes: (k,).
    """

    def __init__(self, system: System, part: BlockPart, chi: float) -> None:
        """Prepare the mean forces of elements (collective)."""
        block, masses = part.block, part.masses
        count = len(block.frames)
        self.block, self.chi, self.h = block, chi, 0.0
        self.elements: StepForces | None = None
        if part.elements is not None:
            assert isinstance(part.elements, SteppedElements)  # families have been checked
            self.elements = part.elements.step_forces(system.comm, count, chi > 0.0)
        centres = np.zeros((count, 3))
        self.nodes, self.lumps = masses.nodes, lump(masses.matrices)
        self.entries: IntArray = np.arange(len(masses.nodes))
        if self.elements is None:
            self._centre(masses.matrices, centres)
        else:
            centres = self.elements.centres
            self.lumps = moved_lumps(self.lumps, centres[self.nodes])
        self.offset = bool(np.any(self.lumps[:, 1:4])) or (
            self.elements is not None and self.elements.offset
        )
        self.before = block.frames0.copy()
        self.inner = part.line_forces
        self._inner0 = np.zeros((count if self.inner else 0, 6))
        self._memory = 1.0
        self.state = StepNodes(
            frames0=block.frames0, frames=block.frames, increments=block.increment,
            rates0=np.zeros((count, 6)), rates=np.zeros((count, 6)), centres=centres,
            jumps=np.zeros((count, 6)), base=np.zeros((count, 6)), velocity=block.velocity,
            step=block.step, residual=block.residual, gravity=system.gravity, law=np.zeros(3),
        )  # fmt: skip

    def _centre(self, matrices: FloatArray, centres: FloatArray) -> None:
        """Refer the masses of every rigid body to their common centre, written to ``centres``."""
        nodes, self.entries, inverse = np.unique(self.nodes, return_index=True, return_inverse=True)
        total = np.zeros((len(nodes), 6, 6))
        np.add.at(total, inverse, matrices)
        lumps = lump(total)
        centre = lumps[:, 1:4] / lumps[:, :1]
        centres[nodes] = centre
        self.nodes, self.lumps = nodes, moved_lumps(lumps, centre)
        self.lumps[:, 1:4] = 0.0  # except for rounding

    def set_law(self, h: float) -> None:
        """Set the size of the step, s, and the law of its rates."""
        self.h = h
        self.state.law[:] = 0.5 * self.chi, 1.0 / h, 2.0 / (h * (1.0 + self.chi))

    def begin(self, h: float, memory: float) -> None:
        """Rates and their last change from the accepted state.

        A part ``memory`` of this change enters the dissipation.
        """
        block, state, c = self.block, self.state, self.state.centres
        R = block.frames0[:, 3:].reshape(-1, 3, 3)
        v, omega = block.velocity[:, :3], block.velocity[:, 3:]
        w, spin = block.acceleration[:, :3], block.acceleration[:, 3:]
        local = v + np.cross(omega, c)
        state.rates0[:, :3] = np.einsum("nij,nj->ni", R, local)
        state.rates0[:, 3:] = omega
        local = w + np.cross(omega, local) + np.cross(spin, c)
        state.jumps[:, :3] = h * np.einsum("nij,nj->ni", R, local)
        state.jumps[:, 3:] = h * spin
        self.set_law(h)
        self._memory = memory

    def begin_inner(self, factors: FloatArray) -> None:
        """Forces inside the elements at the start, with load factors ``factors``, are kept."""
        block = self.block
        if self.inner:
            block.frames[:], block.residual[:] = block.frames0, 0.0
            for forces in self.inner:
                forces.add_residual(block, factors, 1.0)
            turns = se3.rotation(block.frames0)
            self._inner0[:] = np.einsum(
                "nab,nkb->nka", turns, block.residual.reshape(-1, 2, 3)
            ).reshape(-1, 6)

    def add_inner(self, factors: FloatArray, scale: float) -> None:
        """Add ``scale`` times the forces inside the elements, means of both ends."""
        block = self.block
        if self.inner:
            turns = se3.rotation(block.frames)
            start = np.einsum("nba,nkb->nka", turns, self._inner0.reshape(-1, 2, 3))
            block.residual += 0.5 * scale * start.reshape(-1, 6)
            for forces in self.inner:
                forces.add_residual(block, factors, 0.5 * scale)

    def predict(self, h: float, prediction: Prediction, share: float) -> None:
        """Predict increments as zero, from the rates, or also from their last change.

        A ``share`` of them is taken.
        """
        chi = self.chi
        law = np.array([
            share * h * (prediction >= Prediction.VELOCITY),
            share * 0.5 * h * (prediction >= Prediction.ACCELERATION),
            (chi - 1.0) / (1.0 + chi), self._memory * chi / (1.0 + chi),
        ])  # fmt: skip
        start(self.state.memory, law)

    def exchanged(self) -> "StepPart":
        """The same step from its end to its start: of negative size, with negative dissipation.

        Its mean forces are the same, if the last changes of strains are opposite. Its derivatives
        along the local twists of nodes are hence those by the start of the step, in whose axes its
        forces are, where rates at the start changed with increments.
        """
        other, state = copy(self), self.state
        other.h, other.chi = -self.h, -self.chi
        other.state = StepNodes(
            frames0=state.frames, frames=state.frames0, increments=-state.increments,
            rates0=state.rates, rates=state.rates0, centres=state.centres, jumps=state.jumps,
            base=state.base, velocity=state.velocity, step=state.step, residual=state.residual,
            gravity=state.gravity, law=state.law * (-1.0, -1.0, 1.0),
        )  # fmt: skip
        return other

    def at_end[Found](self, found: Callable[[], Found]) -> Found:
        """What is found with the block at the end of this step, which may be exchanged."""
        block, kept = self.block, self.block.frames.copy()
        block.frames[:] = self.state.frames
        result = found()
        block.frames[:] = kept
        return result

    def inner_loads(self, factors: FloatArray) -> FloatArray:
        """Forces (n_owned, w) inside elements at the end of the step, in its axes (collective)."""
        block = self.block

        def found() -> FloatArray:
            block.residual[:] = 0.0
            for forces in self.inner:
                forces.add_residual(block, factors, 1.0)
            block.add_ghosts()
            return block.owned_residual.copy()

        return self.at_end(found)

    def inner_tangents(self, factors: FloatArray, weight: float) -> list[FloatArray]:
        """``weight`` times the derivatives of these forces, half of which act.

        Those of the change of axes in which forces of the start are counted are left out.
        """
        half = 0.5 * weight
        return self.at_end(lambda: [f.tangent(self.block, factors, half) for f in self.inner])

    def masses(self, count: int, weight: float) -> FloatArray:
        """``weight`` times the derivatives (count, 6, 6) of inertia forces of the part's masses."""
        out, own = np.zeros((count, 6, 6)), np.zeros((len(self.nodes), 6, 6))
        step_inertia_tangent(self.nodes, self.lumps, self.state.memory, self.h, weight, own)
        out[self.entries] = own
        return out

    def forces(self, forces: NodeForces, factors: FloatArray, weight: float) -> FloatArray:
        """The same (k, 6, 6) of forces at nodes with load factors ``factors``."""
        out, own = np.zeros((len(forces.nodes), 6, 6)), forces.wrenches.memory
        step_force_tangent(forces.nodes, own, self.state.memory, factors, weight, out)
        return out

    def third(self) -> float:
        """Largest change of the rates' change over a step."""
        owned, state = slice(0, self.block.owned), self.state
        change = (state.rates - state.rates0 - state.jumps)[owned]
        return float(np.abs(change).max(initial=0.0))

    def correct(self, sign: float) -> float:
        """Move by the local twists ``sign * step``."""
        self.block.spread_step()
        largest: float = correct(self.state.memory, sign)
        return largest

    def accept(self, h: float) -> Misses:
        """Accept the trial state; returns the errors of the predictions."""
        state, block = self.state, self.block
        owned = slice(0, block.owned)
        path = (state.rates - state.base)[owned] / state.law[2]
        plain = path - h * state.rates0[owned]
        curved = plain - 0.5 * h * state.jumps[owned]
        whole, first, second = (float(np.abs(x).max(initial=0.0)) for x in (path, plain, curved))
        mean_acceleration(state.memory, h, block.acceleration)
        self.before[:] = state.frames0
        block.take()
        return whole, first, second


class StepMechanics(Mechanics):
    """Equations of a step between two states; see :class:`flexfem.system.mechanics.Mechanics`.

    Attributes:
        chi: numerical dissipation, 0 for none.
    """

    def __init__(self, system: System, chi: float) -> None:
        """Prepare the data of all blocks (collective).

        Raises:
            InputError: a part of the model has no such equations; named on all ranks.
        """
        self.chi, self.h, self._last_h = chi, 0.0, np.inf
        _check_parts(system, chi)
        self._contacts = [c for c in system.contacts if isinstance(c, BarrierContacts)]
        self._parts = {id(p): StepPart(system, p, chi) for p in system.parts}
        self._check_offsets(system)
        self._rows = StepRows(system.constraints, chi)
        self._factors = system.factors.copy()
        self._impulse: Impulse | None = None

    def _check_offsets(self, system: System) -> None:
        offset = any(p.offset for p in self._parts.values() if p.elements is not None)
        if system.comm.size > 1:
            offset = bool(system.comm.allreduce(int(offset)))
        if offset and self.chi > 0.0:
            raise InputError(
                "EnergyMomentum: a mass on a beam off the mass centres of its sections, and a beam "
                "with a corner, or with sections that vary, and mass centres off its axis, need "
                f"rho_inf 1 (no dissipation), got chi = {self.chi:.6g}"
            )

    def over(self, part: BlockPart) -> StepPart:
        """A part over the present step."""
        return self._parts[id(part)]

    @property
    def rows(self) -> StepRows:
        """Rows over the present step."""
        return self._rows

    @property
    def factors(self) -> FloatArray:
        """Load factors of the present step."""
        return self._factors

    @property
    def weight(self) -> float:
        """Factor of mean forces and of multipliers, s^2."""
        return 0.5 * self.h * self.h * (1.0 + self.chi)

    def begin(self, system: System, h: float, factors: FloatArray) -> None:
        """Start a step of size ``h`` (s) from the accepted state with load factors ``factors``."""
        first, self.h = not np.isfinite(self._last_h), h
        self._factors = factors
        system.interface.update()
        for part in self._parts.values():
            part.begin(h, min(1.0, self._last_h / h))
            part.begin_inner(factors)
            if part.elements is not None and first:
                part.before[:] = se3.retract(part.state.frames0, -h * part.block.velocity)
            self.begin_elements(part)
        self._rows.begin(h, self.weight, self._last_h)
        for contacts in self._contacts:
            contacts.begin_step(h, 2.0 / (1.0 + self.chi), cayley=True)

    def resume(self, system: System, before: Mapping[str, FloatArray], last: float) -> None:
        """Take the accepted state for that after a step of size ``last``, s (collective).

        Args:
            system: with loads and drives at the time of that state.
            before: (n, 12) frames of blocks at the start of that step.
            last: its size; infinite for the start of a motion.
        """
        self._last_h = last
        for part in self._parts.values():
            part.before[:] = part.block.frames[:] = before[part.block.name]
        system.interface.update()
        if np.isfinite(last):
            self._rows.resume(last)
        for part in self._parts.values():
            part.block.frames[:] = part.block.frames0
        system.interface.update()
        self._rows.accept()

    def place(self, increments: Mapping[str, FloatArray]) -> None:
        """Move blocks by increments (n, 6) of the step that has begun."""
        for part in self._parts.values():
            part.predict(self.h, Prediction.REST, 0.0)
            part.state.increments[:] = increments[part.block.name]
            part.block.step[:] = 0.0
            part.correct(1.0)

    def by_last(self, part: StepPart) -> tuple[FloatArray, FloatArray]:
        """See ``StepForces.by_last``; of a part with elements."""
        assert part.elements is not None
        return part.elements.by_last(part.state, part.before, self._part_of_last(), self.weight)

    def begin_elements(self, part: StepPart) -> None:
        """Let elements of a part know the start of the present step, and of the last one."""
        if part.elements is not None:
            part.elements.begin(part.state, part.before, self._part_of_last())

    def _part_of_last(self) -> float:
        """Part of the last changes of strains that enters a step of this size."""
        return min(1.0, self.h / self._last_h) if np.isfinite(self._last_h) else 1.0

    def state(self, system: System) -> State:
        """State carried from one step to the next."""
        blocks = {p.block.name: {"before": self._parts[id(p)].before} for p in system.parts}
        return State({"last_h": np.array([self._last_h])}, {**blocks, "rows": self._rows.state()})

    def restore(self, system: System, state: State) -> None:
        """Restore a result of :meth:`state`, after blocks and rows."""
        self._last_h = float(state.values["last_h"][0])
        for name, values in self._rows.state().items():
            values[:] = state.rows["rows"][name]
        for part in self._parts.values():
            part.before[:] = state.rows[part.block.name]["before"]

    def predict(self, system: System, prediction: Prediction) -> None:
        """Trial state from the accepted one (collective)."""

        def predict(share: float) -> None:
            for part in self._parts.values():
                part.predict(self.h, prediction, share)

        predict_apart(system, predict)

    def error(self, system: System) -> float:
        """Estimated error of the trial state's increments, m or rad (collective)."""
        largest = max((part.third() for part in self._parts.values()), default=0.0)
        if system.comm.size > 1:
            largest = system.comm.allreduce(largest, op=MPI.MAX)
        return (1.0 / 12.0 + 0.5 * self.chi) * self.h * largest

    def accept(self, system: System) -> None:
        """Accept the trial state (collective)."""
        for contacts in system.contacts:
            contacts.evaluate()
        misses = [part.accept(self.h) for part in self._parts.values()]
        rest, plain, curved = (max(each) for each in zip(*misses, strict=True))

        def remember() -> None:
            for own in system.parts:
                if own.elements is not None:
                    own.elements.accept(own.block)
            system.interface.update()

        system.choose_prediction((rest, plain, curved), remember)
        self._rows.accept()
        system.constraints.accept()
        for contacts in self._contacts:
            if contacts.restitutes:
                self._restitute(system, contacts)
            contacts.end_step(1.0)
        self._last_h = self.h

    def _restitute(self, system: System, contacts: BarrierContacts) -> None:
        """Slow down what leaves contacts, in the accepted state (collective)."""
        if self._impulse is None:
            self._impulse = Impulse(system)
        system.constraints.evaluate(_UNSCALED)
        if self._impulse.restitute(contacts, self.h, np.zeros(system.constraints.size)):
            for part in system.parts:
                part.block.spread_step()
                part.block.velocity += part.block.step
                part.block.start()

    def evaluate(self, system: System, shifts: Shifts, strains: PartStrains | None = None) -> None:
        """See :class:`flexfem.system.mechanics.Mechanics`; stresses are means over the step."""
        system.begin_evaluation(shifts.acceleration)
        for part in system.parts:
            mine, block, forces = self._parts[id(part)], part.block, part.forces
            state = mine.state
            block.residual[:] = 0.0
            if mine.elements is not None:
                mine.elements.add_force(state, self.weight)
                mine.add_inner(self._factors, self.weight)
                block.add_ghosts()
            if len(mine.nodes):
                add_step_inertia(mine.nodes, mine.lumps, state.memory, self.h, self.weight)
            if len(forces.nodes):
                add_step_forces(
                    forces.nodes, forces.wrenches.memory, state.memory, self._factors, self.weight
                )
            if part.contacts is not None:
                part.contacts.add_residual(shifts.scale)
        system.interface.update()
        self._rows.evaluate()
        system.add_constraint_forces(system.constraints.multipliers)

    def correct(self, system: System, again: SolveAgain | None) -> Moved:
        """See :class:`flexfem.system.mechanics.Mechanics`."""
        return move_apart(system, lambda: self.move(system, -1.0))

    def move(self, system: System, sign: float) -> float:
        """See :class:`flexfem.system.mechanics.Mechanics`."""
        moves = [self._parts[id(part)].correct(sign) for part in system.parts]
        return float(np.max(moves, initial=0.0))

    def cells(
        self, system: System, part: BlockPart, shifts: Shifts, request: TangentRequest
    ) -> FloatArray:
        """See :class:`flexfem.system.mechanics.Mechanics`; stresses are means over the step."""
        mine = self._parts[id(part)]
        assert mine.elements is not None
        values = mine.elements.tangent(mine.state, self.weight).ravel()
        own = mine.inner_tangents(self._factors, self.weight)
        return np.concatenate([values, *(matrices.ravel() for matrices in own)])

    def add_cells(
        self, system: System, part: BlockPart, shifts: Shifts, request: TangentRequest,
        factor: float,
    ) -> None:  # fmt: skip
        """See :class:`flexfem.system.mechanics.Mechanics`; stresses are means over the step."""
        mine = self._parts[id(part)]
        assert mine.elements is not None
        mine.elements.add_action(mine.state, factor * self.weight)
        for forces in mine.inner:
            forces.add_action(part.block, self._factors, 0.5 * factor * self.weight)

    def masses(self, system: System, part: BlockPart, shifts: Shifts) -> FloatArray:
        """See :class:`flexfem.system.mechanics.Mechanics`."""
        return self._parts[id(part)].masses(len(part.masses.nodes), self.weight)

    def forces(self, system: System, part: BlockPart, shifts: Shifts) -> FloatArray:
        """See :class:`flexfem.system.mechanics.Mechanics`."""
        return self._parts[id(part)].forces(part.forces, self._factors, self.weight)

    def origin(self, system: System, part: BlockPart) -> tuple[dict[str, FloatArray], FloatArray]:
        """See :class:`flexfem.system.mechanics.Mechanics`."""
        mine = self._parts[id(part)]
        names = ("frames0", "frames", "increments", "rates0", "rates")
        nodes = {"before": mine.before, **{name: getattr(mine.state, name) for name in names}}
        return nodes, np.array([self.h, self._last_h, *self._factors])

    def recall(
        self, system: System, part: BlockPart, nodes: Mapping[str, FloatArray], numbers: FloatArray
    ) -> None:
        """See :class:`flexfem.system.mechanics.Mechanics`."""
        mine = self._parts[id(part)]
        for name, values in self.origin(system, part)[0].items():
            values[:] = nodes[name]
        self.h, self._last_h, self._factors = float(numbers[0]), float(numbers[1]), numbers[2:]
        mine.set_law(self.h)
        self.begin_elements(mine)

    def hessians(self, system: System, factor: FloatArray) -> FloatArray:
        """See :class:`flexfem.system.mechanics.Mechanics`."""
        return self._rows.hessians(factor)


def _check_parts(system: System, chi: float) -> None:
    """Raise on all ranks for parts without discrete derivatives along a step.

    The guide's page on limits has the reasons. Families say so themselves; rows are checked by
    :mod:`flexfem.integrators.energy_momentum.constraints`.
    """
    for contacts in system.contacts:
        if isinstance(contacts, Contacts):
            name = contacts.groups[0].surfaces.contact.name
            raise InputError(
                f'Contact "{name}": the integrator energy_momentum does not support the penalty'
            )
    if system.modal_dampers is not None:
        raise InputError(
            f"{system.modal_dampers.owner}: "
            "the integrator energy_momentum does not support damping of modes"
        )
    for part in system.parts:
        part.family.check_energy_momentum(chi > 0.0)
        if part.elements is not None and part.elements.law_owner is not None:
            raise InputError(
                f"{part.elements.law_owner}: the integrator energy_momentum needs a linear section"
            )
