# SPDX-License-Identifier: LGPL-3.0-or-later
"""Coordinates of a mechanism as the driver of cell kernels takes them: nodes with one number each.

Every cell names its entries of the vector of all coordinates; entries that are held name the one
after the last, which is zero, and what is added there is dropped.
"""

import math

from mpi4py import MPI

import numpy as np
import ufl

from flexfem._types import FloatArray
from flexfem.kernels.driver import CellKernel, Nodal, cell_kernel
from flexfem.kernels.ffcx import compile_kernel
from flexfem.kernels.records import Float2D, Record

__all__ = ["Coordinates", "coordinate_kernel"]


class Coordinates(Record):
    """Coordinates of a mechanism and their derivatives in time, with the zero of those held.

    Attributes:
        q: (n + 1, 1) coordinates.
        v: (n + 1, 1) their rates.
        a: (n + 1, 1) the rates of these.
    """

    q: Float2D
    v: Float2D
    a: Float2D

    @classmethod
    def zeros(cls, size: int) -> "Coordinates":
        """Zeros, of n coordinates."""
        q, v, a = np.zeros((3, size + 1, 1))
        return cls(q=q, v=v, a=a)

    def put(self, *parts: FloatArray) -> None:
        """Write q, q', q'' (n,), or the first of these."""
        for values, part in zip((self.q, self.v, self.a), parts, strict=False):
            values[:-1, 0] = part


#: Kind and word of the coordinates and of their rates.
_NODAL = {name: (Nodal.NUMBERS, Coordinates.word(name)) for name in Coordinates.fields}


def coordinate_kernel(form: ufl.Form, fields: tuple[ufl.Coefficient, ...]) -> CellKernel:
    """Compile a form of q, q', q'' of a cell, or of the first of these ``fields`` (collective)."""
    kernel = compile_kernel(MPI.COMM_WORLD, form, fields)
    spaces = [argument.ufl_function_space() for argument in form.arguments()]
    size = math.prod(space.ufl_element().dim for space in spaces)
    nodal = dict(list(_NODAL.items())[: len(fields)])
    return cell_kernel(kernel, size, nodal, nodal, {})
