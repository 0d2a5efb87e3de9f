# SPDX-License-Identifier: LGPL-3.0-or-later
"""B-spline bases on the elements of a knot vector, in Bernstein form and in powers.

An element is a non-empty knot span [a, b], with the coordinate xi = (u - a)/(b - a) in [0, 1].
"""

from math import comb

import numpy as np

from flexfem._types import FloatArray, IntArray


def knot_spans(degree: int, knots: FloatArray) -> IntArray:
    """Return the indices i of the non-empty spans [knots[i], knots[i + 1]], shape (m,)."""
    inside = knots[degree : len(knots) - degree]
    return np.flatnonzero(np.diff(inside) > 0.0).astype(np.int64) + degree


def extraction(degree: int, knots: FloatArray) -> FloatArray:
    """Return the Bezier extraction operators of all elements.

    The recursion of Cox and de Boor is done with polynomials in Bernstein form, where every factor
    is non-negative, so that nothing cancels.

    Args:
        degree: Degree p.
        knots: Knot vector with p + 1 equal knots at both ends.

    Returns:
        C, shape (m, p + 1, p + 1): the I-th function that is not zero on an element is
        `N_I(xi) = sum_j C[I, j] B_j(xi)`, B_j the Bernstein polynomials of degree p.
    """
    spans = knot_spans(degree, knots)
    a, b = knots[spans], knots[spans + 1]
    old = np.ones((len(spans), 1, 1))
    for q in range(1, degree + 1):
        new = np.zeros((len(spans), q + 1, q + 1))
        rise = np.arange(1, q + 1) / q  # Bernstein form of xi times a polynomial of degree q - 1
        fall = 1.0 - np.arange(q) / q
        for j in range(q):
            # Function j of degree q - 1 enters the functions j (falling) and j + 1 (rising)
            start, end = knots[spans - q + 1 + j], knots[spans + 1 + j]
            for i, x, y in ((j, end - a, end - b), (j + 1, a - start, b - start)):
                new[:, i, :-1] += (x / (end - start))[:, None] * fall * old[:, j]
                new[:, i, 1:] += (y / (end - start))[:, None] * rise * old[:, j]
        old = new
    return old


def bernstein_powers(degree: int) -> FloatArray:
    """Return the matrix whose row j holds the coefficients of B_j in powers of xi."""
    matrix = np.zeros((degree + 1, degree + 1))
    for j in range(degree + 1):
        for i in range(j, degree + 1):
            matrix[j, i] = (-1) ** (i - j) * comb(degree, i) * comb(i, j)
    return matrix


def power_table(count: int, xi: FloatArray, derivatives: int) -> FloatArray:
    """Return powers of xi and their derivatives, shape (derivatives + 1, n, count)."""
    table = np.zeros((derivatives + 1, len(xi), count))
    table[0] = xi[:, None] ** np.arange(count)
    factor = np.ones(count)
    for d in range(1, derivatives + 1):
        factor = factor * np.maximum(np.arange(count) - d + 1, 0)
        table[d, :, d:] = factor[d:] * table[0, :, : count - d]
    return table


def rational(weighted: FloatArray) -> FloatArray:
    """Return the rational functions and their derivatives.

    Args:
        weighted: Derivatives 0, 1, ... of the weighted functions w_I N_I, shape (d + 1, ..., k).

    Returns:
        Derivatives of `w_I N_I / sum_J w_J N_J` by Leibniz' rule, of the same shape.
    """
    total = weighted.sum(axis=-1, keepdims=True)
    result = np.empty_like(weighted)
    for d in range(len(weighted)):
        known = sum(comb(d, j) * total[j] * result[d - j] for j in range(1, d + 1))
        result[d] = (weighted[d] - known) / total[0]
    return result


def greville(degree: int, knots: FloatArray) -> FloatArray:
    """Return the Greville abscissae, the means of `degree` successive inner knots."""
    windows = np.lib.stride_tricks.sliding_window_view(knots[1:-1], degree)
    # Round-off must not carry a mean of equal knots away from them
    return np.clip(windows.mean(axis=1), windows[:, 0], windows[:, -1])


def uniform_knots(degree: int, count: int) -> FloatArray:
    """Return the clamped knots of `count` equal elements on [0, 1]."""
    return clamped(degree, np.linspace(0.0, 1.0, count + 1))


def clamped(degree: int, breaks: FloatArray) -> FloatArray:
    """Return the knots with the given distinct values, simple inside."""
    return np.concatenate([np.repeat(breaks[0], degree), breaks, np.repeat(breaks[-1], degree)])
