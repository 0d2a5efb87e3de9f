# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sequences of compiled loops with fixed arguments, which run by one call from Python.

A step of a small model is hundreds of calls from Python, which take longer than the loops that they
call: 0.2 us for each loop, and as much again for each function in Python between two of them. The
loops work on arrays that stay where they are, so that their arguments are the same in every step::

    weigh = Number()
    run = sequence([Call(clear, residual), Call(add_inertia, nodes, masses, weigh), exchange])
    weigh.set(0.5)
    run()

A :class:`Call` writes the function and its arguments into a row of machine words. For each list of
types of arguments there is a small function that reads such a row and calls a loop by its address;
a sequence is a table of these functions and rows. The loops are those that Python calls, with the
same results. Functions of Python between them, such as messages to other ranks, divide a sequence.
"""

from collections.abc import Callable, Iterable, Sequence
from functools import cache
from typing import Any

import llvmlite.binding as llvm
import numpy as np
import numpy.typing as npt
from llvmlite import ir
from numba import typeof
from numba.core import types
from numba.core.dispatcher import Dispatcher
from numba.core.registry import cpu_target
from numba.extending import intrinsic

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.kernels.compiled import kernel

__all__ = [
    "Call",
    "Check",
    "ForeignCall",
    "Number",
    "Step",
    "all_true",
    "clear",
    "copy",
    "in_one_array",
    "largest_entry",
    "sequence",
]

_Results = npt.NDArray[Any]
_WORD = ir.IntType(64)
#: What numba's functions return besides 0 where nothing is wrong: that they return no value.
_NONE = -2
#: Where they store errors, which are raised by another call from Python.
_ERROR = np.zeros(1, dtype=np.int64)
#: Most numbers that a loop returns.
_MOST = 3
#: Results of loops in memory.
_RESULTS = {types.none: np.int64, types.float64: np.float64, types.boolean: np.bool_}


class Number:
    """A number that is an argument of calls and may be another one in the next run."""

    def __init__(self, value: float = 0.0) -> None:
        """Store the number."""
        self.value = value
        self._places: list[FloatArray] = []

    def set(self, value: float) -> None:
        """Change it in all calls."""
        if value != self.value:
            self.value = value
            for place in self._places:
                place[0] = value

    def written_to(self, place: FloatArray) -> None:
        """Keep a word (1,) of a call up to date."""
        place[0] = self.value
        self._places.append(place)


class Call:
    """A loop with its arguments: contiguous arrays, numbers, and :class:`Number`.

    Attributes:
        result: (k,) what it returned when it ran last.
    """

    def __init__(self, loop: Callable[..., object], *arguments: Any) -> None:
        """Compile the loop for these arguments and write them down.

        Raises:
            TypeError: an array is not contiguous.
        """
        self.loop, self.arguments = loop, arguments
        plain = [x.value if isinstance(x, Number) else x for x in arguments]
        function, self.address, self.result = _compiled(loop, plain)
        # what the loop returns, and the place of an error
        words = [np.array([function, self.result.ctypes.data, _ERROR.ctypes.data])]
        words += [_words(x) for x in plain]
        self.words: IntArray = np.concatenate(words)
        starts = np.cumsum([len(one) for one in words]).tolist()
        for number, at in zip(arguments, starts, strict=False):
            if isinstance(number, Number):
                number.written_to(self.words[at : at + 1].view(np.float64))

    def write_to(self, result: _Results) -> None:
        """Write what it returns to another array (k,) of the same type from now on."""
        self.result = result
        self.words[1] = result.ctypes.data

    def __call__(self) -> None:
        """Run it alone, from Python."""
        found = self.loop(*(x.value if isinstance(x, Number) else x for x in self.arguments))
        if found is not None:
            self.result[:] = found


class Check(Call):
    """A loop that returns True if all is well, and what is done otherwise after its sequence."""

    def __init__(
        self, otherwise: Callable[[], None], loop: Callable[..., bool], *arguments: Any
    ) -> None:
        """Store ``otherwise``, and see :class:`Call`."""
        super().__init__(loop, *arguments)
        self.otherwise = otherwise

    def __call__(self) -> None:
        """Run it alone, from Python."""
        super().__call__()
        if not self.result[0]:
            self.otherwise()


def in_one_array(calls: Sequence[Call]) -> _Results:
    """Results (k,) of loops that return one number each, in one array from now on."""
    results: _Results = np.array([call.result[0] for call in calls])
    for k, call in enumerate(calls):
        call.write_to(results[k : k + 1])
    return results


class ForeignCall:
    """A function of a library in C, of pointers, which returns 0.

    ``alone`` does the same from Python, and raises an error where that fails.
    """

    def __init__(self, function: int, pointers: Iterable[int], alone: Callable[[], None]) -> None:
        """Write down its address and its arguments."""
        self.words: IntArray = np.array([function, *pointers], dtype=np.int64)
        compiled = isinstance(_run, Dispatcher)  # not with NUMBA_DISABLE_JIT
        self.address = _foreign_caller(len(self.words) - 1) if compiled else 0
        self._alone = alone

    def __call__(self) -> None:
        """Run it alone, from Python."""
        self._alone()


#: What a sequence consists of.
Step = Call | ForeignCall | Callable[[], None]


class _Table:
    """Calls that follow one another."""

    def __init__(self, calls: list[Call | ForeignCall]) -> None:
        self._calls = calls
        self._checks = [one for one in calls if isinstance(one, Check)]
        self._table = np.array([(one.address, one.words.ctypes.data) for one in calls])

    def __call__(self) -> None:
        failed = _run(self._table)
        if failed >= 0:
            self._calls[failed]()  # which raises its error
            raise RuntimeError(f"{self._calls[failed]} failed in a sequence alone")
        for check in self._checks:
            if not check.result[0]:
                check.otherwise()


def sequence(steps: Iterable[Step]) -> Callable[[], None]:
    """A function that takes these steps, one after the other."""
    parts: list[Callable[[], None]] = []
    calls: list[Call | ForeignCall] = []
    for step in steps:
        if isinstance(step, Call | ForeignCall) and step.address:
            calls.append(step)
            continue
        if calls:
            parts.append(_Table(calls))
        parts.append(step)
        calls = []
    if calls:
        parts.append(_Table(calls))
    if len(parts) == 1:
        return parts[0]

    def run() -> None:
        for part in parts:
            part()

    return run


@kernel
def clear(x: FloatArray) -> None:
    """Set the rows of an array to zero."""
    for i in range(x.shape[0]):
        for j in range(x.shape[1]):
            x[i, j] = 0.0


@kernel
def copy(source: FloatArray, target: FloatArray) -> None:
    """Copy the rows of an array."""
    for i in range(source.shape[0]):
        for j in range(source.shape[1]):
            target[i, j] = source[i, j]


@kernel
def largest_entry(x: FloatArray) -> float:
    """Largest absolute value, 0 for an empty array; NaN is preserved."""
    largest = 0.0
    for value in x:
        size = abs(value)
        if size > largest or size != size:
            largest = size
    return largest


@kernel
def all_true(x: BoolArray) -> bool:
    """True if all entries are."""
    found = True
    for one in x:
        found = found and one
    return found


def _words(x: Any) -> IntArray:
    """Machine words of an argument, as numba passes an array, or of a number."""
    if isinstance(x, np.ndarray):
        if not x.flags.c_contiguous:
            raise TypeError("arrays of a sequence must be contiguous")
        return np.array([0, 0, x.size, x.itemsize, x.ctypes.data, *x.shape, *x.strides])
    if isinstance(x, float):
        return np.array([x]).view(np.int64)
    return np.array([int(x)])


@intrinsic
def _call(typingctx, address, words):  # type: ignore
    """Call the function at an address with the address of its words."""

    def codegen(context, builder, sig, arguments):  # type: ignore
        function = ir.FunctionType(_WORD, [_WORD]).as_pointer()
        return builder.call(builder.inttoptr(arguments[0], function), [arguments[1]])

    return types.int64(types.int64, types.int64), codegen


@kernel
def _run(table: IntArray) -> int:
    """Call functions (k, 2) by their words; number of the first one that fails, or -1."""
    for k in range(table.shape[0]):
        if _call(table[k, 0], table[k, 1]) != 0:  # type: ignore[call-arg]
            return k
    return -1


def _compiled(loop: Any, arguments: list[Any]) -> tuple[int, int, Any]:
    """Addresses of a loop and of the function that calls it, and an array for its results."""
    kinds = tuple([types.unliteral(typeof(x)) for x in arguments])
    if not isinstance(loop, Dispatcher):  # with NUMBA_DISABLE_JIT
        return 0, 0, np.zeros(_MOST)
    compiled: Any = loop.overloads.get(kinds)
    if compiled is None:
        loop.compile(kinds)
        compiled = loop.overloads[kinds]
    returned = compiled.signature.return_type
    count, one = getattr(returned, "count", 1), getattr(returned, "dtype", returned)
    result = np.zeros(count, dtype=_RESULTS[one])
    function = compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name)
    return int(function), _caller(returned, kinds), result


#: Compiled functions that read words: their code must not be freed.
_ENGINES: list[Any] = []


def _finished(kind: Any, first: int, *, foreign: bool) -> int:
    """Address of a function that calls functions of an LLVM type by the address of their words.

    The address of the called function is the word before the ``first`` argument. Such a function
    fails if it returns another number than those of numba's calls that have succeeded.
    """
    module = ir.Module()
    name = f"flexfem.call.{len(_ENGINES)}"
    function = ir.Function(module, ir.FunctionType(_WORD, [_WORD]), name)
    builder = ir.IRBuilder(function.append_basic_block())
    words = builder.inttoptr(function.args[0], _WORD.as_pointer())

    def word(k: int) -> Any:
        return builder.load(builder.gep(words, [_WORD(k)]))

    def argument(k: int, to: Any) -> Any:
        if isinstance(to, ir.PointerType):
            return builder.inttoptr(word(k), to)
        if isinstance(to, ir.DoubleType):
            return builder.bitcast(word(k), to)
        return word(k) if to == _WORD else builder.trunc(word(k), to)

    pointer = builder.inttoptr(word(first - 1), kind.as_pointer())
    code = builder.call(pointer, [argument(first + k, to) for k, to in enumerate(kind.args)])
    failed = builder.icmp_signed("!=", code, code.type(0))
    if not foreign:
        other = builder.icmp_signed("!=", code, code.type(_NONE))
        failed = builder.and_(failed, other)
    builder.ret(builder.zext(failed, _WORD))
    machine = llvm.Target.from_default_triple().create_target_machine(opt=1, jit=True)
    module.triple, module.data_layout = machine.triple, str(machine.target_data)
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(str(module)), machine)
    engine.finalize_object()
    _ENGINES.append(engine)
    return int(engine.get_function_address(name))


@cache
def _caller(returned: Any, kinds: tuple[Any, ...]) -> int:
    """Address of the function that calls a loop of these types by the address of its words."""
    convention = cpu_target.target_context.call_conv
    return _finished(convention.get_function_type(returned, kinds), 1, foreign=False)


@cache
def _foreign_caller(count: int) -> int:
    """Address of the function that calls a function in C of so many pointers."""
    kind = ir.FunctionType(ir.IntType(32), count * [ir.IntType(8).as_pointer()])
    return _finished(kind, 1, foreign=True)
