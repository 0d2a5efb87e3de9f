# SPDX-License-Identifier: LGPL-3.0-or-later
"""Flying spaghetti: a very flexible free beam tumbling in space (after Simo, Vu-Quoc 1988).

A straight beam of length 10 from the lower end (6, 0, 0) to the upper end (0, 8, 0), at rest and
free. EA = GA2 = GA3 = 1e4, EI2 = EI3 = GJ = 500, mass per length 1, rotary inertia per length
diag(10, 10, 10). At the lower end act the dead force (T/10, 0, 0) and the dead moment
(0, -T/2, -T), with T rising linearly from 0 to 200 at t = 2.5 and falling to 0 at t = 5. No
gravity. Any consistent units.

History: ``lower_x, lower_y, lower_z, upper_x, upper_y, upper_z``, the positions of both ends.

Expected: both ends within 0.02 of ``tests/data/flying_spaghetti.csv`` (another code, refined) over
15 s with 40 elements; the centre of mass at 15 s is (65.5, 4, 0) (impulse of the force).
Run: ``mpirun -n 2 python cases/flying_spaghetti.py --elements 40``.
"""

import sys

import flexfem as ff


def build(
    *, elements: int, base: float, height: float, axial_stiffness: float, shear_stiffness: float,
    bending_stiffness: float, torsional_stiffness: float, line_mass: float, line_inertia: float,
    force: float, moment_y: float, moment_z: float, duration: float,
) -> ff.Model:  # fmt: skip
    """Model with ``elements`` beam elements."""
    mesh = ff.build_mesh("flying_spaghetti", elements=elements, base=base, height=height)
    shear, bending = (shear_stiffness,) * 2, (bending_stiffness,) * 2
    section = ff.Section.general(
        stiffness=(axial_stiffness, *shear, torsional_stiffness, *bending),
        inertia=(line_mass,) * 3 + (line_inertia,) * 3,
    )
    model = ff.Model("flying_spaghetti", mesh=mesh)
    lower, upper = ff.Marker("beam", "start"), ff.Marker("beam", "end")
    pulse = ff.Table((0.0, 0.5 * duration, duration), (0.0, 1.0, 0.0))
    model.add(
        ff.Beam("beam", section, orientation=(0.0, 0.0, 1.0)),
        ff.PointForce("pull", lower, (force, 0.0, 0.0), amplitude=pulse),
        ff.PointMoment("twist", lower, (0.0, moment_y, moment_z), amplitude=pulse),
        ff.PositionProbe("lower", lower),
        ff.PositionProbe("upper", upper),
    )
    return model


CASE = ff.Case(
    name="flying_spaghetti",
    summary="very flexible free beam tumbling in space (Simo, Vu-Quoc 1988)",
    description=__doc__,
    build=build,
    options=(
        ff.Option("elements", int, 40, "beam elements", minimum=1),
        ff.Option("base", float, 6.0, "distance of the lower end from the Y axis", above=0.0),
        ff.Option("height", float, 8.0, "of the upper end", above=0.0),
        ff.Option("axial_stiffness", float, 1e4, "EA", above=0.0),
        ff.Option("shear_stiffness", float, 1e4, "GA2 and GA3", above=0.0),
        ff.Option("bending_stiffness", float, 500.0, "EI2 and EI3", above=0.0),
        ff.Option("torsional_stiffness", float, 500.0, "GJ", above=0.0),
        ff.Option("line_mass", float, 1.0, "mass per length", above=0.0),
        ff.Option("line_inertia", float, 10.0, "rotary inertia per length", above=0.0),
        ff.Option("force", float, 20.0, "largest force along X at the lower end"),
        ff.Option("moment_y", float, -100.0, "largest moment about Y there"),
        ff.Option("moment_z", float, -200.0, "largest moment about Z there"),
        ff.Option("duration", float, 5.0, "of the loads, which rise and fall", above=0.0),
    ),
    dt=5e-3,
    t_end=15.0,
    smoke={"elements": 4, "t_end": 0.05},
    results=lambda history: {
        f"{end}_{axis}": history[f"{end}_{axis}"][-1]
        for end in ("lower", "upper")
        for axis in "xyz"
    },
)

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
