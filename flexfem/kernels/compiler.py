# SPDX-License-Identifier: LGPL-3.0-or-later
"""Numba's compiler with less work for loops that call one another.

Two thirds of the package's compiled functions are subroutines, called by other loops and not by
Python. Numba would make each of them callable from Python, and copy its code into every function
that calls it, where it is optimised and translated once more, and again in the callers of that.

Here a function is small or large. Callers of a small one contain its intermediate code, which is
optimised, since loops take half as long again otherwise; a small subroutine has no machine code. A
large function is translated once, and called: files of its callers contain its machine code. It
would not be inlined in any case, so that calls are as fast as before.
"""

import hashlib
import pickle
from collections.abc import Callable
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, NoReturn, override

import llvmlite.binding as llvm
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, Flags, compile_result
from numba.core.runtime import rtsys

from flexfem.kernels.on_demand import HERE_ALONE, Demand, demanded, demands_of

__all__ = ["AddressCompiler", "LoopCompiler", "SubroutineCompiler"]

#: Errors of files that refer to removed classes, or are truncated.
_UNREADABLE = (
    AttributeError, EOFError, ImportError, IndexError, KeyError, TypeError, ValueError,
    pickle.UnpicklingError,
)  # fmt: skip

#: Name of what files hold: those that another version of this module wrote are left alone.
_FORMAT = hashlib.blake2b(Path(__file__).read_bytes(), digest_size=4).hexdigest()
#: Instructions of a large function: LLVM would hardly inline it.
_LARGE = 100
#: Code of callers whose files do not contain their subroutines.
_MARKED = f'@"{HERE_ALONE}" = weak constant i8 0'
#: Prefixes of the functions that numba adds for calls from Python.
_WRAPPER = "_ZN7cpython"


