# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gradients of motions, equilibria and modes, and derivatives of motions by the tangent."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._types import FloatArray
from flexfem.analyses.dynamics import RunOptions
from flexfem.gradients.equations.linearized import LinearizedStep
from flexfem.gradients.motion.arrays import Known
from flexfem.gradients.motion.exactness import linearized
from flexfem.gradients.motion.functionals import TIME, Functional, change
from flexfem.gradients.motion.influence import NumberInfluence
from flexfem.gradients.motion.parameters import Build, Values, along, check_names, parameters, plain
from flexfem.gradients.motion.records import MEMORY, Storage
from flexfem.gradients.motion.runs import backward, forward
from flexfem.gradients.motion.support import check_columns, differentiable
from flexfem.gradients.motion.trajectory import Motion, StoppedError
from flexfem.gradients.shapes.node_influence import influences_of
from flexfem.gradients.states.analyses import Options, found_at, numbers_of
from flexfem.gradients.states.neighbours import by_name
from flexfem.model.model import Model

__all__ = [
    "SOLVED",
    "Differentiation",
    "Gradient",
    "TangentMotion",
    "gradient",
    "tangent_motion",
]

#: Relative accuracy of the linearised equations.
SOLVED = 1e-8
#: Growth of the adjoint over the motion from which on it is of little use.
_GROWTH = 1e4
_CHAOTIC = (
    "the adjoint grows {:.0e} times over the motion, which is chaotic: the gradient is that of the "
    "computed motion, and of little use for descent"
)
#: Relative difference of adjoint and tangent from which on there is a warning.
_APART = 1e-4
_INACCURATE = (
    'adjoint and tangent of "{}" differ by {:.0e} of its derivatives, which are not more accurate: '
    "take a smaller accuracy, if equations of steps are not nearly singular"
)


@dataclass(frozen=True)
class Gradient:
    """Values of functionals and their derivatives.

    Attributes:
        value: of each functional by its name.
        gradient: its derivatives by the parameters' names, of the shapes of arrays.
        history: columns of the motion or of the load steps, or numbers of the modes or of the
            linear model, on the first rank.
        wall_seconds_forward, wall_seconds_backward: s.
        factorizations_forward, factorizations_backward: numbers of factorisations of the bodies.
        applications: products with the exact linearised equations backwards.
        steps_repeated: steps that were taken again, as not all states fit in the memory.
        check: relative difference of the derivatives along a random direction of the numbers among
            the parameters, between adjoint and tangent, for each functional; empty if not checked,
            or if there are arrays alone.
        growth: largest adjoint of any step over that of the last one: motions in which it grows by
            more than about 1e4 are chaotic, and their gradients useless for descent.
        warnings: what should be known before the gradient is used.
        at: values of the parameters, those of nodes their places, m.
    """

    value: Mapping[str, float]
    gradient: Mapping[str, Mapping[str, float | FloatArray]]
    history: Mapping[str, FloatArray] = field(repr=False)
    wall_seconds_forward: float
    wall_seconds_backward: float
    factorizations_forward: int
    factorizations_backward: int
    applications: int
    steps_repeated: int
    growth: float
    check: Mapping[str, float]
    warnings: tuple[str, ...] = ()
    at: Mapping[str, float | FloatArray] = field(default_factory=dict, repr=False)


@dataclass(frozen=True)
class TangentMotion:
    """Derivatives of the columns of a history along one direction of the parameters.

    Attributes:
        history: columns of the motion by name, (n,), "t" among them; on the first rank.
        derivative: derivatives of columns by name, (n,), on the first rank.
    """

    history: Mapping[str, FloatArray]
    derivative: Mapping[str, FloatArray]


