# SPDX-License-Identifier: LGPL-3.0-or-later
"""Points of NURBS curves by which beams touch: means of control points."""

import numpy as np

from flexfem._types import FloatArray
from flexfem.families.beam_nurbs.curves import NurbsLines
from flexfem.layout.family import ContactLine
from flexfem.mesh.nurbs.elements import shape_functions

__all__ = ["contact_line"]

#: Distance of a chord from its curve at the start, relative to the length of the element.
_OFF = 5e-3
#: Most parts of an element.
_MOST = 10


def contact_line(curves: NurbsLines, beam: int) -> ContactLine:
    """Return the polyline of a beam.

    An element is divided into as many parts as its degree, into more where it is strongly curved
    at the start. A point between two elements belongs to the first.

    Args:
        curves: all NURBS beams.
        beam: number of one of them.
    """
    nodes, shape = curves.nodes(beam), curves.parts[beam].shape
    count, width = nodes.shape
    parts = max(width - 1, min(_parts(curves.frames[nodes, :3], shape), _MOST))
    inner = np.arange(1, parts + 1) / parts
    weights = [shape_functions(one, inner)[0] for one in shape]
    first = shape_functions(shape[0], np.zeros(1))[0]
    rows = np.concatenate([nodes[:1], np.repeat(nodes, parts, axis=0)])
    at = np.arange(count * parts)
    return ContactLine(rows, np.concatenate([first, *weights]), np.column_stack([at, at + 1]))


def _parts(points: FloatArray, shape: FloatArray) -> int:
    """Parts of an element for which all chords are near their curves, from the middles."""
    most = 0.0
    for own, one in zip(points, shape, strict=True):
        start, middle, end = shape_functions(one, np.array([0.0, 0.5, 1.0]))[0] @ own
        chord = float(np.linalg.norm(end - start)) or 1.0
        most = max(most, float(np.linalg.norm(middle - 0.5 * (start + end))) / chord)
    return int(np.ceil(np.sqrt(most / _OFF)))  # the distance falls with the square
