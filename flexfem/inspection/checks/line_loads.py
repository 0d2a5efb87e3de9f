# SPDX-License-Identifier: LGPL-3.0-or-later
"""Loads along beams that change faster than the quadrature points of elements resolve.

Each element is integrated by Gauss points, and once more in two halves. Functions without jumps
inside elements give the same to six digits and more; a jump that is no breakpoint gives up to a
seventh of an element's length times its height too much or too little.
"""

from collections.abc import Iterator

import numpy as np

from flexfem._types import FloatArray
from flexfem.inspection.finding import Finding
from flexfem.inspection.inspection import Inspection
from flexfem.layout.lines import Line
from flexfem.layout.placed_loads import load_at_points
from flexfem.loads.line_load import LineLoad

#: Smallest reported difference of both sums in one element, relative to the whole load. A jump in
#: one of a hundred elements is ten times this; a kink in one of ten a tenth.
_SEEN = 1e-4


def find(inspection: Inspection) -> Iterator[Finding]:
    """At most one finding for each load."""
    for load in inspection.model.loads:
        if not isinstance(load, LineLoad) or load.uniform:
            continue
        line = inspection.serial.line(load.body)
        whole, halves = _sums(line, load, 1), _sums(line, load, 2)
        size = np.abs(whole).sum(axis=0)
        size = np.repeat([size[:3].max(), size[3:].max()], 3)
        missed = np.abs(whole - halves) / np.where(size > 0.0, size, 1.0)
        worst = int(missed.max(axis=1).argmax())
        if missed[worst].max() > _SEEN:
            unit = line.length if load.coordinate == "fraction" else 1.0
            ends = np.array([*line.starts, line.length])[worst : worst + 2] / unit
            yield Finding(
                "line_loads", f'LineLoad "{load.name}"',
                f"its function changes so fast between {ends[0]:.6g} and {ends[1]:.6g} that "
                f"{100.0 * missed[worst].max():.2g} % of the load may be wrong",
                "give the places where it jumps as breakpoints, or take shorter elements",
            )  # fmt: skip


def _sums(line: Line, load: LineLoad, parts: int) -> FloatArray:
    """Force and moment (m, 6) on each element, N and N m."""
    found = np.zeros((len(line.nodes), 6))
    for element in range(len(line.nodes)):
        for _, force, moment in load_at_points(line, load, element, parts):
            found[element] += np.concatenate([force, moment])
    return found
