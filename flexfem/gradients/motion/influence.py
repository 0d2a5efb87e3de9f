# SPDX-License-Identifier: LGPL-3.0-or-later
"""What the start of a motion and its equations depend on parameters.

Both are differentiated by central differences between two models that differ in one parameter: at a
fixed state, one step after the other, not between two motions. What is linear in a parameter is
exact.

An array of parameters that act on elements each, as the sections of a beam do, takes a few models
for all of them. Parameters with numbers that are equal modulo a small one are changed together, so
that each equation changes by one of them alone (Curtis, Powell, Reid, J. Inst. Math. Appl. 13
(1974) 117-119). By which one, is known from models in which each changes by a part that is a digit
of its number. Other arrays are in ``arrays.py``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from mpi4py import MPI

import numpy as np

from flexfem._checks import InputError
from flexfem._types import FloatArray, IntArray
from flexfem.core.status import Status
from flexfem.gradients.equations.carried import CARRIED, Carried
from flexfem.gradients.equations.node_maps import RateMaps, applied, twists
from flexfem.gradients.equations.step_tangent import BlockVectors
from flexfem.gradients.equations.values import Equations, equations_at, jump
from flexfem.gradients.motion.direct import DirectEffect, copy_state, disturb
from flexfem.gradients.motion.parameters import Build, Values, plain
from flexfem.gradients.motion.trajectory import Motion, StoppedError
from flexfem.model.model import Model
from flexfem.simulation.motion.stepping import Simulation
from flexfem.simulation.run.setup import set_up
from flexfem.system.system import MASS, Shifts, System

__all__ = [
    "ElementInfluence", "Factors", "Influence", "NumberInfluence", "Owners", "Sums",
    "beside", "check_layout", "difference_of", "element_owners", "evaluated",
]  # fmt: skip

#: Difference of a parameter, relative to it, or itself for one that is zero.
_STEP = 1e-5
#: Largest number of groups of an array's parameters.
_GROUPS = 4
#: Base of the digits of their numbers.
_BASE = 64
#: Part of the largest change of an equation below which it does not depend on a parameter, and
#: deviation of changes from equal ones.
_NOTHING, _ALIKE = 1e-12, 1e-3
#: Largest change of positions and velocities of a start that is the same, m and so on.
_SAME_START = 1e-13
#: Second differences of the equations over first ones, from which on they are no smooth functions
#: of a parameter.
_ROUGH = 3e-3
#: Motion of fixed nodes, m and rad, up to which it is none.
_ROUNDING = 1e-13

#: Factors of the equations of blocks, of rows (r,) and of the memories' numbers (n,).
Factors = tuple[BlockVectors, FloatArray, FloatArray]
#: Sums for each block, and of the memories' numbers (n,).
Sums = tuple[Sequence[Carried], FloatArray]


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

    def direct_products(self, step: int, weights: FloatArray) -> FloatArray:
        """Weights (k, columns) times derivatives of all columns at a fixed state, on one rank.

        The system of the motion is at the accepted state after a step (collective).

        Returns:
            (k, count).
        """
        ...


class NumberInfluence:
    """What one number changes: two models.

    Attributes:
        start: derivatives of the start, for each block.
        numbers: (n,) those of the memories' numbers there.
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
        self._step = difference_of(values[name][at])
        self.scale = self._step / _STEP
        simulations = []
        for sign in (1.0, -1.0):
            moved: FloatArray = np.array(values[name])
            moved[at] += sign * self._step
            simulations.append(beside(motion, build, {**values, name: moved}, name))
        self._pair = simulations
        # later the models are at other states
        for other in self._pair:
            _check_fixed(motion.system, other.system, self._name)
        self.start = self._start()
        first, second = (motion.memories.start(one) for one in self._pair)
        self.numbers = (first - second) / (2.0 * self._step)
        self._direct = DirectEffect(motion, simulations)
        self._checked = False

    def _start(self) -> list[Carried]:
        found = []
        for k, part in enumerate(self._motion.system.parts):
            first = self._motion.state(0).rows[part.block.name]
            pair = [one.system.parts[k].block.state() for one in self._pair]
            own = np.s_[: part.block.owned, : part.block.width]
            moved = [
                twists(first["frames"], state["frames"], inertial=part.block.inertial)
                for state in pair
            ]
            rates = [
                (pair[0][name] - pair[1][name])[own] / (2.0 * self._step)
                for name in ("velocity", "auxiliary", "acceleration")
            ]
            moves = part.block.hold((moved[0] - moved[1])[own] / (2.0 * self._step))
            found.append(Carried(moves, *rates))
        return found

    def equations(self, step: int) -> Factors:
        """Derivatives of the equations of blocks, rows and memories at a step's end (collective).

        Args:
            step: number of the step, at whose trial state the system of the motion is.

        Raises:
            InputError: they are no smooth functions of the parameter.
        """
        motion, own = self._motion, np.zeros(len(self._motion.measured))
        if motion.measured and self._direct.present:
            own = self._direct.difference(step)[[motion.columns.index(c) for c in motion.measured]]
        found, numbers = [], []
        for one, sign in zip(self._pair, (1.0, -1.0), strict=True):
            found.append(evaluated(motion, one, step))
            if motion.renewal is None:
                numbers.append(motion.memories.moved(one, motion.end(step), 0.5 * sign * own))
            else:  # there are none
                numbers.append(np.zeros(0))
        first, second = found
        if not self._checked and motion.renewal is None:
            self._check_smooth(first, second, step)
        whole = 2.0 * self._step
        blocks = [(a - b) / whole for a, b in zip(first[0], second[0], strict=True)]
        return blocks, (first[1] - second[1]) / whole, (numbers[0] - numbers[1]) / whole

    def _check_smooth(self, first: Equations, second: Equations, step: int) -> None:
        """Refuse equations that jump with the parameter, as those with other modes (collective)."""
        self._checked = True
        system = self._motion.system
        owned = system.constraints.owned
        still = equations_at(system, self._motion.laws(step).shifts)
        blocks = [np.concatenate([x.ravel() for x in one[0]]) for one in (second, first, still)]
        rows = [owned * one[1] for one in (second, first, still)]
        if any(jump(system.comm, (a, b), c, _ROUGH) for a, b, c in (blocks, rows)):
            raise InputError(
                f'gradient: the equations jump where "{self._name}" changes by '
                f"{self._step:.2g}, and have no derivative"
            )

    def products(self, step: int, factors: Sequence[Factors]) -> FloatArray:
        """See :class:`Influence`."""
        blocks, rows, numbers = self.equations(step)
        owned, counted = self._motion.system.constraints.owned, self._motion.memories.owned
        return np.array(
            [
                [
                    sum(float((a * b).sum()) for a, b in zip(z, blocks, strict=True))
                    + float(mu @ (owned * rows) + own @ (counted * numbers))
                ]
                for z, mu, own in factors
            ]
        )

    def start_products(self, carried: Sequence[Sums]) -> FloatArray:
        """See :class:`Influence`."""
        return np.array(
            [
                [
                    sum(
                        float((getattr(a, part) * getattr(b, part)).sum())
                        for a, b in zip(own, self.start, strict=True)
                        for part in CARRIED
                    )
                    + float(remembered @ (self._motion.memories.owned * self.numbers))
                ]
                for own, remembered in carried
            ]
        )

    def direct_products(self, step: int, weights: FloatArray) -> FloatArray:
        """See :class:`Influence`."""
        if not self._direct.present:
            return np.zeros((len(weights), 1))
        return weights @ self.columns(step)[:, np.newaxis]

    @property
    def depends_directly(self) -> bool:
        """True if columns depend on the parameter at a fixed state."""
        return self._direct.present

    def columns(self, step: int) -> FloatArray:
        """Derivatives (columns,) of all columns at a fixed state, on the first rank (collective).

        They are zero on the others.
        """
        return self._direct.difference(step) / (2.0 * self._step)


