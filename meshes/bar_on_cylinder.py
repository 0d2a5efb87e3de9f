# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bar behind a cylinder in the plane z = 0, in curved quadrilaterals of second order.

The bar begins on the circle and ends at `tip`; cells are shorter where it begins. Surface: bar.
Curves: cylinder (the arc), bottom, tip, top.

    python meshes/bar_on_cylinder.py --cells-along 70 --cells-across 4 --output bar.msh
"""

import math

import gmsh

from flexfem.mesh.library import run_script


def build(
    *, centre_x: float = 0.2, centre_y: float = 0.2, radius: float = 0.05, tip: float = 0.6,
    thickness: float = 0.02, cells_along: int = 35, cells_across: int = 2, grading: float = 4.0,
) -> None:  # fmt: skip
    """Build a bar of `thickness` that ends at x = `tip`, at the height of the centre, in metres.

    The last cells are `grading` times as long as the first ones, at the cylinder.
    """
    if thickness >= 2.0 * radius:
        raise ValueError(f"bar_on_cylinder: thickness {thickness:g} is more than the cylinder's")
    if tip <= centre_x + radius:
        raise ValueError(f"bar_on_cylinder: tip {tip:g} is within the cylinder")
    if grading <= 0.0:
        raise ValueError(f"bar_on_cylinder: grading must be positive, got {grading:g}")
    geo, half = gmsh.model.geo, 0.5 * thickness
    start = centre_x + math.sqrt(radius**2 - half**2)
    centre = geo.addPoint(centre_x, centre_y, 0.0)
    corners = [
        geo.addPoint(x, centre_y + y, 0.0)
        for x, y in ((start, -half), (tip, -half), (tip, half), (start, half))
    ]
    curves = {
        "bottom": geo.addLine(corners[0], corners[1]),
        "tip": geo.addLine(corners[1], corners[2]),
        "top": geo.addLine(corners[2], corners[3]),
        "cylinder": geo.addCircleArc(corners[3], centre, corners[0]),
    }
    surface = geo.addPlaneSurface([geo.addCurveLoop(list(curves.values()))])
    ratio = grading ** (1.0 / max(cells_along - 1, 1))
    for name, along in (("bottom", ratio), ("top", 1.0 / ratio)):
        geo.mesh.setTransfiniteCurve(curves[name], cells_along + 1, "Progression", along)
    for name in ("tip", "cylinder"):
        geo.mesh.setTransfiniteCurve(curves[name], cells_across + 1)
    geo.mesh.setTransfiniteSurface(surface, cornerTags=corners)
    geo.mesh.setRecombine(2, surface)
    geo.synchronize()
    gmsh.model.addPhysicalGroup(2, [surface], name="bar")
    for name, curve in curves.items():
        gmsh.model.addPhysicalGroup(1, [curve], name=name)
    gmsh.model.mesh.generate(2)
    gmsh.model.mesh.setOrder(2)


if __name__ == "__main__":
    run_script(build)
