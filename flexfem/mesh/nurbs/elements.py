# SPDX-License-Identifier: LGPL-3.0-or-later
"""Elements of a NURBS curve: Bezier extraction, shape functions and arc length."""

from dataclasses import dataclass

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.mesh.nurbs.basis import bernstein_powers, extraction, knot_spans, power_table, rational

# Numbers of Chebyshev points tried for the speed of an element; with more of them, rounding errors
# of the powers of xi exceed the gain
_SAMPLES = (6, 12, 18, 24)
# Error of the speed relative to its mean in the element: wanted, and still accepted
_WANTED = 2e-15
_ACCEPTED = 1e-7


@dataclass(frozen=True, eq=False)
class NurbsElements:
    """The non-empty knot spans of one curve, each with the coordinate xi in [0, 1].

    Attributes:
        nodes: Control points of each element, shape (m, p + 1).
        spans: Parameters at both ends, shape (m, 2).
        extraction: Bezier extraction C, shape (m, p + 1, p + 1): the functions without weights are
            `N_I(xi) = sum_j C[I, j] B_j(xi)`, B_j the Bernstein polynomials of degree p.
        shape: Coefficients of w_I N_I in powers of xi, shape (m, p + 1, p + 1); the rational shape
            functions are these over their sum.
        arc: Coefficients of the arc length from the element's start in powers of xi, shape (m, q),
            metres; accurate to 1e-12 of the element's length, less (1e-8) where an element turns by
            more than a quarter circle.
        lengths: Arc lengths of the elements, shape (m,), metres.
    """

    nodes: IntArray
    spans: FloatArray
    extraction: FloatArray
    shape: FloatArray
    arc: FloatArray
    lengths: FloatArray


def make_elements(
    degree: int, knots: FloatArray, points: FloatArray, weights: FloatArray
) -> NurbsElements:
    """Return the elements of a curve given by its parts; see `NurbsCurve`.

    Raises:
        ValueError: the curve bends so sharply inside an element, compared with the element's
            length, that no polynomial of moderate degree describes its arc length.
    """
    spans = knot_spans(degree, knots)
    nodes = spans[:, None] + np.arange(-degree, 1)
    operators = extraction(degree, knots)
    shape = weights[nodes][:, :, None] * (operators @ bernstein_powers(degree))
    arc = _arc_polynomials(shape, points[nodes])
    return NurbsElements(
        nodes=nodes,
        spans=np.stack([knots[spans], knots[spans + 1]], axis=1),
        extraction=operators,
        shape=shape,
        arc=arc,
        lengths=arc.sum(axis=1),
    )


def shape_functions(shape: FloatArray, xi: FloatArray, derivatives: int = 0) -> FloatArray:
    """Return the rational shape functions of one element and their derivatives by xi.

    Args:
        shape: One element's coefficients `NurbsElements.shape[e]`, shape (k, k).
        xi: Places in the element, shape (n,).
        derivatives: Highest derivative.

    Returns:
        Shape (derivatives + 1, n, k).
    """
    return rational(power_table(shape.shape[-1], xi, derivatives) @ shape.T)


def evaluate(
    parts: NurbsElements, points: FloatArray, index: IntArray, xi: FloatArray, order: int
) -> FloatArray:
    """Return position and derivatives by xi at one place in each of the given elements.

    Args:
        parts: The elements.
        points: Values at all control points, shape (n, c).
        index: Elements, shape (k,).
        xi: Places in them, shape (k,).
        order: Highest derivative.

    Returns:
        Shape (order + 1, k, c).
    """
    powers = power_table(parts.shape.shape[-1], xi, order)
    functions = rational(np.einsum("dkj,kIj->dkI", powers, parts.shape[index]))
    values: FloatArray = np.einsum("dkI,kIc->dkc", functions, points[parts.nodes[index]])
    return values


def _speeds(shape: FloatArray, points: FloatArray, xi: FloatArray) -> FloatArray:
    """Return |dx/dxi| at the same places xi (n,) of all elements, shape (m, n)."""
    weighted = np.einsum("dnj,mIj->dmnI", power_table(shape.shape[-1], xi, 1), shape)
    slopes = np.einsum("mnI,mIc->mnc", rational(weighted)[1], points)
    result: FloatArray = np.linalg.norm(slopes, axis=-1)
    return result


def _arc_polynomials(shape: FloatArray, points: FloatArray) -> FloatArray:
    """Return the arc lengths of elements with control points (m, k, 3) in powers of xi.

    The speed is interpolated at Chebyshev points, where the last coefficients estimate the error.
    """
    from numpy.polynomial import chebyshev

    for count in _SAMPLES:
        angle = np.pi * (np.arange(count) + 0.5) / count
        speeds = _speeds(shape, points, 0.5 * (1.0 + np.cos(angle)))
        # discrete cosine transform: Chebyshev coefficients of the speed
        series = speeds @ np.cos(np.outer(angle, np.arange(count))) * (2.0 / count)
        series[:, 0] *= 0.5
        error = np.abs(series[:, -2:]).sum(axis=1) / series[:, 0]
        if error.max() <= _WANTED * count:
            break
    if error.max() > _ACCEPTED:
        raise ValueError(
            f"NurbsCurve: element {int(np.argmax(error))} bends too sharply for its length, "
            "refine the curve there"
        )
    arc = chebyshev.chebint(series, lbnd=-1, scl=0.5, axis=1)
    size = np.abs(arc).max(axis=0) / arc.sum(axis=1).max()
    keep = max(int(np.flatnonzero(size > _WANTED)[-1]) + 1, 2)
    powers: FloatArray = arc[:, :keep] @ _shifted_chebyshev(keep)
    powers[:, 0] = 0.0
    return powers


def _shifted_chebyshev(count: int) -> FloatArray:
    """Return the matrix whose row j holds T_j(2 xi - 1) in powers of xi; its entries are whole."""
    rows = np.zeros((count, count))
    rows[0, 0] = 1.0
    rows[1, :2] = -1.0, 2.0
    for j in range(2, count):
        rows[j] = -2.0 * rows[j - 1] - rows[j - 2]
        rows[j, 1:] += 4.0 * rows[j - 1, :-1]
    return rows