class _Flags(Flags):
    """Numba's flags with a hash that distinguishes them: numba's is the same for all of them.

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


class _Unit(NamedTuple):
    """A large function in the files of its callers.

    Attributes:
        name: name of its library.
        entry: name of the function in its machine code.
        machine_code: an object file.
        environments: constants of the functions in it.
        demands: functions that it calls on demand.
        units: entries of the large functions that it calls, which come before it.
    """

    name: str
    entry: str
    machine_code: bytes
    environments: tuple[Any, ...]
    demands: tuple[Demand, ...]
    units: tuple[str, ...]


class _Kept(NamedTuple):
    """Code of a function in its file.

    Attributes:
        name: name of its library.
        entry: name of the function in its code.
        machine_code: an object file, of all but small subroutines.
        bitcode: intermediate code, of small functions.
        units: large functions that it calls.
        demands: functions that it calls on demand.
    """

    name: str
    entry: str
    machine_code: bytes | None
    bitcode: bytes | None
    units: tuple[_Unit, ...]
    demands: tuple[Demand, ...]


class _Library(JITCodeLibrary):
    """Code of a loop or subroutine; callers contain it if it is small.

    Attributes:
        called: True if Python calls the function.
        entry: name of the function in it, when it is complete.
        large: True if callers use its machine code.
        units: large functions that it calls, directly or by small ones, by their entries.
        environments: constants of the functions in machine code.
        demands: functions that it calls on demand.
    """

    #: Large functions whose machine code is loaded, by their entries.
    _loaded: ClassVar[dict[str, "_Library"]] = {}

    def __init__(self, codegen: Any, name: str, *, called: bool, large: bool | None = None) -> None:
        """Make an empty library.

        Args:
            codegen: numba's code generator.
            name: of the library.
            called: True if Python calls the function.
            large: True if callers use its machine code, None to decide by its size.
        """
        super().__init__(codegen, name)
        self.entry, self.large = "", bool(large)
        self.units: dict[str, _Library] = {}
        self.environments: tuple[Any, ...] = ()
        self.demands: tuple[Demand, ...] = ()
        self.called, self._by_size = called, large is None
        self._machine_code, self._bitcode = b"", b""
        self.enable_object_caching()

    @classmethod
    def restored(cls, codegen: Any, kept: _Kept, *, called: bool) -> "_Library":
        """The library from a result of :meth:`kept`."""
        if kept.entry in cls._loaded:
            return cls._loaded[kept.entry]
        library = cls(codegen, kept.name, called=called)
        library.entry, library.large = kept.entry, kept.bitcode is None
        library._bitcode = kept.bitcode or b""
        for unit in kept.units:
            library.units[unit.entry] = cls._restored_unit(codegen, unit)
        library.demands = kept.demands
        library._load(kept.machine_code)
        return library

    @classmethod
    def _restored_unit(cls, codegen: Any, unit: _Unit) -> "_Library":
        """The library of a large function."""
        library = cls._loaded.get(unit.entry)
        if library is None:
            library = cls(codegen, unit.name, called=False)
            library.entry, library.large = unit.entry, True
            library.demands = unit.demands
            library.units = {entry: cls._loaded[entry] for entry in unit.units}
            library._load(unit.machine_code)
            library.set_environments(unit.environments)
        return library

    def _load(self, machine_code: bytes | None) -> None:
        """Load the machine code if there is any."""
        demanded(self.demands)
        if machine_code is None:
            self._finalized = True
            return
        self._machine_code = machine_code
        self._set_compiled_object(machine_code)
        super()._finalize_final_module()
        self._codegen._engine._defined_symbols.add(self.entry)
        if self.large:
            self._loaded[self.entry] = self

    def kept(self) -> _Kept:
        """Its code for a file."""
        machine_code = self._object() if self.called or self.large else None
        bitcode = None if self.large else self._get_module_for_linking().as_bitcode()
        units = [
            _Unit(
                unit.name, entry, unit._object(), unit.environments, unit.demands, tuple(unit.units)
            )
            for entry, unit in self.units.items()
        ]
        return _Kept(self.name, self.entry, machine_code, bitcode, tuple(units), self.demands)

    def _object(self) -> bytes:
        """Its machine code."""
        return self._machine_code or self._get_compiled_object()

    def set_environments(self, environments: tuple[Any, ...]) -> None:
        """Link the machine code to the constants of all functions in it."""
        self.environments = environments
        codegen: Any = self._codegen
        for environment in environments:
            codegen.set_env(environment.env_name, environment)

    @override
    def _optimize_functions(self, ll_module: Any) -> None:
        """Do nothing: the passes of the module begin with the same optimisations."""
        ll_module.data_layout = self._codegen._data_layout

    @override
    def _optimize_final_module(self) -> None:
        """Optimise once: numba does it twice, for reference counts, of which loops have few."""
        manager, builder = self._codegen._module_pass_manager()
        manager.run(self._final_module, builder)

    @override
    def add_linking_library(self, library: Any) -> None:
        library._ensure_finalized()
        if isinstance(library, _Library):
            self.units |= library.units
            if library.large:
                self.units[library.entry] = library
                return
        super().add_linking_library(library)

    @override
    def _get_module_for_linking(self) -> Any:
        if self._shared_module is None and self.large:
            self._shared_module = llvm.parse_assembly(_MARKED)
        elif self._bitcode:
            self._shared_module, self._bitcode = llvm.parse_bitcode(self._bitcode), b""
        return super()._get_module_for_linking()

    @override
    def _finalize_dynamic_globals(self) -> None:
        super()._finalize_dynamic_globals()
        self._dynamic_globals = [name for name in self._dynamic_globals if name != HERE_ALONE]

    @override
    def _finalize_final_module(self) -> None:
        own = [
            function
            for function in self._final_module.functions
            if function.linkage == llvm.Linkage.external
            and not function.is_declaration
            and not function.name.startswith(_WRAPPER)
        ]
        (function,) = own
        self.entry = function.name
        if self._by_size:
            instructions = (one for block in function.blocks for one in block.instructions)
            self.large = any(True for _ in islice(instructions, _LARGE, None))
        self.demands = demands_of(self._final_module)
        if self.called or self.large:
            super()._finalize_final_module()
        else:
            if self.units:
                self._final_module.link_in(llvm.parse_assembly(_MARKED))
            self._finalize_dynamic_globals()
            self._finalized = True
        if self.large:
            self._loaded[self.entry] = self


class _CacheImpl(CompileResultCacheImpl):
    """Cache files beside those of numba, with other contents."""

    @override
    def get_filename_base(self, fullname: str, abiflags: str) -> str:
        return f"{super().get_filename_base(fullname, abiflags)}.flexfem-{_FORMAT}"


class _LoopCacheImpl(_CacheImpl):
    """Serialisation of a compiled loop for the cache on disk."""

    @override
    def reduce(self, result: Any) -> tuple[Any, ...]:
        environments = tuple(result._find_referenced_environments())
        return *_reduced(result), environments

    @override
    def rebuild(self, target_context: Any, payload: tuple[Any, ...]) -> Any:
        kept, fndesc, environment, signature, environments = payload
        library = _Library.restored(target_context.codegen(), kept, called=True)
        library._codegen._engine._defined_symbols.add(fndesc.llvm_cpython_wrapper_name)
        executable = target_context.get_executable(library, fndesc, environment)
        library.set_environments(environments)
        return _restored(target_context, library, executable, fndesc, environment, signature)


class _Files(IndexDataCacheFile):
    """Files of one function; unreadable ones are recompiled.

    Types of arguments are stored by the names of their classes, which another version of the
    package may not have.
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
    """Cache of functions on disk, which looks for its files when one is first needed.

    Most functions of the package are parts of others, and not needed once these are compiled.
    """

    _impl_class: Any

    def __init__(self, py_func: Any) -> None:  # instead of numba's, which looks for files now
        self._py_func, self._name = py_func, repr(py_func)
        self.enable()

    @cached_property
    def _impl(self) -> Any:
        return self._impl_class(self._py_func)

    @cached_property
    def _cache_path(self) -> str:
        return str(self._impl.locator.get_cache_path())

    @cached_property
    def _cache_file(self) -> _Files:  # type: ignore[override]
        stamp = self._impl.locator.get_source_stamp()
        return _Files(self._cache_path, self._impl.filename_base, stamp)

    @override
    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load a function from its file, None if it is to be compiled.

        Numba would import all that it can compile before: its compiler does that as well.
        """
        rtsys.initialize(target_context)  # memory of arrays
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)


class _LoopCache(_Cache):
    """Cache of loops on disk."""

    _impl_class = _LoopCacheImpl


class _SubroutineCacheImpl(_CacheImpl):
    """Serialisation of a compiled subroutine for the cache on disk."""

    @override
    def reduce(self, result: Any) -> tuple[Any, ...]:
        return _reduced(result)

    @override
    def rebuild(self, target_context: Any, payload: tuple[Any, ...]) -> Any:
        kept, fndesc, environment, signature = payload
        library = _Library.restored(target_context.codegen(), kept, called=False)
        entry = _entry(fndesc.qualname)
        return _restored(target_context, library, entry, fndesc, environment, signature)


class _SubroutineCache(_Cache):
    """Cache of subroutines on disk."""

    _impl_class = _SubroutineCacheImpl


class LoopCompiler(Compiler):
    """Numba's steps, with the environments of the subroutines that a loop contains."""

    def __init__(self, *args: Any) -> None:
        """Replace the flags and the library."""
        super().__init__(*args)
        state = self.state
        state.flags = _Flags(state.flags)
        state.library = _Library(state.targetctx.codegen(), "loop", called=True)

    @staticmethod
    def keep(loop: Any) -> None:
        """Enable the cache on disk of a loop, given by numba's dispatcher."""
        loop._cache = _LoopCache(loop.py_func)

    @override
    def _compile_bytecode(self) -> Any:
        result = super()._compile_bytecode()
        result.library.set_environments(tuple(result._find_referenced_environments()))
        return result


