# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rotating shaft with an unbalanced disk (Bauchau, Betsch, Cardona and others 2016)."""

import math

import numpy as np

import flexfem as ff
from tests.verification.motions import run
from tests.verification.result import Result

SAG, FREQUENCY = -3.30981e-3, 56.87
STIFFNESS = (313.4e6, 60.5e6, 60.5e6, 272.7e3, 354.5e3, 354.5e3)
AREA, MASS, RADIUS, THICKNESS = math.pi * (0.05**2 - 0.045**2), 70.573, 0.24, 0.05
SECOND_MOMENT = math.pi / 4 * (0.05**4 - 0.045**4)
SPEED, SLOW, FAST = 60.0, 0.8, 1.2


def speed(t: float) -> float:
    """Law of the drive: below the critical speed, then above it, rad/s."""
    if t < 0.5:
        return 0.5 * SLOW * SPEED * (1.0 - math.cos(2.0 * math.pi * t))
    if t < 1.0:
        return SLOW * SPEED
    if t < 1.25:
        rise = 1.0 - math.cos(4.0 * math.pi * (t - 1.0))
        return SLOW * SPEED + 0.5 * (FAST - SLOW) * SPEED * rise
    return FAST * SPEED


def angle(t: float) -> float:
    """Its integral, rad."""
    first, rise = min(t, 0.5), min(max(t - 1.0, 0.0), 0.25)
    turned = 0.5 * SLOW * SPEED * (first - math.sin(2.0 * math.pi * first) / (2.0 * math.pi))
    turned += SLOW * SPEED * (min(max(t - 0.5, 0.0), 0.5) + rise)
    swell = rise - math.sin(4.0 * math.pi * rise) / (4.0 * math.pi)
    return turned + 0.5 * (FAST - SLOW) * SPEED * swell + FAST * SPEED * max(t - 1.25, 0.0)


def build(elements: int, drive: bool, damping: float) -> ff.Model:
    """Shaft of 6 m along x, disk in the middle with its mass centre 50 mm off the axis."""
    points = np.zeros((elements + 1, 3))
    points[:, 0] = np.linspace(0.0, 6.0, elements + 1)
    cells = np.stack([np.arange(elements), np.arange(1, elements + 1)], axis=1)
    mesh = ff.LineMesh(points, cells, {"shaft": np.arange(elements)})
    line, turning = 7800.0 * AREA, 7800.0 * SECOND_MOMENT
    section = ff.Section.general(
        stiffness=STIFFNESS, inertia=(line, line, line, 2 * turning, turning, turning)
    )
    across = MASS * (RADIUS**2 / 4 + THICKNESS**2 / 12)
    left, right = ff.Marker("shaft", "start"), ff.Marker("shaft", "end")
    model, x = ff.Model("shaft", mesh=mesh), (1.0, 0.0, 0.0)
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.Beam("shaft", section, orientation=(0.0, 1.0, 0.0), damping=damping),
        ff.RigidBody("disk", MASS, (MASS * RADIUS**2 / 2, across, across), position=(3, 0, 0),
                     centre=(0.0, 0.0, 0.05)),
        ff.Rigid("seat", ff.Marker("shaft", 0.5), ff.Marker("disk")),
        ff.Cylindrical("right_bearing", ff.Ground((6, 0, 0)), right, axis=x),
        ff.Revolute("left_bearing", ff.Ground(), left, axis=x),
        ff.PrescribedAngle("motor", ff.Ground(), left, axis=x,
                           angle=angle if drive else lambda t: 0.0),
        ff.PositionProbe("middle", ff.Marker("shaft", 0.5)),
        ff.EnergyProbe(),
    )  # fmt: skip
    return model


def _frequency(t: np.ndarray, z: np.ndarray) -> float:
    """Of an oscillation about its mean value, rad/s, from its first and last upward crossing."""
    at = np.flatnonzero((z[:-1] < 0.0) & (z[1:] >= 0.0))
    times = t[at] - z[at] * (t[at + 1] - t[at]) / (z[at + 1] - z[at])
    return 2.0 * math.pi * (len(at) - 1) / float(times[-1] - times[0])


def results(full: bool = True) -> list[Result]:
    """Sag, frequency of bending, and the energy balance of the run through the critical speed."""
    elements, h, case = (32 if full else 16), 1e-3, "rotating shaft"
    mesh = f"{elements} elements, h = {h:g} s"
    # long steps with annihilation end in equilibrium
    rest = run(build(elements, False, 0.02), 1.0, 30.0, rho_inf=0.0)
    swing = run(build(elements, False, 0.0), h, 1.0 if full else 0.5)
    sag, found = float(rest["middle_z"][-1]), _frequency(swing["t"], swing["middle_z"] - SAG)
    source = "beam theory"
    tolerance = 1e-2 if full else 2e-2
    results = [
        # without the shaft's own weight a quarter less; half the span's stiffness, eight times
        Result(case, "sag, m", SAG, source, sag, mesh, tolerance),
        Result(case, "first bending, rad/s", FREQUENCY, source, found, mesh, tolerance),
    ]
    if full:
        run_up = run(build(elements, True, 0.0), h, 2.5)
        lost = float(np.abs(run_up["energy_balance"]).max() / run_up["energy_work"].max())
        what = "energy lost, share of the drive's work"
        results.append(Result(case, what, 0.0, "conservation", lost, mesh, 2e-2, 1.0))
    return results
