# SPDX-License-Identifier: LGPL-3.0-or-later
"""Flyball governor, benchmark A05 of the IFToMM library: stiff springs and dampers on a spinner."""

import math

import numpy as np

import flexfem as ff
from tests.verification.motions import box_inertia, compare, run
from tests.verification.result import Result

SOURCE = "three freedoms, DAE at 1e-12"
STIFF = {
    0.1: (0.523836476, 0.496173869, 6.103717809),
    0.5: (0.743249425, 0.259491382, 5.103415422),
    1.0: (0.501420922, 0.521833302, 6.271125742),
    2.0: (0.505909294, 0.516663797, 6.236223614),
    5.0: (0.535563104, 0.482874577, 6.022496500),
    10.0: (0.619622917, 0.390073702, 5.548203623),
}
SOFT = {
    1.0: (0.485212991, 0.517603241, 6.242521197),
    10.0: (0.610999675, 0.376720968, 5.491844285),
}
SPIN = 2.0 * math.pi


def _turned(angle: float) -> np.ndarray:
    """Rotation about y."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def build(stiffness: float, damping: float) -> ff.Model:
    """Shaft along z, two rods with balls 30 degrees below the level, slider at half height."""
    model, spin = ff.Model("governor"), np.array([0.0, 0.0, SPIN])
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.RigidBody("shaft", 0.3, box_inertia(0.3, 0.01, 0.01, 1.0), position=(0, 0, 0.5),
                     angular_velocity=spin),
        ff.RigidBody("slider", 3.0, box_inertia(3.0, 0.1, 0.1, 0.1), position=(0, 0, 0.5),
                     angular_velocity=spin),
        ff.Revolute("bearing", ff.Ground((0, 0, 0.5)), ff.Marker("shaft"), axis=(0, 0, 1)),
        ff.Prismatic("guide", ff.Marker("shaft"), ff.Marker("slider"), axis=(0, 0, 1)),
    )  # fmt: skip
    for side, name in ((1.0, "right"), (-1.0, "left")):
        # the rod's x axis points outwards and down
        turn = _turned(math.radians(30.0) if side > 0 else math.radians(150.0))
        hinge = np.array([0.05 * side, 0.0, 1.0])
        middle = hinge + turn @ (0.5, 0.0, 0.0)
        model.add(
            ff.RigidBody(
                name, 0.3, box_inertia(0.3, 1.0, 0.01, 0.01), position=middle, rotation=turn,
                velocity=np.cross(spin, middle), angular_velocity=spin,
            ),
            ff.PointMass(f"{name}_ball", 5.0, ff.Marker(name, offset=(0.5, 0.0, 0.0))),
            ff.Revolute(
                f"{name}_hinge", ff.Marker("shaft", offset=hinge - (0, 0, 0.5)),
                ff.Marker(name, offset=(-0.5, 0.0, 0.0)), axis=(0, 1, 0),
            ),
            ff.SpringDamper(
                f"{name}_spring", ff.Marker("slider", offset=(0.05 * side, 0.0, 0.0)),
                ff.Marker(name), stiffness=stiffness, damping=damping, rest_length=0.5,
            ),
        )  # fmt: skip
    rod = ff.Marker("right", rotation=_turned(math.radians(30.0)))
    model.add(ff.Probe(
        "state", (ff.Marker("slider"), rod, ff.Marker("shaft")), ("s", "beta", "omega"),
        lambda t, slider, rod, shaft: (
            slider.position[2], -math.asin(rod.rotation[2, 0]), shaft.angular_velocity[2]
        ),
    ))  # fmt: skip
    return model


def results(full: bool = True) -> list[Result]:
    """Height of the slider, angle of the rods and rate of the shaft."""
    h, found = (1e-3 if full else 2e-3), []
    for name, k, c, rows in (("stiff", 8e5, 4e4, STIFF), ("soft", 4e3, 2e2, SOFT)):
        kept = {t: values for t, values in rows.items() if full or t <= 1.0}
        history = run(build(k, c), h, max(kept))
        # of second order; without the dampers or with another spring it is off by tenths
        found += compare(
            f"flyball governor A05, {name}", SOURCE, f"h = {h:g} s", history,
            ("s", "beta", "omega"), kept, 1e-4, 1.0,
        )  # fmt: skip
    return found
