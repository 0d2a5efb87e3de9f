# SPDX-License-Identifier: LGPL-3.0-or-later
"""Circular arc about the origin in the plane z = 0, anticlockwise.

Line: arc. Points: start, end, and middle when `elements` is even.

    python meshes/arc.py --radius 100 --angle 45 --first 270 --elements 8 --output arc.msh
"""

from itertools import pairwise
from math import cos, radians, sin

import gmsh

from flexfem.mesh.library import run_script


def build(
    *, radius: float = 100.0, angle: float = 45.0, first: float = 270.0, elements: int = 8
) -> None:
    """Build an arc of `radius` (metres) over `angle` degrees with `elements` cells.

    Its first point lies at the angle `first` (degrees) from the axis X.
    """
    pieces = 2 if elements % 2 == 0 else 1
    if angle >= 180.0 * pieces:
        raise ValueError(f"arc: angle must be less than {180 * pieces} degrees, got {angle:g}")
    geo = gmsh.model.geo
    centre = geo.addPoint(0.0, 0.0, 0.0)
    places = [radians(first + angle * i / pieces) for i in range(pieces + 1)]
    points = [geo.addPoint(radius * cos(a), radius * sin(a), 0.0) for a in places]
    curves = [geo.addCircleArc(a, centre, b) for a, b in pairwise(points)]
    for curve in curves:
        geo.mesh.setTransfiniteCurve(curve, elements // pieces + 1)
    geo.addPhysicalGroup(1, curves, name="arc")
    for name, point in (("start", points[0]), ("end", points[-1])):
        geo.addPhysicalGroup(0, [point], name=name)
    if pieces == 2:
        geo.addPhysicalGroup(0, [points[1]], name="middle")
    geo.synchronize()
    gmsh.model.mesh.generate(1)


if __name__ == "__main__":
    run_script(build)
