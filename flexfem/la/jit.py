# SPDX-License-Identifier: LGPL-3.0-or-later
"""Options and folder of the compilation of forms, which no file in the working folder changes.

DOLFINx and FFCx read ``dolfinx_jit_options.json`` and ``ffcx_options.json`` of the working folder,
which may name a folder of compiled code, libraries and tolerances. Whoever left them there would
run his code in ours, or change our numbers; here all options have values of our own.
"""

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

from mpi4py import MPI

import ufl

from flexfem._trust import private_folder, trusted

__all__ = ["compile_options", "compiled_form"]

#: Arguments of the C compiler unless others are asked for: those of DOLFINx.
_ARGUMENTS = ("-O2", "-g0")
#: Seconds that a process waits for another one that compiles the same form.
_PATIENCE = 120


def compile_options(comm: MPI.Intracomm, arguments: Sequence[str] = _ARGUMENTS) -> dict[str, Any]:
    """Keyword arguments of DOLFINx's functions that compile forms (collective).

    Args:
        comm: communicator whose first rank compiles, and says where to.
        arguments: of the C compiler.
    """
    from ffcx.options import FFCX_DEFAULT_OPTIONS

    jit = {
        "cache_dir": comm.bcast(_folder() if comm.rank == 0 else None),
        "cffi_extra_compile_args": list(arguments), "cffi_libraries": None, "cffi_debug": False,
        "cffi_verbose": False, "timeout": _PATIENCE,
    }  # fmt: skip
    form = {name: option[1] for name, option in FFCX_DEFAULT_OPTIONS.items()}
    return {"form_compiler_options": form, "jit_options": jit}


def compiled_form(form: ufl.Form) -> Any:
    """DOLFINx's form on its mesh (collective)."""
    from dolfinx import fem

    return fem.form(form, **compile_options(form.ufl_domain().ufl_cargo().comm))


@cache
def _folder() -> Path:
    """DOLFINx's own folder, else that below the home, else one of this process."""
    from dolfinx.jit import DOLFINX_DEFAULT_JIT_OPTIONS

    usual = Path(str(DOLFINX_DEFAULT_JIT_OPTIONS["cache_dir"][0]))
    advice = "XDG_CACHE_HOME names a folder of your own"
    for folder in dict.fromkeys([usual, Path.home() / ".cache" / "fenics"]):
        if trusted(folder, advice):
            return folder
    return private_folder() / "fenics"