def difference_of(values: FloatArray) -> float:
    """Difference of a number, or of several that change together."""
    return _STEP * (float(np.abs(values).max()) or 1.0)


def beside(motion: Motion, build: Build, values: Values, name: str) -> Simulation:
    """Start of a model of other values of one parameter (collective).

    Raises:
        InputError: the model does not exist at one of the values, or has another layout there.
        StoppedError: it does not start there.
    """
    one = Simulation(build(**plain(values)), motion.options, motion.system.comm)
    if one.status is not Status.OK:
        raise StoppedError(f'gradient: the motion with another "{name}" does not start')
    check_layout(motion.system, one.system, name)
    _check_times(motion, one, name)
    return one


@dataclass
class _Group:
    """Parameters that are changed together.

    Attributes:
        pair: starts with more and with less of them.
        owners: for each block, (n_owned,) number of the parameter that each node depends on, -1
            for none.
    """

    pair: list[Simulation]
    owners: list[IntArray]


class ElementInfluence:
    """An array of parameters that act on some elements each: a few models for all of them."""

    def __init__(
        self, motion: Motion, build: Build, values: Values, name: str, owners: Owners
    ) -> None:
        """Build the models of the groups (collective).

        Args:
            motion: the motion.
            build: a model of all values.
            values: of all parameters.
            name: of this array.
            owners: see :func:`element_owners`.
        """
        self._motion, self.count = motion, len(values[name])
        self._groups = _pairs(_Builder(motion, build, values, name), self.count, owners)
        self._steps = _steps(values[name])

    def products(self, step: int, factors: Sequence[Factors]) -> FloatArray:
        """See :class:`Influence`."""
        found = np.zeros((len(factors), self.count))
        for group in self._groups:
            first, second = (evaluated(self._motion, one, step)[0] for one in group.pair)
            self._add(group, first, second, ([z for z, *_ in factors], found))
        return found

    def start_products(self, carried: Sequence[Sums]) -> FloatArray:
        """See :class:`Influence`.

        Parameters of elements change the accelerations of the start alone, which satisfy
        ``M W + f = 0`` on the constraints: the factors of these equations take one solve with the
        mass matrix.
        """
        motion, system = self._motion, self._motion.system
        found, every = np.zeros((len(carried), self.count)), []
        for own, _ in carried:
            motion.tangent.assemble(MASS)
            motion.tangent.factor()
            right = [
                part.block.hold(
                    applied(_lv(part.block.width, RateMaps.of(part.block)), one.a + one.w)
                )
                for part, one in zip(system.parts, own, strict=True)
            ]
            motion.tangent.solve(right, np.zeros(system.constraints.size))
            every.append([-part.block.owned_step for part in system.parts])
        for group in self._groups:
            first, second = (evaluated(motion, one, 0)[0] for one in group.pair)
            self._add(group, first, second, (every, found))
        return found

    def direct_products(self, step: int, weights: FloatArray) -> FloatArray:
        """See :class:`Influence`: none, see :func:`_grouped`."""
        return np.zeros((len(weights), self.count))

    def _add(
        self, group: _Group, first: BlockVectors, second: BlockVectors,
        into: tuple[Sequence[BlockVectors], FloatArray],
    ) -> None:  # fmt: skip
        """Add factors times differences of equations, by parameter."""
        for owners, a, b, k in zip(group.owners, first, second, range(len(first)), strict=True):
            held = owners >= 0
            index = owners[held]
            change = (a - b)[held] / (2.0 * self._steps[index])[:, np.newaxis]
            for z, out in zip(into[0], into[1], strict=True):
                own = (z[k][held] * change).sum(axis=1)
                out[:] += np.bincount(index, own, minlength=self.count)