class Differentiation:
    """Functionals of an analysis of models that differ in the values of their parameters alone.

    What is found out about a model's parameters with some values serves for others as well.
    """

    def __init__(
        self, build: Build, of: str | Functional | Sequence[str | Functional],
        options: Options, *, ks_rho: float | None = None, accuracy: float = SOLVED,
        storage: Storage | None = None, comm: MPI.Intracomm | None = None,
    ) -> None:  # fmt: skip
        """Store the arguments of :func:`gradient`."""
        self._build, self._options, self._comm = build, options, comm
        self.functionals = numbers_of(of, ks_rho, options)
        self._accuracy, self._storage = accuracy, storage or Storage()
        self._known: Known = {}

    def at(self, values: Values, *, check: bool = False) -> Gradient:
        """Derivatives at values of all parameters (collective)."""
        made, options = made_of(self._build, values), self._options
        if isinstance(options, RunOptions):
            return _finite(self._of_motion(made, options, values, check=check))
        if check:
            raise ValueError("gradient: check compares adjoint and tangent of motions only")
        begin = time.perf_counter()
        comm = self._comm or MPI.COMM_WORLD
        found = found_at(made, self.functionals, (self._build, values), options, comm)
        return _finite(Gradient(
            value=found.value, gradient=found.gradient, history=found.history,
            wall_seconds_forward=found.middle - begin,
            wall_seconds_backward=time.perf_counter() - found.middle,
            factorizations_forward=found.factorizations[0],
            factorizations_backward=found.factorizations[1],
            applications=0, steps_repeated=0, growth=1.0, check={}, at=plain(values),
        ))  # fmt: skip

    def value(self, values: Values) -> Mapping[str, float]:
        """Values of the functionals alone (collective)."""
        made, options = made_of(self._build, values), self._options
        if isinstance(options, RunOptions):
            return _values(*self._moved(made, options))
        comm = self._comm or MPI.COMM_WORLD
        return found_at(made, self.functionals, (self._build, {}), options, comm).value

    def _moved(self, made: Model, options: RunOptions) -> tuple[Motion, list[Functional]]:
        """The motion of a model, and the functionals, whose columns it has (collective)."""
        functionals = [one for one in self.functionals if isinstance(one, Functional)]
        wanted = [name for one in functionals for name in one.columns]
        check_columns(made, wanted)
        return Motion(made, options, self._comm, self._storage, wanted), functionals

    def _of_motion(
        self, made: Model, options: RunOptions, values: Values, *, check: bool
    ) -> Gradient:  # fmt: skip
        """Derivatives of a motion (collective)."""
        begin = time.perf_counter()
        build, (motion, functionals) = self._build, self._moved(made, options)
        history = motion.history()
        done, middle = motion.system.counters.factorizations, time.perf_counter()
        influences = influences_of(motion, build, values, self._known)
        linear = linearized(motion, self._accuracy)
        sums, growth = backward(motion, linear, functionals, influences)
        found = [by_name(row, values) for row in sums]
        numbers = {n: one for n, one in influences.items() if isinstance(one, NumberInfluence)}
        checked = check and bool(numbers)
        differences = _check(motion, linear, (functionals, found), numbers) if checked else {}
        return Gradient(
            value=_values(motion, functionals),
            gradient={one.name: own for one, own in zip(functionals, found, strict=True)},
            check=differences,
            history=history,
            wall_seconds_forward=middle - begin,
            wall_seconds_backward=time.perf_counter() - middle,
            factorizations_forward=done,
            factorizations_backward=linear.factorizations,
            applications=linear.applications,
            steps_repeated=motion.steps_repeated,
            growth=growth,
            warnings=_warnings(growth, differences),
            at=plain(values),
        )


