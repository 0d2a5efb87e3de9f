# SPDX-License-Identifier: LGPL-3.0-or-later
"""Half cylinders of unstructured triangles one behind the other along Y, open to the top.

Surfaces: first, second. Curves of each: first_bottom and first_top (arcs at its lower and higher
Y), first_left and first_right (straight, at X = radius and X = -radius). Points:
first_bottom_left, ... The two do not share nodes.

    python meshes/cylindrical_pendulum.py --size 0.05 --output halves.msh
"""

from math import pi

import gmsh

from flexfem.mesh.library import run_script


def build(*, radius: float = 0.3, length: float = 1.2, size: float = 0.06) -> None:
    """Build two half cylinders of `radius` and `length` with edges of about `size`, all metres."""
    for k, name in enumerate(("first", "second")):
        _half_cylinder(name, radius, k * length, length)
    gmsh.option.setNumber("Mesh.MeshSizeMin", size)
    gmsh.option.setNumber("Mesh.MeshSizeMax", size)
    gmsh.model.mesh.generate(2)


def _half_cylinder(name: str, radius: float, start: float, length: float) -> None:
    """Half a cylinder from y = `start` on, with its names."""
    occ = gmsh.model.occ
    arc = occ.addCircle(0.0, 0.0, 0.0, radius, angle1=pi, angle2=2.0 * pi)
    occ.rotate([(1, arc)], 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.5 * pi)
    occ.translate([(1, arc)], 0.0, start, 0.0)
    swept = occ.extrude([(1, arc)], 0.0, length, 0.0)
    occ.synchronize()
    surface = next(tag for dim, tag in swept if dim == 2)
    gmsh.model.addPhysicalGroup(2, [surface], name=name)
    for _, curve in gmsh.model.getBoundary([(2, surface)], oriented=False):
        x, y, _ = occ.getCenterOfMass(1, curve)
        if abs(x) > 0.5 * radius:
            side = "left" if x > 0.0 else "right"
        else:
            side = "bottom" if y < start + 0.5 * length else "top"
        gmsh.model.addPhysicalGroup(1, [curve], name=f"{name}_{side}")
    for _, point in gmsh.model.getBoundary([(2, surface)], recursive=True):
        x, y, _ = gmsh.model.getValue(0, point, [])
        end, side = "bottom" if y < start + 0.5 * length else "top", "left" if x > 0.0 else "right"
        gmsh.model.addPhysicalGroup(0, [point], name=f"{name}_{end}_{side}")


if __name__ == "__main__":
    run_script(build)
