# SPDX-License-Identifier: LGPL-3.0-or-later
"""Link on a moving base (Kane, Ryan, Banerjee 1987): spin-up and deployment by three theories.

The source shows figures only: the reference is the geometrically exact beam on a fine mesh.
"""

import math
from collections.abc import Iterator, Mapping

import numpy as np
import scipy.optimize

import flexfem as ff
from flexfem import research
from flexfem.research.moving_base.equations import PrescribedBaseEquations
from tests.verification.result import Result

#: Geometrically exact, h = 0.01 s.
SOURCE = "48 beam elements"
#: Twist of the spin-up at times, its largest, degrees.
TWIST, LARGEST = {8.0: 18.16, 10.0: 5.72, 12.0: 1.48}, 43.06
#: Lag of the spin-up, means of u3 and stretch after it, m.
LAG, OUT, STRETCH = -0.3854, -0.04433, 3.947e-4
#: Results of the deployment: name and value.
DEPLOYMENT = {
    "least u2, m": ("u2_min", -0.07973),
    "least u3, m": ("u3_min", -0.12833),
    "largest u3, m": ("u3_max", 0.06923),
    "largest twist, rad": ("theta1_max", 0.13422),
}
#: Lowest frequency in the plane at rest, without eccentric mass centres, Hz.
LOWEST = 0.9478146

_Values = Mapping[str, float]


def run(case: str, theory: str, full: bool, end: float) -> ff.Outcome:
    """A case by a theory."""
    dt, elements = (0.01, 24) if full else (0.05, 12)
    return ff.load_case(case).run(theory=theory, dt=dt, elements=elements, t_end=end)


def spin_up(theory: str, full: bool) -> Iterator[tuple[str, float, float, float, float]]:
    """Quantity, reference, value, tolerance and scale."""
    outcome = run("spin_up", theory, full, 30.0 if full else 17.0)
    history, exact = outcome.history, theory == "beam"
    # with sections rotated about a vector the twist at 10 s is half of its peak off
    for t, twist in TWIST.items():
        found = math.degrees(np.interp(t, history["t"], history["theta1"]))
        yield f"twist at {t:g} s, degrees", twist, found, 5e-3 if exact else 0.05, LARGEST
    largest = math.degrees(np.abs(history["theta1"]).max())
    # a theory linear in the twist; without eccentric masses there is none
    yield "largest twist, degrees", LARGEST, largest, 1e-2 if exact else 0.25, 0.0
    # without dynamic stiffening it diverges
    yield "largest lag, m", LAG, float(history["u2"].min()), 5e-3 if exact else 0.05, 0.0
    found = outcome.summary["results"]
    if full:
        # an eccentric mass with the wrong arm would be off by its part
        yield "u3 after it, mean, m", OUT, found["u3_mean"], 1e-2, 0.0
        yield "stretch after it, mean, m", STRETCH, found["s_mean"], 5e-3, 0.0


def deployment(theory: str, full: bool) -> Iterator[tuple[str, float, float, float, float]]:
    """The same."""
    found: _Values = run("manipulator_deployment", theory, full, 15.0).summary["results"]
    for what, (name, value) in DEPLOYMENT.items():
        # another course of the joints' angles gives tens of per cent; points on the axis do not
        # twist the channel
        tolerance = {"beam": 5e-3, "consistent": 0.08, "conventional": 0.08}[theory]
        if theory != "conventional" or name != "theta1_max":
            yield what, value, found[name], tolerance, 0.0


def critical_spin() -> float:
    """Spin at which bending in the plane diverges by the conventional algorithm, rad/s."""

    def lowest(spin: float) -> float:
        base = research.PrescribedBase(angular_velocity=lambda t: (0.0, 0.0, spin))
        source = research.MovingBaseBeam(
            properties=research.outboard_link(),
            base=base,
            effects=research.effects_of("conventional"),
        )
        equations = source.equations()
        assert isinstance(equations, PrescribedBaseEquations)
        return float(np.linalg.eigvalsh(equations.matrices(0.0)[1])[0])

    return float(scipy.optimize.brentq(lowest, 4.0, 6.0, xtol=1e-4))


def results(full: bool = True) -> list[Result]:
    """Both cases by assumed modes and the exact beam; coarse: spin-up by assumed modes."""
    out = []
    mesh = "24 elements, h = 0.01 s" if full else "12 elements, h = 0.05 s"
    for theory in ("consistent", "conventional", "beam"):
        name = {"beam": "exact beam"}.get(theory, f"{theory} modes")
        rows = []
        if theory != "conventional" and (full or theory == "consistent"):
            rows += [("spin-up of a link", *row) for row in spin_up(theory, full)]
        if full:
            rows += [("deployment of a link", *row) for row in deployment(theory, full)]
        out += [
            Result(f"{case}, {name}", what, reference, SOURCE, value, mesh, tolerance, scale)
            for case, what, reference, value, tolerance, scale in rows
        ]
    # with dynamic stiffening there is none; eccentric mass centres would make it 5.83
    what = "spin that bending diverges at, rad/s"
    found = critical_spin()
    reference = 2.0 * math.pi * LOWEST
    out.append(
        Result(
            "spin-up of a link, conventional modes", what, reference, "mode of 96 beam elements",
            found, "10 modes of 24 elements", 1e-3,
        )
    )  # fmt: skip
    return out
