# SPDX-License-Identifier: LGPL-3.0-or-later
"""Straight beam from (base, 0, 0) to (0, height, 0) (Simo, Vu-Quoc 1988: 6 and 8).

Line: beam. Points: lower and upper, its ends.

    python meshes/flying_spaghetti.py --elements 40 --output flying_spaghetti.msh
"""

import gmsh

from flexfem.mesh.library import run_script


def build(*, elements: int = 40, base: float = 6.0, height: float = 8.0) -> None:
    """Build the beam with `elements` cells."""
    geo = gmsh.model.geo
    lower, upper = geo.addPoint(base, 0.0, 0.0), geo.addPoint(0.0, height, 0.0)
    beam = geo.addLine(lower, upper)
    geo.mesh.setTransfiniteCurve(beam, elements + 1)
    geo.addPhysicalGroup(1, [beam], name="beam")
    geo.addPhysicalGroup(0, [lower], name="lower")
    geo.addPhysicalGroup(0, [upper], name="upper")
    geo.synchronize()
    gmsh.model.mesh.generate(1)


if __name__ == "__main__":
    run_script(build)
