# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sensitivities: derivatives of results with respect to options, by differences of runs."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from flexfem.analyses.analysis import Analysis
from flexfem.case import Case, load_case
from flexfem.io.summary import write_summary
from flexfem.io.tables.table import write_table
from flexfem.options import VectorOption, meant, vector_of, with_components
from flexfem.studies.differences import OFFSETS, Derivative, derivative
from flexfem.studies.reductions import Reduction
from flexfem.studies.sweep import sweep
from flexfem.studies.workers import Workers

__all__ = ["Sensitivity", "sensitivities", "write_sensitivities"]

#: Step over the value of an option; how much longer or shorter a second try is; digits of values.
_STEP, _OTHER, _DIGITS = 1e-2, 5.0, 12


@dataclass(frozen=True)
class Sensitivity:
    """The derivative of a result with respect to an option.

    Attributes:
        of: the result, ``final:tip_z``.
        wrt: the option, ``stiffness`` or ``gravity[2]``.
        at: value of the option.
        value: of the result there.
        derivative: unit of the result over that of the option; NaN if runs failed.
        error: its estimated error.
        relative: derivative times ``at`` over ``value``, the exponent of a power law; NaN where
            ``value`` is 0.
        step: the longer of both steps.
        warning: why the derivative should not be trusted, empty if it may be.
    """

    of: str
    wrt: str
    at: float
    value: float
    derivative: float
    error: float
    relative: float
    step: float
    warning: str


def sensitivities(
    case: str | Path,
    of: Sequence[str],
    wrt: Sequence[str],
    *,
    options: Mapping[str, Any] | None = None,
    steps: Mapping[str, float] | None = None,
    output: Path | str | None = None,
    jobs: int | None = None,
    ranks: int = 1,
    workers: Workers | None = None,
    analysis: Analysis | None = None,
    smoke: bool = False,
    progress: str = "none",
) -> list[Sensitivity]:
    """Derivatives of results of a case with respect to its options, several runs at a time.

    Central differences with two steps, one half of the other, are extrapolated; their difference
    and the noise of the values give the error. Where it is more than 1 %, another step is tried,
    five times as long or short; the better one counts. Four runs for each option, and one more::

        for one in ff.sensitivities("buffer.py", ["rms:deflection"], ["damping", "mass"]):
            print(one.of, one.wrt, one.derivative, one.error, one.warning)

    Args:
        case: name of a shipped case, or path of a case file.
        of: results, as "final:tip_x": final, max, min, mean, rms or integral of a column of the
            history; or names of headline results of the case.
        wrt: options, real numbers other than 0 or with a step; "gravity[2]" for a component.
        options: values of options at which derivatives are taken; defaults otherwise.
        steps: steps of options in their units, with no second try; 1 % of the value by default.
        output: folder of runs and tables, see :func:`write_sensitivities`; None for a temporary
            one.
        jobs: runs at the same time; as many as there are cores for their ranks by default.
        ranks: MPI ranks of each run.
        workers: processes that stay for other studies; they have their own jobs and ranks.
        analysis: other than that of the case.
        smoke: a few steps on tiny meshes.
        progress: "auto", "bar", "lines" or "none".

    Returns:
        One for each result and option, in this order.

    Raises:
        TypeError: A value has the wrong type.
        ValueError: There is no such case, option or result, an option is no real number, a value
            beside it is not admissible, or the folder is that of something else.
        RuntimeError: The run with the options as they are failed.
        OSError: The folder cannot be written.
    """
    loaded = load_case(case)
    loaded = loaded if analysis in (None, loaded.analysis) else loaded.under(analysis)
    known = [_Result.parse(text) for text in of]
    at = _values(loaded, wrt, options or {}, smoke)
    chosen = _steps(at, steps or {})
    if not known or not at:
        raise ValueError("sensitivities: nothing to derive, give results and options")
    if workers is not None and (jobs is not None or ranks != 1):
        raise ValueError("sensitivities: workers have jobs and ranks, give neither beside them")
    with _pool(workers, jobs, ranks) as pool, _folder(output) as folder:
        study = _Study(at, known)
        others = _without(options or {}, at)
        more = {
            "options": others, "output": folder, "workers": pool, "analysis": analysis,
            "smoke": smoke, "progress": progress,
        }  # fmt: skip
        if any(one.reduction is None for one in known):
            study.evaluate(case, {}, more)  # the first run tells whether they exist
        study.evaluate(case, chosen, more)
        if again := study.better_steps(_without(chosen, steps or {})):
            with contextlib.suppress(ValueError):  # the option ends there: the first try counts
                study.evaluate(case, again, more)
        found = [study.sensitivity(result, name) for result in known for name in at]
        if output is not None:
            write_sensitivities(folder, found)
        return found


