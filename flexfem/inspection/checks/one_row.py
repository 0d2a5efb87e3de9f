# SPDX-License-Identifier: LGPL-3.0-or-later
"""Director shells that are one row of wide cells.

Without nodes inside, only the directors at free edges determine the bending of the cells. Clamped
strips under their weight, of 8 and 16 cells along, are too soft by (mean deflection of the corners
at the tip, against 16 cells along and as wide as long)

====================  ===========  ============  ============  ==========
width by length       0.2          0.4           0.8           1.6
====================  ===========  ============  ============  ==========
one row,  nu = 0      0.2-0.3 %    0.5-0.8 %     2.8-3.4 %     25-26 %
one row,  nu = 0.3    0.4 %        0.3-0.6 %     0.7-1.5 %     21-22 %
two rows, nu = 0      0.1 %        0.2 %         0.7 %         5 %
two rows, nu = 0.3    0.3 %        0.4 %         0.4 %         3 %
====================  ===========  ============  ============  ==========

Under a couple at the tip, a row of 8 cells twists 1 to 2 %, 5 to 6 %, 13 to 16 % too far where they
are 1, 1.6, 3.2 times as wide as long. Clamped along a long side, the row is one cell between that
side and the other: 11 % too stiff to 7 % too soft where it is 0.6 to 1 times as wide as long.
"""

from collections.abc import Iterator

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.inspection.finding import Finding, owner_of
from flexfem.inspection.inspection import Inspection

__all__ = ["find"]

#: Width by length above which a single row is too soft by half a per cent and more.
_WIDE = 0.35


def find(inspection: Inspection) -> Iterator[Finding]:
    """At most one finding for each shell."""
    surface = inspection.model.surface
    for shell in inspection.model.shells:
        if shell.element != "director" or surface is None:
            continue
        triangles = surface.triangles[surface.body_rows(shell.body)]
        width = _width(surface.points, triangles)
        if width > _WIDE:
            yield Finding(
                "one_row", owner_of(shell),
                f"it is one row of cells that is {width:.2g} times as wide as long: too soft in "
                "bending along it and more so in torsion, a single coarse cell across it",
                "take two rows at least",
            )  # fmt: skip


def _width(points: FloatArray, triangles: IntArray) -> float:
    """Width by length of a strip without nodes inside; 0 where there are some."""
    edges = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    every, times = np.unique(edges, axis=0, return_counts=True)
    lengths = np.linalg.norm(points[every[:, 1]] - points[every[:, 0]], axis=1)
    rim, across = times == 1, times > 1
    if len(np.unique(triangles)) > len(np.unique(every[rim])):
        return 0.0
    a, b, c = points[triangles].transpose(1, 0, 2)
    area = 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
    # sides of the rectangle with this area and rim
    half = 0.25 * float(lengths[rim].sum())
    root = max(half**2 - area, 0.0) ** 0.5
    short, long = float(half - root), float(half + root)
    # edges inside lead from one side of the row to the other, but in a single cell
    inside = float(lengths[across].min()) if len(triangles) > 2 else short
    return long / short if abs(inside - long) < abs(inside - short) else short / long
