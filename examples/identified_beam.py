# SPDX-License-Identifier: LGPL-3.0-or-later
"""Stiffness and damping of a swinging rubber strip, fitted to noisy positions of its tip.

A strip of rubber hangs on a hinge that rubs, falls from the horizontal, swings and bends. A camera
sees its tip at 50 frames a second, with a noise of 2 mm. Which modulus of elasticity, which
retardation time of the rubber and which damping of the hinge fit best, and how well are they known?

The film is one that is computed, with noise added, so that the truth is known. Fits to thirty films
with other noise tell whether the standard errors are right: the estimates scatter by them, and 95 %
of the intervals hold the truth.

Run: ``python examples/identified_beam.py`` takes some minutes; ``--smoke`` fits a tenth of it.
"""

import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

import flexfem as ff

TRUTH = {"modulus": 4e6, "retardation": 5e-3, "hinge": 2e-3}  # Pa, s, N m s/rad
START = {"modulus": 6e6, "retardation": 2e-3, "hinge": 5e-4}
NOISE = 2e-3  # m
STEPS = ff.RunOptions(dt=0.01, t_end=1.2, quiet=True)
RESULTS = Path("results/identified_beam")


def build(*, modulus: float, retardation: float, hinge: float) -> ff.Model:
    """A strip of 500 x 20 x 10 mm on a hinge about y."""
    rubber = ff.Material(modulus, 0.45, 1100.0)
    start, axis = ff.Marker("strip", "start"), (0.0, 1.0, 0.0)
    line = {"strip": [(0.0, 0.0, 0.0), (0.5, 0.0, 0.0)]}
    model = ff.Model("identified_beam", mesh=ff.LineMesh.straight(line, elements=6))
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.Beam("strip", ff.Section.rectangle(0.02, 0.01, rubber), damping=retardation),
        ff.Revolute("hinge", ff.Ground(), start, axis=axis),
        ff.TorsionalSpringDamper("friction", ff.Ground(), start, axis=axis, damping=hinge),
        ff.PositionProbe("tip", ff.Marker("strip", "end")),
    )
    return model


def film(number: int, steps: ff.RunOptions = STEPS) -> dict[str, np.ndarray]:
    """Positions of the tip in one film, NaN between its frames."""
    history = ff.simulate(build(**TRUTH), steps).history
    random = np.random.default_rng(number)
    seen = {}
    for name in ("tip_x", "tip_z"):
        seen[name] = history[name] + NOISE * random.standard_normal(len(history[name]))
        seen[name][1::2] = np.nan
    return seen


def fitted(
    seen: Mapping[str, np.ndarray], start: Mapping[str, float] = START,
    steps: ff.RunOptions = STEPS,
) -> ff.Identification:  # fmt: skip
    """The fit to a film."""
    bounds = {name: (0.1 * value, None) for name, value in TRUTH.items()}  # none is negative
    return ff.identify(build, seen, start, steps, bounds=bounds, tolerance=1e-6)


def tell(fit: ff.Identification) -> None:
    """Print the parameters with their intervals."""
    print(f"{fit.motions} motions, {1e3 * fit.noise:.2f} mm are left")
    for name, truth in TRUTH.items():
        low, high = fit.interval(name)
        value = fit.values[name]
        print(f"{name}: {value:.4g}, 95 % between {low:.4g} and {high:.4g}, true {truth:g}")


def write(name: str, columns: Mapping[str, np.ndarray]) -> None:
    """A history that postprocessing reads."""
    folder = RESULTS / name
    folder.mkdir(parents=True, exist_ok=True)
    table = np.column_stack([*columns.values()])
    table = table[np.isfinite(table).all(axis=1)]
    header = ",".join(columns)
    np.savetxt(folder / "history.csv", table, delimiter=",", header=header, comments="")


def keep(seen: Mapping[str, np.ndarray], fit: ff.Identification) -> None:
    """The motion that fits, and what it leaves of the film."""
    options = replace(STEPS, output=str(RESULTS))
    history = ff.simulate(build(**fit.values), options).history
    t, x, z = (np.asarray(history[name]) for name in ("t", "tip_x", "tip_z"))
    left = {"left_x": seen["tip_x"] - x, "left_z": seen["tip_z"] - z}
    write("film", {"t": t, "tip_x": seen["tip_x"], "tip_z": seen["tip_z"], **left})
    write("fit", {"t": t, "tip_x": x, "tip_z": z, "left_x": 0.0 * t, "left_z": 0.0 * t})


def main(*, smoke: bool) -> None:
    """Fit, and compare standard errors with the scatter of many fits."""
    if smoke:
        few = replace(STEPS, t_end=0.1 * STEPS.t_end)
        tell(fitted(film(0, few), TRUTH, few))
        return
    seen = film(0)
    fit = fitted(seen)
    tell(fit)
    keep(seen, fit)
    every = [fitted(film(number), TRUTH) for number in range(1, 31)]
    for name, truth in TRUTH.items():
        found = np.array([one.values[name] for one in every])
        error = float(np.mean([one.errors[name] for one in every]))
        inside = [low <= truth <= high for low, high in (one.interval(name) for one in every)]
        print(
            f"{name}: estimates scatter by {found.std(ddof=1) / error:.2f} of their standard "
            f"errors, {sum(inside)} of {len(inside)} intervals hold the truth"
        )


if __name__ == "__main__":
    main(smoke="--smoke" in sys.argv)