def write_sensitivities(folder: Path, found: Sequence[Sensitivity]) -> None:
    """Write ``sensitivities.csv`` and ``sensitivities.json``.

    Raises:
        OSError: They cannot be written.
    """
    rows = [asdict(one) for one in found]
    write_table(folder / "sensitivities.csv", rows)
    write_summary(folder / "sensitivities.json", {"sensitivities": rows})


@dataclass(frozen=True)
class _Result:
    """A result of runs.

    Attributes:
        text: as it was given.
        reduction: of a column; None for a headline result.
    """

    text: str
    reduction: Reduction | None

    @classmethod
    def parse(cls, text: str) -> _Result:
        """Read it.

        Raises:
            ValueError: It is neither a reduced column nor a name.
        """
        return cls(text, None if text.isidentifier() else Reduction.parse(text))

    def of(self, results: Mapping[str, Any]) -> float:
        """The number, of results of a sweep.

        Raises:
            ValueError: There is none.
        """
        name = self.text if self.reduction is None else self.reduction.label
        value = results.get(f"result_{name}", results.get(name))
        if isinstance(value, bool) or not isinstance(value, int | float):
            numbers = [
                key for key, own in results.items()
                if isinstance(own, float) and key != "wall_seconds"
            ]  # fmt: skip
            raise ValueError(
                f"sensitivities: no number '{self.text}' in the results{_hint(name, numbers)}"
            )
        return float(value)


def _hint(name: str, known: Iterable[str]) -> str:
    """Names that may be meant, else all."""
    listed = ", ".join(known)
    return f", {meant(name, known) or f'known are {listed}'}" if listed else ""


def _values(
    case: Case, wrt: Sequence[str], options: Mapping[str, Any], smoke: bool
) -> dict[str, float]:
    """Values of the options.

    Raises:
        TypeError, ValueError: One is not there, is no real number, or has a wrong value.
    """
    known = with_components(case.all_options())
    _, settings = case.prepare(options, smoke=smoke)
    values: dict[str, float] = {}
    for name in wrt:
        if name not in known:
            raise ValueError(f"sensitivities: no option '{name}'{_hint(name, known)}")
        option, whole = known[name], settings.recorded[vector_of(name)]
        if isinstance(option, VectorOption):
            raise ValueError(f"sensitivities: {name} has components: give {name}[0] and so on")
        if option.kind is not float or whole is None:
            raise ValueError(
                f"sensitivities: {name} must be a real number, it is {option.describe()}"
            )
        if name in values:
            raise ValueError(f"sensitivities: {name} comes twice")
        values[name] = whole if name == vector_of(name) else whole[int(name[:-1].split("[")[1])]
    return values


def _steps(at: Mapping[str, float], given: Mapping[str, float]) -> dict[str, float]:
    """The longer steps.

    Raises:
        ValueError: One is missing, not above 0, too small, or of no option.
    """
    for name, step in given.items():
        if name not in at:
            raise ValueError(f"sensitivities: a step of {name}, which is not among the options")
        if isinstance(step, bool) or not isinstance(step, int | float) or not 0.0 < step < 1e300:
            raise ValueError(f"sensitivities: the step of {name} must be above 0, got {step!r}")
        if step <= 10.0**-_DIGITS * 100.0 * abs(at[name]):
            raise ValueError(
                f"sensitivities: the step {step:g} of {name} is lost in the digits of {at[name]:g}"
            )
    for name, value in at.items():
        if value == 0.0 and name not in given:
            raise ValueError(f"sensitivities: {name} is 0, give the step that it needs")
    return {name: float(given.get(name, _STEP * abs(value))) for name, value in at.items()}


