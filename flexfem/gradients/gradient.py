# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gradients of a motion by its adjoint, and derivatives of its history by the tangent."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from mpi4py import MPI

import numpy as np

from flexfem import _checks
from flexfem._types import FloatArray
from flexfem.analyses.dynamics import RunOptions
from flexfem.gradients.adjoint import CARRIED, Adjoint, Carried, Tangent, maps_of
from flexfem.gradients.columns import ColumnDerivatives
from flexfem.gradients.functionals import Functional, parse
from flexfem.gradients.linearized import LinearizedStep
from flexfem.gradients.parameters import Build, Influence, build_of, values_at
from flexfem.gradients.trajectory import Motion
from flexfem.model.model import Model

__all__ = ["Gradient", "TangentMotion", "gradient", "tangent_motion"]

#: Relative accuracy of the linearised equations.
SOLVED = 1e-8
#: Growth of the adjoint over the motion from which on it is of little use.
_GROWTH = 1e4


@dataclass(frozen=True)
class Gradient:
    """Values of functionals of a motion and their derivatives.

    Attributes:
        value: of each functional by its name.
        gradient: its derivatives by the parameters' names.
        history: columns of the motion, on the first rank.
        wall_seconds_forward, wall_seconds_backward: s.
        factorizations_forward, factorizations_backward: numbers of factorisations of the bodies.
        applications: products with the exact linearised equations backwards.
        growth: largest adjoint of any step over that of the last one, for each functional: motions
            that grow by more than about 1e4 are chaotic, and their gradients useless for descent.
        warnings: what should be known before the gradient is used.
    """

    value: Mapping[str, float]
    gradient: Mapping[str, Mapping[str, float]]
    history: Mapping[str, FloatArray] = field(repr=False)
    wall_seconds_forward: float
    wall_seconds_backward: float
    factorizations_forward: int
    factorizations_backward: int
    applications: int
    growth: Mapping[str, float]
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class TangentMotion:
    """Derivatives of the columns of a history along one direction of the parameters.

    Attributes:
        history: columns of the motion by name, (n,), "t" among them; on the first rank.
        derivative: derivatives of columns by name, (n,), on the first rank.
    """

    history: Mapping[str, FloatArray]
    derivative: Mapping[str, FloatArray]


def gradient(
    model: Model | Callable[..., Model],
    of: str | Functional | Sequence[str | Functional],
    wrt: Sequence[str] | Mapping[str, float],
    options: RunOptions,
    *,
    ks_rho: float | None = None,
    accuracy: float = SOLVED,
    comm: MPI.Intracomm | None = None,
) -> Gradient:
    """Derivatives of numbers of a motion by any number of parameters (collective).

    The motion is computed once, with Newton steps to 1e-9 at least, and its discrete adjoint goes
    back over the same steps with the same factors::

        found = ff.gradient(model, "final:tip_z", ["rod.mass", "spring.stiffness"], options)
        found.gradient["final:tip_z"]["spring.stiffness"]

    Args:
        model: the model; or a function that builds it from numbers with the names in ``wrt``, such
            as the ``build`` of a case.
        of: functionals, such as "final:tip_x": final, mean, integral, rms, max, min or ks of a
            column of a :class:`Probe`; or :class:`Functional`.
        wrt: parameters: paths into a model ("rod.mass", "spring.stiffness", "gravity[2]",
            "rod.velocity[0]"), or values of the arguments of a function by their names.
        options: those of the motion.
        ks_rho: of "ks", one over the unit of the column.
        accuracy: relative accuracy of the linearised equations of a step.
        comm: communicator, all ranks by default.

    Raises:
        InputError: a mistake in the model or in a name, or something in it that has no derivative
            yet (a ValueError).
        TypeError: an argument has the wrong type.
        StoppedError: the motion does not come to its end, or its linearised equations cannot be
            solved (a RuntimeError).
    """
    _checks.instance("gradient", "options", options, RunOptions)
    begin = time.perf_counter()
    functionals = _functionals(of, ks_rho)
    build, values = _parameters(model, wrt)
    motion = Motion(build(**values), options, comm)
    names = sorted({name for one in functionals for name in one.columns})
    columns = ColumnDerivatives(motion, names)
    influences = {name: Influence(motion, build, values, name) for name in values}
    forward, middle = motion.system.counters.factorizations, time.perf_counter()
    back = _Backward(motion, columns, influences, accuracy)
    found = back.run(functionals, names)
    sums, growth = found
    warnings = [
        f"{one.name}: its derivatives grow {size:.0e} times over the motion, which is chaotic: they "
        "are those of the computed motion, and of little use for descent"
        for one, size in zip(functionals, growth, strict=True)
        if size > _GROWTH
    ]
    history = _history(motion)
    return Gradient(
        value=_values_of(motion, functionals, history),
        gradient={
            one.name: dict(zip(values, row.tolist(), strict=True))
            for one, row in zip(functionals, sums, strict=True)
        },
        history=history,
        wall_seconds_forward=middle - begin,
        wall_seconds_backward=time.perf_counter() - middle,
        factorizations_forward=forward,
        factorizations_backward=back.linear.factorizations,
        applications=back.linear.applications,
        growth=dict(zip((one.name for one in functionals), growth, strict=True)),
        warnings=tuple(warnings),
    )