def gradient(
    model: Model | Callable[..., Model],
    of: str | Functional | Sequence[str | Functional],
    wrt: Sequence[str] | Mapping[str, npt.ArrayLike],
    options: Options,
    *,
    ks_rho: float | None = None,
    accuracy: float = SOLVED,
    memory: float = MEMORY,
    scratch: str | Path | None = None,
    check: bool = False,
    comm: MPI.Intracomm | None = None,
) -> Gradient:
    """Derivatives of numbers of an analysis by any number of parameters (collective).

    A motion (``RunOptions``) is computed once, with Newton steps to 1e-9 at least, and its discrete
    adjoint goes back over the same steps with the same factors::

        found = ff.gradient(model, "final:tip_z", ["rod.mass", "spring.stiffness"], options)
        found.gradient["final:tip_z"]["spring.stiffness"]

    Equilibria under increasing loads (``StaticOptions``) take one transposed solve for each row of
    the history on which a number depends; ``buckling:1`` is the first load factor of linearised
    buckling from the first and the last equilibrium. With ``ModeOptions`` the numbers are
    ``frequency:1`` (Hz), ``damping:1`` and so on, about the state of the options; the mean of those
    that are equal is ``frequency:1-2``. With ``LinearOptions`` they are gains and phases (rad) of
    frequency responses from the inputs to the outputs of :func:`linearize`, with all degrees of
    freedom, ``gain:tip_z/push@12.5`` at 12.5 Hz; these are also the columns, each of one row, of a
    :class:`Functional`.

    Args:
        model: the model; or a function that builds it from numbers with the names in ``wrt``, such
            as the ``build`` of a case.
        of: functionals, such as "final:tip_x": final, mean, integral, rms, max, min or ks of a
            column of a :class:`Probe`, over time or over the load factor; or :class:`Functional`.
        wrt: parameters: paths into a model ("rod.mass", "spring.stiffness", "gravity[2]",
            "rod.velocity[0]"), to the places (n, 3) of the nodes of a group ("mesh.nodes[free]",
            "surface.nodes[edge]", "bracket.mesh.nodes[notch]"), or values of the arguments of a
            function by their names: numbers, or arrays of one or two axes, such as one stiffness
            for each element.
        options: those of the motion, the equilibria, the modes or the linear model.
        ks_rho: of "ks", one over the unit of the column.
        accuracy: relative accuracy of the linearised equations of a step of a motion.
        check: compare with the tangent of a motion along a random direction, which takes as long
            again.
        memory: largest number of bytes for states of a motion on each rank; with less, states are
            computed once more.
        scratch: folder in which states that do not fit are kept instead, in a file of each rank
            that is removed in the end.
        comm: communicator, all ranks by default.

    Raises:
        InputError: a mistake in the model or in a name, or something in it that has no derivative
            yet (a ValueError).
        TypeError: an argument has the wrong type.
        StoppedError: the analysis does not come to its end, or its linearised equations cannot be
            solved (a RuntimeError).
    """
    build, values = parameters(model, wrt)
    return Differentiation(
        build, of, options, ks_rho=ks_rho, accuracy=accuracy, storage=Storage(memory, scratch),
        comm=comm,
    ).at(values, check=check)  # fmt: skip


def tangent_motion(
    model: Model | Callable[..., Model],
    wrt: Sequence[str] | Mapping[str, npt.ArrayLike],
    direction: Mapping[str, npt.ArrayLike],
    options: RunOptions,
    *,
    columns: Sequence[str] | None = None,
    accuracy: float = SOLVED,
    memory: float = MEMORY,
    scratch: str | Path | None = None,
    comm: MPI.Intracomm | None = None,
) -> TangentMotion:
    """Derivatives of columns of a history along one direction of parameters (collective).

    Args:
        model: see :func:`gradient`, as for ``wrt``.
        wrt: parameters.
        direction: change of each parameter, in its unit; others do not change.
        options: those of the motion.
        columns: names; all that have derivatives by default.
        accuracy: relative accuracy of the linearised equations of a step.
        memory: largest number of bytes for states on each rank; with less, states are computed
            once more.
        scratch: folder in which states that do not fit are kept instead.
        comm: communicator, all ranks by default.

    Raises:
        InputError, TypeError, StoppedError: see :func:`gradient`.
    """
    _checks.instance("tangent_motion", "options", options, RunOptions)
    build, values = parameters(model, wrt)
    check_names("tangent_motion", "direction", values, direction)
    made = made_of(build, values)
    chosen = [*columns] if columns is not None else differentiable(made)
    check_columns(made, chosen)
    motion = Motion(made, options, comm, Storage(memory, scratch), chosen)
    directions = [
        one
        for name, given in direction.items()
        for one in _directions(motion, build, values, name, given)
    ]
    linear = linearized(motion, accuracy)
    (found,) = forward(motion, linear, chosen, [directions])
    derivative = dict(zip(chosen, found.T, strict=True)) if motion.system.comm.rank == 0 else {}
    return TangentMotion(motion.history(), derivative)


