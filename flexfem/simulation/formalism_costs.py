# SPDX-License-Identifier: LGPL-3.0-or-later
"""What the formalisms cost: a table, and what its figures say."""

from __future__ import annotations

import textwrap
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from mpi4py import MPI

import numpy as np

from flexfem.analyses.dynamics import RunOptions
from flexfem.core.status import Status
from flexfem.formalisms.compiled import energies_of
from flexfem.formalisms.counting import FORMS, Count, count_formalism
from flexfem.formalisms.equations import MechanismEquations
from flexfem.formalisms.formalism import accelerations
from flexfem.formalisms.study import FormalismStudy
from flexfem.simulation.formalism_motion import SchemedMotion

__all__ = ["cost_rows", "findings", "table_text"]

Row = Mapping[str, Any]
#: Seconds over which an evaluation is timed, and how often: the quickest counts.
_SECONDS, _REPEATS = 0.005, 5
#: Cells of a loop whose time is measured: enough to forget how it is called.
_CELLS = 200


def cost_rows(study: FormalismStudy, options: RunOptions, comm: MPI.Comm) -> list[dict[str, Any]]:
    """One row for each mechanism and formalism (collective); the first rank's on all.

    Columns after the labels: ``formalism``; ``derivatives``, ``nodes``, ``terms``, ``operations``
    per cell, see :mod:`flexfem.formalisms.counting`; ``unknowns`` and ``multipliers`` of the
    mechanism; ``microseconds_per_cell`` of the kernels of the equations of motion;
    ``milliseconds_accelerations`` from a state to the accelerations, matrices and solution
    included; ``iterations_per_step`` and ``milliseconds_per_step``.
    """
    rows = []
    for key, mechanism in study.mechanisms.items():
        model = MechanismEquations(mechanism)
        body = mechanism.bodies[0]
        for formalism in study.formalisms:
            none = Count(0, 0, 0, 0)
            count = none
            if comm.rank == 0:
                count = count_formalism(formalism, energies_of(body.matter, body.frame))
            motion = SchemedMotion(model, formalism)
            sizes = motion.summary()
            rows.append(
                dict(zip(study.labels, key, strict=True))
                | {
                    "formalism": formalism, "derivatives": count.derivatives,
                    "nodes": count.nodes, "terms": count.terms, "operations": count.operations,
                    "unknowns": sizes["unknowns"], "multipliers": sizes["multipliers"],
                }
                | _evaluation_times(motion)
                | _step_times(motion, options, study.steps)
            )  # fmt: skip
    shared: list[dict[str, Any]] = comm.bcast(rows)
    return shared


def _quickest(call: Callable[[], object]) -> float:
    """Seconds of a call."""
    call()
    begin = time.perf_counter()
    call()
    often = max(1, int(_SECONDS / max(time.perf_counter() - begin, 1e-9)))
    times = []
    for _ in range(_REPEATS):
        begin = time.perf_counter()
        for _ in range(often):
            call()
        times.append((time.perf_counter() - begin) / often)
    return min(times)


def _evaluation_times(motion: SchemedMotion) -> dict[str, float]:
    """Times of the kernels of one cell, and of the accelerations at the start."""
    model, formalism = motion.model, motion.formalism
    q, v = motion.start()
    fields, out = np.zeros((3, model.size + 1)), np.zeros(model.size + 1)
    fields[:, :-1] = q, v, accelerations(formalism, model, q, v)
    body = model.bodies[0].tiled(_CELLS)

    def equations() -> None:
        for name in FORMS[formalism]:
            body.add_vector(name, fields, out)

    return {
        "microseconds_per_cell": 1e6 * _quickest(equations) / _CELLS,
        "milliseconds_accelerations": 1e3
        * _quickest(lambda: accelerations(formalism, model, q, v)),
    }


def _step_times(motion: SchemedMotion, options: RunOptions, steps: int) -> dict[str, float]:
    """Iterations and time of some steps after the first, which loads compiled code."""
    stepper = motion.stepper
    assert stepper is not None
    nothing = {"iterations_per_step": float("nan"), "milliseconds_per_step": float("nan")}
    with np.errstate(all="ignore"):
        if stepper.begin(motion, options) is not Status.OK:
            return nothing
        if stepper.step(options.dt) is not Status.OK:
            return nothing
        before, begin = stepper.counters["newton_iterations"], time.perf_counter()
        for _ in range(steps):
            if stepper.step(options.dt) is not Status.OK:
                return nothing
    seconds = time.perf_counter() - begin
    return {
        "iterations_per_step": (stepper.counters["newton_iterations"] - before) / steps,
        "milliseconds_per_step": 1e3 * seconds / steps,
    }


_HEADS = {
    "microseconds_per_cell": "us/cell", "milliseconds_accelerations": "ms/accel.",
    "iterations_per_step": "iter./step", "milliseconds_per_step": "ms/step",
}  # fmt: skip