#: Owners of groups, see :class:`_Group`.
Owners = list[list[IntArray]]


def element_owners(motion: Motion, build: Build, values: Values, name: str) -> Owners | None:
    """Owners of the fewest groups, None if there are none (collective)."""
    if len(values[name]) <= _GROUPS or motion.system.viscous() or motion.remembering:
        return None
    builder = _Builder(motion, build, values, name)
    for count in range(1, _GROUPS):
        found = _grouped(motion, builder, len(values[name]), count)
        if found is not None:
            return found
    return None


def _pairs(builder: _Builder, size: int, owners: list[list[IntArray]]) -> list[_Group]:
    """Groups with their systems (collective)."""
    found = []
    for first, own in enumerate(owners):
        parts = (np.arange(size) % len(owners) == first).astype(np.float64)
        pair = [builder.started(parts), builder.started(-parts)]
        found.append(_Group([one for one in pair if one is not None], own))
    return found


def _steps(values: FloatArray) -> FloatArray:
    """Differences (n,) of an array of parameters."""
    return np.where(values == 0.0, _STEP, _STEP * np.abs(values))


def check_layout(system: System, other: System, name: str) -> None:
    """Raise unless blocks and rows of another model are those of the motion's (collective)."""
    same = len(other.parts) == len(system.parts)
    same = same and other.constraints.size == system.constraints.size
    same = same and all(
        np.array_equal(a.block.node_ids, b.block.node_ids) and a.block.width == b.block.width
        for a, b in zip(other.parts, system.parts, strict=True)
    )
    if not system.comm.allreduce(same, op=MPI.LAND):
        raise InputError(
            f'gradient: "{name}" changes the number of nodes or joints, and has no derivative'
        )


