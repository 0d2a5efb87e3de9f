# SPDX-License-Identifier: LGPL-3.0-or-later
"""The best tuned mass damper: SciPy minimises a result over options of a model.

A mass on a spring vibrates after a blow; a small mass on a spring and a damper of its own calms it.
Which stiffness and damping leave the least integral of the square of the deflection over time? That
is also the answer for a random force of all frequencies, for which there is a closed form (T. Asami
et al., J. Vib. Acoust. 124, 2002, 284-295, H2 optimisation without damping of the main mass).

``python examples/tuned_damper.py`` takes about half a minute; with ``--smoke`` it makes a few runs.
"""

import math
import sys

import numpy as np
from scipy.optimize import minimize

import flexfem as ff

MASS, FREQUENCY, RATIO = 100.0, 2.0 * math.pi, 0.05  # kg, rad/s, damper to main mass
AXIS = (1.0, 0.0, 0.0)


def build(*, tuning: float, damping: float) -> ff.Model:
    """Model of both masses, 1 m apart; the blow gives the main mass 1 m/s."""
    small = RATIO * MASS
    own = tuning * FREQUENCY
    ground, main, damper = ff.Ground(), ff.Marker("main"), ff.Marker("damper")
    inertia = (1.0, 1.0, 1.0)
    model = ff.Model("tuned_damper")
    model.add(
        ff.RigidBody("main", MASS, inertia, position=(1.0, 0.0, 0.0), velocity=AXIS),
        ff.RigidBody("damper", small, inertia, position=(2.0, 0.0, 0.0)),
        ff.Prismatic("rail", ground, main, axis=AXIS),
        ff.Prismatic("slide", ground, damper, axis=AXIS),
        ff.SpringDamper("tower", ground, main, stiffness=MASS * FREQUENCY**2, rest_length=1.0),
        ff.SpringDamper(
            "spring", main, damper, stiffness=small * own**2, damping=2.0 * damping * small * own,
            rest_length=1.0,
        ),
        ff.Probe("path", main, ("deflection",), lambda t, at: (at.position[0] - 1.0,)),
    )  # fmt: skip
    return model


CASE = ff.Case(
    name="tuned_damper",
    summary="a mass on a spring with a tuned mass damper",
    build=build,
    options=(
        ff.Option("tuning", float, 1.0, "frequency of the damper over that of the mass", above=0.0),
        ff.Option("damping", float, 0.1, "of the damper, over the critical one", minimum=0.0),
    ),
    dt=0.02,
    t_end=16.0,
)


def main(*, smoke: bool) -> None:
    """Minimise, and compare with the closed form."""
    few = {"t_end": 0.1} if smoke else {}

    def cost(values: np.ndarray) -> float:
        """Integral of the square of the deflection, m^2 s; infinite where a run is impossible."""
        tuning, damping = map(float, values)
        if tuning <= 0.0 or damping < 0.0:
            return math.inf
        outcome = CASE.run(tuning=tuning, damping=damping, quiet=True, **few)
        history = outcome.history
        square = float(np.trapezoid(history["deflection"] ** 2, history["t"]))
        return square if outcome.status == "ok" else math.inf

    best = minimize(
        cost, [1.0, 0.08], method="Nelder-Mead",
        options={"xatol": 1e-3, "fatol": 1e-7, "maxiter": 1 if smoke else 60},
    )  # fmt: skip
    tuning = math.sqrt((2.0 + RATIO) / 2.0) / (1.0 + RATIO)
    damping = math.sqrt(RATIO * (4.0 + 3.0 * RATIO) / (8.0 * (1.0 + RATIO) * (2.0 + RATIO)))
    print(f"after {best.nfev} runs: tuning {best.x[0]:.3f}, damping {best.x[1]:.3f}; "
          f"the closed form gives {tuning:.3f} and {damping:.3f}")  # fmt: skip
    if not smoke:
        values = dict(zip(("tuning", "damping"), best.x.tolist(), strict=True))
        CASE.run(**values, quiet=True, output="results/tuned_damper")


if __name__ == "__main__":
    main(smoke="--smoke" in sys.argv)
