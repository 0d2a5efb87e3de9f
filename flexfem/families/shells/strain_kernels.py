# SPDX-License-Identifier: LGPL-3.0-or-later
"""Strains of elements and their derivatives, by the kernels that FFCx makes of UFL forms."""

from mpi4py import MPI

import numpy as np
import ufl

from flexfem._types import FloatArray
from flexfem.forms.strain_forms import StrainForms
from flexfem.kernels.driver import NO_NODES, CellKernel, cell_kernel, evaluate, plain_cells
from flexfem.kernels.ffcx import compile_kernel

__all__ = ["StrainKernels"]


class StrainKernels:
    """Kernels of k strains of n unknowns."""

    def __init__(self, comm: MPI.Intracomm, forms: StrainForms) -> None:
        """Compile (collective)."""
        fields = forms.unknowns, forms.stress
        k, n = (field.ufl_element().dim for field in (forms.stress, forms.unknowns))
        own = {"unknowns": (0, n), "stress": (n, k)}

        def compiled(form: ufl.Form, size: int) -> CellKernel:
            made = compile_kernel(comm, form, fields, batched=True)
            return cell_kernel(made, size, own, {}, own)

        self._shape = k, n
        self._strain = compiled(forms.strain, k * (1 + n))
        self._geometric = compiled(forms.geometric, n * n)

    def strains(self, unknowns: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Strains (m, k) and their derivatives (m, k, n) at unknowns (m, n)."""
        k, n = self._shape
        values = _values(self._strain, np.ascontiguousarray(unknowns))
        return values[:, :k], values[:, k:].reshape(-1, k, n)

    def geometric(self, unknowns: FloatArray, stresses: FloatArray) -> FloatArray:
        """Derivatives (m, n, n) of the forces of fixed stresses (m, k): geometric stiffness."""
        n = self._shape[1]
        both = np.concatenate([unknowns, stresses], axis=1)
        return _values(self._geometric, both).reshape(-1, n, n)


def _values(kernel: CellKernel, own: FloatArray) -> FloatArray:
    """Results (m, s) of a kernel in cells with the data ``own``."""
    out = np.empty((len(own), kernel.size))
    evaluate(kernel.memory, plain_cells(own).memory, NO_NODES, np.zeros(1), out)
    return out
