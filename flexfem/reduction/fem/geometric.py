# SPDX-License-Identifier: LGPL-3.0-or-later
"""Geometric stiffness of the stresses that a reduced body may be under."""

import numpy as np
import ufl
from dolfinx import fem

from flexfem._types import FloatArray
from flexfem.reduction.fem.blocks import AssembledMatrix, multiply, projected, set_rows
from flexfem.reduction.fem.linear_body import LinearBody

__all__ = ["GeometricStiffness"]


class GeometricStiffness:
    """Work of the stress of one displacement on the second-order strain of others."""

    def __init__(self, body: LinearBody) -> None:
        """Compile the form (collective)."""
        assert body.prestress is not None
        self._comm = body.space.mesh.comm
        self._state = fem.Function(body.space)
        u, v = ufl.TrialFunction(body.space), ufl.TestFunction(body.space)
        self._matrix = AssembledMatrix(body.prestress(self._state, u, v))

    def of(self, states: FloatArray, basis: FloatArray) -> FloatArray:
        """(states, n, n) matrices in a basis, for each displacement (rows, states) (collective)."""
        n = basis.shape[1]
        matrices = np.zeros((states.shape[1], n, n))
        for matrix, state in zip(matrices, states.T, strict=True):
            set_rows(self._state, state)
            product = projected(self._comm, basis, multiply(self._matrix.assemble(), basis))
            matrix[:] = 0.5 * (product + product.T)
        return matrices
