# SPDX-License-Identifier: LGPL-3.0-or-later
"""Geometric stiffness of the stresses that a reduced body may be under."""

import numpy as np
import ufl
from dolfinx import fem

from flexfem._types import FloatArray
from flexfem.reduction.fem.body.blocks import ProjectedForm, set_rows
from flexfem.reduction.fem.body.linear_body import LinearBody
from flexfem.reduction.fem.body.ties import Ties
from flexfem.reduction.reduced_body import Interface, interface_motions

__all__ = ["GeometricStiffness"]


class GeometricStiffness:
    """Work of the stress of one displacement on the second-order strain of others."""

    def __init__(self, body: LinearBody) -> None:
        """Compile the form (collective)."""
        assert body.prestress is not None
        self._state = fem.Function(body.space)
        u, v = ufl.TrialFunction(body.space), ufl.TestFunction(body.space)
        self._form = ProjectedForm(body.prestress(self._state, u, v), body.space.mesh.comm)

    def of(self, states: FloatArray, basis: FloatArray) -> FloatArray:
        """(states, n, n) matrices in a basis, for each displacement (collective).

        Args:
            states: (rows, states).
            basis: as from :func:`with_neighbours`.
        """
        n = basis.shape[1]
        matrices = np.zeros((states.shape[1], n, n))
        for matrix, state in zip(matrices, states.T, strict=True):
            set_rows(self._state, state)
            product = self._form.project(basis)
            matrix[:] = 0.5 * (product + product.T)
        return matrices

    def of_interfaces(self, ties: Ties, static: FloatArray, basis: FloatArray) -> FloatArray:
        """(6 k, n, n) matrices for the static functions of the interfaces (collective).

        Rigid motions cause no stress: the effect of the first interface is the opposite of that of
        all others together.
        """
        matrices = np.zeros((static.shape[1], basis.shape[1], basis.shape[1]))
        moving = np.flatnonzero(~ties.held)
        later = moving[moving >= 6]
        matrices[later] = self.of(static[:, later], basis)
        if len(ties.interfaces) > 1:
            about = ties.interfaces[0].position
            motions = interface_motions(
                [Interface(i.name, i.position - about) for i in ties.interfaces], ties.held
            )
            matrices[:6] = -np.einsum("ka,kij->aij", motions[6:], matrices[6:])
        return matrices