def tangent_motion(
    model: Model | Callable[..., Model],
    wrt: Mapping[str, float],
    direction: Mapping[str, float],
    options: RunOptions,
    *,
    columns: Sequence[str] | None = None,
    accuracy: float = SOLVED,
    comm: MPI.Intracomm | None = None,
) -> TangentMotion:
    """Derivatives of columns of a history along one direction of parameters (collective).

    Args:
        model, options, accuracy, comm: see :func:`gradient`.
        wrt: parameters with their values; those of a model are its own.
        direction: change of each parameter, in its unit; others do not change.
        columns: names; all columns of every :class:`Probe` by default.

    Raises:
        InputError, TypeError, StoppedError: see :func:`gradient`.
    """
    _checks.instance("tangent_motion", "options", options, RunOptions)
    build, values = _parameters(model, wrt)
    for name in direction:
        if name not in values:
            raise ValueError(f'tangent_motion: direction names "{name}", which is no parameter')
    motion = Motion(build(**values), options, comm)
    chosen = motion.columns if columns is None else list(columns)
    derivatives = ColumnDerivatives(motion, chosen)
    influences = {name: Influence(motion, build, values, name) for name in direction}
    linear = LinearizedStep(motion.system, motion.policy, accuracy)
    found = _forward(motion, derivatives, influences, (direction, linear, len(chosen)))
    return TangentMotion(_history(motion), dict(zip(chosen, found.T, strict=True)))


class _Backward:
    """The backward run of several functionals together."""

    def __init__(
        self, motion: Motion, columns: ColumnDerivatives, influences: Mapping[str, Influence],
        accuracy: float,
    ) -> None:  # fmt: skip
        self._motion, self._columns, self._influences = motion, columns, influences
        self.linear = LinearizedStep(motion.system, motion.policy, accuracy)

    def run(
        self, functionals: Sequence[Functional], names: Sequence[str]
    ) -> tuple[FloatArray, list[float]]:
        """Gradients (functionals, parameters), and growth of each adjoint (collective)."""
        motion, comm = self._motion, self._motion.system.comm
        weights = _weights(motion, functionals, names)
        adjoints = [Adjoint(motion) for _ in functionals]
        sums = np.zeros((len(functionals), len(self._influences)))
        sizes = np.zeros((len(functionals), motion.steps + 1))
        self._seed(adjoints, weights, motion.steps)
        for step in range(motion.steps, 0, -1):
            motion.go_to_end(step)
            self.linear.take(motion.laws.shifts)
            maps = maps_of(motion, step)
            changes = [one.equations(step) for one in self._influences.values()]
            for k, adjoint in enumerate(adjoints):
                adjoint.step(self.linear, maps)
                sums[k] -= [_product(motion, adjoint.z, adjoint.mu, *one) for one in changes]
                sizes[k, step] = sum(float((z**2).sum()) for z in adjoint.z)
            self._seed(adjoints, weights, step - 1)
        starts = [one.start for one in self._influences.values()]
        for k, adjoint in enumerate(adjoints):
            for p, blocks in enumerate(starts):
                for own, start in zip(adjoint.carried, blocks, strict=True):
                    for name in CARRIED:
                        sums[k, p] += float((getattr(own, name) * getattr(start, name)).sum())
        comm.Allreduce(MPI.IN_PLACE, sums)
        comm.Allreduce(MPI.IN_PLACE, sizes)
        return sums, [_growth(row) for row in sizes]

    def _seed(self, adjoints: Sequence[Adjoint], weights: FloatArray, step: int) -> None:
        """Go to an accepted state and add the functionals' own derivatives there."""
        motion = self._motion
        motion.go_to(step)
        for adjoint, own in zip(adjoints, weights, strict=True):
            if own[:, step].any():
                adjoint.add(self._columns.seeds(step, own[:, step]))


