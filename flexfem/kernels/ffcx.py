# SPDX-License-Identifier: LGPL-3.0-or-later
"""FFCx kernels callable from compiled loops.

A form is compiled without mesh data (:func:`compile_kernel`), and its ``tabulate_tensor`` is called
by address from numba code (:func:`tabulate`). The address is an ordinary argument of the loop, so
that numba can cache the loop on disk.
"""

import hashlib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt
import ufl
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from flexfem.kernels.ffcx_options import c_arguments, compile_options, quick_compiler
from flexfem.kernels.lanes import LANES

__all__ = [
    "Kernel",
    "cell_form",
    "compile_arguments",
    "compile_kernel",
    "kernel_at",
    "tabulate",
]

#: Generated code is straight-line arithmetic: vectorised, without unsafe reordering of sums.
_COMPILE_ARGUMENTS = c_arguments("-O3 -march=native -fno-math-errno")
#: FFCx's language backend of kernels that treat several cells.
_BATCH = "flexfem.kernels.ffcx_backend"


@dataclass(frozen=True)
class Kernel:
    """A compiled cell kernel.

    Attributes:
        address: address of the function ``tabulate_tensor_float64``.
        offsets: first entry of each coefficient of the form in the packed coefficients of one cell,
            -1 for a coefficient that the kernel does not use; then the total length.
        owner: keeps the loaded module alive.
        lanes: number of cells that one call evaluates.
    """

    address: int
    offsets: npt.NDArray[np.int64]
    owner: Any
    lanes: int = 1


def cell_form(comm: MPI.Intracomm, form: ufl.Form, *, batched: bool = False) -> Any:
    """DOLFINx's compiled form behind a kernel (collective; cached on disk by FFCx).

    Args:
        comm: communicator whose first rank compiles.
        form: form with one cell integral.
        batched: see :func:`compile_kernel`.
    """
    from dolfinx.fem import compile_form

    options = compile_options(comm, compile_arguments(batched=batched))
    if batched:
        options["form_compiler_options"]["language"] = _BATCH
    with quick_compiler():
        return compile_form(comm, form, **options)


def compile_arguments(*, batched: bool) -> list[str]:
    """Arguments of the C compiler, see :func:`compile_kernel`."""
    return [*_COMPILE_ARGUMENTS, *(_batch_arguments() if batched else ())]


@cache
def _batch_arguments() -> tuple[str, ...]:
    """C compiler arguments of batched kernels; they make FFCx's cache depend on its backend."""
    text = files("flexfem.kernels").joinpath("ffcx_backend.py").read_bytes()
    revision = hashlib.blake2b(text, digest_size=4).hexdigest()
    return "-fopenmp-simd", f"-DFLEXFEM_LANES={LANES}", f"-DFLEXFEM_BATCH=0x{revision}"


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
        coefficients: coefficients in the order of the offsets.
        batched: True if one call evaluates ``LANES`` cells. The data of lane l of entry k of the
            coefficients and of the tensor are at ``k LANES + l``; constants and coordinates are
            common to all.
    """
    compiled = cell_form(comm, form, batched=batched)
    ufcx, own = compiled.ufcx_form, form.coefficients()
    offsets = np.full(len(coefficients) + 1, -1, dtype=np.int64)
    total = 0
    for k in range(ufcx.num_coefficients):
        coefficient = own[ufcx.original_coefficient_positions[k]]
        offsets[coefficients.index(coefficient)] = total
        total += coefficient.ufl_element().dim
    offsets[-1] = total
    return kernel_at(compiled.module, ufcx, offsets, batched=batched)


def kernel_at(module: Any, ufcx: Any, offsets: npt.NDArray[np.int64], *, batched: bool) -> Kernel:
    """The kernel of the single cell integral of a compiled form.

    Args:
        module: module of the compiled code.
        ufcx: the form in it.
        offsets: see :class:`Kernel`.
        batched: see :func:`compile_kernel`.
    """
    kernel = ufcx.form_integrals[0].tabulate_tensor_float64
    address = int(module.ffi.cast("uintptr_t", kernel))
    return Kernel(address, offsets, module, LANES if batched else 1)


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
        data = [
            context.make_array(kind)(context, builder, value).data
            for kind, value in zip(sig.args[1:], arguments[1:], strict=True)
        ]
        builder.call(pointer, [*data, integer(None), byte(None), byte(None)])
        return context.get_dummy_value()

    return signature, codegen
