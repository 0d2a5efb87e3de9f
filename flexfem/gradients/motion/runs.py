# SPDX-License-Identifier: LGPL-3.0-or-later
"""The adjoint of a motion from its end to its start, and the tangent from its start to its end."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from mpi4py import MPI

import numpy as np

from flexfem._checks import InputError
from flexfem._types import FloatArray
from flexfem.gradients.equations.carried import Carried
from flexfem.gradients.equations.linearized import LinearizedStep
from flexfem.gradients.motion.adjoint import Adjoint, Tangent
from flexfem.gradients.motion.arrays import Entry
from flexfem.gradients.motion.columns import ColumnDerivatives, Seeds, history_weights
from flexfem.gradients.motion.event_times import EventTimes, along
from flexfem.gradients.motion.functionals import TIME, Functional, by_last_time
from flexfem.gradients.motion.influence import Factors, Influence, NumberInfluence, Sums
from flexfem.gradients.motion.trajectory import Motion
from flexfem.gradients.schemes.base import Recursion
from flexfem.gradients.schemes.generalized_alpha import alpha_of
from flexfem.gradients.unilateral.impulses import Impulses, LeftDamping

__all__ = ["backward", "forward"]


#: Influences of parameters with the change of each.
Direction = Sequence[tuple[NumberInfluence | Entry, float]]
#: Relative accuracy of the adjoint that shows the growth.
_ROUGHLY = 1e-2


def backward(
    motion: Motion, linear: LinearizedStep, functionals: Sequence[Functional],
    influences: Mapping[str, Influence],
) -> tuple[FloatArray, float]:  # fmt: skip
    """Derivatives of functionals by all parameters (collective).

    Returns:
        (functionals, parameters), and the growth of an adjoint that begins at the end, of a
        functional of the end or of the sum of all columns: the largest of any step over that of the
        last one.
    """
    names = sorted({name for one in functionals for name in one.columns if name != TIME})
    columns = ColumnDerivatives(motion, names)
    count = len(functionals)
    weights = np.zeros((count, len(names), motion.steps + 1))
    history = motion.history()
    weights[:, :, motion.rows_at] = history_weights(
        functionals, names, len(motion.rows_at), history, motion.system.comm
    )
    adjoints = [Adjoint(motion) for _ in functionals]
    ending = np.flatnonzero(weights[:, :, -1].any(axis=1) & ~weights[:, :, :-1].any(axis=(1, 2)))
    if len(ending):
        growing = adjoints[ending[0]]
    else:
        growing = Adjoint(motion, _ROUGHLY)
        adjoints.append(growing)
        weights = np.append(weights, np.zeros((1, len(names), motion.steps + 1)), axis=0)
        weights[-1, :, -1] = 1.0  # the sum of all columns
    total = sum(one.count for one in influences.values())
    sums, sizes = np.zeros((count, total)), np.zeros(motion.steps + 1)

    measured = ColumnDerivatives(motion, motion.measured)

    def seed(step: int) -> None:
        if not weights[:, :, step].any():
            return
        motion.go_to(step)
        every = columns.every(weights[:count, :, step])
        seeds = [_seeds(motion, columns, step, own[:, step]) for own in weights]
        for adjoint, own in zip(adjoints, seeds, strict=True):
            adjoint.add(own)
        direct = [one.direct_products(step, every, seeds[:count]) for one in influences.values()]
        np.add(sums, np.hstack(direct), out=sums)

    def seed_memories(step: int) -> None:
        # the start is differentiated as a whole
        if motion.measured and step and motion.follows(step):
            motion.go_to(step)
            for adjoint in adjoints:
                own = motion.memories.weights(step, adjoint.remembered)
                adjoint.add(_seeds(motion, measured, step, own))

    events, impulses = EventTimes(motion), Impulses(motion.system, linear.tangent.forces)
    seed(motion.steps)
    if motion.grid.free(motion.steps):
        rates = events.rates(motion.steps, names)
        for adjoint, one, own in zip(adjoints, functionals, weights[:, :, -1], strict=False):
            adjoint.time = float(own @ rates) + (by_last_time(one, history) if history else 0.0)
    for step in range(motion.steps, 0, -1):
        if step in motion.grid.events:
            events.reach(step)
            changes = np.concatenate([one.event_changes(step) for one in influences.values()])
        left = _left(motion, step)
        motion.go_to_end(step)
        if motion.renewal is not None:
            motion.take_memories(step)
            for adjoint in adjoints:
                adjoint.renew(step, motion.renewal)
            events.renew(step, adjoints)
        else:
            over, kicks = motion.scheme.over(step, linear), list[Factors]()
            if motion.kicked(step):
                motion.take_memories(step)
                kicks = _kick(motion, over, impulses, adjoints)
                sums -= np.hstack(
                    [one.products(step, kicks[:count]) for one in influences.values()]
                )
                motion.go_to_end(step)
            linear.take(motion.scheme.shifts(step))
            motion.take_memories(step)
            size = events.size(over)
            for adjoint in adjoints:
                adjoint.step(over, size)
                if left is not None:
                    left.back(adjoint.carried, adjoint.z)
            for adjoint, (z, mu, nothing) in zip(adjoints, kicks, strict=False):
                more = motion.memories.back(nothing, z, 0.0 * mu)
                adjoint.remembered = adjoint.remembered + more
            for k, _ in enumerate(_beside(motion, over)):
                own = [(*one.beside[k], 0.0 * one.remembered) for one in adjoints[:count]]
                sums -= np.hstack([one.products(step, own) for one in influences.values()])
            factors = events.back(over, adjoints)
            if step in motion.grid.events:
                sums -= np.outer(factors[:count], changes) * (motion.system.comm.rank == 0)
            sizes[step] = sum(float((z**2).sum()) for z in growing.z)
        # the numbers of memories follow by their own equations, of the form s1 - N = 0
        every = [(one.z, one.mu, -one.arrived) for one in adjoints[:count]]
        sums -= np.hstack([one.products(step, every) for one in influences.values()])
        seed(step - 1)
        seed_memories(step - 1)
    motion.go_to(0)
    for adjoint in adjoints:
        adjoint.to_step(0)
    carried = [(one.carried, one.remembered, one.forces) for one in adjoints[:count]]
    sums += np.hstack([one.start_products(carried) for one in influences.values()])
    for values in (sums, sizes):
        motion.system.comm.Allreduce(MPI.IN_PLACE, values)
    return sums, float(np.sqrt(sizes.max() / sizes[-1])) if sizes[-1] else 1.0


def forward(
    motion: Motion, linear: LinearizedStep, columns: Sequence[str], directions: Sequence[Direction]
) -> FloatArray:
    """Derivatives (directions, rows, columns) of columns of a history (collective).

    Args:
        motion: the motion.
        linear: its linearised equations.
        columns: names, also that of the times.
        directions: each a list of parameters' influences and changes.
    """
    names = [name for name in columns if name != TIME]
    at, first = [columns.index(name) for name in names], motion.system.comm.rank == 0
    derivatives = ColumnDerivatives(motion, names)
    measured = ColumnDerivatives(motion, motion.measured)
    tangents = [Tangent(motion, *_start(motion, own)) for own in directions]
    found = np.zeros((len(directions), len(motion.rows_at), len(columns)))
    row_of = {int(step): row for row, step in enumerate(motion.rows_at)}
    events, impulses = EventTimes(motion), Impulses(motion.system, linear.tangent.forces)
    for step in range(motion.steps + 1):
        if step:
            if step in motion.grid.events:
                events.reach(step)
                moved = [_at_event(step, own) for own in directions]
            left = _left(motion, step)
            motion.go_to_end(step)
            if motion.renewal is None:
                linear.take(motion.scheme.shifts(step))
            motion.take_memories(step)
            every = _changes(motion, step, directions)
            changes = [(blocks, rows) for blocks, rows, _ in every]
            if motion.renewal is not None:
                events.renew_ahead(step, tangents, changes)
            else:
                over = motion.scheme.over(step, linear)
                size = events.size(over)
                others = [_changes(motion, step, directions) for _ in _beside(motion, over)]
                for k, (tangent, (blocks, rows)) in enumerate(zip(tangents, changes, strict=True)):
                    change = blocks, rows
                    if left is not None:
                        more = left.changes(tangent.carried)
                        change = [a + b for a, b in zip(blocks, more, strict=True)], rows
                    own_size = None if size is None else (size, -tangent.time)
                    beside = [(own[k][0], own[k][1]) for own in others]
                    tangent.step(over, change, own_size, beside)
                if step in motion.grid.events:
                    events.ahead(over, list(zip(tangents, moved, strict=True)))
                else:
                    for tangent in tangents:
                        tangent.time = 0.0
                if motion.kicked(step):
                    _kick_ahead(motion, over, impulses, (tangents, directions))
            if motion.follows(step):
                _arrive(motion, measured, step, (tangents, every))
        if step not in row_of:
            continue
        motion.go_to(step)
        row, places = row_of[step], [motion.columns.index(name) for name in names]
        seeds = [_seeds(motion, derivatives, step, one) for one in np.eye(len(names))]
        for values, direction in zip(found, directions, strict=True):
            for influence, factor in direction:
                if influence.depends_directly:
                    values[row, at] += factor * influence.columns(step)[places]
                    values[row, at] -= [factor * influence.followed(step, own) for own in seeds]
        for values, tangent in zip(found, tangents, strict=True):
            values[row, at] += [along(motion, own, tangent) for own in seeds]
        rates = events.rates(step, names)
        for values, tangent in zip(found, tangents, strict=True):
            values[row, at] += tangent.time * rates
            if TIME in columns and first and motion.grid.free(step):
                values[row, columns.index(TIME)] = tangent.time
    motion.system.comm.Allreduce(MPI.IN_PLACE, found)
    return found


def _seeds(motion: Motion, columns: ColumnDerivatives, step: int, weights: FloatArray) -> Seeds:
    """Derivatives of columns times weights at the accepted state after a step (collective).

    Raises:
        InputError: impulses have a part in accelerations, or drives at an event in forces.
    """
    found = columns.seeds(step, weights)
    if motion.grid.free(step):  # rates of drives depend on its time
        driven = bool(found.forces.any()) and motion.system.constraints.driven
        if motion.system.comm.allreduce(driven, op=MPI.LOR):
            raise InputError(
                "gradient: there are no derivatives of forces of joints with drives in rows at "
                "times of events yet; take equal steps, or another number"
            )
    _check_accelerations(motion, step, [found])
    return found


def _check_accelerations(motion: Motion, step: int, seeds: Sequence[Seeds]) -> None:
    """Refuse derivatives by accelerations in a step with impulses (collective)."""
    if motion.kicked(step):
        measured = any(own.accelerations.any() for one in seeds for own in one.blocks)
        if motion.system.comm.allreduce(measured, op=MPI.LOR):
            raise InputError(
                "gradient: there are no derivatives of accelerations in steps with impulses yet; "
                "leave them out"
            )


def _beside(motion: Motion, over: Recursion) -> Iterator[None]:
    """Go to the neighbours of the end of a step, and return to it (collective)."""
    for equations in over.neighbours():
        motion.between, motion.equations = equations, None
        yield
    motion.between, motion.equations = None, None


def _left(motion: Motion, step: int) -> LeftDamping | None:
    """What accelerations before a step lack of damping; None if nothing (collective)."""
    if motion.grid.renewal(step) is not None or not (h := motion.lacking(step)):
        return None
    taken = motion.grid.step(step)
    motion.go_to(step - 1)
    scheme = alpha_of(taken.scheme)
    share = scheme.weight - 1.0 + scheme.unseen
    return LeftDamping(motion.system, share * motion.scheme.shifts(step).scale * h)


def _take(motion: Motion, step: int, impulses: Impulses) -> None:
    """Linearise the impulses at the end of a step (collective)."""
    motion.go_to_end(step)
    taken = motion.grid.step(step)
    shifts = motion.scheme.shifts(step)
    impulses.take(alpha_of(taken.scheme), taken.h, shifts, motion.state(step))
    motion.between = impulses


def _kick(
    motion: Motion, over: Recursion, impulses: Impulses, adjoints: Sequence[Adjoint]
) -> list[Factors]:
    """Go back over the impulses of a step; returns factors of their equations (collective)."""
    _take(motion, over.step, impulses)
    found = []
    for adjoint in adjoints:
        adjoint.arrive(over)
        z, mu, adjoint.impulsive = impulses.back(adjoint.carried, over.maps)
        found.append((z, mu, np.zeros(len(motion.memories.owned))))
    return found


def _kick_ahead(
    motion: Motion, over: Recursion, impulses: Impulses,
    moved: tuple[Sequence[Tangent], Sequence[Direction]],
) -> None:  # fmt: skip
    """Go over the impulses at the end of a step (collective)."""
    tangents, directions = moved
    _take(motion, over.step, impulses)
    changes = _changes(motion, over.step, directions)
    for tangent, (blocks, rows, _) in zip(tangents, changes, strict=True):
        # laws of force elements have their forces from the step
        more = motion.memories.equations(tangent.recalled)
        total = blocks if more is None else [a + b for a, b in zip(blocks, more[0], strict=True)]
        impulses.ahead(tangent.carried, over.maps, (total, rows), tangent.multipliers)
        tangent.lead(over.step)


def _changes(motion: Motion, step: int, directions: Sequence[Direction]) -> list[Factors]:
    """Changes of the present equations along directions, each parameter's once (collective)."""
    once = {id(one): one.equations(step) for own in directions for one, _ in own}
    return [_combined(motion, own, once) for own in directions]


