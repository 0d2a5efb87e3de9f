# SPDX-License-Identifier: LGPL-3.0-or-later
"""Shape functions of NURBS elements at their quadrature points, and integrals over the elements."""

from dataclasses import dataclass

import numpy as np

from flexfem._types import FloatArray, IndexArray
from flexfem.mesh.nurbs.basis import power_table, rational

__all__ = ["Masses", "Points", "gauss", "masses", "points", "shape_functions"]

#: Gauss points for lengths and masses: evaluated at set-up only, and enough for any smooth curve.
_FINE = 16


def gauss(count: int) -> tuple[FloatArray, FloatArray]:
    """Points and weights (count,) of Gauss-Legendre quadrature on [0, 1]."""
    at, weights = np.polynomial.legendre.leggauss(count)
    return 0.5 * (at + 1.0), 0.5 * weights


def shape_functions(shape: FloatArray, xi: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rational shape functions and their derivatives by xi.

    Args:
        shape: (m, k, k) coefficients in powers of xi of the weighted functions.
        xi: (q,) coordinates of points in all elements, or (m, q).

    Returns:
        Two arrays (m, q, k).
    """
    at = np.broadcast_to(xi, (len(shape), np.shape(xi)[-1]))
    k = shape.shape[-1]
    powers = power_table(k, at.ravel(), 1).reshape(2, *at.shape, k)
    values, derivatives = rational(np.einsum("dmqj,mij->dmqi", powers, shape))
    return values, derivatives


@dataclass(frozen=True)
class Points:
    """Shape functions at points of all elements.

    Attributes:
        values, slopes: (m, q, k) shape functions and their derivatives by the arc length at the
            start, 1/m.
        lengths: (m, q) arc length that each point stands for, m.
    """

    values: FloatArray
    slopes: FloatArray
    lengths: FloatArray


def points(
    shape: FloatArray, cells: IndexArray, start: FloatArray, xi: FloatArray, weights: FloatArray
) -> Points:
    """Shape functions at given places.

    Args:
        shape: (m, k, k), see :func:`shape_functions`.
        cells: (m, k) nodes.
        start: (n, 12) frames of the nodes at the start.
        xi: (q,) or (m, q) coordinates of points.
        weights: (q,) their weights.
    """
    values, slopes = shape_functions(shape, xi)
    speed = np.linalg.norm(np.einsum("mqi,mij->mqj", slopes, start[cells, :3]), axis=-1)
    return Points(values, slopes / speed[..., np.newaxis], weights * speed)


@dataclass(frozen=True)
class Masses:
    """Integrals over the arc length at the start.

    Attributes:
        products: (m, k, k) of the products of two shape functions, m.
        weights: (m, k) of the shape functions, m.
        lengths: (m,) of the elements, m.
    """

    products: FloatArray
    weights: FloatArray
    lengths: FloatArray


def masses(shape: FloatArray, cells: IndexArray, start: FloatArray) -> Masses:
    """Integrals over all elements, to round-off; arguments as for :func:`points`."""
    fine = points(shape, cells, start, *gauss(_FINE))
    products = np.einsum("mq,mqi,mqj->mij", fine.lengths, fine.values, fine.values)
    # partition of unity of the shape functions, also of their integrals
    return Masses(products, products.sum(axis=2), products.sum(axis=(1, 2)))
