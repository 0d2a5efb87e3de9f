# SPDX-License-Identifier: LGPL-3.0-or-later
"""Displacement gradients at the points of the cells, and the tensors and forces of an energy there.

Tensors are sums over the points of this rank's cells of products of gradients, and are summed over
the ranks once.
"""

from typing import Any

import basix
import basix.ufl
import numpy as np
import ufl
from dolfinx import fem

from flexfem._types import FloatArray, IntArray
from flexfem.kernels.ffcx_options import compile_options, compiled_form, quick_compiler
from flexfem.reduction.elastic_polynomial import pair_count
from flexfem.reduction.fem.body.blocks import assemble_rows, own_rows, set_rows, total
from flexfem.reduction.fem.body.linear_body import LinearBody
from flexfem.reduction.fem.body.strain_energy import StrainEnergy

__all__ = ["CellGradients"]

#: Points whose products are held at once.
_POINTS = 256


class CellGradients:
    """Derivatives of a body's energy along functions of its space.

    Gradients are (m, 9, n) at m points of n functions. The energy must have its derivatives at
    rest, see :class:`StrainEnergy`.
    """

    def __init__(self, body: LinearBody, energy: StrainEnergy) -> None:
        """Compile (collective)."""
        domain = body.space.mesh
        self._comm, self._rows, self._body = domain.comm, own_rows(body.space), body
        self._second, self._third, self._fourth = energy.derivatives
        self._state = fem.Function(body.space)
        rule: Any = basix.make_quadrature(
            basix.CellType[domain.topology.cell_name()], energy.quadrature
        )
        points, weights = rule
        self._cells = np.arange(
            domain.topology.index_map(domain.topology.dim).size_local, dtype=np.int32
        )
        size: Any = abs(ufl.JacobianDeterminant(domain))  # type: ignore[arg-type]
        how = compile_options(domain.comm)
        with quick_compiler():
            self._gradient = fem.Expression(ufl.grad(self._state), points, **how)
            volume: Any = fem.Expression(size, points, **how)
        sizes = volume.eval(domain, self._cells).reshape(-1, len(weights))
        self._weights: FloatArray = (sizes * weights).ravel()
        element = basix.ufl.quadrature_element(
            domain.basix_cell(), value_shape=(3, 3), degree=energy.quadrature
        )
        self._stress = fem.Function(fem.functionspace(domain, element))
        v = ufl.TestFunction(body.space)
        measure = ufl.dx(domain, metadata={"quadrature_degree": energy.quadrature})
        self._work = compiled_form(ufl.inner(self._stress, ufl.grad(v)) * measure)

    def of(self, functions: FloatArray) -> FloatArray:
        """Gradients (m, 9, n) of functions (rows, n) (collective)."""
        gradients = np.empty((len(self._weights), 9, functions.shape[1]))
        for j, function in enumerate(functions.T):
            set_rows(self._state, function)
            values = self._gradient.eval(self._body.space.mesh, self._cells)
            gradients[:, :, j] = values.reshape(-1, 9)
        return gradients

    def forces(self, first: FloatArray, second: FloatArray, i: IntArray, j: IntArray) -> FloatArray:
        """Third derivatives (rows, p) along pairs of functions and all of the space (collective).

        Args:
            first: gradients (m, 9, a).
            second: gradients (m, 9, b).
            i: (p,) function of the first in each pair.
            j: (p,) function of the second.
        """
        forces = np.empty((self._rows, len(i)))
        places = self._stress.function_space.dofmap.list[: len(self._cells)].ravel()
        for pair, (a, b) in enumerate(zip(i, j, strict=True)):
            along = np.tensordot(first[:, :, a], self._third, axes=1)
            stress = np.einsum("mab,mb->ma", along, second[:, :, b])
            self._stress.x.array.reshape(-1, 9)[places] = stress
            forces[:, pair] = assemble_rows(self._work, self._rows)
        return forces

    def third(self, first: FloatArray, second: FloatArray, last: FloatArray) -> FloatArray:
        """Third derivatives (p, q, n) along three functions each (collective)."""
        p, q, n = (g.shape[2] for g in (first, second, last))
        found = np.zeros((p, q * n))
        for at in self._chunks():
            stress = np.einsum("abc,mcn->mabn", self._third, last[at], optimize=True)
            both = np.einsum("mabn,mbq->maqn", stress, second[at], optimize=True)
            weighted = (self._weights[at, np.newaxis, np.newaxis] * first[at]).reshape(-1, p)
            found += weighted.T @ both.reshape(len(weighted), -1)
        return total(self._comm, found).reshape(p, q, n)

    def fourth(self, first: FloatArray, second: FloatArray, symmetric: bool) -> FloatArray:
        """Fourth derivatives (P, q) along pairs of functions (collective).

        Args:
            first: gradients (m, 9, p), whose P pairs count once.
            second: gradients (m, 9, n).
            symmetric: along the n (n + 1)/2 pairs of the second functions themselves, or along
                the (n p) pairs of a second and a first one.
        """
        i, j = np.triu_indices(9)
        twice = np.where(i == j, 1.0, 2.0)
        tensor = self._fourth[i, j][:, i, j] * twice
        p, n = first.shape[2], second.shape[2]
        found = np.zeros((pair_count(p), pair_count(n) if symmetric else n * p))
        for at in self._chunks():
            a, c = first[at], second[at]
            left = _pairs(a, a, True) * (self._weights[at, np.newaxis] * twice)[..., np.newaxis]
            right = _pairs(c, c, True) if symmetric else _pairs(c, a, False)
            stress = np.matmul(tensor, right)
            rows = left.reshape(-1, len(found))
            found += rows.T @ stress.reshape(len(rows), found.shape[1])  # there may be no columns
        return total(self._comm, found)

    def unit_strain(self) -> float:
        """Energy norm of a displacement with strains of one, the largest of all (collective)."""
        volume = float(total(self._comm, np.array([self._weights.sum()]))[0])
        stiffest = np.linalg.eigvalsh(self._second)[-1]
        return float(np.sqrt(volume * stiffest))

    def _chunks(self) -> list[slice]:
        """Runs of points."""
        count = len(self._weights)
        return [slice(a, a + _POINTS) for a in range(0, count, _POINTS)]


def _pairs(first: FloatArray, second: FloatArray, symmetric: bool) -> FloatArray:
    """Symmetric products (m, 45, pairs) of gradients (m, 9, p) and (m, 9, q)."""
    i, j = np.triu_indices(9)
    if symmetric:
        k, n = np.triu_indices(first.shape[2])
    else:
        k, n = (x.ravel() for x in np.indices((first.shape[2], second.shape[2])))
    a, b = first[:, :, k], second[:, :, n]
    products: FloatArray = 0.5 * (a[:, i] * b[:, j] + a[:, j] * b[:, i])
    return products
