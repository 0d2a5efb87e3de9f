# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pendulum that slides down along another beam, beside a program of another theory."""

from dataclasses import replace
from pathlib import Path

import numpy as np

import flexfem as ff
from flexfem.cli import load_case
from tests.verification.result import Result

SOURCE = "rods of positions and normals, tests/data/sliding_beam.csv"
DATA = Path(__file__).parents[2] / "data" / "sliding_beam.csv"
ARRIVAL = 1.31468


def reference(t: float) -> dict[str, float]:
    """Row of the table at a time."""
    lines = [line for line in DATA.read_text().splitlines() if not line.startswith("#")]
    table = np.array([line.split(",") for line in lines[1:]], dtype=float)
    row = table[int(np.argmin(np.abs(table[:, 0] - t)))]
    return dict(zip(lines[0].split(","), row.tolist(), strict=True))


def slide(t_end: float, **given: object) -> tuple[ff.Outcome, dict[str, float]]:
    """Run the case with other values of its options; history and results."""
    case = load_case("sliding_beam")
    values, options = case.prepare({"t_end": t_end, **given})
    outcome = ff.simulate(case.model(**values), replace(options, quiet=True))
    own = {name: values[name] for name in ("width", "height")}
    return outcome, dict(case.results(outcome.history, **own))


def results(full: bool = True) -> list[Result]:
    """Place of the mass and of the slider on the way, and the arrival."""
    mesh = (
        {"elements": 64, "slider_elements": 8} if full else {"elements": 16, "slider_elements": 4}
    )
    outcome, found = slide(2.0 if full else 0.3, **mesh)
    h, lines = outcome.history, []
    text = f"{mesh['elements']} + {mesh['slider_elements']} cubic elements, h = 1 ms"
    for t in (0.3, 0.6, 0.9) if full else (0.3,):
        row, table = int(np.argmin(np.abs(h["t"] - t))), reference(t)
        for column, scale in (("mass_y", 3.0), ("zeta", LENGTH)):
            # without the carrier's own motion the mass would be 0.1 m away at 0.3 s
            lines.append(Result("sliding beam", f"{column} at t = {t:g} s, m", table[column],
                                SOURCE, float(h[column][row]), text, 1e-3 if full else 5e-3,
                                scale))  # fmt: skip
    if full:
        # coarse meshes arrive at 1.294 s, and so do those without the buckling of the slack beam
        lines.append(Result("sliding beam", "arrival, s", ARRIVAL, SOURCE,
                            found["arrival_time"], text, 1e-3))  # fmt: skip
        lines.append(Result("sliding beam", "arrival, published mesh and step, s", 1.306,
                            "Wu et al. 2020", published(), "16 + 2 quadratic elements, h = 1 ms",
                            1e-2))  # fmt: skip
    return lines


def published() -> float:
    """Arrival with the mesh and the step of the paper."""
    return slide(2.0, elements=16, slider_elements=2, degree=2)[1]["arrival_time"]


LENGTH = float(np.hypot(3.0, 1.0))
