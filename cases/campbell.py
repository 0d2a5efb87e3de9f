# SPDX-License-Identifier: LGPL-3.0-or-later
"""Campbell diagram of a rotating shaft with a disk.

A steel tube of 6 m (radii 0.045 and 0.05 m, E = 2.1e11 N/m^2, nu = 0.3, rho = 7800 kg/m^3) along Z
is driven at one end, where it cannot tilt; at the other end a cylindrical bearing lets it slide. A
disk of 70.573 kg, radius ``--radius`` and thickness 0.05 m is at the fraction ``--place`` of the
length: at the middle the first modes do not tilt it, elsewhere they do and gyroscopic moments
separate forward from backward whirls. No gravity.

History: ``t`` is the speed of rotation (rad/s). Every mode has ``<mode>_frequency`` (Hz, in axes
that rotate with the shaft), ``<mode>_fixed`` (Hz, in fixed axes; negative for whirls against the
rotation), ``<mode>_damping`` (ratio) and ``<mode>_whirl`` (1 circular with the rotation, -1 against
it, 0 plane). Modes are ``forward_1``, ``backward_1``, ..., and ``mode_1``, ... for others.

Expected (shaft of Bauchau et al. 2016): with ``--place 0.5 --radius 0.24`` the first bending
frequency is 56.87 rad/s (9.051 Hz), at any speed but for 0.1 %; 40 elements give 56.95 rad/s.
Figure: ``flexfem plot results/campbell --campbell``. Run: ``python cases/campbell.py``.
"""

import math
import sys
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

import flexfem as ff

AXIS = (0.0, 0.0, 1.0)


def build(
    *, elements: int, place: float, radius: float, disk_mass: float, thickness: float,
    length: float, inner_radius: float, outer_radius: float, youngs_modulus: float,
    poisson_ratio: float, density: float,
) -> ff.Model:  # fmt: skip
    """Model with ``elements`` elements along the shaft."""
    mesh = ff.build_mesh("shaft", elements=elements, length=length)
    steel = ff.Material(youngs_modulus, poisson_ratio, density)
    across = disk_mass * (radius**2 / 4 + thickness**2 / 12)
    section = ff.Section.tube(2.0 * inner_radius, 2.0 * outer_radius, steel)
    seat = round(place * elements) / elements
    start, end = ff.Marker("shaft", "start"), ff.Marker("shaft", "end")
    model = ff.Model("campbell", mesh=mesh)
    model.add(
        ff.Beam("shaft", section, orientation=(1.0, 0.0, 0.0)),
        ff.RigidBody(
            "disk", disk_mass, (across, across, disk_mass * radius**2 / 2),
            position=(0.0, 0.0, seat * length),
            shape=ff.Cylinder(radius=radius, length=thickness, axis=AXIS),
        ),
        ff.Rigid("fit", ff.Marker("shaft", seat), ff.Marker("disk")),
        ff.Revolute("motor_bearing", ff.Ground(), start, axis=AXIS),
        ff.PrescribedAngle("motor", ff.Ground(), start, axis=AXIS),
        ff.Cylindrical("tail_bearing", ff.Ground((0.0, 0.0, length)), end, axis=AXIS),
    )  # fmt: skip
    return model


def results(history: Mapping[str, npt.NDArray[np.float64]]) -> dict[str, float]:
    """Lowest frequency at the first speed, and fixed-axes frequencies at the last."""
    plain = [v[0] for k, v in history.items() if k.endswith("_frequency") and v[0] > 0.0]
    last = {f"{k}_end": v[-1] for k, v in history.items() if k.endswith("_fixed")}
    return {"first_frequency": min(plain), "first_speed": 2.0 * math.pi * min(plain)} | last


CASE = ff.Case(
    name="campbell",
    summary="Campbell diagram of a rotating shaft with a disk: forward and backward whirls",
    description=__doc__,
    build=build,
    options=(
        ff.Option("elements", int, 24, "beam elements along the shaft", minimum=4),
        ff.Option(
            "place",
            float,
            0.25,
            "fraction of the length at which the disk sits",
            above=0,
            maximum=0.99,
        ),
        ff.Option("radius", float, 0.5, "radius of the disk", unit="m", above=0),
        ff.Option("disk_mass", float, 70.573, "mass of the disk", unit="kg", above=0),
        ff.Option("thickness", float, 0.05, "of the disk", unit="m", above=0),
        ff.Option("length", float, 6.0, "of the shaft", unit="m", above=0),
        ff.Option(
            "inner_radius", float, 0.045, "of the shaft, below outer-radius", unit="m", above=0
        ),
        ff.Option("outer_radius", float, 0.05, "of the shaft", unit="m", above=0),
        ff.Option("youngs_modulus", float, 2.1e11, "of the shaft", unit="Pa", above=0),
        ff.Option("poisson_ratio", float, 0.3, "of the shaft", minimum=0, maximum=0.5),
        ff.Option("density", float, 7800.0, "of the shaft", unit="kg/m^3", above=0),
    ),
    analysis=ff.CAMPBELL,
    modes=7,
    spin_end=500.0,
    speeds=21,
    smoke={"elements": 4, "speeds": 3, "modes": 4},
    results=results,
)

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
