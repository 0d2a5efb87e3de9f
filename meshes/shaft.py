# SPDX-License-Identifier: LGPL-3.0-or-later
"""A straight shaft along +Z from the origin.

Line: shaft. Points: shaft_start, shaft_end.

    python meshes/shaft.py --elements 20 --output shaft.msh
"""

import gmsh

from flexfem.mesh.library import run_script


def build(*, elements: int = 24, length: float = 6.0) -> None:
    """Build a shaft of `length` (metres) with `elements` cells."""
    geo = gmsh.model.geo
    start, end = geo.addPoint(0.0, 0.0, 0.0), geo.addPoint(0.0, 0.0, length)
    shaft = geo.addLine(start, end)
    geo.mesh.setTransfiniteCurve(shaft, elements + 1)
    geo.addPhysicalGroup(1, [shaft], name="shaft")
    geo.addPhysicalGroup(0, [start], name="shaft_start")
    geo.addPhysicalGroup(0, [end], name="shaft_end")
    geo.synchronize()
    gmsh.model.mesh.generate(1)


if __name__ == "__main__":
    run_script(build)
