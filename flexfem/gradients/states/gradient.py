# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gradients of motions, equilibria, natural frequencies and buckling loads."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._types import FloatArray
from flexfem.analyses.dynamics import RunOptions
from flexfem.analyses.modes import ModeOptions
from flexfem.analyses.statics import StaticOptions
from flexfem.gradients.motion.functionals import Functional, parse
from flexfem.gradients.gradient import MEMORY, SOLVED, Gradient
from flexfem.gradients.gradient import gradient as gradient_of_motion
from flexfem.gradients.motion.parameters import Build, Values, parameters, plain
from flexfem.gradients.states.buckling import BucklingLoads
from flexfem.gradients.states.modes import Frequencies
from flexfem.gradients.states.neighbours import by_name, parameters_of
from flexfem.gradients.states.path import Equilibria
from flexfem.gradients.states.statics import gradients_of_columns
from flexfem.gradients.motion.support import check_columns
from flexfem.model.model import Model

__all__ = ["gradient"]


def gradient(
    model: Model | Callable[..., Model],
    of: str | Functional | Sequence[str | Functional],
    wrt: Sequence[str] | Mapping[str, npt.ArrayLike],
    options: RunOptions | StaticOptions | ModeOptions,
    *,
    ks_rho: float | None = None,
    accuracy: float = SOLVED,
    memory: float = MEMORY,
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
    ``frequency:1`` (Hz), ``damping:1`` and so on, about the state of the options.

    Args:
        model: the model; or a function that builds it from numbers with the names in ``wrt``, such
            as the ``build`` of a case.
        of: functionals, such as "final:tip_x": final, mean, integral, rms, max, min or ks of a
            column of a :class:`Probe`; or :class:`Functional`. The columns of statics count over
            the load factor.
        wrt: parameters: paths into a model ("rod.mass", "spring.stiffness", "gravity[2]",
            "rod.velocity[0]"), or values of the arguments of a function by their names: numbers, or
            arrays (n,), such as one stiffness for each element.
        options: those of the motion, the equilibria or the modes.
        ks_rho: of "ks", one over the unit of the column.
        accuracy: relative accuracy of the linearised equations of a step of a motion.
        memory: largest number of bytes for states of a motion on each rank; with less, states are
            computed once more.
        check: compare with the tangent of a motion along a random direction, which takes as long
            again.
        comm: communicator, all ranks by default.

    Raises:
        InputError: a mistake in the model or in a name, or something in it that has no derivative
            yet (a ValueError).
        TypeError: an argument has the wrong type.
        StoppedError: the analysis does not come to its end, or its linearised equations cannot be
            solved (a RuntimeError).
    """
    if isinstance(options, RunOptions):
        return gradient_of_motion(
            model, of, wrt, options, ks_rho=ks_rho, accuracy=accuracy, memory=memory, check=check,
            comm=comm,
        )  # fmt: skip
    if type(options) not in (StaticOptions, ModeOptions):
        raise TypeError(
            "gradient: options must be RunOptions, StaticOptions or ModeOptions, got "
            f"{_checks.show(options)}"
        )
    if check:
        raise ValueError("gradient: check compares adjoint and tangent of motions only")
    given = [of] if isinstance(of, str | Functional) else list(of)
    every = [one.strip() if isinstance(one, str) else one for one in given]
    if not every:
        raise ValueError("gradient: nothing to derive, name functionals")
    build, values = parameters(model, wrt)
    made = build(**plain(values))
    if not isinstance(made, Model):
        raise TypeError(f"gradient: the function returned {_checks.show(made)}, not a Model")
    comm = comm or MPI.COMM_WORLD
    if isinstance(options, StaticOptions):
        return _of_equilibria(made, (every, ks_rho), (build, values), options, comm)
    return _of_modes(made, every, (build, values), options, comm)


def _of_equilibria(
    model: Model, of: tuple[Sequence[str | Functional], float | None], wrt: tuple[Build, Values],
    options: StaticOptions, comm: MPI.Intracomm,
) -> Gradient:  # fmt: skip
    """Gradients of columns and of buckling loads (collective)."""
    begin = time.perf_counter()
    every, ks_rho = of
    loads = {str(one): _number(one) for one in every if _kind(one) == "buckling"}
    functionals = [
        parse(one, ks_rho) if isinstance(one, str) else one for one in every if one not in loads
    ]
    check_columns(model, [name for one in functionals for name in one.columns])
    path = Equilibria(model, options, comm)
    done, middle = path.system.counters.factorizations, time.perf_counter()
    chosen = parameters_of(*wrt)
    rows = dict(
        zip(
            [one.name for one in functionals],
            gradients_of_columns(path, functionals, chosen),
            strict=True,
        )
    )
    own = {one.name: one.value(path.history) for one in functionals if path.history}
    value: dict[str, float] = comm.bcast(own)
    if loads:
        buckling = BucklingLoads(path, list(loads.values()))
        rows |= dict(zip(loads, buckling.gradients(chosen), strict=True))
        value |= {name: buckling.loads[k - 1] for name, k in loads.items()}
    names = [one if isinstance(one, str) else one.name for one in every]
    return _result(
        {name: value[name] for name in names},
        {name: by_name(rows[name], wrt[1]) for name in names},
        dict(path.history), (begin, middle),
        (done, path.system.counters.factorizations - done),
    )  # fmt: skip


def _of_modes(
    model: Model, every: Sequence[str | Functional], wrt: tuple[Build, Values],
    options: ModeOptions, comm: MPI.Intracomm,
) -> Gradient:  # fmt: skip
    """Gradients of frequencies and damping ratios (collective)."""
    begin = time.perf_counter()
    for one in every:
        if _kind(one) not in ("frequency", "damping"):
            raise ValueError(
                f"gradient: with ModeOptions numbers are frequency:1, damping:1 and so on, got "
                f"{one if isinstance(one, str) else one.name}"
            )
    numbers = {str(one): _number(one) for one in every}
    found = Frequencies(model, options, comm, sorted(set(numbers.values())))
    middle = time.perf_counter()
    by_eigenvalue = found.gradients(parameters_of(*wrt))
    value, rows = {}, {}
    for name, k in numbers.items():
        own, change = complex(found.modes.eigenvalues[k - 1]), by_eigenvalue[k]
        if _kind(name) == "frequency":
            value[name] = float(found.modes.frequencies[k - 1])
            rows[name] = change.imag / (2.0 * np.pi)
        else:
            value[name] = float(found.modes.damping[k - 1])
            size = abs(own)
            rows[name] = own.real * (np.conj(own) * change).real / size**3 - change.real / size
    history = {} if comm.rank else {
        "t": np.arange(1.0, len(found.modes) + 1.0), "frequency": found.modes.frequencies,
        "damping_ratio": found.modes.damping,
    }  # fmt: skip
    gradients = {name: by_name(row, wrt[1]) for name, row in rows.items()}
    return _result(value, gradients, history, (begin, middle), (0, 0))


def _kind(one: str | Functional) -> str:
    """What stands before the colon, empty for functionals."""
    return one.partition(":")[0].strip() if isinstance(one, str) else ""


def _number(one: str | Functional) -> int:
    """The number behind the colon, from 1."""
    text = str(one).partition(":")[2].strip()
    if not text.isdecimal() or int(text) < 1:
        raise ValueError(f"gradient: '{one}' must end with a number from 1, as in frequency:1")
    return int(text)


def _result(
    value: Mapping[str, float], gradients: Mapping[str, Mapping[str, float | FloatArray]],
    history: Mapping[str, FloatArray], times: tuple[float, float], factorizations: tuple[int, int],
) -> Gradient:  # fmt: skip
    return Gradient(
        value=value, gradient=gradients, history=history,
        wall_seconds_forward=times[1] - times[0],
        wall_seconds_backward=time.perf_counter() - times[1],
        factorizations_forward=factorizations[0], factorizations_backward=factorizations[1],
        applications=0, growth=1.0, check={},
    )  # fmt: skip
