# SPDX-License-Identifier: LGPL-3.0-or-later
"""Connecting rod of tetrahedra along +X, its eyes about axes along Z.

The big end is at the origin, the small end at `length`. Solid: rod. Surfaces: big_end and
small_end, the bores of the eyes; with a `gauge` also middle, a band around the shank's middle.

    python meshes/connecting_rod.py --length 0.6 --size 0.01 --output connecting_rod.msh
"""

import gmsh

from flexfem.mesh.library import run_script


def build(
    *, length: float = 0.6, width: float = 0.03, thickness: float = 0.03, big_bore: float = 0.025,
    small_bore: float = 0.015, wall: float = 0.012, size: float = 0.012, gauge: float = 0.0,
) -> None:  # fmt: skip
    """Build a rod between two eyes that are `length` apart, from axis to axis.

    The shank is `width` wide along Y and, as the eyes, `thickness` thick along Z. The bores have
    the radii `big_bore` and `small_bore` in walls of `wall`. Edges are about `size` long, the band
    around the middle is `gauge` long, if any; all in metres.
    """
    bores = {"big_end": (0.0, big_bore), "small_end": (length, small_bore)}
    if length <= big_bore + small_bore + 2.0 * wall:
        raise ValueError(f"connecting_rod: no room for a shank in a length of {length:g}")
    if width >= 2.0 * (small_bore + wall):
        raise ValueError(f"connecting_rod: width {width:g} is more than that of the small eye")
    if not 0.0 <= gauge <= 0.5 * length - big_bore - wall:
        raise ValueError(f"connecting_rod: gauge {gauge:g} is negative or reaches an eye")
    occ, low = gmsh.model.occ, -0.5 * thickness
    shank = occ.addBox(0.0, -0.5 * width, low, length, width, thickness)
    eyes = [
        (3, occ.addCylinder(x, 0.0, low, 0.0, 0.0, thickness, radius + wall))
        for x, radius in bores.values()
    ]
    body, _ = occ.fuse([(3, shank)], eyes)
    holes = [
        (3, occ.addCylinder(x, 0.0, low, 0.0, 0.0, thickness, radius))
        for x, radius in bores.values()
    ]
    body, _ = occ.cut(body, holes)
    if gauge > 0.0:
        start = 0.5 * (length - gauge)
        band = occ.addBox(start, -0.5 * width, low, gauge, width, thickness)
        body, _ = occ.fragment(body, [(3, band)])
    occ.synchronize()
    gmsh.model.addPhysicalGroup(3, [tag for _, tag in body], name="rod")
    for name, (x, radius) in bores.items():
        faces = [
            tag
            for _, tag in gmsh.model.getBoundary(body, oriented=False)
            if gmsh.model.getType(2, tag) == "Cylinder" and _within(tag, x, radius)
        ]
        gmsh.model.addPhysicalGroup(2, faces, name=name)
    if gauge > 0.0:
        # the faces between the pieces are not on the boundary of all of them
        sides = [
            tag
            for _, tag in gmsh.model.getBoundary(body, oriented=False)
            if _within(tag, 0.5 * length, 0.5 * max(gauge, width, thickness))
        ]
        gmsh.model.addPhysicalGroup(2, sides, name="middle")
    gmsh.option.setNumber("Mesh.MeshSizeMin", 0.0)
    gmsh.option.setNumber("Mesh.MeshSizeMax", size)
    gmsh.model.mesh.generate(3)


def _within(face: int, x: float, radius: float) -> bool:
    """Whether a face lies within a radius about the axis of an eye."""
    x_low, y_low, _, x_high, y_high, _ = gmsh.model.getBoundingBox(2, face)
    reach = 1.001 * radius
    return x - reach < x_low and x_high < x + reach and -reach < y_low and y_high < reach


if __name__ == "__main__":
    run_script(build)
