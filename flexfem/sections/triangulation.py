# SPDX-License-Identifier: LGPL-3.0-or-later
"""Triangles within a polygon with holes, by gmsh."""

from collections.abc import Sequence

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.mesh.imported.gmsh_model import session

__all__ = ["triangulate"]

# Relative difference between the area of the triangles and that within the outlines
_AREA = 1e-9


def triangulate(loops: Sequence[FloatArray], size: float) -> tuple[FloatArray, IntArray]:
    """Return nodes, shape (n, 2), and triangles, shape (m, 3).

    Args:
        loops: Outline and holes, vertices of shape (k, 2), metres.
        size: Length of edges, metres.

    Raises:
        ValueError: gmsh cannot fill the outlines, as where a hole leaves the outline.
    """
    with session("flexfem_section"):
        import gmsh

        geo = gmsh.model.geo
        curves = []
        for loop in loops:
            corners = [geo.addPoint(y, z, 0.0, size) for y, z in loop.tolist()]
            ends = corners[1:] + corners[:1]
            sides = [geo.addLine(a, b) for a, b in zip(corners, ends, strict=True)]
            curves.append(geo.addCurveLoop(sides))
        geo.addPlaneSurface(curves)
        geo.synchronize()
        try:
            gmsh.model.mesh.generate(2)
        except Exception as error:  # gmsh raises nothing more special
            raise ValueError(f"SectionMesh: gmsh cannot fill the outlines: {error}") from None
        tags, points, _ = gmsh.model.mesh.getNodes()
        nodes = gmsh.model.mesh.getElementsByType(2)[1]
    used, triangles = np.unique(nodes, return_inverse=True)
    place = np.argsort(tags)[np.searchsorted(np.sort(tags), used)]
    found = np.reshape(points, (-1, 3))[place, :2].copy()
    rows = triangles.reshape(-1, 3).astype(np.int64)
    a, b, c = np.moveaxis(found[rows], 1, 0)
    filled = 0.5 * np.abs(np.linalg.det(np.stack([b - a, c - a], axis=1))).sum()
    outer, *inner = (abs(_area(loop)) for loop in loops)
    wanted = outer - sum(inner)
    if abs(filled - wanted) > _AREA * outer:
        raise ValueError(
            f"SectionMesh: gmsh cannot fill the outlines: their area is {wanted:g}, that of the "
            f"cells {filled:g}"
        )
    return found, rows


def _area(loop: FloatArray) -> float:
    """Area within a polygon, positive if it runs counterclockwise."""
    y, z = loop.T
    return 0.5 * float(y @ np.roll(z, -1) - z @ np.roll(y, -1))
