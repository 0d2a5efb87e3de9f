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


def build(*, elements: int) -> ff.Model:
    """Model with ``elements`` beam elements."""
    mesh = ff.build_mesh("flying_spaghetti", elements=elements)
    section = ff.Section.general(
        stiffness=(1e4, 1e4, 1e4, 500.0, 500.0, 500.0), inertia=(1.0, 1.0, 1.0, 10.0, 10.0, 10.0)
    )
    model = ff.Model("flying_spaghetti", mesh=mesh)
    lower, upper = ff.Marker("beam", "start"), ff.Marker("beam", "end")
    pulse = ff.Table((0.0, 2.5, 5.0), (0.0, 200.0, 0.0))
    model.add(
        ff.Beam("beam", section, orientation=(0.0, 0.0, 1.0)),
        ff.PointForce("pull", lower, (0.1, 0.0, 0.0), amplitude=pulse),
        ff.PointMoment("twist", lower, (0.0, -0.5, -1.0), amplitude=pulse),
        ff.PositionProbe("lower", lower),
        ff.PositionProbe("upper", upper),
    )
    return model


CASE = ff.Case(
    name="flying_spaghetti",
    summary="very flexible free beam tumbling in space (Simo, Vu-Quoc 1988)",
    description=__doc__,
    build=build,
    options=(ff.Option("elements", int, 40, "beam elements", minimum=1),),
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
