# SPDX-License-Identifier: LGPL-3.0-or-later
"""Two panels of a solar array that are pulled straight: free hinges, and a fold that holds.

The model is that of ``cases/solar_array.py``. With free hinges the blanket gets flat, and the
spring has the given tension. A clamped fold keeps both panels along it as they lay in the pile:
each is an elastica of length l that begins across the pull and ends in a hinge,
``D theta'' = p sin theta`` with the pull p per width, which tells the tension and the energy.
"""

from functools import cache
from math import asin, pi

import numpy as np
from scipy.integrate import solve_bvp
from scipy.optimize import brentq

import flexfem as ff
from flexfem.cli import load_case
from tests.verification.result import Result

CASE = load_case("solar_array")
WIDTH, LENGTH, THICKNESS, PITCH, SPRING, TENSION = 0.45, 2.4, 0.8e-3, 0.01, 200.0, 20.0
#: Way of the mast, flat blanket and spring.
WAY = 2.0 * WIDTH - 2.0 * PITCH + TENSION / SPRING
#: Long steps that damp vibrations: it is the rest that counts.
END = 20.0


@cache
def elastica(tension: float) -> tuple[float, float]:
    """Height of both panels along the pull (m), and the energy in them (J), without Poisson."""
    rigidity = 8e9 * THICKNESS**3 / 12.0
    first = 0.5 * pi - asin(PITCH / WIDTH)

    def rates(s: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.stack([y[1], tension / LENGTH / rigidity * np.sin(y[0])])

    def ends(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.array([a[0] - first, b[1]])

    s = np.linspace(0.0, WIDTH, 201)
    guess = np.stack([first * np.exp(-s / 0.1), -first / 0.1 * np.exp(-s / 0.1)])
    found = solve_bvp(rates, ends, s, guess, tol=1e-8)
    angle, curvature = found.sol(s)
    height = 2.0 * float(np.trapezoid(np.cos(angle), s))
    return height, rigidity * LENGTH * float(np.trapezoid(curvature**2, s))


def pulled(hinges: str, mesh: str, step: float) -> dict[str, float]:
    """Means over the last second of a run that has come to rest."""
    given = {"panels": 2, "mesh": mesh, "wire_elements": 2, "hinges": hinges, "contact": False}
    model = CASE.model(**given, poisson_ratio=0.0, tension=TENSION)
    options = ff.RunOptions(dt=step, t_end=END, rho_inf=0.0, quiet=True)
    outcome = ff.simulate(model, options)
    if outcome.status != "ok":
        raise RuntimeError(f"solar array: {outcome.status}")
    last = outcome.history["t"] > END - 1.0
    return {name: float(values[last].mean()) for name, values in outcome.history.items()}


def results(full: bool = True) -> list[Result]:
    """Mass, tension, height and energy."""
    mesh, step, tolerance = ("33x5", 0.1, 1e-2) if full else ("9x5", 0.2, 5e-2)
    words = f"2 x {mesh.replace('x', ' x ')} nodes, h = {step:g} s"
    model = CASE.model(panels=2)
    panel = next(shell for shell in model.shells if shell.name == "panel_1")
    assert model.surface is not None
    mass = panel.section.mass * float(model.surface.areas[model.surface.body_rows("panel_1")].sum())
    free = pulled("free", mesh, step)
    case, source = "solar array, free hinges", "geometry and spring"
    lines = [
        # the printed numbers; a density or size mistaken changes the first digits
        Result("solar array", "mass of a panel, kg", 2.0, "data", mass, "11 x 41 nodes", 1e-4),
        # what is left of the sway, whose square shortens the blanket; a wire, a hinge or a clamp
        # that holds it back changes the first digit
        Result(case, "tension, N", TENSION, source, free["mast_force_fz"], words, 1e-3),
        Result(case, "lift, m", 2.0 * (WIDTH - PITCH), source, free["lift"], words, 1e-4),
    ]

    def missing(tension: float) -> float:
        """Further displacement of the mast that gives the spring a tension, m."""
        return elastica(tension)[0] + tension / SPRING - (WAY + 2.0 * PITCH)

    tension = brentq(missing, 0.5, 60.0, xtol=1e-6)
    height, energy = elastica(tension)
    clamped = pulled("clamped", mesh, step)
    ours = clamped["energy_strain"] - 0.5 * clamped["mast_force_fz"] ** 2 / SPRING
    case, source = "solar array, clamped fold", "elastica"
    # a hinge in place of the clamp stores nothing; half of its stiffness changes the first digit
    lines += [
        Result(case, "tension, N", tension, source, clamped["mast_force_fz"], words, tolerance),
        Result(case, "lift, m", height - 2.0 * PITCH, source, clamped["lift"], words, tolerance),
        Result(case, "energy of the bent panels, J", energy, source, ours, words, tolerance),
    ]
    return lines
