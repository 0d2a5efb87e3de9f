# SPDX-License-Identifier: LGPL-3.0-or-later
"""Arrays of parameters: on which elements, or at which times, each of their entries acts.

Values of a load or drive at knots of time, as the coefficients of a spline, act one after the
other: at any time on few of them, and linearly. Entries with numbers that are equal modulo a small
one are changed together; if at each step the equations change by one of them alone, two models give
the derivatives of all. By which one, is known from models in which each entry changes by a part of
its own, at random: the equations of a step change by this part. A second set of parts must agree; a
step at which several entries act agrees with none, unlike equations in which they are symmetric,
such as values of a cubic spline at its knots, with parts that grow from entry to entry. These
changes are as large as the entries, so that what is found holds for all values of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from mpi4py import MPI

import numpy as np

from flexfem._faults import FAILURES
from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.gradients.equations.carried import Carried
from flexfem.gradients.equations.node_maps import RateMaps, transposed
from flexfem.gradients.equations.step_tangent import BlockVectors
from flexfem.gradients.motion.columns import Seeds
from flexfem.gradients.motion.direct import DirectEffect
from flexfem.gradients.motion.element_arrays import (
    Builder,
    ElementInfluence,
    Owners,
    element_influence,
    element_owners,
)
from flexfem.gradients.motion.influence import (
    Factors,
    Influence,
    NumberInfluence,
    Sums,
    beside,
    difference_of,
    evaluated,
)
from flexfem.gradients.motion.parameters import Build, Values, flattened
from flexfem.gradients.motion.trajectory import Motion
from flexfem.simulation.motion.stepping import Simulation
from flexfem.system.system import MASS

__all__ = ["Known", "TimedInfluence", "directions_of", "influence_of"]

#: Numbers of groups that are tried; entries of one have numbers that are equal modulo it.
_GROUPS = (1, 2, 4, 8)
#: Least number of entries of a group that is worth the models by which it is found.
_WORTH = 4
#: Part of the largest change of the equations below which they do not depend on an entry, and
#: deviation of changes from parts of one another.
_NOTHING, _ALIKE = 1e-8, 1e-3
#: Deviation of parts from those given, as part of the distance of two of them.
_CLEAR = 0.1
#: Every which step is looked at first.
_FIRST = 16


@dataclass(frozen=True)
class Times:
    """When the entries of a group act.

    Attributes:
        entries: their numbers.
        grid: (steps + 1,) times of the steps.
        equations: (steps + 1,) that which the equations of a step depend on, -1 for none; of the
            first one, the start.
        columns: (steps + 1,) that which columns depend on at a fixed state.
    """

    entries: IntArray
    grid: FloatArray
    equations: IntArray
    columns: IntArray


#: What is known of arrays by their names; None of those whose entries have models of their own.
Known = dict[str, Owners | list[Times] | None]


def influence_of(
    motion: Motion, build: Build, values: Values, name: str, known: Known
) -> Influence:
    """What a parameter, or an array of them, changes (collective).

    Args:
        motion: the motion.
        build: a model of all values.
        values: of all parameters.
        name: of this one.
        known: what was found of arrays with other values, to which that found is added.
    """
    build, values = flattened(build, values)
    if values[name].ndim == 0:
        return NumberInfluence(motion, build, values, name)
    builder = Builder(motion, build, values, name)
    if name not in known or _of_other_steps(known[name], motion):
        found: Owners | list[Times] | None = element_owners(motion, builder)
        known[name] = _times(motion, build, values, name) if found is None else found
    owners = known[name]
    if owners is None:
        return SeparateInfluence(motion, build, values, name)
    timed = [one for one in owners if isinstance(one, Times)]
    if timed:
        return TimedInfluence(motion, build, values, name, timed)
    elements = [one for one in owners if not isinstance(one, Times)]
    return element_influence(motion, builder, elements) or SeparateInfluence(
        motion, build, values, name
    )


def _of_other_steps(known: Owners | list[Times] | None, motion: Motion) -> bool:
    """True of times of a motion with other steps."""
    one = known[0] if known else None
    return isinstance(one, Times) and not np.array_equal(one.grid, motion.times)


class SeparateInfluence:
    """An array of parameters each of which has models of its own."""

    def __init__(self, motion: Motion, build: Build, values: Values, name: str) -> None:
        """Build all models (collective)."""
        self.count = len(values[name])
        self.every = [NumberInfluence(motion, build, values, name, k) for k in range(self.count)]

    def products(self, step: int, factors: Sequence[Factors]) -> FloatArray:
        """See :class:`Influence`."""
        return np.hstack([one.products(step, factors) for one in self.every])

    def start_products(self, carried: Sequence[Sums]) -> FloatArray:
        """See :class:`Influence`."""
        return np.hstack([one.start_products(carried) for one in self.every])

    def event_changes(self, state: int) -> FloatArray:
        """See :class:`Influence`."""
        return np.concatenate([one.event_changes(state) for one in self.every])

    def direct_products(self, step: int, weights: FloatArray, seeds: Sequence[Seeds]) -> FloatArray:
        """See :class:`Influence`."""
        return np.hstack([one.direct_products(step, weights, seeds) for one in self.every])


class TimedInfluence:
    """An array of parameters that act one after the other: a few models for all of them."""

    def __init__(
        self, motion: Motion, build: Build, values: Values, name: str, times: Sequence[Times]
    ) -> None:
        """Build the models of the groups (collective)."""
        self.count = len(values[name])
        self.times = times
        self.every = [
            NumberInfluence(motion, build, values, name, group.entries) for group in times
        ]

    def products(self, step: int, factors: Sequence[Factors]) -> FloatArray:
        """See :class:`Influence`."""
        found = np.zeros((len(factors), self.count))
        for one, group in zip(self.every, self.times, strict=True):
            if group.equations[step] >= 0:
                found[:, group.equations[step]] = one.products(step, factors)[:, 0]
        return found

    def start_products(self, carried: Sequence[Sums]) -> FloatArray:
        """See :class:`Influence`."""
        found = np.zeros((len(carried), self.count))
        for one, group in zip(self.every, self.times, strict=True):
            if group.equations[0] >= 0:
                found[:, group.equations[0]] = one.start_products(carried)[:, 0]
        return found

    def event_changes(self, state: int) -> FloatArray:
        """See :class:`Influence`; there are no events, see :func:`_times`."""
        return np.zeros(self.count)

    def direct_products(self, step: int, weights: FloatArray, seeds: Sequence[Seeds]) -> FloatArray:
        """See :class:`Influence`."""
        found = np.zeros((len(weights), self.count))
        for one, group in zip(self.every, self.times, strict=True):
            if group.columns[step] >= 0:
                found[:, group.columns[step]] = one.direct_products(step, weights, seeds)[:, 0]
        return found


@dataclass(frozen=True)
class Entry:
    """What one entry of an array changes, where others share its models.

    Attributes:
        start, numbers, forces, equations, depends_directly, columns, followed: see
            :class:`NumberInfluence`.
    """

    start: list[Carried]
    numbers: FloatArray
    forces: FloatArray
    equations: Callable[[int], Factors]
    depends_directly: bool
    columns: Callable[[int], FloatArray]
    followed: Callable[[int, Seeds], float]

    def event_changes(self, state: int) -> FloatArray:
        """None, see those of the arrays."""
        return np.zeros(1)


def directions_of(motion: Motion, influence: Influence) -> list[NumberInfluence | Entry]:
    """What each number of a parameter changes (collective); the motion is elsewhere after it."""
    if isinstance(influence, NumberInfluence):
        return [influence]
    if isinstance(influence, SeparateInfluence):
        return [*influence.every]
    if isinstance(influence, TimedInfluence):
        return _timed_entries(motion, influence)
    assert isinstance(influence, ElementInfluence)
    return _element_entries(motion, influence)


def _timed_entries(motion: Motion, influence: TimedInfluence) -> list[NumberInfluence | Entry]:
    """Entries that act one after the other."""
    found: dict[int, NumberInfluence | Entry] = {}
    nothing, no_columns = _nothing(motion), np.zeros(len(motion.columns))
    still = [Carried.nothing(x.shape) for x in nothing[0]]
    for one, group in zip(influence.every, influence.times, strict=True):
        equations, columns = _latest(one.equations), _latest(one.columns)
        for entry in map(int, group.entries):
            starts = group.equations[0] == entry
            found[entry] = Entry(
                one.start if starts else still, one.numbers if starts else nothing[2],
                one.forces if starts else nothing[1],
                partial(_if_owned, equations, group.equations == entry, nothing),
                one.depends_directly,
                partial(_if_owned, columns, group.columns == entry, no_columns),
                partial(_followed_if_owned, one, group.columns == entry),
            )  # fmt: skip
    return [found[k] for k in range(influence.count)]


def _if_owned[Found](
    values: Callable[[int], Found], owned: BoolArray, nothing: Found, step: int
) -> Found:
    """Values of a step that are an entry's own, and nothing at others (collective)."""
    return values(step) if owned[step] else nothing


