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

SPIN = {"fast": (0.0, 150.0, -4.61538), "slow": (0.0, 1.5, -0.0461538)}


def build(*, spin: str) -> ff.Model:
    """Model of the fast or the slow top."""
    centre, omega = np.array([0.0, 1.0, 0.0]), np.array(SPIN[spin])
    model = ff.Model("heavy_top")
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.RigidBody(
            "top", 15.0, (0.234375, 0.46875, 0.234375), position=centre,
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
    options=(ff.Option("spin", str, "fast", "initial spin", choices=("fast", "slow")),),
    dt=1e-3,
    t_end=1.0,
    smoke={"t_end": 5e-3},
    results=lambda history: {f"centre_{axis}": history[f"centre_{axis}"][-1] for axis in "xyz"},
)

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
