# SPDX-License-Identifier: LGPL-3.0-or-later
"""Carrier from A = (0, width, height) to B = (0, 0, 0) and slider from A along X to M, metres.

Lines: carrier, slider; each has its own node at A. Points: carrier_start, carrier_end,
slider_start, slider_end.

    python meshes/sliding_beam.py --elements 64 --slider-elements 8 --output sliding_beam.msh
"""

import gmsh

from flexfem.mesh.library import run_script


def build(
    *, elements: int = 64, slider_elements: int = 8, width: float = 3.0, height: float = 1.0,
    arm: float = 1.0,
) -> None:  # fmt: skip
    """Build the carrier with `elements` and the slider of length `arm` with `slider_elements`."""
    geo = gmsh.model.geo
    a, b, mass = (0.0, width, height), (0.0, 0.0, 0.0), (arm, width, height)
    lines = {"carrier": (a, b, elements), "slider": (a, mass, slider_elements)}
    for name, (first, last, cells) in lines.items():
        start, end = geo.addPoint(*first), geo.addPoint(*last)
        line = geo.addLine(start, end)
        geo.mesh.setTransfiniteCurve(line, cells + 1)
        geo.addPhysicalGroup(1, [line], name=name)
        geo.addPhysicalGroup(0, [start], name=f"{name}_start")
        geo.addPhysicalGroup(0, [end], name=f"{name}_end")
    geo.synchronize()
    gmsh.model.mesh.generate(1)


if __name__ == "__main__":
    run_script(build)
