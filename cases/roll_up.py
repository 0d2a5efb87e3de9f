# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cantilever rolled up by a moment at its tip, to circles or to a helix.

Straight beam of length 10 along +X, clamped at the origin, EA = GA = 1e4, EI = GJ = 1e2, any
consistent units. A dead moment about Z closes it to ``turns`` circles at t = 1; a state of constant
strain, which the element holds exactly. With ``--out-of-plane-force 50`` and ``--turns 10`` the
beam becomes a helix that opens and closes (Ibrahimbegovic 1997).

History: ``tip_x, tip_y, tip_z``: displacement of the tip.

Expected: (-10, 0, 0) at t = 1 after one turn, to round-off. The helix: (-9.288519, 6.285664,
2.750736) at t = 0.05 and (-9.589797, 0.053771, -1.091729) at t = 0.1 (solution of the rod's
differential equations). Run: ``mpirun -n 2 python cases/roll_up.py --load-steps 4``.
"""

import sys
from math import pi

import flexfem as ff


def build(
    *, elements: int, turns: float, out_of_plane_force: float, length: float,
    axial_stiffness: float, bending_stiffness: float,
) -> ff.Model:  # fmt: skip
    """Model with ``elements`` beam elements, rolled up by so many turns."""
    mesh = ff.build_mesh("chain", links=1, elements=elements, length=length)
    section = ff.Section.general((axial_stiffness,) * 3 + (bending_stiffness,) * 3, (1.0,) * 6)
    model = ff.Model("roll_up", mesh=mesh)
    tip = ff.Marker("link_1", "end")
    model.add(
        ff.Beam("link_1", section, orientation=(0.0, 0.0, 1.0)),
        ff.Rigid("clamp", ff.Ground(), ff.Marker("link_1", "start")),
        ff.PointMoment("moment", tip, (0.0, 0.0, 2.0 * pi * turns * bending_stiffness / length)),
        ff.PointForce("force", tip, (0.0, 0.0, out_of_plane_force)),
        ff.Probe(
            "tip",
            tip,
            ("tip_x", "tip_y", "tip_z"),
            lambda t, at: (at.position[0] - length, at.position[1], at.position[2]),
        ),
    )
    return model


CASE = ff.Case(
    name="roll_up",
    summary="cantilever rolled up to a circle, or to a helix, by a moment at its tip",
    description=__doc__,
    build=build,
    options=(
        ff.Option("elements", int, 8, "beam elements", minimum=1),
        ff.Option("turns", float, 1.0, "full turns of the tip at t = 1"),
        ff.Option("out_of_plane_force", float, 0.0, "force along Z at t = 1"),
        ff.Option("length", float, 10.0, "of the beam", above=0.0),
        ff.Option("axial_stiffness", float, 1e4, "EA, GA2 and GA3", above=0.0),
        ff.Option("bending_stiffness", float, 100.0, "EI2, EI3 and GJ", above=0.0),
    ),
    analysis=ff.STATICS,
    load_steps=8,
    smoke={"elements": 3, "load_steps": 2, "t_end": 0.1},
    results=lambda history: {f"tip_{axis}": history[f"tip_{axis}"][-1] for axis in "xyz"},
)

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
