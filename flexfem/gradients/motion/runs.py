# SPDX-License-Identifier: LGPL-3.0-or-later
"""The adjoint of a motion from its end to its start, and the tangent from its start to its end."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from mpi4py import MPI

import numpy as np

from flexfem._types import FloatArray
from flexfem.gradients.equations.linearized import LinearizedStep
from flexfem.gradients.motion.adjoint import CARRIED, Adjoint, Carried, Tangent, maps_of
from flexfem.gradients.motion.columns import ColumnDerivatives, history_weights
from flexfem.gradients.motion.functionals import Functional
from flexfem.gradients.motion.influence import Factors, Influence, NumberInfluence
from flexfem.gradients.motion.trajectory import Motion

__all__ = ["backward", "forward"]


#: Influences of parameters with the change of each.
Direction = Sequence[tuple[NumberInfluence, float]]
#: Relative accuracy of the adjoint that shows the growth.
_ROUGHLY = 1e-2


def backward(
    motion: Motion, linear: LinearizedStep, functionals: Sequence[Functional],
    influences: Mapping[str, Influence],
) -> tuple[FloatArray, float]:  # fmt: skip
    """Derivatives of functionals by all parameters (collective).

    Returns:
        (functionals, parameters), and the growth of an adjoint that begins with the sum of all
        columns at the end: the largest of any step over that of the last one.
    """
    names = sorted({name for one in functionals for name in one.columns})
    columns = ColumnDerivatives(motion, names)
    weights = np.zeros((len(functionals) + 1, len(names), motion.steps + 1))
    weights[:-1, :, motion.rows_at] = history_weights(
        functionals, names, len(motion.rows_at), motion.history(), motion.system.comm
    )
    weights[-1, :, -1] = 1.0  # the sum of all columns at the end
    adjoints = [*(Adjoint(motion) for _ in functionals), Adjoint(motion, _ROUGHLY)]
    total = sum(one.count for one in influences.values())
    sums, sizes = np.zeros((len(functionals), total)), np.zeros(motion.steps + 1)

    def seed(step: int) -> None:
        if not weights[:, :, step].any():
            return
        motion.go_to(step)
        every = columns.every(weights[:-1, :, step])
        direct = [one.direct_products(step, every) for one in influences.values()]
        np.add(sums, np.hstack(direct), out=sums)
        for adjoint, own in zip(adjoints, weights, strict=True):
            if own[:, step].any():
                adjoint.add(columns.seeds(step, own[:, step]))

    seed(motion.steps)
    for step in range(motion.steps, 0, -1):
        motion.go_to_end(step)
        linear.take(motion.laws(step).shifts)
        maps = maps_of(motion, step)
        for adjoint in adjoints:
            adjoint.step(step, linear, maps)
        sizes[step] = sum(float((z**2).sum()) for z in adjoints[-1].z)
        factors = [(one.z, one.mu) for one in adjoints[:-1]]
        sums -= np.hstack([one.products(step, factors) for one in influences.values()])
        seed(step - 1)
    motion.go_to(0)
    for adjoint in adjoints:
        adjoint.to_step(0)
    carried = [one.carried for one in adjoints[:-1]]
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
        columns: names.
        directions: each a list of parameters' influences and changes.
    """
    derivatives = ColumnDerivatives(motion, columns)
    tangents = [Tangent(motion, _start(motion, own)) for own in directions]
    found = np.zeros((len(directions), len(motion.rows_at), len(columns)))
    row_of = {int(step): row for row, step in enumerate(motion.rows_at)}
    for step in range(motion.steps + 1):
        if step:
            motion.go_to_end(step)
            linear.take(motion.laws(step).shifts)
            maps = maps_of(motion, step)
            once = {
                id(one): one.equations(step) for own in directions for one, _ in own
            }  # each parameter's
            for tangent, own in zip(tangents, directions, strict=True):
                tangent.step(step, linear, maps, _combined(motion, own, once))
        if step not in row_of:
            continue
        motion.go_to(step)
        row, places = row_of[step], [motion.columns.index(name) for name in columns]
        for values, own in zip(found, directions, strict=True):
            for influence, factor in own:
                if influence.depends_directly:
                    values[row] += factor * influence.columns(step)[places]
        for k in range(len(columns)):
            one = Adjoint(motion)
            one.add(derivatives.seeds(step, np.eye(1, len(columns), k)[0]))
            for values, tangent in zip(found, tangents, strict=True):
                values[row, k] += sum(
                    float((getattr(a, name) * getattr(b, name)).sum())
                    for a, b in zip(one.carried, tangent.carried, strict=True)
                    for name in CARRIED
                )
    motion.system.comm.Allreduce(MPI.IN_PLACE, found)
    return found


def _start(motion: Motion, direction: Direction) -> list[Carried]:
    """Change of the start along a direction."""
    found = [Carried.nothing(part.block.owned_step.shape) for part in motion.system.parts]
    for influence, factor in direction:
        for total, own in zip(found, influence.start, strict=True):
            for name in CARRIED:
                getattr(total, name)[:] += factor * getattr(own, name)
    return found


def _combined(motion: Motion, direction: Direction, equations: Mapping[int, Factors]) -> Factors:
    """Change of the equations along a direction."""
    blocks = [np.zeros_like(part.block.owned_step) for part in motion.system.parts]
    rows = np.zeros(motion.system.constraints.size)
    for influence, factor in direction:
        own, own_rows = equations[id(influence)]
        blocks = [a + factor * b for a, b in zip(blocks, own, strict=True)]
        rows = rows + factor * own_rows
    return blocks, rows
