# SPDX-License-Identifier: LGPL-3.0-or-later
"""What the start of a motion and its equations depend on parameters.

Both are differentiated by central differences between two models that differ in one parameter: at a
fixed state, one step after the other, not between two motions. What is linear in a parameter is
exact. Where nodes move, forces of bodies are small differences of what is rounded, and four models
farther away give more digits, if nothing has a kink between them. They are needed where a mesh
generator places nodes to a tolerance: the start and the equations must then tell the same motion of
the nodes. Forces of contacts, which are as steep as gaps are small, are differences of their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import Protocol

from mpi4py import MPI

import numpy as np

from flexfem._checks import InputError
from flexfem._faults import FAILURES
from flexfem._types import FloatArray, IntArray
from flexfem.core.differences import STENCIL, differenced
from flexfem.core.status import Status
from flexfem.gradients.equations.carried import Carried
from flexfem.gradients.equations.node_maps import twists
from flexfem.gradients.equations.step_tangent import BlockVectors
from flexfem.gradients.equations.values import (
    Equations,
    SystemEquations,
    contact_forces,
    copy_state,
    equations_at,
    jump,
    product,
    row_directions,
    rows_turn,
)
from flexfem.gradients.motion.columns import Seeds
from flexfem.gradients.motion.direct import DirectEffect, force_columns, take_rows
from flexfem.gradients.motion.parameters import Build, Values, plain, refusing
from flexfem.gradients.motion.support import (
    check_alike,
    check_fixed,
    check_layout,
    check_times,
)
from flexfem.gradients.motion.trajectory import Motion, StoppedError
from flexfem.gradients.unilateral.forces import leave_out_contacts, recall_penalties
from flexfem.simulation.motion.stepping import Simulation
from flexfem.system.measure.energies import refresh_rows
from flexfem.system.system import Shifts, System

__all__ = [
    "STEP", "UNSCALED", "Factors", "Influence", "NumberInfluence", "Sums", "beside",
    "difference_of", "evaluated", "own_equations",
    "start_by_blocks", "start_of",
]  # fmt: skip

#: Difference of a parameter, relative to it, or itself for one that is zero.
STEP = 1e-5
#: The same of forces of drives, whose accelerations are differences over parts of a step: those
#: divided by a smaller one are rounding.
_FAR = 1e-3
#: The same with contacts, stops and what goes slack, whose forces change within a small part of the
#: sizes of bodies.
_CLOSE = 3e-7
#: The same of nodes that move: rounding of positions, divided by a short difference, opens joints,
#: and moves small rotary inertia by accelerations above those of the change itself.
_LONG = 1e-3
#: Squared error of second order over size, an estimate of that of fourth order, over what the
#: length changes, up to which long differences are better than short ones.
_BETTER = 0.5
#: Part of the equations' changes that rounding is, with short differences: what differs more from
#: long ones has a kink within their length.
_SMOOTH = 1e-6
#: Second differences of the equations over first ones, from which on they are no smooth functions
#: of a parameter.
_ROUGH = 3e-3
#: Differences of fourth order from those of second order, relative to these or to what short ones
#: are off by, up to which long ones are taken where short ones cannot be.
_BENT, _LESS = 1e-4, 0.1
#: Relative difference between motions of nodes by short and by long differences from which on a
#: mesh has noise: gmsh places nodes of circles to 1e-9 rad. Rounding is 1e-9 at most.
_NOISE = 1e-7
#: Differences of a parameter for forces of contacts alone, the longest first, and the relative
#: difference between second and fourth order up to which they suit; errors are its square.
_CONTACTS, _SUITS = (1e-5, 1e-6, 1e-7, 1e-8), 3e-5

#: Places of two models, and of four.
_PAIR, _PLACES = (1.0, -1.0), [place for place, _ in STENCIL]
#: Rows of :func:`start_of` that forces do not change: moves and velocities.
_RATES = 2

#: Equations without scale.
UNSCALED = Shifts(velocity=0.0, acceleration=0.0, scale=1.0)

#: Factors of the equations of blocks, of rows (r,) and of the memories' numbers (n,).
Factors = tuple[BlockVectors, FloatArray, FloatArray]
#: Sums for each block, of the memories' numbers (n,), and of forces of rows (r,).
Sums = tuple[list[Carried], FloatArray, FloatArray]


class Influence(Protocol):
    """What a parameter, or an array of them, changes.

    Attributes:
        count: number of parameters.
    """

    count: int

    def products(self, step: int, factors: Sequence[Factors]) -> FloatArray:
        """This rank's part of factors times derivatives of the equations at a step's end.

        The system of the motion is at the step's trial state (collective).

        Returns:
            (factors, count).
        """
        ...

    def start_products(self, carried: Sequence[Sums]) -> FloatArray:
        """The same of sums for each block times derivatives of the start.

        The system of the motion is at its start (collective).
        """
        ...

    def event_changes(self, state: int) -> FloatArray:
        """Derivatives (count,) of the function of the event at a state, where the system is.

        They are the same on all ranks (collective).
        """
        ...

    def direct_products(self, step: int, weights: FloatArray, seeds: Sequence[Seeds]) -> FloatArray:
        """This rank's part of weights times derivatives of all columns at a fixed state.

        The system of the motion is at the accepted state after a step (collective).

        Args:
            step: its number.
            weights: (k, columns).
            seeds: of the weighted columns.

        Returns:
            (k, count).
        """
        ...


class NumberInfluence:
    """What one number changes: two models.

    Attributes:
        start: derivatives of the start, for each block.
        numbers: (n,) those of the memories' numbers there; forces: (r,) those of rows.
        scale: size of the parameter, 1 if it is zero.
    """

    count = 1

    def __init__(
        self, motion: Motion, build: Build, values: Values, name: str,
        entry: int | IntArray | None = None,
    ) -> None:  # fmt: skip
        """Build both models (collective).

        Args:
            motion: the motion.
            build: a model of all values.
            values: of all parameters.
            name: of this one.
            entry: number of the entry of an array, or of several that change together.

        Raises:
            InputError: the model does not exist at one of the values, or has another layout there.
            StoppedError: it does not start there.
        """
        self._motion = motion
        self._name = f"{name}[{entry}]" if isinstance(entry, int) else name
        at = () if entry is None else entry
        whole = difference_of(values[name][at])
        self.scale = whole / STEP
        touching, rows = bool(motion.system.contacts), motion.system.constraints
        self._step = _CLOSE * self.scale if touching or rows.has_unilateral else whole

        def changed(by: float) -> Simulation:
            """Start of the model with the parameter changed (collective)."""
            moved: FloatArray = np.array(values[name])
            moved[at] += by
            found = beside(motion, build, {**values, name: moved}, name)
            motion.scheme.begin(found)
            return found

        self._changed = changed
        self._pair = self._models(_PAIR, self._step)
        # later the models are at other states
        for other in self._pair:
            check_fixed(motion.system, other.system, self._name)
        #: Models farther away, where nodes move and these exist; with contacts, two without their
        #: forces, and those of contacts by the length of their differences.
        self._far, self._bodies, self._noise = list[Simulation](), list[Simulation](), False
        self._contacts: dict[float, list[Simulation]] = {}
        self.start = self._start()
        self._length = self._step if rows.has_unilateral else whole
        if touching:
            self._bodies = self._models(_PAIR, self._length)
            for one in (*self._far, *self._bodies):
                leave_out_contacts(one.system)
        first, second = (motion.memories.start(one) for one in self._pair)
        self.numbers = (first - second) / (2.0 * self._step)
        self._direct = self._columns_of()
        # what sticks leaves more of rounding than equations change
        self._checked = any(contacts.rubs for contacts in motion.system.contacts)

    def _models(self, places: Sequence[float], step: float) -> list[Simulation]:
        """Models with the parameter changed by parts of a step (collective)."""
        return [self._changed(place * step) for place in places]

    def _start(self) -> list[Carried]:
        """Differences between the two models, or of fourth order over a longer way (collective)."""
        motion, rows = self._motion, self._motion.system.constraints
        first, second = (start_of(motion, one) for one in self._pair)
        short = (first - second) / (2.0 * self._step)
        if not any(motion.largest(short[0])):
            return start_by_blocks(motion, short)
        step, far = _LONG * self.scale, list[Simulation]()
        with suppress(*FAILURES):  # the model may not exist so far away
            far = self._models(_PLACES, step)
        if not far:
            return start_by_blocks(motion, short)
        long, lower = _orders([start_of(motion, one) for one in far], step)
        by_length, size = motion.largest(long[0] - short[0], long[0])
        self._noise = by_length > _NOISE * size
        if not (rows.has_unilateral or motion.remembering):
            self._far = far
        elif self._noise:  # the equations know the motion of the nodes from short differences
            return start_by_blocks(motion, short)
        for k in range(_RATES if self._pressed() else len(short)):
            by_order, by_length, size = motion.largest(
                long[k] - lower[k], long[k] - short[k], long[k]
            )
            if by_order**2 <= _BETTER * by_length * size:
                short[k] = long[k]
        return start_by_blocks(motion, short)

    def _pressed(self) -> bool:
        """True if contacts act at the start, whose accelerations they change (collective)."""
        closed = [one.closed for near in self._pair for one in near.system.contacts]
        return bool(self._motion.system.comm.allreduce(any(closed), op=MPI.LOR))

    def _columns_of(self) -> DirectEffect:
        """Columns at a fixed state; models farther away show forces of drives (collective)."""
        motion, simulations, step = self._motion, self._pair, self._step
        weights = [0.5 / step, -0.5 / step]
        driven = motion.system.comm.allreduce(motion.system.constraints.driven, op=MPI.LOR)
        if driven and force_columns(motion.simulation, motion.wanted):
            step = _FAR * self.scale
            simulations = self._models(_PLACES, step)
        elif self._noise and self._far and not motion.system.contacts:
            step, simulations = _LONG * self.scale, self._far
        if len(simulations) > len(weights):
            weights = [weight / step for _, weight in STENCIL]
        self.forces = differenced(weights, [one.system.constraints.forces for one in simulations])
        return DirectEffect(motion, simulations, weights)

    def equations(self, step: int) -> Factors:
        """Derivatives of the equations of blocks, rows and memories at a step's end (collective).

        Args:
            step: number of the step, at whose trial state the system of the motion is.

        Raises:
            InputError: they are no smooth functions of the parameter.
        """
        motion, own = self._motion, np.zeros(len(self._motion.measured))
        if motion.measured and self._direct.present and motion.follows(step):
            own = 2.0 * self._step * self._direct.difference(step, following=False)
            own = own[[motion.columns.index(c) for c in motion.measured]]
        found, numbers = [], []
        for one, sign in zip(self._pair, (1.0, -1.0), strict=True):
            found.append(evaluated(motion, one, step))
            follows = motion.remembering and motion.between is motion.renewal
            if follows and motion.follows(step):
                numbers.append(motion.memories.moved(one, motion.end(step), 0.5 * sign * own))
            else:  # they do not change
                numbers.append(np.zeros(len(motion.memories.owned)))
        first, second = found
        if not self._checked and motion.between is None:
            self._check_smooth(first, second, step)
        whole = 2.0 * self._step
        changes = (numbers[0] - numbers[1]) / whole
        if motion.between is None and motion.system.contacts:
            first, second = (evaluated(motion, one, step) for one in self._bodies)
            near = _difference(first, second, 2.0 * self._length)
            blocks, rows = self._better(step, near)
            of_contacts = self._of_contacts(step)
            return [a + b for a, b in zip(blocks, of_contacts, strict=True)], rows, changes
        blocks, rows = _difference(first, second, whole)
        if motion.between is None:
            blocks, rows = self._better(step, (blocks, rows))
        return blocks, rows, changes

    def _better(self, step: int, near: Equations) -> Equations:
        """Differences of fourth order over a longer way, if they are better (collective).

        Args:
            step: number of the step.
            near: differences over a short way.

        Raises:
            InputError: they have a kink, and shorter ones have noise.
        """
        if not self._far:
            return near
        every = [near, *(evaluated(self._motion, one, step) for one in self._far)]
        better = [
            self._longer(own, found)
            for own, *found in zip(*([*one[0], one[1]] for one in every), strict=True)
        ]
        return better[:-1], better[-1]

    def _longer(self, short: FloatArray, values: Sequence[FloatArray]) -> FloatArray:
        """Differences over a longer way, from four values, or short ones if these are better."""
        length = _LONG * self.scale
        long, lower = _orders(values, length)
        by_order, by_length, size = self._motion.largest(long - lower, long - short, long)
        if self._noise:
            if by_order > max(_BENT * size, _LESS * by_length):
                raise InputError(
                    f'gradient: the equations have a kink where "{self._name}" changes by '
                    f"{length:.2g}, and its mesh has noise that shorter changes would show"
                )
            return long
        smooth = by_length <= _SMOOTH * size and by_order**2 <= _BETTER * by_length * size
        return long if smooth else short

    def _of_contacts(self, step: int) -> BlockVectors:
        """Derivatives of the forces of contacts, by the longest differences that suit them.

        They are the same from whichever step one comes (collective).
        """
        best, least = list[FloatArray](), np.inf
        for length in _CONTACTS:
            size = length * self.scale
            if length not in self._contacts:
                self._contacts[length] = []
                with suppress(*FAILURES):  # models may not exist so far away
                    self._contacts[length] = self._models(_PLACES, size)
            if not (models := self._contacts[length]):
                continue
            found = [contacts_evaluated(self._motion, one, step) for one in models]
            orders = [_orders(own, size) for own in zip(*found, strict=True)]
            off = [self._motion.largest(long - lower, long) for long, lower in orders]
            missed = max(own[0] for own in off) / (max(own[1] for own in off) or 1.0)
            if missed < least:
                best, least = [long for long, _ in orders], missed
            if missed <= _SUITS:
                break
        return best

    def _check_smooth(self, first: Equations, second: Equations, step: int) -> None:
        """Refuse equations that jump with the parameter, as those with other modes (collective)."""
        self._checked = True
        system = self._motion.system
        owned = system.constraints.owned
        shifts = self._motion.scheme.shifts(step)
        still = equations_at(system, shifts, self._motion.scheme.mechanics(step))
        blocks = [np.concatenate([x.ravel() for x in one[0]]) for one in (second, first, still)]
        rows = [owned * one[1] for one in (second, first, still)]
        plus, minus = (row_directions(one.system) for one in self._pair)
        turned = rows_turn(system.comm, (minus, plus), row_directions(system), _ROUGH)
        if turned or any(jump(system.comm, (a, b), c, _ROUGH) for a, b, c in (blocks, rows)):
            raise InputError(
                f'gradient: the equations jump where "{self._name}" changes by '
                f"{self._step:.2g}, and have no derivative"
            )

    def event_changes(self, state: int) -> FloatArray:
        """See :class:`Influence`."""
        motion, values = self._motion, []
        number = motion.grid.events[state]
        for one in self._pair:
            copy_state(motion.system, one.system)
            take_rows(motion, one.system, state)
            one.system.interface.update()
            refresh_rows(one.system)  # and sliders' places
            values.append(float(one.events.evaluate()[number]))
        return np.array([(values[0] - values[1]) / (2.0 * self._step)])

    def products(self, step: int, factors: Sequence[Factors]) -> FloatArray:
        """See :class:`Influence`."""
        blocks, rows, numbers = self.equations(step)
        system, counted = self._motion.system, self._motion.memories.owned * numbers
        return np.array(
            [
                [product(system, (z, mu), (blocks, rows)) + float(own @ counted)]
                for z, mu, own in factors
            ]
        )

    def start_products(self, carried: Sequence[Sums]) -> FloatArray:
        """See :class:`Influence`."""
        numbers = self._motion.memories.owned * self.numbers
        forces = self._motion.system.constraints.owned * self.forces
        return np.array(
            [
                [
                    sum(a.product(b) for a, b in zip(own, self.start, strict=True))
                    + float(remembered @ numbers)
                    + float(by_forces @ forces)
                ]
                for own, remembered, by_forces in carried
            ]
        )

    def direct_products(self, step: int, weights: FloatArray, seeds: Sequence[Seeds]) -> FloatArray:
        """See :class:`Influence`."""
        if not self._direct.present:
            return np.zeros((len(weights), 1))
        found = weights @ self.columns(step)[:, np.newaxis]
        found[:, 0] -= [self.followed(step, own) for own in seeds]
        return found

    def followed(self, step: int, seeds: Seeds) -> float:
        """This rank's part of the change of a column by nodes that follow their starts.

        It is to be subtracted from those of :meth:`columns`.

        Args:
            step: number of the step, the same for all.
            seeds: of the column.
        """
        del step
        return sum(
            float((own.twists * following[own.nodes]).sum())
            for own, following in zip(seeds.blocks, self._direct.following, strict=True)
        )

    @property
    def depends_directly(self) -> bool:
        """True if columns depend on the parameter at a fixed state."""
        return self._direct.present

    def columns(self, step: int) -> FloatArray:
        """Derivatives (columns,) of all columns, on the first rank (collective).

        The state is fixed but for nodes whose start moves with the parameter, which follow it, see
        :meth:`followed`. They are zero on the other ranks.
        """
        return self._direct.difference(step)


def _difference(first: Equations, second: Equations, whole: float) -> Equations:
    """First values minus second ones over the change of the parameter between them."""
    blocks = [(a - b) / whole for a, b in zip(first[0], second[0], strict=True)]
    return blocks, (first[1] - second[1]) / whole


def _orders(values: Sequence[FloatArray], step: float) -> tuple[FloatArray, FloatArray]:
    """Differences of fourth and of second order of values at the places of a stencil."""
    fourth = differenced([weight / step for _, weight in STENCIL], values)
    return fourth, (values[2] - values[1]) / (2.0 * step)


def start_of(motion: Motion, other: Simulation) -> FloatArray:
    """(4, n) moves of another model from the motion's start, and rates, of all owned nodes."""
    found = []
    for part, own_part in zip(motion.system.parts, other.system.parts, strict=True):
        first, state = motion.state(0).rows[part.block.name], own_part.block.state()
        own = np.s_[: part.block.owned, : part.block.width]
        moves = twists(first["frames"], state["frames"], inertial=part.block.inertial)
        rates = [state[name] for name in ("velocity", "auxiliary", "acceleration")]
        found.append(np.stack([each[own].ravel() for each in (moves, *rates)]))
    return np.concatenate(found, axis=1)


