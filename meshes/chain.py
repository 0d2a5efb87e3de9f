# SPDX-License-Identifier: LGPL-3.0-or-later
"""Links along +X from the origin that touch end to end, each with its own end nodes.

Lines: link_1, link_2, ... Points: link_1_start, link_1_end, link_2_start, ...

    python meshes/chain.py --links 8 --output chain.msh
"""

import gmsh

from flexfem.mesh.library import run_script


def build(*, links: int = 4, elements: int = 8, length: float = 0.5) -> None:
    """Build `links` links of `length` (metres) with `elements` cells each."""
    geo = gmsh.model.geo
    for i in range(links):
        start = geo.addPoint(i * length, 0.0, 0.0)
        end = geo.addPoint((i + 1) * length, 0.0, 0.0)
        link = geo.addLine(start, end)
        geo.mesh.setTransfiniteCurve(link, elements + 1)
        geo.addPhysicalGroup(1, [link], name=f"link_{i + 1}")
        geo.addPhysicalGroup(0, [start], name=f"link_{i + 1}_start")
        geo.addPhysicalGroup(0, [end], name=f"link_{i + 1}_end")
    geo.synchronize()
    gmsh.model.mesh.generate(1)


if __name__ == "__main__":
    run_script(build)
