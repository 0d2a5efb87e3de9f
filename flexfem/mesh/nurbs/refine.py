# SPDX-License-Identifier: LGPL-3.0-or-later
"""Refinement of NURBS curves and their parameters at given arc lengths."""

import numpy as np

from flexfem._types import FloatArray
from flexfem.mesh.nurbs.basis import greville
from flexfem.mesh.nurbs.elements import NurbsElements

#: degree and knots
Basis = tuple[int, FloatArray]

# Newton's method on a monotonic function, kept inside by bisection
_ITERATIONS = 60


def represent(
    basis: Basis, points: FloatArray, weights: FloatArray, finer: Basis
) -> tuple[FloatArray, FloatArray]:
    """Return control points and weights of the same curve on a basis that contains the old one.

    Interpolation at the Greville abscissae of the finer basis, in homogeneous coordinates, which
    is exact because the spaces are nested.

    Args:
        basis: Degree and knots of the curve.
        points: Its control points, shape (n, 3).
        weights: Its weights, shape (n,).
        finer: Degree and knots wanted.
    """
    from scipy.interpolate import BSpline

    homogeneous = np.column_stack([weights[:, None] * points, weights])
    old = BSpline(basis[1], homogeneous, basis[0])
    new = interpolate(finer, old(greville(*finer)))
    new[[0, -1]] = homogeneous[[0, -1]]
    return new[:, :3] / new[:, 3:], new[:, 3]


def interpolate(basis: Basis, values: FloatArray) -> FloatArray:
    """Return the coefficients of the spline with values (n, c) at the Greville abscissae."""
    from scipy.interpolate import make_interp_spline

    degree, knots = basis
    spline = make_interp_spline(greville(degree, knots), values, k=degree, t=knots)
    return np.array(spline.c)


def cuts(spans: FloatArray, lengths: FloatArray, wanted: int) -> FloatArray:
    """Return the knots that cut spans (m, 2) into `wanted` elements in all.

    Args:
        spans: Parameters at both ends of the elements.
        lengths: Their arc lengths, shape (m,).
        wanted: New number of elements.
    """
    parts = np.full(len(spans), wanted // len(spans))
    for _ in range(wanted % len(spans)):
        parts[np.argmax(lengths / parts)] += 1
    return np.concatenate(
        [np.linspace(a, b, n + 1)[1:-1] for (a, b), n in zip(spans, parts, strict=True)]
    )


def parameters(elements: NurbsElements, fractions: FloatArray) -> FloatArray:
    """Return the parameters at fractions (n,) of the whole arc length."""
    ends = np.cumsum(elements.lengths)
    wanted = fractions * ends[-1]
    index = np.minimum(np.searchsorted(ends, wanted, side="right"), len(ends) - 1)
    wanted = wanted - (ends[index] - elements.lengths[index])
    arc = elements.arc[index]
    powers = np.arange(arc.shape[1])
    low, high = np.zeros(len(wanted)), np.ones(len(wanted))
    xi = wanted / elements.lengths[index]
    for _ in range(_ITERATIONS):
        excess = np.einsum("nj,nj->n", arc, xi[:, None] ** powers) - wanted
        slope = np.einsum("nj,nj->n", arc[:, 1:] * powers[1:], xi[:, None] ** powers[:-1])
        low, high = np.where(excess < 0.0, xi, low), np.where(excess > 0.0, xi, high)
        new = xi - excess / slope
        new = np.where((new < low) | (new > high), 0.5 * (low + high), new)
        if np.abs(new - xi).max(initial=0.0) < 1e-15:
            break
        xi = new
    start, end = elements.spans[index].T
    result: FloatArray = (1.0 - xi) * start + xi * end
    return result


def missing_knots(degree: int, knots: FloatArray, order: int) -> FloatArray:
    """Return the knots whose insertion leaves a basis C^order at most inside."""
    inside, counts = np.unique(knots[degree + 1 : -degree - 1], return_counts=True)
    return np.repeat(inside, np.maximum(degree - order - counts, 0))