def _check_times(motion: Motion, other: Simulation, name: str) -> None:
    """Refuse parameters that move jumps and kinks at which steps end (same on all ranks)."""
    if not other.breakpoints.same(motion.simulation.breakpoints):
        raise InputError(
            f'gradient: "{name}" moves the time of a jump or kink of a load or drive, at which a '
            "step ends, and has no derivative yet"
        )


def _check_fixed(system: System, other: System, name: str) -> None:
    """Refuse parameters that move nodes with rotations that are fixed in part (collective)."""
    partly = False
    for part, moved in zip(system.parts, other.parts, strict=True):
        if (fixed := part.block.dirichlet) is not None and part.block.width == 6:
            frames = part.block.start_frames, moved.block.start_frames
            change = np.abs(twists(*frames, inertial=part.block.inertial)) * fixed
            some = change.max(axis=1, initial=0.0) > _ROUNDING
            partly = partly or bool((some & ~fixed.all(axis=1)).any())
    if system.comm.allreduce(partly, op=MPI.LOR):
        raise InputError(
            f'gradient: "{name}" moves nodes that are fixed in part, and has no derivative yet'
        )


def evaluated(motion: Motion, other: Simulation, step: int) -> Equations:
    """Residuals of another model at the trial state of the motion, after a step, or at the start.

    Those of the start are not scaled (collective).
    """
    state, system = motion.state(max(step - 1, 0)), other.system
    for part in system.parts:
        part.block.restore(state.rows[part.block.name])
    # of the rows what a motion changes, and not their targets, which are the other model's own
    rows = system.constraints
    rows.angles[:] = state.rows["terms"]["angles"]
    rows.lines.restore_places(state.rows["places"]["places"])
    rows.lines.angles[:] = state.rows["line_terms"]["line_angles"]
    system.interface.update()
    system.lead = motion.system.lead
    if not step:
        system.set_time(motion.times[step])
        copy_state(motion.system, system)
        return equations_at(system, _UNSCALED)
    if motion.renewal is not None:
        system.set_time(motion.times[step])
        copy_state(motion.system, system)
        return motion.renewal.equations(system)
    end = motion.end(step)
    motion.memories.recall(other, step)
    system.set_time(motion.times[step])
    rows.elements.begin(end.states, exact=True)
    copy_state(motion.system, system)
    blocks, values = equations_at(system, end.shifts)
    # equations of force elements are scaled by the derivatives in use
    scaled, own = rows.of_elements, motion.system.constraints
    values[scaled] *= own.compliance[scaled] / rows.compliance[scaled]
    return blocks, values


#: Equations without scale.
_UNSCALED = Shifts(velocity=0.0, acceleration=0.0, scale=1.0)


