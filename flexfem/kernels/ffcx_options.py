# SPDX-License-Identifier: LGPL-3.0-or-later
"""Options and folder of the compilation of forms, independent of files in the working folder.

DOLFINx and FFCx read ``dolfinx_jit_options.json`` and ``ffcx_options.json`` of the working folder,
which may name a folder of compiled code, libraries and tolerances. Files of another user there
could run other code or change results; here all options have fixed values.
"""

import os
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from importlib import import_module, metadata
from pathlib import Path
from types import ModuleType
from typing import Any

from mpi4py import MPI

import ufl
from ufl.algorithms import expand_derivatives, strip_variables

from flexfem._packages import without_collection
from flexfem._trust import private_folder, trusted

__all__ = [
    "c_arguments", "compile_options", "compiled_form", "kernel_folder", "quick_compiler",
    "remove_abandoned", "without_variables",
]  # fmt: skip

#: Seconds that a process waits for another one that compiles the same form.
_PATIENCE = 120


def c_arguments(usual: str) -> list[str]:
    """Arguments of the C compiler: those in ``FLEXFEM_CFLAGS`` or, without it, the usual ones.

    The variable is for clusters with different nodes, and for those whose runs are shorter than
    compilation.
    """
    return [*os.environ.get("FLEXFEM_CFLAGS", usual).split(), "-g0"]


#: Default arguments: those of DOLFINx.
_ARGUMENTS = tuple(c_arguments("-O2"))


def compile_options(comm: MPI.Intracomm, arguments: Sequence[str] = _ARGUMENTS) -> dict[str, Any]:
    """Keyword arguments of DOLFINx's functions that compile forms (collective).

    Args:
        comm: communicator whose first rank compiles and chooses the folder.
        arguments: arguments of the C compiler.
    """
    from ffcx.options import FFCX_DEFAULT_OPTIONS

    jit = {
        "cache_dir": comm.bcast(kernel_folder() if comm.rank == 0 else None),
        "cffi_extra_compile_args": list(arguments), "cffi_libraries": None, "cffi_debug": False,
        "cffi_verbose": False, "timeout": _PATIENCE,
    }  # fmt: skip
    form = {name: option[1] for name, option in FFCX_DEFAULT_OPTIONS.items()}
    return {"form_compiler_options": form, "jit_options": jit}


def compiled_form(form: ufl.Form) -> Any:
    """DOLFINx's form on its mesh (collective)."""
    from dolfinx import fem

    options = compile_options(form.ufl_domain().ufl_cargo().comm)
    with quick_compiler():
        return fem.form(form, **options)


def without_variables(expression: Any) -> Any:
    """The same UFL expression with its derivatives taken, and without variables.

    Variables have numbers, which count all of a process: FFCx names what it compiles by them, and
    would not find it in its cache after another number of variables.
    """
    return strip_variables(expand_derivatives(expression))


@contextmanager
def quick_compiler() -> Iterator[None]:
    """Context in which FFCx generates the same code in two thirds of the time.

    FFCx compares each expression with all others to find its number; here a hash table is used.
    Garbage collection, a tenth of the time, is disabled. Setuptools, which starts the C compiler,
    reads the entry points of all installed packages six times for each form; here once.
    """
    graph = import_module("ffcx.ir.analysis.graph")
    usual = getattr(graph, "ValueNumberer", None)
    with ExitStack() as stack:
        if hasattr(usual, "get_node_symbols"):  # other versions of FFCx may not need it
            stack.enter_context(_replaced(graph, "ValueNumberer", _with_table(usual)))
        stack.enter_context(_replaced(metadata, "entry_points", _selected))
        stack.enter_context(without_collection())
        yield


@contextmanager
def _replaced(module: ModuleType, name: str, other: Any) -> Iterator[None]:
    """Context in which a module of another package has another object by this name."""
    usual = getattr(module, name)
    setattr(module, name, other)
    try:
        yield
    finally:
        setattr(module, name, usual)


_entry_points = cache(metadata.entry_points)


def _selected(**wanted: Any) -> metadata.EntryPoints:
    """Entry points of the packages that are installed when a process first asks for some."""
    return _entry_points().select(**wanted)


@cache
def _with_table(usual: Any) -> Any:
    """FFCx's class that numbers the values of a graph of expressions, with a table of them."""

    class Numberer(usual):
        """Graph that finds an expression by its hash."""

        def __init__(self, G: Any) -> None:
            super().__init__(G)
            self._places: dict[Any, int] = {}
            for place, node in G.nodes.items():
                self._places.setdefault(node["expression"], place)

        def get_node_symbols(self, expr: Any) -> Any:
            return self.V_symbols[self._places[expr]]

    return Numberer


@cache
def kernel_folder() -> Path:
    """Folder of compiled forms: DOLFINx's own, else that below the home, else a temporary one."""
    from dolfinx.jit import DOLFINX_DEFAULT_JIT_OPTIONS

    usual = Path(str(DOLFINX_DEFAULT_JIT_OPTIONS["cache_dir"][0]))
    advice = "XDG_CACHE_HOME names a folder of your own"
    for folder in dict.fromkeys([usual, Path.home() / ".cache" / "fenics"]):
        if trusted(folder, advice):
            remove_abandoned(folder)
            return folder
    return private_folder() / "fenics"


def remove_abandoned(folder: Path) -> None:
    """Remove sources whose compilation has not ended within the time that others wait for it.

    A run that is killed while it compiles leaves one, for which all later ones would wait in vain.
    """
    begun = time.time() - _PATIENCE
    for source in folder.glob("libffcx_*.c"):
        with suppress(OSError):  # others may remove it as well
            if not source.with_suffix(".c.cached").exists() and source.stat().st_mtime < begun:
                source.unlink()