class _Study:
    """Values of all results at all places, as far as they are known."""

    def __init__(self, at: Mapping[str, float], results: Sequence[_Result]) -> None:
        """Nothing is evaluated yet."""
        self._at, self._results = at, results
        self._runs: dict[tuple[float, ...], Mapping[str, Any]] = {}
        self._tried: dict[str, list[float]] = {name: [] for name in at}

    def evaluate(self, case: str | Path, steps: Mapping[str, float], more: dict[str, Any]) -> None:
        """Make the runs that these steps need.

        Raises:
            ValueError: A value beside the given one is not admissible, or a result is not there.
            RuntimeError: The run without a step failed.
        """
        points = dict.fromkeys([tuple(self._at.values()), *self._runs])
        for name, step in steps.items():
            points |= dict.fromkeys(self._point(name, step, offset) for offset in OFFSETS)
        vary = {name: [point[k] for point in points] for k, name in enumerate(self._at)}
        reduce = [one.reduction for one in self._results if one.reduction is not None]
        texts = [f"{one.kind}:{one.column}" for one in dict.fromkeys(reduce)]
        rows = sweep(case, vary, together=True, reduce=texts, **more)
        self._runs = dict(zip(points, (results for _, results in rows), strict=True))
        first = self._runs[tuple(self._at.values())]
        if first["status"] != "ok":
            raise RuntimeError(f"the run with the options as they are: {first['status']}")
        for result in self._results:
            result.of(first)
        for name, step in steps.items():
            self._tried[name].append(step)

    def _point(self, name: str, step: float, offset: float) -> tuple[float, ...]:
        """Values of all options where one of them is changed."""
        changed = self._at[name] + offset * step
        plain = float(f"{changed:.{_DIGITS}g}") if offset else changed
        return tuple(plain if other == name else value for other, value in self._at.items())

    def better_steps(self, steps: Mapping[str, float]) -> dict[str, float]:
        """Other steps of the options with a poor derivative."""
        found = {}
        for name, step in steps.items():
            own = [self._derivative(result, name, step) for result in self._results]
            poor = [one for one in own if one is not None and one.poor]
            if poor:
                worst = max(poor, key=lambda one: one.error / (abs(one.value) or 1e-300))
                found[name] = step * _OTHER if worst.noisy else step / _OTHER
        return found

    def _derivative(self, result: _Result, name: str, step: float) -> Derivative | None:
        """The derivative; None if one of its runs failed."""
        points = [self._point(name, step, offset) for offset in OFFSETS]
        if any(self._runs[point]["status"] != "ok" for point in points):
            return None
        k = list(self._at).index(name)
        values = [result.of(self._runs[point]) for point in points]
        return derivative([point[k] for point in points], values)

    def _failures(self, name: str, step: float) -> Iterator[str]:
        for offset in OFFSETS:
            point = self._point(name, step, offset)
            if (status := self._runs[point]["status"]) != "ok":
                yield f"{name}={point[list(self._at).index(name)]!r}: {status}"

    def sensitivity(self, result: _Result, name: str) -> Sensitivity:
        """The best derivative that is known."""
        at = self._at[name]
        value = result.of(self._runs[tuple(self._at.values())])
        tried = {step: self._derivative(result, name, step) for step in self._tried[name]}
        good = {step: one for step, one in tried.items() if one is not None}
        if not good:
            step, nan = self._tried[name][0], float("nan")
            why = next(self._failures(name, step))
            return Sensitivity(result.text, name, at, value, nan, nan, nan, step, why)
        step, best = min(good.items(), key=lambda item: item[1].error)
        relative = best.value * at / value if value else float("nan")
        return Sensitivity(
            result.text, name, at, value, best.value, best.error, relative, step,
            _warning(best, step, value),
        )  # fmt: skip


def _warning(one: Derivative, step: float, value: float) -> str:
    """Why a derivative should not be trusted."""
    if not one.poor:
        return ""
    if one.noisy:
        return (
            f"the difference drowns in deviations of {one.level:.2g} in values of {value:.4g} "
            f"(tolerances, round-off, a kink): try a longer step, or a smaller tolerance"
        )
    return (
        f"the steps {step:.4g} and {step / 2.0:.4g} disagree, {one.both[0]:.4g} and "
        f"{one.both[1]:.4g}: try a shorter step"
    )


def _without(values: Mapping[str, Any], names: Container[str]) -> dict[str, Any]:
    return {name: value for name, value in values.items() if name not in names}


@contextmanager
def _pool(workers: Workers | None, jobs: int | None, ranks: int) -> Iterator[Workers]:
    """The given workers, which stay, or some for this study."""
    if workers is not None:
        yield workers
        return
    with Workers(jobs, ranks) as own:
        yield own


@contextmanager
def _folder(output: Path | str | None) -> Iterator[Path]:
    """The given folder, or a temporary one."""
    if output is not None:
        yield Path(output)
        return
    with tempfile.TemporaryDirectory(prefix="flexfem-sensitivities-") as folder:
        yield Path(folder)