def start_by_blocks(motion: Motion, derivatives: FloatArray) -> list[Carried]:
    """Derivatives of :func:`start_of` for each block, without moves of what is fixed."""
    carried, begins = [], 0
    for part in motion.system.parts:
        shape = part.block.owned, part.block.width
        ends = begins + part.block.owned * part.block.width
        moves, *rates = (own[begins:ends].reshape(shape) for own in derivatives)
        carried.append(Carried(part.block.hold(moves), *rates))
        begins = ends
    return carried


def difference_of(values: FloatArray) -> float:
    """Difference of a number, or of several that change together."""
    return STEP * (float(np.abs(values).max()) or 1.0)


def beside(motion: Motion, build: Build, values: Values, name: str) -> Simulation:
    """Start of a model of other values of one parameter (collective).

    Raises:
        InputError: the model does not exist at one of the values, or has another layout there.
        StoppedError: it does not start there.
    """
    with refusing(name):
        one = Simulation(build(**plain(values)), motion.options, motion.system.comm)
    if one.status is not Status.OK:
        raise StoppedError(f'gradient: the motion with another "{name}" does not start')
    check_alike(motion.model, one.serial.model, name)
    check_layout(motion.system, one.system, name)
    check_times(motion.simulation.breakpoints, one.breakpoints, name)
    return one


