# SPDX-License-Identifier: LGPL-3.0-or-later
"""Functions that are compiled when a loop first calls them.

Loops serve all kinds of lines and rows, of which a model has a few. The code of one kind is a
separate function, which a loop calls by address. The loop requests the address at the first call by
calling back into Python, where the function is compiled or loaded. Each loop stores the addresses
that it has received.
"""

import ctypes
import hashlib
from collections.abc import Iterable
from importlib import import_module
from typing import Any, NamedTuple

import llvmlite.binding as llvm
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.registry import cpu_target
from numba.core.typing import make_concrete_template, signature

__all__ = ["HERE_ALONE", "Demand", "call_on_demand", "demanded", "demands_of"]

#: Name of a variable in code with an address that is valid in this process only: numba writes no
#: function with such a variable to disk. The files of ``compiler`` list the other functions to be
#: loaded.
HERE_ALONE = "numba.dynamic.globals.flexfem"

#: Prefix of the names that loops call for an address.
_PREFIX = "flexfem.address."
_POINTER = ir.IntType(8).as_pointer()


class Demand(NamedTuple):
    """A function that is compiled on demand.

    Attributes:
        module: its module.
        function: its name.
        kinds: types of its arguments.
    """

    module: str
    function: str
    kinds: tuple[Any, ...]


class _OnDemand:
    """A function for arguments of certain types.

    Attributes:
        demand: the function.
        symbol: name of the function that returns its address, or null if it cannot be compiled.
    """

    def __init__(self, loop: Any, demand: Demand) -> None:
        """Register it with numba and the linker."""
        text = f"{demand.module}.{demand.function} {demand.kinds}"
        self.demand, self._loop = demand, loop
        self.symbol = _PREFIX + hashlib.blake2b(text.encode(), digest_size=16).hexdigest()
        self._callback = ctypes.CFUNCTYPE(ctypes.c_void_p)(self._address)
        address = ctypes.cast(self._callback, ctypes.c_void_p).value
        llvm.add_symbol(self.symbol, address)
        cpu_target.target_context.insert_func_defn([(self._call, self, demand.kinds)])

    def _address(self) -> int:
        """Compile or load it; an error is printed, and the loop gets null."""
        self._loop.compile(self.demand.kinds)
        result = self._loop.overloads[self.demand.kinds]
        if result.signature.return_type != types.none:
            raise TypeError(f"{self.demand.function} is called on demand: it can return nothing")
        return int(result.library.get_pointer_to_function(result.fndesc.llvm_func_name))

    def _call(self, context: Any, builder: Any, called: Any, arguments: Any) -> Any:
        """Code that calls it."""
        module, convention = builder.module, context.call_conv
        kind = convention.get_function_type(types.none, self.demand.kinds)
        name = f"{self.symbol}.kept"
        kept = module.globals.get(name)
        if kept is None:
            if HERE_ALONE not in module.globals:
                mark = ir.GlobalVariable(module, ir.IntType(8), HERE_ALONE)
                mark.linkage, mark.initializer = "weak", ir.IntType(8)(0)
            kept = ir.GlobalVariable(module, _POINTER, name)
            kept.linkage, kept.initializer = "internal", _POINTER(None)
        with cgutils.if_unlikely(builder, cgutils.is_null(builder, builder.load(kept))):
            ask = cgutils.get_or_insert_function(module, ir.FunctionType(_POINTER, []), self.symbol)
            found = builder.call(ask, [])
            with cgutils.if_unlikely(builder, cgutils.is_null(builder, found)):
                message = f"{self.demand.function} cannot be compiled; the reason is above"
                convention.return_user_exc(builder, RuntimeError, (message,))
            builder.store(found, kept)
        function = builder.bitcast(builder.load(kept), kind.as_pointer())
        status, _ = convention.call_function(
            builder, function, types.none, self.demand.kinds, arguments
        )
        with cgutils.if_unlikely(builder, status.is_error):
            convention.return_status_propagate(builder, status)
        return context.get_dummy_value()


#: All of them in this process: loaded loops may request any of them at any time.
_KNOWN: dict[Demand, _OnDemand] = {}
_BY_SYMBOL: dict[str, _OnDemand] = {}


def _known(loop: Any, kinds: tuple[Any, ...]) -> _OnDemand:
    """The function for arguments of certain types."""
    demand = Demand(loop.py_func.__module__, loop.py_func.__qualname__, kinds)
    found = _KNOWN.get(demand)
    if found is None:
        found = _KNOWN[demand] = _OnDemand(loop, demand)
        _BY_SYMBOL[found.symbol] = found
    return found


def call_on_demand(loop: Any) -> None:
    """Make a loop callable on demand by other loops.

    Args:
        loop: numba's dispatcher of a subroutine that returns nothing.
    """

    def template(args: Any, kws: Any) -> Any:
        signature_of_python, kinds = loop._compiler.fold_argument_types(args, kws)
        kinds = tuple(types.unliteral(kind) for kind in kinds)
        _known(loop, kinds)
        called = make_concrete_template(
            loop.py_func.__name__, loop.py_func.__name__, [signature(types.none, *kinds)]
        )
        return called, signature_of_python, kinds, {}

    loop.get_call_template = template
    loop.get_overload = lambda kinds: _known(loop, tuple(kinds))


def demands_of(module: Any) -> tuple[Demand, ...]:
    """Functions whose addresses an LLVM module requests."""
    return tuple(
        _BY_SYMBOL[function.name].demand
        for function in module.functions
        if function.is_declaration and function.name.startswith(_PREFIX)
    )


def demanded(demands: Iterable[Demand]) -> None:
    """Register these functions before code from a file that calls them is loaded."""
    for demand in demands:
        _known(getattr(import_module(demand.module), demand.function), demand.kinds)
