# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rectangular plate in the plane z = 0 with a round hole, finer there.

Surface: plate. Curves: left, right (at the ends of X), bottom, top (of Y), hole.

    python meshes/plate_with_hole.py --length 1 --width 0.5 --radius 0.1 --output plate.msh
"""

import gmsh

from flexfem.mesh.library import run_script


def build(
    *, length: float = 1.0, width: float = 0.5, radius: float = 0.1, size: float = 0.05,
    hole_size: float = 0.02,
) -> None:  # fmt: skip
    """Build a plate of `length` and `width` about the origin with a hole of `radius`.

    Edges are about `size` long, those at the hole `hole_size`, all in metres.
    """
    if 2.0 * radius >= min(length, width):
        raise ValueError(f"plate_with_hole: no room for a hole of radius {radius:g}")
    occ = gmsh.model.occ
    plate = occ.addRectangle(-0.5 * length, -0.5 * width, 0.0, length, width)
    hole = occ.addDisk(0.0, 0.0, 0.0, radius, radius)
    ((_, surface),), _ = occ.cut([(2, plate)], [(2, hole)])
    occ.synchronize()
    gmsh.model.addPhysicalGroup(2, [surface], name="plate")
    names = {(-1, 0): "left", (1, 0): "right", (0, -1): "bottom", (0, 1): "top", (0, 0): "hole"}
    for _, curve in gmsh.model.getBoundary([(2, surface)], oriented=False):
        x, y, _ = occ.getCenterOfMass(1, curve)
        place = round(2.0 * x / length), round(2.0 * y / width)
        gmsh.model.addPhysicalGroup(1, [curve], name=names[place])
        points = gmsh.model.getBoundary([(1, curve)], combined=False, oriented=False)
        gmsh.model.mesh.setSize(points, hole_size if place == (0, 0) else size)
    gmsh.model.mesh.generate(2)


if __name__ == "__main__":
    run_script(build)
