# SPDX-License-Identifier: LGPL-3.0-or-later
"""Costs of the formalisms: counts and times."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import asdict
from functools import partial
from typing import Any

from mpi4py import MPI

import numpy as np

from flexfem.analyses.dynamics import RunOptions
from flexfem.core.status import Status
from flexfem.research.formalisms.compiled import CompiledBody, energies_of
from flexfem.research.formalisms.coordinates import Coordinates
from flexfem.research.formalisms.counting import FORMS, Count, count_form, count_formalism
from flexfem.research.formalisms.derivation import BodyEnergies
from flexfem.research.formalisms.description.mechanism import Mechanism
from flexfem.research.formalisms.description.study import FormalismStudy
from flexfem.research.formalisms.equations import MechanismEquations
from flexfem.research.formalisms.formalism import accelerations
from flexfem.research.formalisms.runs.motion import SchemedMotion
from flexfem.research.formalisms.runs.paired_timing import least, ratio_range, timed_in_turns

__all__ = ["cost_rows", "energy_rows"]

#: Cells of a loop whose time is measured: enough to forget how it is called.
_CELLS = 200
#: Number of repetitions of the steps of the table.
_RUNS = 7
#: The energies whose derivatives are the inertia of Lagrange's and of Gibbs and Appell's equations.
_ENERGIES = ("kinetic", "of_accelerations")


def cost_rows(study: FormalismStudy, options: RunOptions, comm: MPI.Comm) -> list[dict[str, Any]]:
    """One row for each mechanism and formalism (collective); the first rank's on all.

    Columns after the labels: ``formalism``; ``derivatives``, ``nodes``, ``terms``, ``operations``
    per cell, see :mod:`flexfem.research.formalisms.counting`; ``unknowns`` and ``multipliers`` of
    the mechanism; ``microseconds_per_cell`` of the kernels of the equations of motion;
    ``milliseconds_accelerations`` from a state to the accelerations, matrices and solution
    included; ``iterations_per_step`` and ``milliseconds_per_step``. Times are the least of repeats
    in which the formalisms take turns; ``cell_ratio_low``, ``cell_ratio_high`` and
    ``step_ratio_low``, ``step_ratio_high`` are the quartiles, over the repeats, of their ratios to
    Lagrange's.
    """
    rows = []
    for key, mechanism in study.mechanisms.items():
        model = MechanismEquations(mechanism)
        motions = {name: SchemedMotion(model, name) for name in study.formalisms}
        cells = timed_in_turns({name: _equations(motion) for name, motion in motions.items()})
        whole = timed_in_turns({name: _accelerations(motion) for name, motion in motions.items()})
        steps = _steps(motions, options, study.steps)
        for name, motion in motions.items():
            count = _count(mechanism, comm, partial(count_formalism, name))
            sizes = motion.summary()
            iterations, seconds = steps[name]
            low, high = ratio_range(cells[name], cells.get("lagrange", ()))
            slow, shigh = ratio_range(seconds, steps.get("lagrange", (0.0, ()))[1])
            rows.append(
                dict(zip(study.labels, key, strict=True))
                | {"formalism": name} | asdict(count)
                | {
                    "unknowns": sizes["unknowns"], "multipliers": sizes["multipliers"],
                    "microseconds_per_cell": 1e6 * least(cells[name]) / _CELLS,
                    "milliseconds_accelerations": 1e3 * least(whole[name]),
                    "iterations_per_step": iterations,
                    "milliseconds_per_step": 1e3 * least(seconds),
                    "cell_ratio_low": low, "cell_ratio_high": high,
                    "step_ratio_low": slow, "step_ratio_high": shigh,
                }
            )  # fmt: skip
    shared: list[dict[str, Any]] = comm.bcast(rows)
    return shared


def energy_rows(study: FormalismStudy, comm: MPI.Comm) -> list[dict[str, Any]]:
    """The energy of accelerations beside the kinetic energy, as functions (collective).

    One row for each mechanism and energy. Columns after the labels: ``energy``, the counts and
    ``microseconds_per_cell`` of `cost_rows`; ``ratio_low`` and ``ratio_high`` are quartiles of the
    ratios of times to the kinetic energy's.
    """
    rows = []
    for key, mechanism in study.mechanisms.items():
        model = MechanismEquations(mechanism)
        body, state = _cells_at_start(SchemedMotion(model, "lagrange"))
        calls = {name: partial(body.value, name, (), state) for name in _ENERGIES}
        times = timed_in_turns(calls)
        for name in _ENERGIES:
            count = _count(mechanism, comm, partial(_count_energy, name))
            low, high = ratio_range(times[name], times["kinetic"])
            rows.append(
                dict(zip(study.labels, key, strict=True))
                | {"energy": name} | asdict(count)
                | {
                    "microseconds_per_cell": 1e6 * least(times[name]) / _CELLS,
                    "ratio_low": low, "ratio_high": high,
                }
            )  # fmt: skip
    shared: list[dict[str, Any]] = comm.bcast(rows)
    return shared


def _count(mechanism: Mechanism, comm: MPI.Comm, count: Callable[[BodyEnergies], Count]) -> Count:
    """Counts for one cell of the first body; zeros on other ranks than the first."""
    if comm.rank != 0:
        return Count(0, 0, 0, 0)
    body = mechanism.bodies[0]
    return count(energies_of(body.matter, body.frame))


def _count_energy(name: str, energies: BodyEnergies) -> Count:
    return count_form(getattr(energies, name))


def _cells_at_start(motion: SchemedMotion) -> tuple[CompiledBody, Coordinates]:
    """Many cells of the first body, and coordinates with their rates at the start."""
    model = motion.model
    q, v = motion.start()
    state = Coordinates.zeros(model.size)
    state.put(q, v, accelerations(motion.formalism, model, q, v))
    return model.bodies[0].tiled(_CELLS), state


def _equations(motion: SchemedMotion) -> Callable[[], None]:
    """Evaluation of the kernels of a formalism."""
    body, state = _cells_at_start(motion)
    out = np.zeros((motion.model.size + 1, 1))

    def evaluate() -> None:
        for name in FORMS[motion.formalism]:
            body.add(name, (), state, out)

    return evaluate


def _accelerations(motion: SchemedMotion) -> Callable[[], object]:
    """Accelerations at the start."""
    return partial(accelerations, motion.formalism, motion.model, *motion.start())


def _steps(
    motions: Mapping[str, SchemedMotion], options: RunOptions, steps: int
) -> dict[str, tuple[float, list[float]]]:
    """Iterations per step, and the mean time of some steps after the first in each repeat.

    All repeats take the same steps; within them the formalisms take turns, step by step. Where a
    step fails there are no times.
    """
    found: dict[str, tuple[float, list[float]]] = {name: (float("nan"), []) for name in motions}
    failed: set[str] = set()
    for _ in range(_RUNS):
        before = {}
        for name, motion in motions.items():
            stepper = motion.stepper
            assert stepper is not None
            with np.errstate(all="ignore"):
                begun = stepper.begin(motion, options) is Status.OK
                if not (begun and stepper.step(options.dt) is Status.OK):
                    failed.add(name)
            before[name] = stepper.counters["newton_iterations"]
        seconds = dict.fromkeys(motions, 0.0)
        for _ in range(steps):
            for name in [name for name in motions if name not in failed]:
                stepper = motions[name].stepper
                assert stepper is not None
                begin = time.perf_counter()
                with np.errstate(all="ignore"):
                    if stepper.step(options.dt) is not Status.OK:
                        failed.add(name)
                seconds[name] += (time.perf_counter() - begin) / steps
        for name in [name for name in motions if name not in failed]:
            stepper = motions[name].stepper
            assert stepper is not None
            taken = stepper.counters["newton_iterations"] - before[name]
            found[name] = taken / steps, [*found[name][1], seconds[name]]
    return {name: (float("nan"), []) if name in failed else found[name] for name in motions}
