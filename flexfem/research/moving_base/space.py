# SPDX-License-Identifier: LGPL-3.0-or-later
"""Finite-element functions on an interval as sparse operators, with exact running integrals."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy.sparse

from flexfem._types import FloatArray

__all__ = ["GAUSS", "LineSpace", "Quadrature", "divide"]

#: Points per element: running integrals of products of slopes of cubics are exact with five.
GAUSS = 5


def divide(breaks: FloatArray, elements: int) -> FloatArray:
    """Ends of elements of about equal length that respect the breaks, (k,), m."""
    length = breaks[-1] - breaks[0]
    parts = [
        np.linspace(a, b, max(1, round(elements * (b - a) / length)) + 1)
        for a, b in pairwise(breaks)
    ]
    return np.unique(np.concatenate(parts))


@dataclass(frozen=True, eq=False)
class Quadrature:
    """Gauss points of all elements, element by element.

    Attributes:
        edges: ends of the elements, m.
        x, weights: (p,), m.
    """

    edges: FloatArray
    x: FloatArray
    weights: FloatArray

    @classmethod
    def of(cls, edges: FloatArray) -> "Quadrature":
        """Points of elements with the given ends."""
        xi, w = _gauss()
        sizes = np.diff(edges)
        x = edges[:-1, None] + sizes[:, None] * xi
        return cls(edges, x.reshape(-1), (sizes[:, None] * w).reshape(-1))

    def running(self, values: FloatArray) -> FloatArray:
        """Integrals from the root to every point of functions given at the points, (p, ...)."""
        xi, w = _gauss()
        # integral from 0 to xi_k of the polynomial through the points
        powers = np.vander(xi, GAUSS, increasing=True)
        orders = np.arange(1, GAUSS + 1)
        partial = (xi[:, None] ** orders / orders) @ np.linalg.inv(powers)
        sizes = np.diff(self.edges)
        by_element = values.reshape(len(sizes), GAUSS, -1)
        whole = np.einsum("e,k,eki->ei", sizes, w, by_element)
        before = np.cumsum(whole, axis=0) - whole
        out = before[:, None] + np.einsum("e,lk,eki->eli", sizes, partial, by_element)
        result: FloatArray = out.reshape(values.shape)
        return result


@dataclass(frozen=True, eq=False)
class LineSpace:
    """Continuous cubics, or cubics with continuous slopes (Hermite), on the elements.

    Attributes:
        edges: ends of the elements, m.
        hermite: whether slopes are continuous.
    """

    edges: FloatArray
    hermite: bool

    @property
    def size(self) -> int:
        """Number of functions."""
        n = len(self.edges) - 1
        return 2 * (n + 1) if self.hermite else 3 * n + 1

    def operators(self, xi: FloatArray) -> tuple[scipy.sparse.csr_matrix, ...]:
        """Values, first and second derivatives at the places xi in [0, 1] of every element.

        Returns:
            Three matrices (elements x places, size).
        """
        n, k = len(self.edges) - 1, len(xi)
        sizes = np.diff(self.edges)
        first = (2 if self.hermite else 3) * np.arange(n)
        columns = np.broadcast_to((first[:, None] + np.arange(4))[:, None], (n, k, 4))
        rows = np.broadcast_to(np.arange(n * k).reshape(n, k, 1), (n, k, 4))
        out = []
        for order, shapes in enumerate(_hermite(xi) if self.hermite else _lagrange(xi)):
            scale = np.broadcast_to((sizes**-order)[:, None, None], (n, k, 4)).copy()
            if self.hermite:
                scale[..., 1::2] *= sizes[:, None, None]
            values = scale * shapes
            entries = (values.reshape(-1), (rows.reshape(-1), columns.reshape(-1)))
            out.append(scipy.sparse.csr_matrix(entries, shape=(n * k, self.size)))
        return tuple(out)


def _gauss() -> tuple[FloatArray, FloatArray]:
    """Points and weights on [0, 1]."""
    points, weights = np.polynomial.legendre.leggauss(GAUSS)
    return 0.5 * (points + 1.0), 0.5 * weights


def _derivatives(powers: FloatArray, xi: FloatArray) -> tuple[FloatArray, ...]:
    """Values and two derivatives of cubics with the given coefficients (power, function)."""
    one, zero = np.ones_like(xi), np.zeros_like(xi)
    bases = (
        (one, xi, xi**2, xi**3),
        (zero, one, 2.0 * xi, 3.0 * xi**2),
        (zero, zero, 2.0 * one, 6.0 * xi),
    )
    return tuple(np.stack(base, axis=-1) @ powers for base in bases)


def _lagrange(xi: FloatArray) -> tuple[FloatArray, ...]:
    nodes = np.arange(4) / 3.0
    return _derivatives(np.linalg.inv(np.vander(nodes, increasing=True)), xi)


def _hermite(xi: FloatArray) -> tuple[FloatArray, ...]:
    powers = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [-3, -2, 3, -1], [2, 1, -2, 1]])
    return _derivatives(powers.astype(np.float64), xi)
