# SPDX-License-Identifier: LGPL-3.0-or-later
"""Polylines through points of a NURBS curve, which are means of control points."""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.mesh.nurbs.elements import NurbsElements, shape_functions

__all__ = ["polyline"]

#: Distance of a chord from its curve, relative to the length of the element's chord.
_OFF = 5e-3
#: Most parts of an element.
_MOST = 10


def polyline(parts: NurbsElements, points: FloatArray) -> tuple[IntArray, FloatArray, IntArray]:
    """Return the polyline along a curve.

    An element is divided into as many parts as its degree, into more where it is strongly curved.
    A point between two elements belongs to the first.

    Args:
        parts: Elements of the curve.
        points: Control points, shape (c, 3), metres.

    Returns:
        Control points of each point, shape (v, k), their weights, shape (v, k), and the points of
        the edges, shape (e, 2).
    """
    count, width = parts.nodes.shape
    cuts = max(width - 1, min(_parts(points[parts.nodes], parts.shape), _MOST))
    inner = np.arange(1, cuts + 1) / cuts
    weights = [shape_functions(one, inner)[0] for one in parts.shape]
    first = shape_functions(parts.shape[0], np.zeros(1))[0]
    rows = np.concatenate([parts.nodes[:1], np.repeat(parts.nodes, cuts, axis=0)])
    at = np.arange(count * cuts)
    return rows, np.concatenate([first, *weights]), np.column_stack([at, at + 1])


def _parts(points: FloatArray, shape: FloatArray) -> int:
    """Parts of an element for which all chords are near their curves, from the middles."""
    most = 0.0
    for own, one in zip(points, shape, strict=True):
        start, middle, end = shape_functions(one, np.array([0.0, 0.5, 1.0]))[0] @ own
        chord = float(np.linalg.norm(end - start)) or 1.0
        most = max(most, float(np.linalg.norm(middle - 0.5 * (start + end))) / chord)
    return int(np.ceil(np.sqrt(most / _OFF)))  # the distance falls with the square