def _arrive(
    motion: Motion, measured: ColumnDerivatives, step: int,
    changed: tuple[Sequence[Tangent], Sequence[Factors]],
) -> None:  # fmt: skip
    """Changes of the memories' numbers after a step, with what parameters change (collective)."""
    seeds = []
    if motion.measured:
        motion.go_to(step)
        seeds = measured.each(step)
        _check_accelerations(motion, step, seeds)
    for tangent, (*_, numbers) in zip(*changed, strict=True):
        changes = np.array([along(motion, own, tangent) for own in seeds])
        motion.system.comm.Allreduce(MPI.IN_PLACE, changes)
        arrived = motion.memories.arrive(step, tangent.remembered, changes)
        tangent.remembered = arrived + numbers


def _at_event(state: int, direction: Direction) -> float:
    """Change of the function of an event along a direction, at a fixed state (collective)."""
    return sum(factor * float(one.event_changes(state)[0]) for one, factor in direction)


def _start(motion: Motion, direction: Direction) -> Sums:
    """Changes of the start along a direction, of the memories' numbers and of the forces there."""
    found = [Carried.nothing(part.block.owned_step.shape) for part in motion.system.parts]
    numbers = np.zeros(len(motion.memories.owned))
    forces = np.zeros(motion.system.constraints.size)
    for influence, factor in direction:
        for total, own in zip(found, influence.start, strict=True):
            total.add(own, factor)
        numbers += factor * influence.numbers
        forces += factor * influence.forces
    return found, numbers, forces


def _combined(motion: Motion, direction: Direction, equations: Mapping[int, Factors]) -> Factors:
    """Change of the equations along a direction."""
    blocks = [np.zeros_like(part.block.owned_step) for part in motion.system.parts]
    rows = np.zeros(motion.system.constraints.size)
    numbers = np.zeros(len(motion.memories.owned))
    for influence, factor in direction:
        own, own_rows, own_numbers = equations[id(influence)]
        blocks = [a + factor * b for a, b in zip(blocks, own, strict=True)]
        rows = rows + factor * own_rows
        numbers = numbers + factor * own_numbers
    return blocks, rows, numbers