def _forward(
    motion: Motion, derivatives: ColumnDerivatives, influences: Mapping[str, Influence],
    along: tuple[Mapping[str, float], LinearizedStep, int],
) -> FloatArray:  # fmt: skip
    """Derivatives (steps + 1, columns) along a direction (collective)."""
    direction, linear, count = along
    starts = {name: one.start for name, one in influences.items()}
    tangent = Tangent(motion, _combined(motion, direction, starts))
    found = np.zeros((motion.steps + 1, count))
    for step in range(motion.steps + 1):
        if step:
            motion.go_to_end(step)
            linear.take(motion.laws.shifts)
            maps = maps_of(motion, step)
            blocks = [np.zeros_like(own.q) for own in tangent.carried]
            rows = np.zeros(motion.system.constraints.size)
            for name, one in influences.items():
                own, own_rows = one.equations(step)
                blocks = [a + direction[name] * b for a, b in zip(blocks, own, strict=True)]
                rows = rows + direction[name] * own_rows
            tangent.step(linear, maps, blocks, rows)
        motion.go_to(step)
        for k in range(count):
            seeds = derivatives.seeds(step, np.eye(1, count, k)[0])
            one = Adjoint(motion)
            one.add(seeds)
            found[step, k] = sum(
                float((getattr(a, name) * getattr(b, name)).sum())
                for a, b in zip(one.carried, tangent.carried, strict=True)
                for name in ("q", "v", "w")
            )
    motion.system.comm.Allreduce(MPI.IN_PLACE, found)
    return found


def _combined(
    motion: Motion, direction: Mapping[str, float], starts: Mapping[str, list[Carried]]
) -> list[Carried]:
    """Change of the start along a direction, for each block."""
    found = [Carried.nothing(part.block.owned_step.shape) for part in motion.system.parts]
    for name, factor in direction.items():
        for total, own in zip(found, starts[name], strict=True):
            for part in CARRIED:
                getattr(total, part)[:] += factor * getattr(own, part)
    return found


def _product(
    motion: Motion, z: list[FloatArray], mu: FloatArray, blocks: list[FloatArray], rows: FloatArray
) -> float:
    """This rank's part of ``z . blocks + mu . rows``."""
    owned = motion.system.constraints.owned
    own = sum(float((a * b).sum()) for a, b in zip(z, blocks, strict=True))
    return own + float(mu @ (owned * rows))


def _functionals(
    of: str | Functional | Sequence[str | Functional], ks_rho: float | None
) -> list[Functional]:
    every = [of] if isinstance(of, str | Functional) else list(of)
    found = [parse(one, ks_rho) if isinstance(one, str) else one for one in every]
    if not found:
        raise ValueError("gradient: nothing to derive, name functionals")
    return found


def _parameters(
    model: Model | Callable[..., Model], wrt: Sequence[str] | Mapping[str, float]
) -> tuple[Build, dict[str, float]]:
    """Function that builds the model, and the values of the parameters."""
    if isinstance(model, Model):
        build, values = build_of(model, list(wrt))
        return build, values_at(values)
    if not callable(model):
        raise TypeError(f"gradient: give a Model or a function that builds one, got {model!r}")
    if not isinstance(wrt, Mapping):
        raise TypeError("gradient: with a function, wrt must be values by name")
    return model, values_at(wrt)


def _history(motion: Motion) -> dict[str, FloatArray]:
    """Columns by name, on the first rank."""
    if motion.system.comm.rank:
        return {}
    return {"t": motion.times, **dict(zip(motion.columns, motion.values.T, strict=True))}


def _values_of(
    motion: Motion, functionals: Sequence[Functional], history: Mapping[str, FloatArray]
) -> dict[str, float]:
    """Values of functionals, on all ranks (collective)."""
    own = {one.name: one.value(history) for one in functionals} if history else None
    found: dict[str, float] = motion.system.comm.bcast(own)
    return found


def _weights(motion: Motion, functionals: Sequence[Functional], names: Sequence[str]) -> FloatArray:
    """Derivatives (functionals, columns, rows) by the history, on all ranks (collective)."""
    found = np.zeros((len(functionals), len(names), motion.steps + 1))
    if motion.system.comm.rank == 0:
        history = _history(motion)
        for own, one in zip(found, functionals, strict=True):
            for name, row in zip(one.columns, one.derivative(history), strict=True):
                own[names.index(name)] += row
    motion.system.comm.Bcast(found)
    return found


def _growth(squares: FloatArray) -> float:
    """Largest of the sizes over that of the latest that is not zero."""
    last = squares[squares > 0.0]
    return float(np.sqrt(squares.max() / last[-1])) if len(last) else 0.0
