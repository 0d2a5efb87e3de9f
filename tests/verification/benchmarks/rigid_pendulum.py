# SPDX-License-Identifier: LGPL-3.0-or-later
"""Simple pendulum, benchmark A01 of the IFToMM library of multibody benchmarks."""

import flexfem as ff
from tests.verification.motions import compare, run
from tests.verification.result import Result

SOURCE = "elliptic functions"
#: place and velocity of the mass
REFERENCE = {
    1.0: (0.98629175113, -0.16501085313),
    2.0: (-0.79356619535, -0.60848393044),
    5.0: (-0.94230543504, -0.33475433841),
    10.0: (-0.27508746258, -0.96141920510),
}
SPEED = {10.0: (4.17559810, -1.19474905)}


def build() -> ff.Model:
    """A mass of 1 kg at 1 m, released level."""
    model = ff.Model("pendulum")
    model.add(
        ff.Gravity((0.0, -9.81, 0.0)),
        ff.RigidBody("bob", 1.0, (1e-9, 1e-9, 1e-9), position=(-1.0, 0.0, 0.0)),
        ff.Revolute("pin", ff.Ground(), ff.Marker("bob", offset=(1.0, 0.0, 0.0)), axis=(0, 0, 1)),
        ff.PositionProbe("place", ff.Marker("bob")),
        ff.Probe("speed", ff.Marker("bob"), ("speed_x", "speed_y"), lambda t, s: s.velocity[:2]),
    )
    return model


def results(full: bool = True) -> list[Result]:
    """Position at four times and the velocity at the end."""
    h = 5e-4 if full else 2e-3
    # the error of the period, (omega h)^2/12 and smaller, times the angle passed
    tolerance = 2e-5 if full else 2e-4
    history, mesh = run(build(), h, 10.0 if full else 2.0), f"h = {h:g} s"
    places = {t: x for t, x in REFERENCE.items() if full or t <= 2.0}
    common = ("simple pendulum A01", SOURCE, mesh, history)
    return [
        *compare(*common, ("place_x", "place_y"), places, tolerance, 1.0),
        *compare(*common, ("speed_x", "speed_y"), SPEED if full else {}, tolerance, 4.4),
    ]
