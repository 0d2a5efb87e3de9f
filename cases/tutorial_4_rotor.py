# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tutorial 4: modes of a rotor, at rest and over its speed.

A steel shaft of 0.5 m (diameter 12 mm, E = 2.1e11 N/m^2, nu = 0.3, rho = 7850 kg/m^3) along Z runs
in a stiff bearing with a motor at one end and carries a disk of 2 kg at the other, radius
``--radius``. As the overhung disk tilts when the shaft bends, gyroscopic moments separate forward
from backward whirls.

History: ``t`` is the speed of rotation (rad/s). Every mode has ``<mode>_frequency`` (Hz, in axes
that rotate with the shaft), ``<mode>_fixed`` (Hz, in fixed axes; negative for whirls against the
rotation), ``<mode>_damping`` (ratio) and ``<mode>_whirl`` (1 circular with the rotation, -1 against
it, 0 plane). Modes are ``forward_1``, ``backward_1``, ..., and ``mode_1``, ... for others.

Expected: at rest the bending modes of both planes have 7.74 Hz and 72.4 Hz (a rigid disk on a shaft
without mass: 7.93 Hz and 78.8 Hz), torsion 24.05 Hz. With the speed forward whirls rise and
backward ones fall; at 400 rad/s the first have 9.52 Hz and 5.86 Hz.
Run: ``python cases/tutorial_4_rotor.py``, then
``flexfem plot results/tutorial_4_rotor --campbell``. Shapes at rest:
``python cases/tutorial_4_rotor.py --analysis modes``.
"""

import sys

import flexfem as ff

AXIS = (0.0, 0.0, 1.0)


def build(
    *, elements: int, length: float, diameter: float, youngs_modulus: float, poisson_ratio: float,
    density: float, radius: float, mass: float,
) -> ff.Model:  # fmt: skip
    """Model with ``elements`` elements along the shaft and a thin disk of this radius."""
    mesh = ff.LineMesh.straight({"shaft": [(0.0, 0.0, 0.0), (0.0, 0.0, length)]}, elements)
    steel = ff.Material(youngs_modulus, poisson_ratio, density)
    start, end = ff.Marker("shaft", "start"), ff.Marker("shaft", "end")
    about, across = mass * radius**2 / 2.0, mass * radius**2 / 4.0

    model = ff.Model("tutorial_4_rotor", mesh=mesh)
    model.add(
        ff.Beam("shaft", ff.Section.circle(diameter, steel), orientation=(1.0, 0.0, 0.0)),
        ff.RigidBody(
            "disk", mass, (across, across, about), position=(0.0, 0.0, length),
            shape=ff.Cylinder(radius=radius, length=0.01, axis=AXIS),
        ),
        ff.Rigid("fit", end, ff.Marker("disk")),
        # the bearing leaves its rotation free; the drive prescribes it, and rotates along in a
        # steady rotation
        ff.Revolute("bearing", ff.Ground(), start, axis=AXIS),
        ff.PrescribedAngle("motor", ff.Ground(), start, axis=AXIS),
    )  # fmt: skip
    return model


CASE = ff.Case(
    name="tutorial_4_rotor",
    summary="tutorial 4: modes and Campbell diagram of an overhung rotor",
    description=__doc__,
    build=build,
    options=(
        ff.Option("elements", int, 16, "beam elements of the shaft", minimum=2),
        ff.Option("length", float, 0.5, "of the shaft", unit="m", above=0.0),
        ff.Option("diameter", float, 0.012, "of the shaft", unit="m", above=0.0),
        ff.Option("youngs_modulus", float, 2.1e11, "of the shaft", unit="N/m^2", above=0.0),
        ff.Option("poisson_ratio", float, 0.3, "of the shaft", minimum=0.0, maximum=0.5),
        ff.Option("density", float, 7850.0, "of the shaft", unit="kg/m^3", above=0.0),
        ff.Option("radius", float, 0.12, "of the disk", unit="m", above=0.0),
        ff.Option("mass", float, 2.0, "of the disk", unit="kg", above=0.0),
    ),
    analysis=ff.CAMPBELL,
    modes=6,
    spin_end=400.0,
    speeds=21,
    smoke={"elements": 2, "speeds": 2, "modes": 4},
    results=lambda history: {
        f"{name}_end": float(column[-1])
        for name, column in history.items()
        if name.endswith("_fixed")
    },
)

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