def _followed_if_owned(one: NumberInfluence, owned: BoolArray, step: int, seeds: Seeds) -> float:
    """What columns of a step change with nodes that follow their starts, if they are an entry's."""
    return one.followed(step, seeds) if owned[step] else 0.0


def _element_entries(motion: Motion, influence: ElementInfluence) -> list[NumberInfluence | Entry]:
    """Entries that act on elements each."""
    _, rows, numbers = _nothing(motion)
    changes = _latest(influence.changes)

    def of(entry: int, step: int) -> Factors:
        total: BlockVectors = []
        for owners, derivatives in changes(step):
            own = [
                np.where((a == entry)[:, np.newaxis], b, 0.0)
                for a, b in zip(owners, derivatives, strict=True)
            ]
            total = [a + b for a, b in zip(total, own, strict=True)] if total else own
        return total, rows, numbers

    motion.go_to(0)
    no_columns = np.zeros(len(motion.columns))
    return [
        Entry(
            _start_along(motion, of(entry, 0)[0]), numbers, rows, partial(of, entry), False,
            lambda step: no_columns, lambda step, seeds: 0.0,
        )
        for entry in range(influence.count)
    ]  # fmt: skip


def _start_along(motion: Motion, changes: BlockVectors) -> list[Carried]:
    """Change of the start by that of its equations (collective).

    It is one of accelerations, see :meth:`ElementInfluence.start_products`.
    """
    motion.tangent.assemble(MASS)
    motion.tangent.factor()
    parts, found = motion.system.parts, []
    right = [part.block.hold(x) for part, x in zip(parts, changes, strict=True)]
    motion.tangent.solve(right, np.zeros(motion.system.constraints.size))
    for part in parts:
        accelerations = -transposed(RateMaps.by_rates(part.block), part.block.owned_step)
        still = np.zeros_like(accelerations)
        found.append(Carried(still, still.copy(), accelerations, accelerations.copy()))
    return found