class _Builder:
    """Systems of models with changed entries of one array of parameters."""

    def __init__(self, motion: Motion, build: Build, values: Values, name: str) -> None:
        self._motion, self._build, self._values, self._name = motion, build, values, name

    def _model(self, parts: FloatArray) -> Model:
        """The model with entries changed by parts (n,) of their differences."""
        given = self._values[self._name]
        moved = given + parts * _steps(given)
        return self._build(**plain({**self._values, self._name: moved}))

    def system(self, parts: FloatArray) -> System:
        """Its system (collective)."""
        options, comm = self._motion.options, self._motion.system.comm
        _, system = set_up(
            self._model(parts), comm, options.split_above, kernels=options.kernels,
            moving=True,
        )  # fmt: skip
        check_layout(self._motion.system, system, self._name)
        return system

    def started(self, parts: FloatArray) -> Simulation | None:
        """Its start, None if positions or velocities there differ (collective)."""
        motion = self._motion
        one = Simulation(self._model(parts), motion.options, motion.system.comm)
        check_layout(motion.system, one.system, self._name)
        _check_times(motion, one, self._name)
        state, worst = motion.state(0), 0.0
        for part in one.system.parts:
            for name in ("frames", "velocity"):
                change = part.block.state()[name] - state.rows[part.block.name][name]
                worst = max(worst, float(np.abs(change).max(initial=0.0)))
        worst = motion.system.comm.allreduce(worst, op=MPI.MAX)
        return one if worst < _SAME_START else None


def _grouped(
    motion: Motion, builder: _Builder, size: int, count: int
) -> list[list[IntArray]] | None:
    """Owners of groups of the entries of an array, whose numbers are equal modulo a count.

    None if an equation depends on two of a group, or rows, the start or columns depend on any
    (collective).
    """
    numbers, found = np.arange(size), []
    for first in range(count):
        own = (numbers % count == first).astype(np.float64)
        other = builder.started(own)
        if other is None or DirectEffect(motion, [other]).present:
            return None
        disturb(motion)
        still = equations_at(motion.system, _UNSCALED)
        whole = _changes(motion.system, other.system, still)
        if whole is None:
            return None
        owners, place = [np.zeros(len(change), dtype=np.int64) for change in whole], 1
        while place <= numbers[-1]:
            part = own * (1.0 + numbers // place % _BASE) / _BASE
            changes = _changes(motion.system, builder.system(part), still)
            digits = None if changes is None else _digits(motion.system, whole, changes)
            if digits is None:
                return None
            for total, digit in zip(owners, digits, strict=True):
                total[:] += place * digit
                total[digit < 0] = -1
            place *= _BASE
        found.append(owners)
    return found


def _changes(source: System, system: System, still: Equations) -> BlockVectors | None:
    """Changes of the equations of blocks in another model; None if rows change (collective)."""
    system.set_time(source.time)
    copy_state(source, system)
    blocks, rows = equations_at(system, _UNSCALED)
    changed = float(np.abs(rows - still[1]).max(initial=0.0))
    if source.comm.allreduce(changed, op=MPI.MAX) != 0.0:
        return None
    return [a - b for a, b in zip(blocks, still[0], strict=True)]


def _digits(system: System, whole: BlockVectors, changes: BlockVectors) -> list[IntArray] | None:
    """For each block, (n_owned,) digit of the parameter of each node, -1 for none.

    None if a node depends on two of them (collective).

    Args:
        system: of the motion.
        whole: changes of the equations if all parameters change by their differences.
        changes: those if they change by parts ``(digit + 1)/base`` of them.
    """
    largest = max((float(np.abs(change).max(initial=0.0)) for change in whole), default=0.0)
    largest = system.comm.allreduce(largest, op=MPI.MAX)
    found, clear = [], True
    for change, part in zip(whole, changes, strict=True):
        square = (change**2).sum(axis=1)
        seen = np.sqrt(square) > _NOTHING * largest
        share = np.divide((part * change).sum(axis=1), square, where=seen, out=0.0 * square)
        digit = np.rint(share * _BASE) - 1.0
        rest = np.abs(part - ((digit + 1.0) / _BASE)[:, np.newaxis] * change)
        clear = clear and bool((rest[seen] <= _ALIKE * np.sqrt(square[seen, np.newaxis])).all())
        clear = clear and bool((digit[seen] >= 0.0).all() and (digit[seen] < _BASE).all())
        clear = clear and bool((np.abs(part[~seen]) <= _NOTHING * largest).all())
        found.append(np.where(seen, digit, -1.0).astype(np.int64))
    return found if system.comm.allreduce(clear, op=MPI.LAND) else None


def _lv(width: int, maps: RateMaps) -> FloatArray:
    """Maps (n, w, w) from rates of increments to those of local twists."""
    return maps.by_rate[:, :width, :width]
