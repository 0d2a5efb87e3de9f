# SPDX-License-Identifier: LGPL-3.0-or-later
"""Beam spun up about one end (Simo, Vu-Quoc 1986): centrifugal forces stiffen it."""

import math

import numpy as np

import flexfem as ff
from tests.verification.motions import compare, run
from tests.verification.result import Result

SOURCE = "spectral rods"
#: displacement of the tip in the axes of the hub, of a beam of 10
REFERENCE = {
    2.0: (-6.059015e-4, -0.1023806),
    4.0: (-6.766007e-3, -0.3422786),
    5.0: (-0.01265464, -0.4684762),
    6.0: (-0.01697125, -0.5435964),
    8.0: (-0.01662992, -0.5428415),
    10.0: (-0.00707234, -0.3628145),
    12.0: (-8.03987e-4, -0.1509007),
    15.0: (5.139897e-4, 1.3036e-3),
}
PEAK = -0.573835
EXTENSION = 5.142857e-4


def _angle(t: float) -> float:
    if t >= 15.0:
        return 6.0 * t - 45.0
    wave = (15.0 / (2.0 * math.pi)) ** 2
    return 0.4 * (0.5 * t * t + wave * (math.cos(2.0 * math.pi * t / 15.0) - 1.0))


def _tip(t: float, tip: ff.MarkerState) -> tuple[float, float]:
    c, s = math.cos(_angle(t)), math.sin(_angle(t))
    x, y, _ = tip.position
    return c * x + s * y - 10.0, c * y - s * x


def build(elements: int) -> ff.Model:
    """Straight beam along x whose root is rotated about z."""
    points = np.zeros((elements + 1, 3))
    points[:, 0] = np.linspace(0.0, 10.0, elements + 1)
    cells = np.stack([np.arange(elements), np.arange(1, elements + 1)], axis=1)
    mesh = ff.LineMesh(points, cells, {"beam": np.arange(elements)})
    section = ff.Section.general(
        stiffness=(2.8e7, 1e7, 1e7, 1.4e4, 1.4e4, 1.4e4),
        inertia=(1.2, 1.2, 1.2, 1.2e-3, 6e-4, 6e-4),
    )
    root = ff.Marker("beam", "start")
    model = ff.Model("spin_up", mesh=mesh)
    model.add(
        ff.Beam("beam", section, orientation=(0.0, 1.0, 0.0)),
        ff.Revolute("bearing", ff.Ground(), root, axis=(0, 0, 1)),
        ff.PrescribedAngle("motor", ff.Ground(), root, axis=(0, 0, 1), angle=_angle),
        ff.Probe("tip", ff.Marker("beam", "end"), ("u1", "u2"), _tip),
        ff.EnergyProbe(),
    )
    return model


def results(full: bool = True) -> list[Result]:
    """Tip in the axes of the hub, its extreme, the extension in steady rotation."""
    elements, h, end = (16, 5e-3, 20.0) if full else (8, 0.02, 6.0)
    history = run(build(elements), h, end)
    case, mesh = "spin-up beam", f"{elements} elements, h = {h:g} s"
    rows = {t: v for t, v in REFERENCE.items() if t <= end}
    # without centrifugal stiffening the deflection grows without bound after 6 s
    tolerance = 2e-3 if full else 5e-3
    common = (case, SOURCE, mesh, history)
    found = compare(*common, ("u1",), {t: v[:1] for t, v in rows.items()}, tolerance, 0.02)
    found += compare(*common, ("u2",), {t: v[1:] for t, v in rows.items()}, tolerance, 0.57)
    if full:
        peak, after = float(history["u2"].min()), history["t"] >= 15.0
        steady = float(history["u1"][after].mean())
        found.append(Result(case, "largest deflection", PEAK, SOURCE, peak, mesh, tolerance))
        what = "mean extension after 15 s"
        found.append(Result(case, what, EXTENSION, "closed form", steady, mesh, 2e-2))
    return found