def _nothing(motion: Motion) -> Factors:
    """No change of the equations."""
    blocks = [np.zeros_like(part.block.owned_step) for part in motion.system.parts]
    return blocks, np.zeros(motion.system.constraints.size), np.zeros(len(motion.memories.owned))


def _latest[Found](function: Callable[[int], Found]) -> Callable[[int], Found]:
    """A function of steps that is called once for each of them, in turn."""
    kept: dict[int, Found] = {}

    def found(step: int) -> Found:
        if step not in kept:
            kept.clear()
            kept[step] = function(step)
        return kept[step]

    return found


def _times(motion: Motion, build: Build, values: Values, name: str) -> list[Times] | None:
    """Times of the fewest groups, None if there are none (collective)."""
    size, system = len(values[name]), motion.system
    if system.contacts or system.constraints.split:
        return None
    if motion.remembering or len(motion.grid.steps) < motion.steps:  # there are renewals
        return None
    for count in _GROUPS:
        if size < _WORTH * count:
            break
        found = []
        for first in range(count):
            try:
                probe = _Probe(motion, build, values, name, np.arange(first, size, count))
            except FAILURES:  # models of which may not exist so far away
                return None
            own = None if probe.times(_FIRST) is None else probe.times(1)
            if own is None:
                break
            found.append(own)
        else:
            return found
    return None


