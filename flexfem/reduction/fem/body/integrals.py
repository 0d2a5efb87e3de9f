# SPDX-License-Identifier: LGPL-3.0-or-later
"""Integrals of masses over a body: forms with data, compiled once and assembled for each entry."""

from typing import Any

from petsc4py import PETSc

import numpy as np
import ufl
from dolfinx import fem, mesh

from flexfem._types import FloatArray
from flexfem.kernels.ffcx_options import compiled_form
from flexfem.reduction.fem.body.blocks import (
    ProjectedForm,
    assemble_rows,
    assembled_matrix,
    own_rows,
    projected,
    total,
    with_neighbours,
)
from flexfem.reduction.fem.body.linear_body import LinearBody

__all__ = ["MassIntegrals"]


class MassIntegrals:
    """Integrals over the masses of a body, of their places and of displacement functions."""

    def __init__(self, body: LinearBody) -> None:
        """Compile the forms (collective)."""
        self.body = body
        self._domain = domain = body.space.mesh
        masses = [(_density(domain, m.density), m.position, m.displacement) for m in body.masses]
        self._rows = own_rows(body.space)
        self._constant = fem.Constant(domain, np.zeros(3))
        self._linear = fem.Constant(domain, np.zeros((3, 3)))
        self._pair = fem.Constant(domain, np.eye(3))
        v, u, dx = ufl.TestFunction(body.space), ufl.TrialFunction(body.space), ufl.dx(domain)
        self._load = compiled_form(
            sum(
                rho * ufl.dot(self._constant + ufl.dot(self._linear, r), moved(v)) * dx
                for rho, r, moved in masses
            )
        )
        inner = sum(
            rho * ufl.dot(moved(v), ufl.dot(self._pair, moved(u))) * dx for rho, _, moved in masses
        )
        self._inner = ProjectedForm(inner, domain.comm)
        self._whole_inner = sum(rho * ufl.dot(moved(v), moved(u)) * dx for rho, _, moved in masses)
        self._second = compiled_form(
            sum(
                rho * (ufl.dot(self._constant, r) + ufl.dot(r, ufl.dot(self._linear, r))) * dx
                for rho, r, _ in masses
            )
        )
        self._whole = compiled_form(sum(rho * dx for rho, _, _ in masses))

    def mass_matrix(self) -> PETSc.Mat:
        """Mass matrix of all rows (collective)."""
        return assembled_matrix(self._whole_inner, self._domain.comm)

    def mass(self) -> float:
        """Whole mass, kg (collective)."""
        return float(total(self._domain.comm, np.array([fem.assemble_scalar(self._whole)]))[0])

    def first(self) -> FloatArray:
        """(3,) integral of rho r (collective)."""
        return self._places(range(3))

    def second(self) -> FloatArray:
        """(3, 3) integral of rho r r^T (collective)."""
        return self._places(range(3, 12)).reshape(3, 3)

    def _places(self, fields: range) -> FloatArray:
        values = []
        for i in fields:
            self._set_field(i)
            values.append(fem.assemble_scalar(self._second))
        return total(self._domain.comm, np.array(values))

    def loads(self) -> FloatArray:
        """(rows, 12) forces of the masses in the fields e_a, then r_b e_a at 3 + 3 a + b."""
        loads = np.zeros((self._rows, 12))
        for i in range(12):
            self._set_field(i)
            loads[:, i] = assemble_rows(self._load, self._rows)
        return loads

    def _set_field(self, index: int) -> None:
        self._constant.value[:] = 0.0
        self._linear.value[:] = 0.0
        if index < 3:
            self._constant.value[index] = 1.0
        else:
            self._linear.value.flat[index - 3] = 1.0

    def products(self, basis: FloatArray, loads: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Moments (3, n+1) and products (3, 3, n+1, n+1) of r and the functions (collective).

        Args:
            basis: (rows, n).
            loads: as from :meth:`loads`.
        """
        comm, n = self._domain.comm, basis.shape[1]
        moments, products = np.zeros((3, n + 1)), np.zeros((3, 3, n + 1, n + 1))
        moments[:, 0], products[:, :, 0, 0] = self.first(), self.second()
        work = projected(comm, loads, basis)
        whole = with_neighbours(self.body.space, basis)
        moments[:, 1:] = work[:3]
        # r_a with Phi_b is the work of the force rho r_a e_b
        mixed = work[3:].reshape(3, 3, n).transpose(1, 0, 2)
        products[:, :, 0, 1:] = mixed
        products[:, :, 1:, 0] = mixed.transpose(1, 0, 2)
        for a in range(3):
            for b in range(a, 3):
                self._pair.value[:] = 0.0
                self._pair.value[a, b] = 1.0
                block = self._inner.project(whole)
                if a == b:
                    block = 0.5 * (block + block.T)
                products[a, b, 1:, 1:] = block
                products[b, a, 1:, 1:] = block.T
        return moments, products


def _density(domain: mesh.Mesh, density: Any) -> Any:
    """Numbers as data of the forms: other densities need not compile them again."""
    if isinstance(density, (int, float, np.number)):
        return fem.Constant(domain, np.array(float(density)))
    return density
