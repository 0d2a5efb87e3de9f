# SPDX-License-Identifier: LGPL-3.0-or-later
"""Decorators of all compiled loops of the package."""

from collections.abc import Callable
from inspect import signature
from typing import Any

from numba import njit
from numba.core import types
from numba.core.dispatcher import Dispatcher

from flexfem.kernels.caching import install
from flexfem.kernels.compile_once import compile_once
from flexfem.kernels.compiler import AddressCompiler, LoopCompiler, SubroutineCompiler
from flexfem.kernels.on_demand import call_on_demand

__all__ = [
    "fused",
    "fused_subroutine",
    "inlined",
    "inlined_fused",
    "kernel",
    "on_demand",
    "subroutine",
    "summed",
]

install()


class _Decorator:
    """Decorator that compiles a loop once for all constants of its callers, without C callbacks.

    Numba's own would compile a function once for every constant argument, without benefit: if the
    function is inlined, the constant is propagated anyway.
    """

    def __init__(
        self, compiler: type[LoopCompiler | SubroutineCompiler] = LoopCompiler, **options: Any
    ) -> None:
        """Store compiler and options.

        Args:
            compiler: that of subroutines for functions that only other loops call.
            options: options of numba.
        """
        options |= {"error_model": "numpy", "no_cfunc_wrapper": True}
        self._compiler = compiler
        self._decorate: Any = njit(**options, pipeline_class=compiler)

    def __call__[Loop: Callable[..., object]](self, function: Loop) -> "Dispatcher[Loop]":
        """The compiled function."""
        function.__signature__ = signature(function)  # type: ignore[attr-defined]  # numba asks twice
        loop = self._decorate(function)
        if isinstance(loop, Dispatcher):  # not with NUMBA_DISABLE_JIT
            template = loop.get_call_template

            def without_constants(args: Any, kws: Any) -> Any:
                named = {name: types.unliteral(kind) for name, kind in kws.items()}
                return template(tuple(types.unliteral(kind) for kind in args), named)

            loop.get_call_template = without_constants  # type: ignore[method-assign]
            self._compiler.keep(loop)
            compile_once(loop)
        compiled: Dispatcher[Loop] = loop
        return compiled


#: cached on disk; division by zero gives inf or NaN as in NumPy, and no test in the loop
kernel = _Decorator()

#: For functions called by other loops and not by Python: see ``flexfem.kernels.compiler``.
subroutine = _Decorator(SubroutineCompiler)

#: Parts that are always inlined, since a call with array arguments costs more than the arithmetic
#: of most of them.
inlined = _Decorator(SubroutineCompiler, forceinline=True)

#: The same with products and sums fused to one operation each, for loops of arithmetic alone.
fused = _Decorator(fastmath={"contract"})

#: The same with sums in any order, which become vectors: for loops that wait for their sums.
summed = _Decorator(fastmath={"contract", "reassoc"})

#: Subroutines of those with products and sums fused.
fused_subroutine = _Decorator(SubroutineCompiler, fastmath={"contract"})

#: Always inlined parts of those.
inlined_fused = _Decorator(SubroutineCompiler, fastmath={"contract"}, forceinline=True)

_by_address = _Decorator(AddressCompiler)


def on_demand[**Arguments](
    function: Callable[Arguments, None],
) -> "Dispatcher[Callable[Arguments, None]]":
    """A subroutine without result that is compiled when it is first called.

    It is for functions that only some models need: see ``flexfem.kernels.on_demand``.
    """
    loop = _by_address(function)
    if isinstance(loop, Dispatcher):
        call_on_demand(loop)
    return loop
