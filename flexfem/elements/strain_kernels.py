# SPDX-License-Identifier: LGPL-3.0-or-later
"""Strains of elements and their derivatives, by the kernels that FFCx makes of UFL forms."""

from mpi4py import MPI

import numpy as np

from flexfem._types import FloatArray
from flexfem.forms.strain_forms import StrainForms
from flexfem.la.kernel import Kernel, compile_kernel, tabulate
from flexfem.la.lanes import LANES, lanes, unlaned
from flexfem.lie.compiled import kernel

__all__ = ["StrainKernels"]


@kernel
def _evaluate(address: int, data: FloatArray, out: FloatArray) -> None:
    """Tabulate a batched kernel: data (b, c, LANES), results (b, s, LANES)."""
    constants, points = np.zeros(1), np.zeros(6)
    points[3] = 1.0
    for b in range(len(data)):
        out[b] = 0.0
        tabulate(address, out[b], data[b], constants, points)  # type: ignore[call-arg]


class StrainKernels:
    """Kernels of k strains of n unknowns."""

    def __init__(self, comm: MPI.Intracomm, forms: StrainForms) -> None:
        """Compile (collective)."""
        fields = forms.unknowns, forms.stress
        self._strain = compile_kernel(comm, forms.strain, fields, batched=True)
        self._geometric = compile_kernel(comm, forms.geometric, fields, batched=True)
        self._shape = tuple(field.ufl_element().dim for field in (forms.stress, forms.unknowns))

    def strains(self, unknowns: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Strains (m, k) and their derivatives (m, k, n) at unknowns (m, n)."""
        k, n = self._shape
        values = _values(self._strain, [unknowns], k * (1 + n))
        return values[:, :k], values[:, k:].reshape(-1, k, n)

    def geometric(self, unknowns: FloatArray, stresses: FloatArray) -> FloatArray:
        """Derivatives (m, n, n) of the forces of stresses (m, k) that stay as they are."""
        n = self._shape[1]
        return _values(self._geometric, [unknowns, stresses], n * n).reshape(-1, n, n)


def _values(kernel: Kernel, fields: list[FloatArray], size: int) -> FloatArray:
    """Results (m, s) of a kernel with the coefficients ``fields`` (m, c), in their order."""
    count = len(fields[0])
    if count == 0:
        return np.empty((0, size))
    data = np.zeros((count, max(int(kernel.offsets[-1]), 1)))
    for field, offset in zip(fields, kernel.offsets[: len(fields)].tolist(), strict=True):
        if offset >= 0:
            data[:, offset : offset + field.shape[1]] = field
    packed = lanes(data)
    out = np.empty((len(packed), size, LANES))
    _evaluate(kernel.address, packed, out)
    return unlaned(out, count)
