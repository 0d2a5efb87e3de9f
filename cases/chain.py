# SPDX-License-Identifier: LGPL-3.0-or-later
"""Chain of flexible links on spherical joints, falling from the horizontal: the scaling case.

n links of 0.5 m in a row along +X from the origin, at first straight and at rest; square section
0.01 x 0.01 m, E = 1e9 N/m^2, nu = 0.3, rho = 1000 kg/m^3; a spherical joint to the ground at the
origin and between consecutive links; gravity 9.81 m/s^2 along -Z. Spherical joints leave the spin
of every link free: its rotary inertia keeps the problem well posed, and no load excites it.

History: ``tip_x, tip_y, tip_z`` of the free end, m.

Expected: the tip of 4 links x 8 elements at t = 1 s, see ``tests/data/chain_4x8.csv`` (another
code, converged in the step). Run: ``mpirun -n 2 python cases/chain.py --links 16``.
"""

import sys

import flexfem as ff


def build(
    *, links: int, elements: int, length: float, side: float, youngs_modulus: float,
    poisson_ratio: float, density: float, gravity: float,
) -> ff.Model:  # fmt: skip
    """Model of a chain of ``links`` links with ``elements`` beam elements each."""
    mesh = ff.build_mesh("chain", links=links, elements=elements, length=length)
    material = ff.Material(youngs_modulus, poisson_ratio, density)
    section = ff.Section.rectangle(side, side, material)
    model = ff.Model("chain", mesh=mesh)
    model.add(ff.Gravity((0.0, 0.0, -gravity)))
    previous: ff.Marker | ff.Ground = ff.Ground()
    for i in range(1, links + 1):
        model.add(ff.Beam(f"link_{i}", section, orientation=(0.0, 1.0, 0.0)))
        model.add(ff.Spherical(f"joint_{i}", previous, ff.Marker(f"link_{i}", "start")))
        previous = ff.Marker(f"link_{i}", "end")
    model.add(ff.PositionProbe("tip", previous))
    return model


CASE = ff.Case(
    name="chain",
    summary="chain of flexible links on spherical joints, falling (scaling case)",
    description=__doc__,
    build=build,
    options=(
        ff.Option("links", int, 4, "number of links", minimum=1),
        ff.Option("elements", int, 8, "beam elements per link", minimum=1),
        ff.Option("length", float, 0.5, "of a link", unit="m", above=0.0),
        ff.Option("side", float, 0.01, "of the square section", unit="m", above=0.0),
        ff.Option("youngs_modulus", float, 1e9, "of the links", unit="Pa", above=0.0),
        ff.Option("poisson_ratio", float, 0.3, "of the links", minimum=0.0, maximum=0.5),
        ff.Option("density", float, 1000.0, "of the links", unit="kg/m^3", above=0.0),
        ff.Option("gravity", float, 9.81, "along -Z", unit="m/s^2"),
    ),
    dt=1e-3,
    t_end=1.0,
    smoke={"links": 2, "elements": 2, "t_end": 5e-3},
    results=lambda history: {f"tip_{axis}": history[f"tip_{axis}"][-1] for axis in "xyz"},
)

if __name__ == "__main__":
    sys.exit(ff.main(CASE))
