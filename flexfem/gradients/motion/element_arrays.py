# SPDX-License-Identifier: LGPL-3.0-or-later
"""Arrays of parameters that act on elements.

An array of parameters that act on elements each, as the sections of a beam do, takes a few models
for all of them. Parameters with numbers that are equal modulo a small one are changed together, so
that each equation changes by one of them alone (Curtis, Powell, Reid, J. Inst. Math. Appl. 13
(1974) 117-119). By which one, is known from models in which each changes by a part that is a digit
of its number, at random.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mpi4py import MPI

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.gradients.equations.node_maps import RateMaps, applied
from flexfem.gradients.equations.step_tangent import BlockVectors
from flexfem.gradients.equations.values import Equations, equations_at
from flexfem.gradients.motion.columns import Seeds
from flexfem.gradients.motion.direct import DirectEffect, copy_state, disturb
from flexfem.gradients.motion.influence import (
    STEP,
    UNSCALED,
    Factors,
    Sums,
    evaluated,
    own_equations,
)
from flexfem.gradients.motion.parameters import Build, Values, plain
from flexfem.gradients.motion.support import check_alike, check_layout, check_times
from flexfem.gradients.motion.trajectory import Motion
from flexfem.layout.elements import TimedElements
from flexfem.model.model import Model
from flexfem.simulation.motion.stepping import Simulation
from flexfem.simulation.run.setup import set_up
from flexfem.system.system import MASS, System

__all__ = ["Builder", "ElementInfluence", "Owners", "element_influence", "element_owners"]

#: Largest number of groups of an array's parameters.
_GROUPS = 4
#: So many nodes for an entry or fewer are those of elements that meet.
_MEETING = 3
#: Largest base of the digits of their numbers: parts that are as close as with the first one are
#: told apart where forces are alike and depend on parameters by not more than about their cube.
_BASES = 8192, 128
#: Part of the largest change of an equation below which it does not depend on a parameter;
#: deviation of parts from those given, as part of the distance of two of them, and by itself;
#: deviation of changes from parts of one another, from which on several parameters change them.
_NOTHING, _CLEAR, _ALIKE, _MIXED = 1e-12, 0.1, 1e-4, 0.01
#: Largest change of positions and velocities of a start that is the same, m and so on.
_SAME_START = 1e-13
#: Differences by which parameters change to see whether equations are linear in them; deviation of
#: equations that are, from first differences, and rounding.
_FAR, _LINEAR, _ROUNDED = 1e3, 1e-9, 1e-12

#: Owners of groups, see :class:`_Group`.
Owners = list[list[IntArray]]


@dataclass
class _Group:
    """Parameters that are changed together.

    Attributes:
        owners: for each block, (n_owned,) number of the parameter that each node depends on, -1
            for none.
        more, less: starts with more and with less of them. Where equations are linear in the
            parameters, the motion itself is the latter.
    """

    owners: list[IntArray]
    more: Simulation
    less: Simulation


class ElementInfluence:
    """An array of parameters that act on some elements each: a few models for all of them."""

    def __init__(self, motion: Motion, steps: FloatArray, groups: Sequence[_Group]) -> None:
        """Store differences (n,) of the parameters and their groups, see :func:`_grouped`."""
        self._motion, self._groups, self._steps = motion, groups, steps
        self.count = len(steps)

    def products(self, step: int, factors: Sequence[Factors]) -> FloatArray:
        """See :class:`Influence`."""
        return self._products(step, [z for z, *_ in factors])

    def start_products(self, carried: Sequence[Sums]) -> FloatArray:
        """See :class:`Influence`.

        Parameters of elements change the accelerations of the start alone, which satisfy
        ``M W + f = 0`` on the constraints: the factors of these equations take one solve with the
        mass matrix.
        """
        motion, system, every = self._motion, self._motion.system, []
        for own, _, _ in carried:
            motion.tangent.assemble(MASS)
            motion.tangent.factor()
            right = [
                part.block.hold(applied(RateMaps.by_rates(part.block), one.a + one.w))
                for part, one in zip(system.parts, own, strict=True)
            ]
            motion.tangent.solve(right, np.zeros(system.constraints.size))
            every.append([-part.block.owned_step for part in system.parts])
        return self._products(0, every)

    def event_changes(self, state: int) -> FloatArray:
        """See :class:`Influence`: none, see :func:`element_owners`."""
        return np.zeros(self.count)

    def direct_products(self, step: int, weights: FloatArray, seeds: Sequence[Seeds]) -> FloatArray:
        """See :class:`Influence`: none, see :func:`_grouped`."""
        return np.zeros((len(weights), self.count))

    def _products(self, step: int, factors: Sequence[BlockVectors]) -> FloatArray:
        """Factors times derivatives of the equations of blocks."""
        found = np.zeros((len(factors), self.count))
        for owners, changes in self.changes(step):
            for k, (index, change) in enumerate(zip(owners, changes, strict=True)):
                held = index >= 0
                for z, out in zip(factors, found, strict=True):
                    own = (z[k][held] * change[held]).sum(axis=1)
                    out[:] += np.bincount(index[held], own, minlength=self.count)
        return found

    def changes(self, step: int) -> list[tuple[list[IntArray], BlockVectors]]:
        """Of each group owners of nodes, and derivatives of equations by them (collective).

        Those of the owner -1 are none. The state of the motion is that of ``influence.evaluated``.
        """
        motion, found = self._motion, []
        for group in self._groups:
            more, _ = evaluated(motion, group.more, step)
            if group.less is motion.simulation:
                (less, _), between = own_equations(motion, step), self._steps
            else:
                (less, _), between = evaluated(motion, group.less, step), 2.0 * self._steps
            parts = zip(more, less, group.owners, strict=True)
            found.append(
                (group.owners, [(a - b) / between[own][:, np.newaxis] for a, b, own in parts])
            )
        return found


class Builder:
    """Systems of models with changed entries of one array of parameters.

    Attributes:
        steps: (n,) differences of the parameters.
    """

    def __init__(self, motion: Motion, build: Build, values: Values, name: str) -> None:
        """Store what the models are made of."""
        self._motion, self._build, self._values, self._name = motion, build, values, name
        given = values[name]
        self.steps = np.where(given == 0.0, STEP, STEP * np.abs(given))
        self._started: dict[bytes, Simulation | None] = {}

    def _model(self, parts: FloatArray) -> Model:
        """The model with entries changed by parts (n,) of their differences."""
        moved = self._values[self._name] + parts * self.steps
        return self._build(**plain({**self._values, self._name: moved}))

    def system(self, parts: FloatArray) -> System:
        """Its system (collective)."""
        options, comm = self._motion.options, self._motion.system.comm
        serial, system = set_up(
            self._model(parts), comm, options.split_above, kernels=options.kernels,
            moving=True,
        )  # fmt: skip
        check_alike(self._motion.model, serial.model, self._name)
        check_layout(self._motion.system, system, self._name)
        return system

    def started(self, parts: FloatArray) -> Simulation | None:
        """Its start, None if positions or velocities there differ (collective); made once."""
        key = parts.tobytes()
        if key not in self._started:
            self._started[key] = self._start(parts)
        return self._started[key]

    def _start(self, parts: FloatArray) -> Simulation | None:
        motion = self._motion
        one = Simulation(self._model(parts), motion.options, motion.system.comm)
        check_alike(motion.model, one.serial.model, self._name)
        check_layout(motion.system, one.system, self._name)
        check_times(motion.simulation.breakpoints, one.breakpoints, self._name)
        state, worst = motion.state(0), 0.0
        for part in one.system.parts:
            for name in ("frames", "velocity"):
                change = part.block.state()[name] - state.rows[part.block.name][name]
                worst = max(worst, float(np.abs(change).max(initial=0.0)))
        worst = motion.system.comm.allreduce(worst, op=MPI.MAX)
        return one if worst < _SAME_START else None


def element_owners(motion: Motion, builder: Builder) -> Owners | None:
    """Owners of the fewest groups, None if there are none (collective)."""
    size = len(builder.steps)
    damped = motion.system.viscous() or motion.start_decayed
    damped = damped or motion.system.timed or motion.system.modal_dampers is not None
    apart = damped or motion.remembering or bool(motion.grid.events)
    apart = apart or bool(motion.system.contacts) or motion.system.constraints.split
    if size <= _GROUPS or apart:
        return None
    nodes = sum(part.block.size_global for part in motion.system.parts)
    # entries of elements that meet at nodes are as many as these: one group would not do
    counts = range(2 if _MEETING * size > nodes else 1, _GROUPS)
    for count in counts:
        found = _grouped(motion, builder, size, count)
        if found is not None:
            return _joined(motion.system, found)
    return None


def _joined(system: System, owners: Owners) -> Owners:
    """One group where no equation depends on parameters of two of them (collective)."""
    every = [np.array(own) for own in zip(*owners, strict=True)]
    meet = any(bool(((own >= 0).sum(axis=0) > 1).any()) for own in every)
    if system.comm.allreduce(meet, op=MPI.LOR):
        return owners
    return [[own.max(axis=0) for own in every]]


def element_influence(motion: Motion, builder: Builder, owners: Owners) -> ElementInfluence | None:
    """What the parameters of some groups change, None if they move the start (collective)."""
    size, count = len(builder.steps), len(owners)
    parts = [(np.arange(size) % count == first).astype(np.float64) for first in range(count)]
    more = [one for own in parts if (one := builder.started(own))]
    if len(more) < count:
        return None
    less = count * [motion.simulation]
    if not _linear(motion, builder, more):
        less = [one for own in parts if (one := builder.started(-own))]
    if len(less) < count:
        return None
    groups = [_Group(*group) for group in zip(owners, more, less, strict=True)]
    return ElementInfluence(motion, builder.steps, groups)


def _linear(motion: Motion, builder: Builder, more: Sequence[Simulation]) -> bool:
    """True if the equations are linear in the parameters (collective).

    These change so much more for it that what is not linear is seen beside rounding of far larger
    forces. The motion is at another state after it.

    Args:
        motion: the motion.
        builder: of the models.
        more: starts with more of the parameters of each group.
    """
    try:
        far = builder.system(-_FAR * np.ones(len(builder.steps)))
    except ValueError:  # the parameters have no such values
        return False
    motion.go_to(0)
    disturb(motion)
    still, clear = equations_at(motion.system, UNSCALED), True
    largest = max((float(np.abs(own).max(initial=0.0)) for own in still[0]), default=0.0)
    largest = motion.system.comm.allreduce(largest, op=MPI.MAX)
    found = [_changes(motion.system, one, still) for one in (far, *(own.system for own in more))]
    changes = [one for one in found if one is not None]
    for moved, *little in zip(*changes, strict=True):
        size = _FAR * np.sum(np.abs(little), axis=0)
        bent = np.abs(moved + _FAR * np.sum(little, axis=0))
        clear = clear and bool((bent <= _LINEAR * size + _ROUNDED * largest).all())
    clear = clear and len(changes) == len(found)
    return bool(motion.system.comm.allreduce(clear, op=MPI.LAND))


def _grouped(motion: Motion, builder: Builder, size: int, count: int) -> Owners | None:
    """Owners of groups of the entries of an array, whose numbers are equal modulo a count.

    None if an equation depends on two of a group, or rows, the start or columns depend on any
    (collective).
    """
    found = []
    for first in range(count):
        own = (np.arange(size) % count == first).astype(np.float64)
        other = builder.started(own)
        if other is None or DirectEffect(motion, [other]).present:
            return None
        disturb(motion)
        still = equations_at(motion.system, UNSCALED)
        whole = _changes(motion.system, other.system, still)
        if whole is None:
            return None
        for base in _BASES:
            reading = _read(motion.system, builder, (own, still, whole), base)
            if reading.mixed:
                return None
            if reading.clear:
                break
        else:
            return None
        if not _always(motion, builder, (own, other.system), reading.owners):
            return None
        found.append(reading.owners)
    return found


def _always(
    motion: Motion, builder: Builder, group: tuple[FloatArray, System], owners: Sequence[IntArray]
) -> bool:
    """True if all parameters of a group own something, and that at all times (collective).

    What is read at one time is not all that parameters of loads do. Loads act with factors that
    change with time: those of the motion are looked at where each is largest, at the start, in the
    middle and at the end; parameters that change factors are none of elements.

    Args:
        motion: the motion, at a state at random.
        builder: of the models.
        group: 1 for its parameters (n,), 0 for others; the system with all of them changed.
        owners: for each block, (n_owned,) numbers of parameters, -1 for none.
    """
    (own, other), system = group, motion.system
    counts = np.zeros(len(own))
    for one in owners:
        counts += np.bincount(one[one >= 0], minlength=len(own))
    system.comm.Allreduce(MPI.IN_PLACE, counts)
    factors = np.array([_factors((system, other), t) for t in motion.times])
    if (counts[own > 0.0] == 0.0).any() or not np.array_equal(factors[:, 0], factors[:, 1]):
        return False
    timed = any(isinstance(part.elements, TimedElements) for part in system.parts)
    if not (factors.size or timed):  # nothing that parameters of elements do changes with time
        return True
    largest = np.abs(factors[:, 0]).argmax(axis=0)
    parts = own * (1.0 + np.random.default_rng(1).permutation(len(own))) / len(own)
    partly, clear = builder.system(parts), True
    for step in sorted({0, motion.steps // 2, motion.steps, *largest.tolist()}):
        system.set_time(motion.times[step])
        still = equations_at(system, UNSCALED)
        whole, moved = (_changes(system, one, still) for one in (other, partly))
        if whole is None or moved is None:
            return False
        for index, a, b in zip(owners, whole, moved, strict=True):
            expected = np.where(index >= 0, parts[index], 0.0)[:, np.newaxis] * a
            most = float(np.abs(a).max(initial=0.0))
            clear = clear and bool(
                (np.abs(b - expected) <= _ALIKE * np.abs(a) + _NOTHING * most).all()
            )
            clear = clear and bool((np.abs(a[index < 0]) <= _NOTHING * most).all())
    system.set_time(motion.times[0])
    return bool(system.comm.allreduce(clear, op=MPI.LAND))


def _factors(systems: Sequence[System], t: float) -> list[FloatArray]:
    """Factors of the loads of systems at a time."""
    for one in systems:
        one.set_time(t)
    return [one.factors.copy() for one in systems]


@dataclass
class _Reading:
    """What models with parts of the changes of a group show, the same on all ranks but for owners.

    Attributes:
        owners: see :class:`_Group`.
        clear: True if all equations change by a given part.
        mixed: True if one changes by several.
    """

    owners: list[IntArray]
    clear: bool = True
    mixed: bool = False


def _read(
    system: System, builder: Builder, group: tuple[FloatArray, Equations, BlockVectors], base: int
) -> _Reading:
    """Read owners of a group from models in which each parameter changes by a part (collective).

    Numbers of parameters are at random, so that those of neighbours are not alike.

    Args:
        system: of the motion.
        builder: of the models.
        group: 1 for its parameters (n,), 0 for others; equations; their changes with the group.
        base: largest base of the digits of numbers.
    """
    own, still, whole = group
    size, places = len(own), 1
    while base**places < size:
        places += 1
    base = next(k for k in range(1, base + 1) if k**places >= size)  # as small as it can be
    numbers = np.random.default_rng(0).permutation(size)
    found = _Reading([np.zeros(len(change), dtype=np.int64) for change in whole])
    for place in range(places):
        digits = numbers // base**place % base
        parts = own * _part(digits, base)
        changes = _changes(system, builder.system(parts), still)
        if changes is None:
            found.mixed = True
        else:
            _add_digits(system, found, (whole, changes), (base, place))
        if found.mixed or not found.clear:
            return found
    index = np.argsort(numbers)
    found.owners = [np.where(one < 0, -1, index[np.minimum(one, size - 1)]) for one in found.owners]
    return found


def _add_digits(
    system: System, found: _Reading, equations: tuple[BlockVectors, ...], digit: tuple[int, int]
) -> None:
    """Add digits to the numbers of owners (collective).

    Args:
        system: of the motion.
        found: numbers so far, to be changed.
        equations: changes of those of blocks with a group, and with parts of it.
        digit: base and place of the digit.
    """
    (whole, changes), (base, place) = equations, digit
    most = max((float(np.abs(change).max(initial=0.0)) for change in whole), default=0.0)
    most = system.comm.allreduce(most, op=MPI.MAX)
    off = np.array([not found.clear, found.mixed])
    for k, (change, moved) in enumerate(zip(whole, changes, strict=True)):
        size = np.sqrt((change**2).sum(axis=1))
        seen = size > _NOTHING * most
        part = np.divide((moved * change).sum(axis=1), size**2, where=seen, out=0.0 * size)
        number = np.rint(base * part) - 1.0
        rest = np.abs(moved - _part(number, base)[:, np.newaxis] * change).max(axis=1)
        across = np.abs(moved - part[:, np.newaxis] * change).max(axis=1)
        unclear = (number < 0.0) | (number >= base) | (rest > min(_CLEAR / base, _ALIKE) * size)
        off |= (np.array([unclear, across > _MIXED * size]) & seen).any(axis=1)
        off[1] |= bool((np.abs(moved[~seen]) > _NOTHING * most).any())
        own = found.owners[k]
        own += base**place * np.where(seen, number, 0.0).astype(np.int64)
        own[~seen] = -1
    system.comm.Allreduce(MPI.IN_PLACE, off, op=MPI.LOR)
    found.clear, found.mixed = not off[0], bool(off[1])


def _part(digits: FloatArray | IntArray, base: int) -> FloatArray:
    """Part of its difference by which a parameter with a digit changes."""
    return (digits + 1.0) / base


def _changes(source: System, system: System, still: Equations) -> BlockVectors | None:
    """Changes of the equations of blocks in another model; None if rows change (collective)."""
    system.set_time(source.time)
    copy_state(source, system)
    blocks, rows = equations_at(system, UNSCALED)
    changed = float(np.abs(rows - still[1]).max(initial=0.0))
    if source.comm.allreduce(changed, op=MPI.MAX) != 0.0:
        return None
    return [a - b for a, b in zip(blocks, still[0], strict=True)]
