# SPDX-License-Identifier: LGPL-3.0-or-later
"""Modes of a blade on a rotating hub.

A blade of length 1 m, 1 kg and bending stiffnesses 1 N m^2 (flap) and 100 N m^2 (chord) is clamped
to a hub of radius ``--hub`` that rotates about Z with ``--spin``. Centrifugal forces stiffen it:
the frequencies are those about the stretched relative equilibrium. In these units spin and
frequencies (rad/s) are the dimensionless ones of the literature.

History: ``t`` is the number of the mode; ``frequency`` (Hz), ``damping_ratio``, ``real`` and
``imag`` of the eigenvalue (1/s), ``mass_x, mass_y, mass_z``, effective masses along the axes (kg).
The folders ``mode_01``, ... hold one period of each mode for ParaView.

Expected (Wright et al. 1982): first flap frequency 13.1702 rad/s at ``--spin 12`` without hub
radius, 19.7215 with ``--hub 1``; 40 elements give 13.172 and 19.726.
Run: ``mpirun -n 2 python cases/blade.py --spin 12 --modes 6``.
"""

import math
import sys

import flexfem as ff


def build(
    *, elements: int, hub: float, length: float, axial_stiffness: float, flap_stiffness: float,
    lag_stiffness: float, torsional_stiffness: float, line_mass: float, line_inertia: float,
) -> ff.Model:  # fmt: skip
    """Model with ``elements`` elements along the blade."""
    mesh = ff.build_mesh("chain", links=1, elements=elements, length=length)
    section = ff.Section.general(
        (axial_stiffness,) * 3 + (torsional_stiffness, flap_stiffness, lag_stiffness),
        (line_mass,) * 3 + (2.0 * line_inertia, line_inertia, line_inertia),
        outline=[(-0.05, -0.005), (0.05, -0.005), (0.05, 0.005), (-0.05, 0.005)],
    )  # fmt: skip
    model = ff.Model("blade", mesh=mesh)
    model.add(
        ff.Beam("blade", section, group="link_1", orientation=(0.0, 1.0, 0.0)),
        ff.RigidBody("hub", 1.0, (1.0, 1.0, 1.0), position=(-hub, 0.0, 0.0)),
        ff.Revolute("bearing", ff.Ground((-hub, 0, 0)), ff.Marker("hub"), axis=(0, 0, 1)),
        ff.PrescribedAngle("motor", ff.Ground((-hub, 0, 0)), ff.Marker("hub"), axis=(0, 0, 1)),
        ff.Rigid("clamp", ff.Marker("hub", offset=(hub, 0, 0)), ff.Marker("blade", "start")),
        ff.PositionProbe("tip", ff.Marker("blade", "end")),
        ff.StrainProbe("root", "blade", 0.0),
    )
    return model


CASE = ff.Case(
    name="blade",
    summary="modes of a rotating blade, stiffened by centrifugal forces",
    description=__doc__,
    build=build,
    options=(
        ff.Option("elements", int, 40, "beam elements along the blade", minimum=2),
        ff.Option(
            "hub", float, 0.0, "radius of the hub; the axis is at --centre", unit="m", minimum=0
        ),
        ff.Option("length", float, 1.0, "of the blade", unit="m", above=0.0),
        ff.Option("axial_stiffness", float, 1e6, "EA, GA2 and GA3", unit="N", above=0.0),
        ff.Option(
            "flap_stiffness", float, 1.0, "EI out of the plane of rotation", unit="N m^2", above=0.0
        ),
        ff.Option("lag_stiffness", float, 100.0, "EI in that plane", unit="N m^2", above=0.0),
        ff.Option("torsional_stiffness", float, 1.0, "GJ", unit="N m^2", above=0.0),
        ff.Option("line_mass", float, 1.0, "mass per length", unit="kg/m", above=0.0),
        ff.Option("line_inertia", float, 1e-7, "rotary inertia per length", unit="kg m", above=0.0),
    ),
    analysis=ff.MODES,
    modes=6,
    spin=12.0,
    smoke={"elements": 4, "modes": 3, "frames": 2},
    results=lambda history: {"lowest_speed": 2.0 * math.pi * history["frequency"][0]},
)

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
