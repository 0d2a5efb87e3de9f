# SPDX-License-Identifier: LGPL-3.0-or-later
"""FFCx kernels callable from compiled loops.

A form is compiled without mesh data (:func:`compile_kernel`), and its ``tabulate_tensor`` is called
by address from numba code (:func:`tabulate`). The address is an ordinary argument of the loop, so
that numba can cache the loop on disk.
"""

import os
from dataclasses import dataclass
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
import ufl
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from flexfem.la.batch import compile_batch
from flexfem.la.jit import compile_options

__all__ = ["Kernel", "cell_form", "compile_kernel", "tabulate", "tabulate_batch"]

#: Generated code is straight-line arithmetic: vectorised, without unsafe reordering of sums. The
#: variable is for clusters whose nodes differ, and for those who compile more than they compute.
_COMPILE_ARGUMENTS = [
    *os.environ.get("FLEXFEM_CFLAGS", "-O3 -march=native -fno-math-errno").split(),
    "-g0",
]
#: Of a kernel for one cell of which loops take the variant for several: only its text is needed.
_QUICKLY = ["-O0", "-g0"]


@dataclass(frozen=True)
class Kernel:
    """A compiled cell kernel.

    Attributes:
        address: address of the function ``tabulate_tensor_float64``; not optimised where there is a
            batch.
        offsets: where each coefficient of the form starts in the packed coefficients of one cell,
            -1 for a coefficient that the kernel does not use; one more entry holds the length.
        batch: address of the variant for several cells at once, 0 if it was not asked for.
        owner: keeps the loaded modules alive.
    """

    address: int
    offsets: npt.NDArray[np.int64]
    batch: int
    owner: Any


def cell_form(comm: MPI.Intracomm, form: ufl.Form, *, batched: bool = False) -> Any:
    """DOLFINx's compiled form behind a kernel (collective; cached on disk by FFCx).

    Args:
        comm: communicator whose first rank compiles.
        form: form with one cell integral.
        batched: loops take the variant for several cells.
    """
    from dolfinx.fem import compile_form

    arguments = _QUICKLY if batched else _COMPILE_ARGUMENTS
    return compile_form(comm, form, **compile_options(comm, arguments))


def compile_kernel(
    comm: MPI.Intracomm,
    form: ufl.Form,
    coefficients: tuple[ufl.Coefficient, ...],
    *,
    batched: bool = False,
) -> Kernel:
    """Compile the single cell integral of ``form`` (collective; cached on disk by FFCx).

    Args:
        comm: communicator whose first rank compiles.
        form: form with one cell integral.
        coefficients: the order in which offsets are reported.
        batched: compile the variant of ``flexfem.la.batch`` as well.
    """
    compiled = cell_form(comm, form, batched=batched)
    ufcx, ffi = compiled.ufcx_form, compiled.module.ffi
    own = form.coefficients()
    offsets = np.full(len(coefficients) + 1, -1, dtype=np.int64)
    total = 0
    for k in range(ufcx.num_coefficients):
        coefficient = own[ufcx.original_coefficient_positions[k]]
        offsets[coefficients.index(coefficient)] = total
        total += coefficient.ufl_element().dim
    offsets[-1] = total
    kernel = ufcx.form_integrals[0].tabulate_tensor_float64
    batch, owner = 0, None
    if batched:
        batch, owner = compile_batch(comm, compiled.module, _COMPILE_ARGUMENTS)
    return Kernel(int(ffi.cast("uintptr_t", kernel)), offsets, batch, (compiled, owner))


@intrinsic
def tabulate(typingctx, address, tensor, coefficients, constants, coordinates):  # type: ignore
    """Call the cell kernel at ``address``: it adds into ``tensor`` (float64 arrays, C order)."""
    signature = types.void(address, tensor, coefficients, constants, coordinates)

    def codegen(context, builder, sig, arguments):  # type: ignore
        double = ir.DoubleType().as_pointer()
        byte = ir.IntType(8).as_pointer()
        integer = ir.IntType(32).as_pointer()
        function = ir.FunctionType(
            ir.VoidType(), [double, double, double, double, integer, byte, byte]
        )
        pointer = builder.inttoptr(arguments[0], function.as_pointer())
        data = _data(context, builder, sig, arguments)
        builder.call(pointer, [*data, integer(None), byte(None), byte(None)])
        return context.get_dummy_value()

    return signature, codegen


@intrinsic
def tabulate_batch(typingctx, address, tensor, coefficients, constants, coordinates):  # type: ignore
    """Call a batched kernel; see ``flexfem.la.batch.compile_batch`` for the layout."""
    signature = types.void(address, tensor, coefficients, constants, coordinates)

    def codegen(context, builder, sig, arguments):  # type: ignore
        double = ir.DoubleType().as_pointer()
        function = ir.FunctionType(ir.VoidType(), [double] * 4)
        pointer = builder.inttoptr(arguments[0], function.as_pointer())
        builder.call(pointer, _data(context, builder, sig, arguments))
        return context.get_dummy_value()

    return signature, codegen


def _data(context, builder, sig, arguments):  # type: ignore
    """Pointers to the data of the array arguments after the address."""
    return [
        context.make_array(kind)(context, builder, value).data
        for kind, value in zip(sig.args[1:], arguments[1:], strict=True)
    ]
