# SPDX-License-Identifier: LGPL-3.0-or-later
"""Right-angled frame: a column along +Y from the origin, then a beam along +X.

Line: frame. Points: foot, corner, loaded (on the beam, `load_at` from the corner), tip.

    python meshes/frame.py --column 120 --beam 120 --load-at 24 --elements 10 --output frame.msh
"""

from itertools import pairwise

import gmsh

from flexfem.mesh.library import run_script


def build(
    *, column: float = 120.0, beam: float = 120.0, load_at: float = 24.0, elements: int = 10
) -> None:
    """Build a frame of two members (metres) with about `elements` cells each."""
    if load_at >= beam:
        raise ValueError(f"frame: load_at must be less than the beam's {beam:g}, got {load_at:g}")
    geo = gmsh.model.geo
    places = {
        "foot": (0.0, 0.0),
        "corner": (0.0, column),
        "loaded": (load_at, column),
        "tip": (beam, column),
    }
    points = {name: geo.addPoint(x, y, 0.0) for name, (x, y) in places.items()}
    near = min(max(round(elements * load_at / beam), 1), max(elements - 1, 1))
    counts = (elements, near, max(elements - near, 1))
    curves = [geo.addLine(a, b) for a, b in pairwise(points.values())]
    for curve, count in zip(curves, counts, strict=True):
        geo.mesh.setTransfiniteCurve(curve, count + 1)
    geo.addPhysicalGroup(1, curves, name="frame")
    for name, point in points.items():
        geo.addPhysicalGroup(0, [point], name=name)
    geo.synchronize()
    gmsh.model.mesh.generate(1)


if __name__ == "__main__":
    run_script(build)