def _values(motion: Motion, functionals: Sequence[Functional]) -> dict[str, float]:
    """Values of functionals on all ranks (collective)."""
    history = motion.history()
    return motion.on_all_ranks({one.name: one.value(history) for one in functionals if history})


def _warnings(growth: float, differences: Mapping[str, float]) -> tuple[str, ...]:
    """What should be known of a gradient."""
    chaotic = [_CHAOTIC.format(growth)] if growth > _GROWTH else []
    apart = [_INACCURATE.format(*one) for one in differences.items() if not one[1] <= _APART]
    return *chaotic, *apart


def _check(
    motion: Motion, linear: LinearizedStep,
    results: tuple[Sequence[Functional], Sequence[Mapping[str, float | FloatArray]]],
    numbers: Mapping[str, NumberInfluence],
) -> dict[str, float]:  # fmt: skip
    """Relative differences between adjoint and tangent along a random direction (collective)."""
    random, functionals = np.random.default_rng(0), results[0]
    along = {name: (one, one.scale * random.standard_normal()) for name, one in numbers.items()}
    names = sorted({TIME, *(name for one in functionals for name in one.columns)})
    (changes,) = forward(motion, linear, names, [list(along.values())])
    columns = dict(zip(names, changes.T, strict=True))
    history, found = motion.history(), {}
    for one, own in zip(functionals, results[1], strict=True) if history else ():
        expected = change(one, history, columns)
        parts = [float(own[name]) * factor for name, (_, factor) in along.items()]
        size = sum(abs(part) for part in parts)
        found[one.name] = float(abs(sum(parts) - expected) / size) if size else abs(expected)
    return motion.on_all_ranks(found)


def _finite(found: Gradient) -> Gradient:
    """The gradient itself.

    Raises:
        StoppedError: a value, or a derivative, is no finite number.
    """
    for name, value in found.value.items():
        by = [wrt for wrt, own in found.gradient[name].items() if not np.isfinite(own).all()]
        if not np.isfinite(value):
            raise StoppedError(f'gradient: "{name}" is {value}')
        if by:
            raise StoppedError(f'gradient: the derivative of "{name}" by "{by[0]}" is no number')
    return found


def made_of(build: Build, values: Values) -> Model:
    """The model of the values themselves.

    Raises:
        TypeError: the function returns something else.
    """
    model = build(**plain(values))
    if not isinstance(model, Model):
        raise TypeError(f"gradient: the function returned {_checks.show(model)}, not a Model")
    return model


def _directions(
    motion: Motion, build: Build, values: Values, name: str, given: npt.ArrayLike
) -> list[tuple[NumberInfluence, float]]:
    """What the entries of a parameter change, with their changes (collective)."""
    change, value = np.asarray(given, dtype=np.float64), values[name]
    if change.shape != value.shape:
        raise ValueError(f"tangent_motion: direction of {name} must have the shape {value.shape}")
    if value.ndim == 0:
        return [(NumberInfluence(motion, build, values, name), float(change))]
    if value.ndim == 1:
        return [
            (NumberInfluence(motion, build, values, name, k), float(one))
            for k, one in enumerate(change)
            if one
        ]
    if not change.any():
        return []
    made, numbers, factor = along(build, values, name, change)
    return [(NumberInfluence(motion, made, numbers, name), factor)]
