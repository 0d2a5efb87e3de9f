# SPDX-License-Identifier: LGPL-3.0-or-later
"""Tube about the axis Z, centred at the origin, of curved hexahedra of second order.

Solid: tube. Surfaces: inner, outer, bottom, top.

    python meshes/bushing.py --inner-radius 0.01 --outer-radius 0.025 --output bushing.msh
"""

import math

import gmsh

from flexfem.mesh.library import run_script


def build(
    *, inner_radius: float = 0.01, outer_radius: float = 0.025, length: float = 0.04,
    cells_around: int = 8, cells_across: int = 2, cells_along: int = 3, grading: float = 1.0,
) -> None:  # fmt: skip
    """Build a tube from `inner_radius` to `outer_radius`, `length` long along Z, all in metres.

    There are `cells_around`, a multiple of four, and those across the wall are `grading` times as
    thick outside as inside.
    """
    if outer_radius <= inner_radius:
        raise ValueError(f"bushing: outer radius {outer_radius:g} is not larger than the inner one")
    if cells_around % 4:
        raise ValueError(f"bushing: cells around must be a multiple of four, got {cells_around}")
    if grading <= 0.0:
        raise ValueError(f"bushing: grading must be positive, got {grading:g}")
    geo, low = gmsh.model.geo, -0.5 * length
    centre = geo.addPoint(0.0, 0.0, low)
    points = [
        [geo.addPoint(r * math.cos(a), r * math.sin(a), low) for r in (inner_radius, outer_radius)]
        for a in (0.5 * math.pi * k for k in range(4))
    ]
    ratio = grading ** (1.0 / max(cells_across - 1, 1))
    spokes = [geo.addLine(*pair) for pair in points]
    for spoke in spokes:
        geo.mesh.setTransfiniteCurve(spoke, cells_across + 1, "Progression", ratio)
    names: dict[str, list[int]] = {"inner": [], "outer": [], "bottom": [], "top": []}
    volumes = []
    for k in range(4):
        ends = points[k], points[(k + 1) % 4]
        inner, outer = (geo.addCircleArc(ends[0][i], centre, ends[1][i]) for i in (0, 1))
        for arc in (inner, outer):
            geo.mesh.setTransfiniteCurve(arc, cells_around // 4 + 1)
        loop = geo.addCurveLoop([spokes[k], outer, -spokes[(k + 1) % 4], -inner])
        base = geo.addPlaneSurface([loop])
        geo.mesh.setTransfiniteSurface(base)
        geo.mesh.setRecombine(2, base)
        made = geo.extrude([(2, base)], 0.0, 0.0, length, numElements=[cells_along], recombine=True)
        # the top, the volume, and the sides in the order of the loop
        tags = [tag for _, tag in made]
        volumes.append(tags[1])
        for name, tag in (
            ("bottom", base),
            ("top", tags[0]),
            ("outer", tags[3]),
            ("inner", tags[5]),
        ):
            names[name].append(tag)
    geo.synchronize()
    gmsh.model.addPhysicalGroup(3, volumes, name="tube")
    for name, surfaces in names.items():
        gmsh.model.addPhysicalGroup(2, surfaces, name=name)
    gmsh.model.mesh.generate(3)
    gmsh.model.mesh.setOrder(2)


if __name__ == "__main__":
    run_script(build)
