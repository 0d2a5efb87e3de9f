# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cantilever bent by 45 degrees under a force out of its plane (Bathe, Bolourchi 1979).

Arc of radius 100 in the plane XY, from the clamped root along +X towards +Y; square section 1 x 1,
E = 1e7, nu = 0, any consistent units; a dead force of 600 along +Z at the tip at t = 1. Published
values belong to two torsion constants: that of the square, 0.1406, and the polar moment 1/6.

History: ``tip_x, tip_y, tip_z``: displacement of the tip.

Expected at t = 1: (-23.8188, -13.7315, 53.6074) with the square's constant, (-23.5602, -13.6045,
53.4749) with the polar moment (solutions of the rod's differential equations; Bathe and Bolourchi:
(-23.5, -13.4, 53.4)). Run: ``mpirun -n 2 python cases/bend_45.py --torsion polar``.
"""

import sys

import flexfem as ff

#: Torsion constant of a square section over the fourth power of its side.
TORSION = {"square": 0.140577, "polar": 1.0 / 6.0}


def build(
    *, elements: int, torsion: str, force: float, radius: float, angle: float, side: float,
    youngs_modulus: float, poisson_ratio: float,
) -> ff.Model:  # fmt: skip
    """Model with ``elements`` beam elements, a torsion constant and the tip force."""
    mesh = ff.build_mesh("arc", radius=radius, angle=angle, first=270.0, elements=elements)
    shear = 0.5 * youngs_modulus / (1.0 + poisson_ratio) * side**2
    axial, twist = youngs_modulus * side**2, shear * TORSION[torsion] * side**2
    bending = axial * side**2 / 12.0
    section = ff.Section.general((axial, shear, shear, twist, bending, bending), (1.0,) * 6)
    model = ff.Model("bend_45", mesh=mesh)
    tip = ff.Marker("arc", "end")
    start = mesh.points[mesh.point_groups["end"]]
    model.add(
        ff.Beam("arc", section, orientation=(0.0, 0.0, 1.0)),
        ff.Rigid("clamp", ff.Ground((0.0, -radius, 0.0)), ff.Marker("arc", "start")),
        ff.PointForce("force", tip, (0.0, 0.0, force)),
        ff.Probe(
            "tip", tip, ("tip_x", "tip_y", "tip_z"), lambda t, at: (at.position - start).tolist()
        ),
    )
    return model


CASE = ff.Case(
    name="bend_45",
    summary="45-degree bend under a force out of its plane (Bathe, Bolourchi 1979)",
    description=__doc__,
    build=build,
    options=(
        ff.Option("elements", int, 16, "beam elements", minimum=1),
        ff.Option("torsion", str, "square", "torsion constant", choices=tuple(TORSION)),
        ff.Option("force", float, 600.0, "tip force at t = 1"),
        ff.Option("radius", float, 100.0, "of the arc", above=0.0),
        ff.Option("angle", float, 45.0, "of the arc", unit="deg", above=0.0, maximum=180.0),
        ff.Option("side", float, 1.0, "of the square section", above=0.0),
        ff.Option("youngs_modulus", float, 1e7, "of the material", above=0.0),
        ff.Option("poisson_ratio", float, 0.0, "of the material", minimum=0.0, maximum=0.5),
    ),
    analysis=ff.STATICS,
    load_steps=6,
    smoke={"elements": 3, "load_steps": 2, "t_end": 0.1},
    results=lambda history: {f"tip_{axis}": history[f"tip_{axis}"][-1] for axis in "xyz"},
)

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
