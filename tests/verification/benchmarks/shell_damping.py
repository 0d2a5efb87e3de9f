# SPDX-License-Identifier: LGPL-3.0-or-later
"""Free vibration of a cantilever strip with stiffness-proportional damping.

Without Poisson's ratio the strip is a beam, whose lowest frequency is ``1.87510^2`` over the square
of the length times the root of EI/m. Damping of a time c takes the share ``c omega/2`` of critical
damping from a mode, and the energy falls by ``exp(-c omega^2 t)`` in whole periods. Bent by a force
at its end, the strip vibrates in its lowest mode once the others, which are damped more, are gone.
"""

from math import exp, pi, sqrt

import flexfem as ff
from tests.verification.motions import run
from tests.verification.result import Result

THICKNESS, YOUNGS, DENSITY = 5e-3, 2e9, 7800.0
OMEGA = 1.8751040687**2 * sqrt(YOUNGS * THICKNESS**2 / (12.0 * DENSITY))
PERIOD = 2.0 * pi / OMEGA
#: Share of critical damping of the lowest mode, and steps in a period.
SHARE, STEPS = 0.03, 200


def strip(element: str, cells: int) -> ff.Model:
    """Strip of length 1 m, bent by a small force that is gone after the start."""
    mesh = ff.SurfaceMesh.rectangle("strip", (1.0, 0.1), (cells, 1))
    section = ff.ShellSection.isotropic(THICKNESS, ff.Material(YOUNGS, 0.0, DENSITY))
    model = ff.Model("strip", surface=mesh)
    model.add(
        ff.Shell(
            "strip", section, element=element, edges={"strip_left": "clamped"},
            damping=2.0 * SHARE / OMEGA,
        ),
        ff.EdgeLoad(
            "bend", "strip", "strip_right", (0.0, 0.0, 0.1),
            amplitude=lambda t: 1.0 if t <= 0.0 else 0.0,
        ),
        ff.EnergyProbe(),
    )  # fmt: skip
    return model


def results(full: bool = True) -> list[Result]:
    """Decay of the energy from the second period on, and what the dissipation leaves open."""
    lines, periods = [], 5 if full else 3
    decay = exp(-2.0 * SHARE * 2.0 * pi * (periods - 2))
    for element, cells in (("rotation_free", 32 if full else 16), ("director", 8 if full else 6)):
        dt = PERIOD / (STEPS if full else STEPS // 4)
        history = run(strip(element, cells), dt, periods * PERIOD, start="equilibrium")
        energy = history["energy_kinetic"] + history["energy_strain"]
        case, words = f"damped strip, {element}", f"{cells} x 1 cells, h = {dt:.4g} s"
        late = float(energy[-1] / energy[round(2.0 * PERIOD / dt)])
        balance = float(history["energy_balance"][-1] / history["energy_dissipation"][-1])
        lines += [
            # mesh, and higher modes that are left; damping that acts on bending or stretching
            # alone, or with another factor, changes the first digit
            Result(case, f"energy after {periods} periods over that after 2", decay, "closed form",
                   late, words, 2e-3 if full else 1e-2),
            # damped motion loses what the dissipation says; half of it, or one by other rates than
            # those of the strains, leaves the first digit
            Result(case, "energy balance over dissipation", 0.0, "conservation", balance, words,
                   1e-3),
        ]  # fmt: skip
    return lines