class SubroutineCompiler(Compiler):
    """Numba's steps up to the intermediate code, and to machine code of large functions."""

    #: True if its function is large, None to decide by its size.
    _large: bool | None = None

    def __init__(self, *args: Any) -> None:
        """Replace the flags and the library, without an entry for calls from Python."""
        super().__init__(*args)
        state = self.state
        state.flags = _Flags(state.flags)
        state.flags.no_compile = state.flags.no_cpython_wrapper = True
        large = False if state.flags.forceinline else self._large
        codegen = state.targetctx.codegen()
        state.library = _Library(codegen, "subroutine", called=False, large=large)

    @staticmethod
    def keep(loop: Any) -> None:
        """Enable the cache on disk of a subroutine, and make calls from Python an error."""

        def enter(result: Any) -> None:
            loop.overloads[tuple(result.signature.args)] = result  # not for calls from Python

        loop._cache = _SubroutineCache(loop.py_func)
        loop.add_overload, loop._compile_for_args = enter, _entry(loop.py_func.__qualname__)

    @override
    def _compile_bytecode(self) -> Any:
        result = super()._compile_bytecode()
        library = result.library
        library._ensure_finalized()
        if library.large:
            library.set_environments(tuple(result._find_referenced_environments()))
        result = result._replace(entry_point=_entry(result.fndesc.qualname))
        result.target_context.insert_user_function(result.entry_point, result.fndesc, [library])
        return result


class AddressCompiler(SubroutineCompiler):
    """The same with machine code, for functions that are called by address."""

    _large = True


def _entry(name: str) -> Callable[..., NoReturn]:
    """Placeholder of machine code, by which numba finds the subroutine."""

    def refuse(*args: object) -> NoReturn:
        raise TypeError(f"{name} is a part of compiled loops: only they can call it")

    return refuse


def _reduced(result: Any) -> tuple[Any, ...]:
    """Code, description, constants and signature of a compiled function."""
    result.fndesc.typemap = result.fndesc.calltypes = None  # large, and not used later
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
