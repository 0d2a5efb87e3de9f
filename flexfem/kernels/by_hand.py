# SPDX-License-Identifier: LGPL-3.0-or-later
"""Hand-written cell kernels: functions that the driver calls by address like those of FFCx.

::

    @by_hand
    def spring(
        tensor: FloatArray, coefficients: FloatArray, constants: FloatArray, coordinates: FloatArray
    ) -> None:
        tensor[0] += coefficients[0] * (constants[0] - coordinates[0])

    kernel = cell_kernel(spring.kernel([1]), 1, ["stiffness"], {}, {"stiffness": (0, 1)})

The four arrays have one axis and no meaningful length: the function knows their sizes. It adds to
``tensor`` and reads the others; its work space is a block of coefficients after those with data.
:func:`shaped` makes arrays with more axes of parts of them.
"""

from collections.abc import Callable, Sequence
from itertools import accumulate
from types import FunctionType
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.imputils import lower_constant
from numba.extending import intrinsic, models, register_model, typeof_impl
from numba.np.arrayobj import make_array, populate_array

from flexfem._types import FloatArray
from flexfem.kernels.compiled import inlined, inlined_fused, kernel
from flexfem.kernels.ffcx import Kernel
from flexfem.kernels.lanes import LANES

__all__ = ["ByHand", "batched_by_hand", "by_hand", "shaped"]

type _CellFunction = Callable[[FloatArray, FloatArray, FloatArray, FloatArray], None]

_ARRAY = types.Array(types.float64, 1, "C")
_ARGUMENTS = (_ARRAY,) * 4


class ByHand:
    """A hand-written kernel, compiled when its address is first requested.

    Attributes:
        part: the function, as a part of compiled loops.
        lanes: number of cells that one call evaluates.
        address: loop that returns the address of the kernel.
    """

    def __init__(self, function: _CellFunction, inline: Any, lanes: int) -> None:
        """Store the function without compiling it.

        Args:
            function: of tensor, coefficients, constants and coordinates.
            inline: decorator of parts of compiled loops.
            lanes: see above.

        Raises:
            TypeError: The function is defined inside another one: the entry on disk would be shared
                by all functions defined there.
        """
        if "<locals>" in function.__qualname__:
            raise TypeError(f"{function.__qualname__} is not a function of a module")
        self.part, self.lanes = inline(function), lanes

        def address() -> int:
            return _address_of(by_hand)  # type: ignore[call-arg]

        # The loop with the address is cached on disk as one of the function's own file, so that
        # it is recompiled when this changes; closures would be distinguished by process.
        code = address.__code__.replace(
            co_filename=function.__code__.co_filename,
            co_firstlineno=function.__code__.co_firstlineno,
        )
        names = {"__name__": function.__module__, "_address_of": _address_of, "by_hand": self}
        loop = FunctionType(code, names, "address")
        loop.__module__, loop.__qualname__ = function.__module__, f"{function.__qualname__}.address"
        self.address = kernel(loop)

    def kernel(self, sizes: Sequence[int]) -> Kernel:
        """The kernel, in the format of ``compile_kernel`` for forms.

        Args:
            sizes: of its coefficients in the order in which it expects them, zero for those that
                this kernel does not use.
        """
        ends = np.array([0, *accumulate(sizes)], dtype=np.int64)
        offsets = np.where(np.array([*sizes, 1]) > 0, ends, -1)
        return Kernel(self.address(), offsets, self, self.lanes)


def by_hand(function: _CellFunction) -> ByHand:
    """Decorator of kernels of one cell; see the module."""
    return ByHand(function, inlined, 1)


def batched_by_hand(function: _CellFunction) -> ByHand:
    """The same for ``LANES`` cells at once, for functions that use ``kernels.vectors``.

    Products and sums are fused to one operation each.
    """
    return ByHand(function, inlined_fused, LANES)


class _KernelType(types.Opaque):
    """Numba's type of one kernel."""

    def __init__(self, kernel: ByHand) -> None:
        self.kernel = kernel
        function = kernel.part.py_func
        super().__init__(f"ByHand[{function.__module__}.{function.__qualname__}]")

    @property
    def key(self) -> ByHand:
        """Key that distinguishes types: numba's own, the name, may be that of two functions."""
        return self.kernel


register_model(_KernelType)(models.OpaqueModel)


@typeof_impl.register(ByHand)
def _type_of(value: ByHand, context: Any) -> _KernelType:
    return _KernelType(value)


@lower_constant(_KernelType)
def _constant(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    return context.get_dummy_value()


@intrinsic
def _address_of(typingctx, kind):  # type: ignore
    """Address of a function with FFCx's signature that calls that of a kernel."""
    part = kind.kernel.part
    part.compile(_ARGUMENTS)

    def codegen(context, builder, sig, arguments):  # type: ignore
        compiled = part.overloads[_ARGUMENTS]
        context.add_linking_libs((compiled.library,))
        double = ir.DoubleType().as_pointer()
        other = ir.IntType(8).as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [double] * 4 + [other] * 3)
        wrapper = ir.Function(builder.module, kind, f"{compiled.fndesc.mangled_name}.tabulate")
        wrapper.linkage = "internal"
        inner = ir.IRBuilder(wrapper.append_basic_block())
        longest = [context.get_constant(types.intp, 2**40)]  # the length is not known
        arrays = [_array(context, inner, pointer, longest) for pointer in wrapper.args[:4]]
        status, _ = context.call_internal_no_propagate(
            inner, compiled.fndesc, compiled.signature, arrays
        )
        with inner.if_then(status.is_error, likely=False):  # numba would not report it
            inner.store(ir.Constant(ir.DoubleType(), float("nan")), wrapper.args[0])
        inner.ret_void()
        return builder.ptrtoint(wrapper, ir.IntType(64))

    return types.int64(kind), codegen


@intrinsic
def _shaped(typingctx, array, first, shape):  # type: ignore
    axes = len(shape)

    def codegen(context, builder, sig, arguments):  # type: ignore
        values, at, extents = arguments
        width = ir.Constant(at.type, LANES)
        data = make_array(sig.args[0])(context, builder, values).data
        lengths = cgutils.unpack_tuple(builder, extents, axes)
        return _array(
            context, builder, builder.gep(data, [builder.mul(at, width)]), [*lengths, width]
        )

    kind = types.Array(types.float64, axes + 1, "C")
    return kind(array, types.intp, types.UniTuple(types.intp, axes)), codegen


@inlined
def shaped(array: FloatArray, first: int, shape: tuple[int, ...]) -> FloatArray:
    """Entries of all lanes from ``first`` on, as an array (shape, LANES) on the same memory."""
    part: FloatArray = _shaped(array, first, shape)  # type: ignore[call-arg]
    return part


def _array(context: Any, builder: Any, pointer: Any, shape: Sequence[Any]) -> Any:
    """An array of a shape at a pointer."""
    array = make_array(types.Array(types.float64, len(shape), "C"))(context, builder)
    size = context.get_constant(types.intp, 8)
    strides = [size]
    for extent in reversed(shape[1:]):
        strides.insert(0, builder.mul(strides[0], extent))
    populate_array(
        array, data=pointer, shape=shape, strides=strides, itemsize=size, meminfo=None
    )  # fmt: skip
    return array._getvalue()
