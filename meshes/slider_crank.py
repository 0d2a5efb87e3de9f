# SPDX-License-Identifier: LGPL-3.0-or-later
"""Two collinear rods along +X that touch end to end, each with its own end nodes.

Lines: rod_1 from the origin, rod_2 from the tip of rod_1. Points: ground_pin (start of rod_1),
rod_1_tip, rod_2_root, slider_pin (end of rod_2), and rod_2_middle when `elements` is even.

    python meshes/slider_crank.py --elements 12 --output slider_crank.msh
"""

from itertools import pairwise

import gmsh

from flexfem.mesh.library import run_script


def build(*, elements: int = 12, length_1: float = 0.3, length_2: float = 0.6) -> None:
    """Build two rods with `elements` cells each, of lengths `length_1` and `length_2` (metres)."""
    geo = gmsh.model.geo
    total = length_1 + length_2
    points = {
        "ground_pin": geo.addPoint(0.0, 0.0, 0.0),
        "rod_1_tip": geo.addPoint(length_1, 0.0, 0.0),
        "rod_2_root": geo.addPoint(length_1, 0.0, 0.0),
        "slider_pin": geo.addPoint(total, 0.0, 0.0),
    }
    rod_2 = ["rod_2_root", "slider_pin"]
    if elements % 2 == 0:
        points["rod_2_middle"] = geo.addPoint(length_1 + length_2 / 2.0, 0.0, 0.0)
        rod_2.insert(1, "rod_2_middle")

    for name, ends in {"rod_1": ["ground_pin", "rod_1_tip"], "rod_2": rod_2}.items():
        curves = [geo.addLine(points[a], points[b]) for a, b in pairwise(ends)]
        for curve in curves:
            geo.mesh.setTransfiniteCurve(curve, elements // len(curves) + 1)
        geo.addPhysicalGroup(1, curves, name=name)
    for name, point in points.items():
        geo.addPhysicalGroup(0, [point], name=name)
    geo.synchronize()
    gmsh.model.mesh.generate(1)


if __name__ == "__main__":
    run_script(build)
