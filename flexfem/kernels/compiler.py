# SPDX-License-Identifier: LGPL-3.0-or-later
"""Numba's compiler with less to do for loops that call one another.

Two thirds of the package's compiled functions are subroutines: other loops call them, and Python
does not. Numba would translate each of them to machine code and make it callable from Python,
although every loop that calls it contains a copy which is translated with the loop. Of them LLVM's
intermediate code is all that is made and kept; it is optimised, since loops are slower by half
otherwise. That of loops is kept beside their machine code, for other loops, and read when one is
compiled. Compiling for the first run of a mechanism takes a fifth less time, and later runs start
a tenth of a second or two earlier.
"""

import pickle
from collections.abc import Callable
from typing import Any, NoReturn, Self, override

import llvmlite.binding as llvm
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, Flags, compile_result

__all__ = ["LoopCompiler", "SubroutineCompiler"]

#: Errors of files that name classes which are gone, or that end early.
_UNREADABLE = (
    AttributeError, EOFError, ImportError, IndexError, KeyError, TypeError, ValueError,
    pickle.UnpicklingError,
)  # fmt: skip


class _Flags(Flags):
    """Numba's flags, whose hash tells them apart: its own is the same for all of them.

    They are part of the key of every function of NumPy that a loop calls.
    """

    __slots__ = ()

    @property
    def _key(self) -> tuple[object, ...]:
        return tuple([self._values.get(name, default) for name, default in _DEFAULTS])

    @override
    def __hash__(self) -> int:
        return hash(tuple([value for value in self._key if isinstance(value, bool)]))

    @override
    def __eq__(self, other: object) -> bool:
        if isinstance(other, _Flags):
            return self._key == other._key
        return bool(super().__eq__(other))


_DEFAULTS = [(name, option.default) for name, option in Flags.options.items()]


class _LoopLibrary(JITCodeLibrary):
    """Machine code, and intermediate code that is read when another loop needs it."""

    def __init__(self, codegen: Any, name: str) -> None:
        """Nothing is compiled yet."""
        super().__init__(codegen, name)
        self._bitcode: bytes | None = None
        self.enable_object_caching()

    @classmethod
    def restored(cls, codegen: Any, kept: tuple[str, bytes, bytes], entry: str) -> Self:
        """The library of what :meth:`kept` has returned.

        Args:
            codegen: numba's code generator.
            kept: name, machine code and intermediate code.
            entry: name of the function that Python calls.
        """
        name, machine_code, bitcode = kept
        library = cls(codegen, name)
        library._set_compiled_object(machine_code)
        library._bitcode = bitcode
        library._finalize_final_module()
        codegen._engine._defined_symbols.add(entry)
        return library

    def kept(self) -> tuple[str, bytes, bytes]:
        """Its name, and its code for a file."""
        return self.name, self._get_compiled_object(), self._get_module_for_linking().as_bitcode()

    @override
    def _get_module_for_linking(self) -> Any:
        if self._bitcode is not None:
            self._shared_module, self._bitcode = llvm.parse_bitcode(self._bitcode), None
        return super()._get_module_for_linking()


class _SubroutineLibrary(JITCodeLibrary):
    """Intermediate code alone."""

    @classmethod
    def restored(cls, codegen: Any, kept: tuple[str, bytes]) -> Self:
        """The library of what :meth:`kept` has returned."""
        name, bitcode = kept
        library = cls(codegen, name)
        library._final_module = llvm.parse_bitcode(bitcode)
        library._finalize_final_module()
        return library

    def kept(self) -> tuple[str, bytes]:
        """Its name, and its code for a file."""
        return self.name, self._get_module_for_linking().as_bitcode()

    @override
    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


class _CacheImpl(CompileResultCacheImpl):
    """Files beside those of numba, which hold something else."""

    @override
    def get_filename_base(self, fullname: str, abiflags: str) -> str:
        return f"{super().get_filename_base(fullname, abiflags)}.flexfem"


class _LoopCacheImpl(_CacheImpl):
    """Serialisation of a compiled loop for the cache on disk."""

    @override
    def reduce(self, result: Any) -> tuple[Any, ...]:
        environments = tuple(result._find_referenced_environments())
        return *_reduced(result), environments

    @override
    def rebuild(self, target_context: Any, payload: tuple[Any, ...]) -> Any:
        kept, fndesc, environment, signature, environments = payload
        entry = fndesc.llvm_cpython_wrapper_name
        library = _LoopLibrary.restored(target_context.codegen(), kept, entry)
        executable = target_context.get_executable(library, fndesc, environment)
        result = _restored(target_context, library, executable, fndesc, environment, signature)
        _set_environments(result, environments)
        return result


