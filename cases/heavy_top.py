# SPDX-License-Identifier: LGPL-3.0-or-later
"""Heavy top: a rigid body on a spherical joint, the test of Lie-group integrators.

Mass 15 kg, inertia diag(0.234375, 0.46875, 0.234375) kg m^2 about its centre, which lies 1 m from
the fixed point along Y at the start; initial angular velocity (0, 150, -4.61538) rad/s (fast top),
or a hundredth of it (slow top, ``--spin slow``); gravity 9.81 m/s^2 along -Z.

History: ``centre_x, centre_y, centre_z`` of the centre of mass, m, and ``spin_x, spin_y, spin_z``,
the angular velocity in body axes, rad/s.

Expected (DOP853 at 1e-13): fast top at t = 0.5 s, centre (-0.70246830, -0.02116519, -0.71140026);
slow top at t = 1 s, centre (-0.03116865, -0.98338368, -0.17884365). Order 2 in all of them from the
first step on. Run: ``python cases/heavy_top.py --dt 1e-3``.
"""

import sys

import numpy as np

import flexfem as ff


def build(
    *, spin: str, spin_y: float, spin_z: float, mass: float, inertia: float,
    axial_inertia: float, distance: float, gravity: float,
) -> ff.Model:  # fmt: skip
    """Model of a top whose initial spin is that of ``spin`` unless its components are given."""
    centre, omega = np.array([0.0, distance, 0.0]), np.array([0.0, spin_y, spin_z])
    model = ff.Model("heavy_top")
    model.add(
        ff.Gravity((0.0, 0.0, -gravity)),
        ff.RigidBody(
            "top", mass, (inertia, axial_inertia, inertia), position=centre,
            velocity=np.cross(omega, centre), angular_velocity=omega,
            shape=ff.Cylinder(radius=0.25, length=0.25, axis=(0.0, 1.0, 0.0)),
        ),
        ff.Spherical("tip", ff.Ground(), ff.Marker("top", offset=-centre)),
        ff.PositionProbe("centre", ff.Marker("top")),
        ff.Probe(
            "spin", ff.Marker("top"), ("spin_x", "spin_y", "spin_z"),
            lambda t, s: s.rotation.T @ s.angular_velocity,
        ),
    )  # fmt: skip
    return model


CASE = ff.Case(
    name="heavy_top",
    summary="rigid body on a spherical joint: order and accuracy of the integrator",
    description=__doc__,
    build=build,
    options=(
        ff.Option("spin", str, "fast", "initial spin", choices=("fast", "slow")),
        ff.Option("spin_y", float, 150.0, "initial spin about the axis of the top", unit="rad/s"),
        ff.Option("spin_z", float, -4.61538, "initial spin about Z", unit="rad/s"),
        ff.Option("mass", float, 15.0, "of the top", unit="kg", above=0.0),
        ff.Option("inertia", float, 0.234375, "across its axis", unit="kg m^2", above=0.0),
        ff.Option("axial_inertia", float, 0.46875, "about its axis", unit="kg m^2", above=0.0),
        ff.Option("distance", float, 1.0, "from the tip to the centre", unit="m", above=0.0),
        ff.Option("gravity", float, 9.81, "along -Z", unit="m/s^2"),
    ),
    presets={"spin": {"slow": {"spin_y": 1.5, "spin_z": -0.0461538}}},
    dt=1e-3,
    t_end=1.0,
    smoke={"t_end": 5e-3},
    results=lambda history: {f"centre_{axis}": history[f"centre_{axis}"][-1] for axis in "xyz"},
)

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
