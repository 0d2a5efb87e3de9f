# SPDX-License-Identifier: LGPL-3.0-or-later
"""Runs of models for verification tables."""

from collections.abc import Mapping, Sequence

from mpi4py import MPI

import numpy as np

import flexfem as ff
from tests.verification.result import Result


def run(model: ff.Model, dt: float, t_end: float, **options) -> Mapping[str, np.ndarray]:
    """History of a run that must reach its end."""
    settings = ff.RunOptions(**({"dt": dt, "t_end": t_end, "tolerance": 1e-10} | options))
    outcome = ff.simulate(model, settings)
    if outcome.status != "ok":
        raise RuntimeError(f"{model!r}: {outcome.status}")
    return outcome.history


def run_undamped(
    model: ff.Model, dt: float, t_end: float, comm: MPI.Intracomm = MPI.COMM_SELF, **options
) -> ff.Outcome:
    """Run without numerical dissipation, which must reach its end."""
    settings = ff.RunOptions(dt=dt, t_end=t_end, rho_inf=1.0, quiet=True, **options)
    found = ff.simulate(model, settings, comm=comm)
    assert found.status == "ok"
    return found


def compare(
    case: str,
    source: str,
    mesh: str,
    history: Mapping[str, np.ndarray],
    columns: Sequence[str],
    rows: Mapping[float, Sequence[float]],
    tolerance: float,
    scale: float,
) -> list[Result]:
    """Results of some columns at some times, with one tolerance and scale for all."""
    results = []
    for t, values in rows.items():
        row = int(np.argmin(np.abs(history["t"] - t)))
        if abs(history["t"][row] - t) > 1e-9:
            raise ValueError(f"{case}: there is no row at t = {t}")
        for column, value in zip(columns, values, strict=True):
            ours = float(history[column][row])
            what = f"{column} at t = {t:g} s"
            results.append(Result(case, what, value, source, ours, mesh, tolerance, scale))
    return results


def box_inertia(mass: float, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Moments of inertia of a box about its centre."""
    return mass / 12 * (y * y + z * z), mass / 12 * (x * x + z * z), mass / 12 * (x * x + y * y)
