# SPDX-License-Identifier: LGPL-3.0-or-later
"""Truss with sliding joints that gravity unfolds, beside one of rigid members."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import flexfem as ff
from flexfem.cli import load_case
from tests.verification.result import Result

SOURCE = "rigid members, Lagrange's equations"
DATA = Path(__file__).parents[2] / "data" / "deployable_truss.csv"
ARRIVALS = {"latch_left_2": 18.537750, "latch_left_1": 19.345002}


def reference() -> dict[str, np.ndarray]:
    """Columns of the table of rigid members."""
    lines = [line for line in DATA.read_text().splitlines() if not line.startswith("#")]
    table = np.array([line.split(",") for line in lines[1:]], dtype=float)
    return dict(zip(lines[0].split(","), table.T, strict=True))


def deploy(formulation: str, h: float, **given: Any) -> ff.Outcome:
    """Run the case with other values of its options."""
    case = load_case("deployable_truss")
    values, options = case.prepare({"formulation": formulation, "dt": h, **given})
    return ff.simulate(case.model(**values), replace(options, quiet=True))


def under_gravity(formulation: str, elements: int, h: float, full: bool) -> list[Result]:
    """Corner D before the first latch, times of the latches."""
    rigid, lines = reference(), []
    outcome = deploy(formulation, h, control="gravity", elements=elements)
    name = f"truss under gravity, {formulation}"
    mesh = f"28 rigid members, h = {h:g} s"
    if formulation != "rigid":
        mesh = f"28 x {elements} elements, h = {h:g} s"
    for t in (10.0, 15.0, 18.0):
        row = int(np.argmin(np.abs(outcome.history["t"] - t)))
        for column in ("D_x", "D_z"):
            value = float(rigid[column][round(t / 0.1)])
            # a bay without its share of the diagonals' inertia is 0.1 m away at 18 s
            lines.append(Result(name, f"{column} at t = {t:g} s", value, SOURCE,
                                float(outcome.history[column][row]), mesh,
                                2e-4 if full else 1e-3, 8.0))  # fmt: skip
    times = {event["name"]: event["t"] for event in outcome.summary["events"]}
    for latch, t in ARRIVALS.items():
        # after the first latch the truss vibrates, which rigid members cannot
        loose = 1e-4 if latch == "latch_left_2" else 3e-3
        lines.append(Result(name, f"{latch} at t, s", t, SOURCE, times[latch], mesh,
                            loose if full else 3.0 * loose))  # fmt: skip
    return lines


def results(full: bool = True) -> list[Result]:
    """Corner D before the first latch, times of the latches."""
    elements, h = (4, 0.02) if full else (1, 0.1)
    formulations = ("nurbs", "se3", "floating", "rigid") if full else ("nurbs", "se3")
    return [line for f in formulations for line in under_gravity(f, elements, h, full)]
