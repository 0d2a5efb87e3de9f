# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cost of NURBS beams against SE(3) beams at equal accuracy.

Both run the flexible slider-crank (0.1 s, one step for all) on several meshes in turn; the error is
the largest difference of the middle rod's deflection from the independent reference in
``tests/data/slider_crank.csv``, relative to its largest value. Run from the source tree, on a
machine that is idle::

    python -m tests.benchmarks.nurbs_against_se3
"""

from pathlib import Path

import numpy as np

import flexfem as ff
from flexfem.resources import load_module, shipped_files

DATA = Path(__file__).parents[1] / "data" / "slider_crank.csv"
STEP, END, ROUNDS = 2.5e-5, 0.1, 3
MESHES = [
    *(("se3", 1, elements) for elements in (6, 12, 24, 48)),
    *(("nurbs", 2, elements) for elements in (4, 8, 16)),
    *(("nurbs", 3, elements) for elements in (2, 4, 6, 8)),
]


def reference() -> tuple[np.ndarray, np.ndarray]:
    """Times and deflections of the reference up to the end."""
    table = np.genfromtxt(DATA, delimiter=",", comments="#")[1:]  # below the names of the columns
    rows = table[:, 0] <= END + 1e-9
    return table[rows, 0], table[rows, 4]


def measure(formulation: str, degree: int, elements: int) -> dict[str, float]:
    """Error, milliseconds a step and counts of one run."""
    case = load_module(shipped_files("cases")["slider_crank"], "flexfem_cases").CASE
    model = case.model(elements=elements, formulation=formulation, degree=degree)
    outcome = ff.simulate(model, ff.RunOptions(dt=STEP, t_end=END, iteration_matrix="frozen"))
    t, deflection = reference()
    ours = np.interp(t, outcome.history["t"], outcome.history["rod_2_deflection"])
    summary = outcome.summary
    return {
        "unknowns": summary["unknowns"],
        "error": float(np.abs(ours - deflection).max() / np.abs(deflection).max()),
        "milliseconds": 1e3 * summary["wall_seconds_steps"] / summary["steps"],
        "iterations": summary["newton_iterations"] / summary["steps"],
        "factorizations": summary["factorizations"],
    }


def main() -> None:
    """Print one line for each mesh: the quickest of several rounds."""
    for formulation, degree in {(f, d) for f, d, _ in MESHES}:
        measure(formulation, degree, 2)  # compiled and loaded
    print("formulation  degree  elements  unknowns  error    ms/step  iterations/step  factors")
    for formulation, degree, elements in MESHES:
        found = [measure(formulation, degree, elements) for _ in range(ROUNDS)]
        best = min(found, key=lambda one: one["milliseconds"])
        print(
            f"{formulation:<11}  {degree:6d}  {elements:8d}  {best['unknowns']:8.0f}  "
            f"{best['error']:.1e}  {best['milliseconds']:7.3f}  {best['iterations']:15.2f}  "
            f"{best['factorizations']:7.0f}"
        )


if __name__ == "__main__":
    main()