def evaluated(
    motion: Motion, other: Simulation, step: int, between: SystemEquations | None = None
) -> Equations:
    """Residuals of another model at the trial state of the motion, after a step, or at the start.

    Those of the start are not scaled (collective).

    Args:
        motion: the motion.
        other: the model.
        step: number of the step.
        between: equations that are not those of the step; None for those of the motion, if any.
    """
    between = between or motion.between
    system = other.system
    _place(motion, system, step)
    if between is not None:
        motion.memories.recall(other, step)
        system.set_time(motion.times[step])
        copy_state(motion.system, system)
        return between.equations(system, motion.restitution(other, step))
    if not step:
        system.set_time(motion.times[step])
        copy_state(motion.system, system)
        return equations_at(system, UNSCALED)
    mechanics = motion.scheme.beside(other, step)
    blocks, values = equations_at(system, motion.scheme.shifts(step), mechanics)
    # equations of force elements are scaled by the derivatives in use
    rows, own = system.constraints, motion.system.constraints
    scaled = rows.of_elements
    values[scaled] *= own.compliance[scaled] / rows.compliance[scaled]
    return blocks, values


def contacts_evaluated(motion: Motion, other: Simulation, step: int) -> BlockVectors:
    """The part of contacts in :func:`evaluated` after a step (collective)."""
    _place(motion, other.system, step)
    motion.scheme.beside(other, step)
    return contact_forces(other.system, motion.scheme.shifts(step))


def _place(motion: Motion, system: System, step: int) -> None:
    """Give another model what the motion's state before a step is, save its rows' targets."""
    state = motion.state(max(step - 1, 0))
    for part in system.parts:
        accepted = state.rows[part.block.name]
        if motion.scheme.from_start:  # what is carried, or acts over the step, does so from there
            part.block.restore(accepted)
            continue
        for name, values in part.block.state().items():
            values[:] = accepted[name]
    # of the rows what a motion changes, and not their targets, which are the other model's own
    rows = system.constraints
    rows.angles[:] = state.rows["terms"]["angles"]
    rows.lines.restore_places(state.rows["places"]["places"])
    rows.lines.angles[:] = state.rows["line_terms"]["line_angles"]
    own = motion.system.constraints  # events may have changed these
    rows.active[:], rows.held[:] = own.active, own.held
    rows.targets[own.held] = own.targets[own.held]
    system.interface.update()
    recall_penalties(motion.system, system, state)
    system.lead = motion.system.lead


def own_equations(motion: Motion, step: int) -> Equations:
    """Residuals of the motion itself, as those of :func:`evaluated`; computed once (collective)."""
    if motion.equations is None:
        motion.equations = evaluated(motion, motion.simulation, step)
    return motion.equations