def table_text(rows: Sequence[Row]) -> str:
    """The table for the screen."""
    heads = [_HEADS.get(name, name) for name in rows[0]]
    lines = [[_cell(value) for value in row.values()] for row in rows]
    widths = [max(map(len, column)) for column in zip(heads, *lines, strict=True)]
    words = [isinstance(value, str) for value in rows[0].values()]

    def line(cells: Sequence[str]) -> str:
        padded = (
            cell.ljust(width) if word else cell.rjust(width)
            for cell, width, word in zip(cells, widths, words, strict=True)
        )  # fmt: skip
        return "  ".join(padded).rstrip()

    return "\n".join([line(heads), *map(line, lines)])


def _cell(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def findings(rows: Sequence[Row], labels: Sequence[str]) -> str:
    """What the figures say of claims that Gibbs–Appell is the cheapest and Hamilton the dearest.

    Every formalism is compared with Lagrange's on the same mechanism; without that there is nothing
    to compare with.
    """
    groups: dict[tuple[Any, ...], dict[str, Row]] = {}
    for row in rows:
        groups.setdefault(tuple(row[label] for label in labels), {})[row["formalism"]] = row
    sentences = []
    for formalism, title in (
        ("gibbs_appell", "Gibbs-Appell"), ("maggi", "Maggi"), ("hamilton", "Hamilton"),
    ):  # fmt: skip
        pairs = {
            " ".join(key): (group[formalism], group["lagrange"])
            for key, group in groups.items()
            if formalism in group and "lagrange" in group
        }
        if pairs:
            sentences.append(_comparison(title, pairs))
    if not sentences:
        return "Without Lagrange's formalism and another one there is nothing to compare."
    if any(len(group) > 1 for group in groups.values()):
        sentences.append(_extremes(groups))
    return textwrap.fill(" ".join(sentences), 100)


_QUANTITIES = {
    "operations": "operations per cell", "unknowns": "unknowns",
    "microseconds_per_cell": "time per evaluation", "milliseconds_per_step": "time per step",
}  # fmt: skip


def _comparison(title: str, pairs: Mapping[str, tuple[Row, Row]]) -> str:
    """Ratios to Lagrange's figures, with where they are below one and where not."""
    parts = []
    for name, words in _QUANTITIES.items():
        ratios = {key: own[name] / other[name] for key, (own, other) in pairs.items()}
        low, high = min(ratios.values()), max(ratios.values())
        span = f"{low:.2f}" if f"{low:.2f}" == f"{high:.2f}" else f"{low:.2f} to {high:.2f}"
        more = [key for key, ratio in ratios.items() if ratio > 1.02]
        less = [key for key, ratio in ratios.items() if ratio < 0.98]
        if len(ratios) == 1 or len(more) == len(ratios) or len(less) == len(ratios):
            where = ""
        elif not more and not less:
            where = " (the same)"
        else:
            where = f" (more in {', '.join(more) or 'none'})"
        parts.append(f"{span} times the {words}{where}")
    return f"{title} takes, relative to Lagrange, {', '.join(parts[:-1])} and {parts[-1]}."


def _extremes(groups: Mapping[tuple[Any, ...], Mapping[str, Row]]) -> str:
    """Whether the claims hold, mechanism by mechanism."""
    claims = [
        ("Gibbs-Appell takes fewer operations than Lagrange", _fewer("gibbs_appell", "operations")),
        ("Maggi has no multipliers", _no_multipliers),
        ("Hamilton takes the most operations", _most("hamilton", "operations")),
        ("Hamilton has the most unknowns", _most("hamilton", "unknowns")),
        ("Hamilton takes the longest per step", _most("hamilton", "milliseconds_per_step")),
    ]
    verdicts = []
    for claim, test in claims:
        held = {" ".join(key): test(group) for key, group in groups.items()}
        known = {key: value for key, value in held.items() if value is not None}
        if not known:
            continue
        wrong = [key for key, value in known.items() if not value]
        if not wrong:
            verdict = "holds" if len(known) == 1 else f"holds in all {len(known)}"
        elif len(wrong) == len(known):
            verdict = "does not hold" if len(known) == 1 else f"holds in none of {len(known)}"
        else:
            verdict = f"holds except in {', '.join(wrong)}"
        verdicts.append(f'"{claim}" {verdict}')
    return f"Claims: {'; '.join(verdicts)}."


Test = Callable[[Mapping[str, Row]], bool | None]


def _fewer(formalism: str, quantity: str) -> Test:
    def test(group: Mapping[str, Row]) -> bool | None:
        if not {formalism, "lagrange"} <= set(group):
            return None
        return bool(group[formalism][quantity] < group["lagrange"][quantity])

    return test


def _most(formalism: str, quantity: str) -> Test:
    def test(group: Mapping[str, Row]) -> bool | None:
        if formalism not in group or len(group) < 2:
            return None
        others = [row[quantity] for name, row in group.items() if name != formalism]
        return bool(group[formalism][quantity] > max(others))

    return test


def _no_multipliers(group: Mapping[str, Row]) -> bool | None:
    return group["maggi"]["multipliers"] == 0 if "maggi" in group else None