class _Files(IndexDataCacheFile):
    """Files of one function; what cannot be read any more is compiled anew.

    Types of arguments are kept by the names of their classes, which another version of the package
    may not have.
    """

    @override
    def _load_index(self) -> dict[Any, str]:
        try:
            return dict(super()._load_index())
        except _UNREADABLE:
            return {}

    @override
    def load(self, key: Any) -> Any:
        try:
            return super().load(key)
        except _UNREADABLE:
            return None


class _Cache(FunctionCache):
    """Functions on disk."""

    _impl_class: Any

    def __init__(self, py_func: Any) -> None:
        super().__init__(py_func)
        implementation: Any = self._impl
        self._cache_file = _Files(
            self.cache_path, implementation.filename_base, self._cache_file._source_stamp
        )


class _LoopCache(_Cache):
    """Loops on disk."""

    _impl_class = _LoopCacheImpl


class _SubroutineCacheImpl(_CacheImpl):
    """Serialisation of a compiled subroutine for the cache on disk."""

    @override
    def reduce(self, result: Any) -> tuple[Any, ...]:
        return _reduced(result)

    @override
    def rebuild(self, target_context: Any, payload: tuple[Any, ...]) -> Any:
        kept, fndesc, environment, signature = payload
        library = _SubroutineLibrary.restored(target_context.codegen(), kept)
        entry = _entry(fndesc.qualname)
        return _restored(target_context, library, entry, fndesc, environment, signature)


class _SubroutineCache(_Cache):
    """Subroutines on disk."""

    _impl_class = _SubroutineCacheImpl


class LoopCompiler(Compiler):
    """Numba's steps, with the environments of the subroutines that a loop contains."""

    def __init__(self, *args: Any) -> None:
        """Replace the flags and the library."""
        super().__init__(*args)
        state = self.state
        state.flags = _Flags(state.flags)
        state.library = _LoopLibrary(state.targetctx.codegen(), "loop")

    @staticmethod
    def keep(loop: Any) -> None:
        """Let a loop, given by numba's dispatcher, be kept on disk."""
        loop._cache = _LoopCache(loop.py_func)

    @override
    def _compile_bytecode(self) -> Any:
        result = super()._compile_bytecode()
        _set_environments(result, result._find_referenced_environments())
        return result


class SubroutineCompiler(Compiler):
    """Numba's steps up to the intermediate code."""

    def __init__(self, *args: Any) -> None:
        """Replace the flags and the library, and ask for nothing that Python could call."""
        super().__init__(*args)
        state = self.state
        state.flags = _Flags(state.flags)
        state.flags.no_compile = state.flags.no_cpython_wrapper = True
        state.library = _SubroutineLibrary(state.targetctx.codegen(), "subroutine")

    @staticmethod
    def keep(loop: Any) -> None:
        """Let a subroutine be kept on disk, and calls from Python end with an error."""

        def enter(result: Any) -> None:
            loop.overloads[tuple(result.signature.args)] = result  # and not for calls from Python

        loop._cache = _SubroutineCache(loop.py_func)
        loop.add_overload, loop._compile_for_args = enter, _entry(loop.py_func.__qualname__)

    @override
    def _compile_bytecode(self) -> Any:
        result = super()._compile_bytecode()
        result = result._replace(entry_point=_entry(result.fndesc.qualname))
        result.target_context.insert_user_function(
            result.entry_point, result.fndesc, [result.library]
        )
        return result


def _entry(name: str) -> Callable[..., NoReturn]:
    """In place of machine code: numba finds the subroutine by this object."""

    def refuse(*args: object) -> NoReturn:
        raise TypeError(f"{name} is a part of compiled loops: only they can call it")

    return refuse


def _set_environments(result: Any, environments: Any) -> None:
    """Let machine code know the constants of all functions in it."""
    for environment in environments:
        result.codegen.set_env(environment.env_name, environment)


def _reduced(result: Any) -> tuple[Any, ...]:
    """Code, description, constants and signature of a compiled function."""
    result.fndesc.typemap = result.fndesc.calltypes = None  # large, and of no use later
    return result.library.kept(), result.fndesc, result.environment, result.signature


def _restored(
    target_context: Any, library: Any, entry: Any, fndesc: Any, environment: Any, signature: Any
) -> Any:
    """The compiled function."""
    return compile_result(
        target_context=target_context,
        typing_context=target_context.typing_context,
        library=library,
        environment=environment,
        entry_point=entry,
        fndesc=fndesc,
        signature=signature,
        objectmode=False,
        lifted=(),
    )