class _Probe:
    """Models of a group of entries that change by nothing, a little, or much by parts of their own.

    Attributes:
        parts: (2, entries) of the last two models, each entry with its own.
    """

    def __init__(
        self, motion: Motion, build: Build, values: Values, name: str, entries: IntArray
    ) -> None:
        """Build the models (collective)."""
        self._motion, self._entries = motion, entries
        random, given = np.random.default_rng(0), values[name]
        ranks = np.array([random.permutation(len(entries)) for _ in range(2)])
        self.parts = (1.0 + ranks / len(entries)) * [[1.0], [-1.0]]
        little = difference_of(given[entries])
        self._ratio = (float(np.abs(given[entries]).max()) or 1.0) / little
        changes = [np.zeros(len(entries)), np.full(len(entries), little)]
        self._models = []
        for change in (*changes, *(self.parts * self._ratio * little)):
            moved = given.copy()
            moved[entries] += change
            self._models.append(beside(motion, build, {**values, name: moved}, name))
        self._starts = [_start(one) for one in self._models]
        still, *others = self._models
        self._columns = [DirectEffect(motion, [one, still]) for one in others]

    def times(self, stride: int) -> Times | None:
        """When each entry acts, from every so manyth step; None if several do (collective)."""
        motion, steps = self._motion, range(0, self._motion.steps + 1, stride)
        sums = np.zeros((2, len(steps), 5))
        for k, step in enumerate(steps):
            sums[0, k] = self._sums(self._equations(step) if step else self._starts)
            motion.go_to(step)
            own = [one.difference(step) for one in self._columns]
            sums[1, k] = self._sums([np.zeros_like(own[0]), *own])
        motion.system.comm.Allreduce(MPI.IN_PLACE, sums)
        owners = [self._owners(own) for own in sums]
        if owners[0] is None or owners[1] is None:
            return None
        return Times(self._entries, np.array(motion.times), owners[0], owners[1])

    def _equations(self, step: int) -> list[FloatArray]:
        """This rank's part of the equations of a step of each model, not scaled (collective)."""
        motion, found = self._motion, []
        motion.go_to_end(step)
        owned, scale = motion.system.constraints.owned, motion.scheme.shifts(step).scale
        for one in self._models:
            blocks, rows = evaluated(motion, one, step)
            found.append(np.concatenate([*(x.ravel() / scale for x in blocks), owned * rows]))
        return found

    @staticmethod
    def _sums(values: Sequence[FloatArray]) -> list[float]:
        """Squares of the three changes, and the first one times the others."""
        little, *much = (one - values[0] for one in values[1:])
        return [
            float(little @ little),
            *(float(one @ one) for one in much),
            *(float(one @ little) for one in much),
        ]

    def _owners(self, sums: FloatArray) -> IntArray | None:
        """Owner of each step, -1 for none, from sums of all ranks; None if there are several."""
        # what changes little is rounding, and compared by what changes much
        size = np.sqrt(sums[:, 1])
        scale = np.full(len(sums), size[1:].max(initial=0.0))
        scale[0] = 0.0  # the start differs from other steps
        found = np.full(len(sums), -1)
        for k in np.flatnonzero(size > _NOTHING * scale):
            little, products = sums[k, 0], sums[k, 3:] / self._ratio
            if little <= 0.0:
                return None
            parts = products / little
            place = int(np.argmin(np.abs(self.parts[0] - parts[0])))
            clear = np.abs(self.parts[:, place] - parts) <= _CLEAR / len(self._entries)
            rest = sums[k, 1:3] - sums[k, 3:] ** 2 / little
            if not (clear.all() and (rest <= _ALIKE**2 * sums[k, 1:3]).all()):
                return None
            found[k] = self._entries[place]
        return found


def _start(one: Simulation) -> FloatArray:
    """This rank's part of the start of a model."""
    states = [
        part.block.state()[name][: part.block.owned].ravel()
        for part in one.system.parts
        for name in ("frames", "velocity", "auxiliary", "acceleration")
    ]
    return np.concatenate([*states, one.system.constraints.owned * one.system.constraints.forces])
