# SPDX-License-Identifier: LGPL-3.0-or-later
"""Kernels of the package's own forms, found on disk without building the forms.

FFCx finds a compiled form by its signature, and for that the form has to be built and
differentiated, which takes 0.3 s for a beam: a seventh of the time to start. Here an index beside
FFCx's files has the compiled modules of the forms that a function returns, by its arguments, its
source and the versions and options of the compilers.
"""

import hashlib
import json
import re
import sys
import sysconfig
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from importlib.machinery import EXTENSION_SUFFIXES, ExtensionFileLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np

from flexfem._checks import InputError
from flexfem._files import read_text, replace_file
from flexfem.kernels.caching import stamp_of
from flexfem.kernels.ffcx import Kernel, compile_arguments, compile_kernel, kernel_at
from flexfem.kernels.ffcx_options import kernel_folder

__all__ = ["FormKernels", "compile_forms"]

#: Names of the modules that FFCx compiles.
_MODULE = re.compile(r"libffcx_forms_[0-9a-f]+")
#: Bytes of the largest index that is read.
_LARGEST = 100_000
#: Packages on which the code of a kernel depends.
_COMPILERS = ("ufl", "basix", "ffcx", "dolfinx", "cffi", "numpy")


@dataclass(frozen=True)
class FormKernels:
    """Compiled kernels of some forms with common coefficients.

    Attributes:
        names: names of the coefficients in the order of the kernels' offsets.
        kernels: the kernel of each form.
    """

    names: tuple[str, ...]
    kernels: dict[str, Kernel]

    def __getitem__(self, form: str) -> Kernel:
        """The kernel of a form."""
        return self.kernels[form]


def compile_forms(
    comm: MPI.Intracomm, build: Callable[..., Any], arguments: tuple[Any, ...],
    wanted: Mapping[str, bool],
) -> FormKernels:  # fmt: skip
    """Compile forms, or load them if they were compiled before (collective).

    Args:
        comm: communicator whose first rank compiles.
        build: function of a module that returns an object with the forms, each with one cell
            integral, and the mapping ``coefficients`` from names to all their coefficients.
        arguments: its arguments. The forms are found without building them if all of these are
            flags, numbers, texts or None.
        wanted: attributes of the object that are compiled; True for ``LANES`` cells at once, see
            ``compile_kernel``.
    """
    file = _index(build, arguments, wanted) if comm.rank == 0 else None
    known = comm.bcast(_read(file, wanted))
    if known is not None:
        folder, names, entries = known
        found = {}
        for form, (module, offsets) in entries.items():
            kernel = _loaded(folder, module, offsets, wanted[form])
            if kernel is not None:
                found[form] = kernel
        if comm.allreduce(len(found) == len(wanted), op=MPI.LAND):
            return FormKernels(tuple(names), found)
    forms = build(*arguments)
    fields = tuple(forms.coefficients.values())
    made = {
        form: compile_kernel(comm, getattr(forms, form), fields, batched=batched)
        for form, batched in wanted.items()
    }
    result = FormKernels(tuple(forms.coefficients), made)
    if file is not None:
        _write(file, result)
    return result


def _index(
    build: Callable[..., Any], arguments: tuple[Any, ...], wanted: Mapping[str, bool]
) -> Path | None:
    """File with the modules of the forms; None for arguments or functions of users."""
    module = sys.modules[build.__module__]
    stamp = stamp_of(str(module.__file__))
    if stamp is None or not all(isinstance(a, (int, float, str, type(None))) for a in arguments):
        return None
    options = [compile_arguments(batched=batched) for batched in (False, True)]
    versions = [getattr(sys.modules.get(name), "__version__", None) for name in _COMPILERS]
    machine = [sysconfig.get_config_var(name) for name in ("SOABI", "CFLAGS")]
    parts = (
        stamp, stamp_of(__file__), build.__qualname__, arguments, dict(wanted), options, versions,
        machine,
    )  # fmt: skip
    key = hashlib.blake2b(repr(parts).encode(), digest_size=16).hexdigest()
    return kernel_folder() / f"flexfem_forms_{key}.json"


def _read(
    file: Path | None, wanted: Mapping[str, bool]
) -> tuple[str, list[str], dict[str, tuple[str, list[int]]]] | None:
    """Folder, names of the coefficients, and module and offsets of each form, if it has them."""
    if file is None:
        return None
    try:
        names, entries = json.loads(read_text("index of forms", file, _LARGEST))
        complete = set(entries) == set(wanted) and all(
            _MODULE.fullmatch(module) and len(offsets) == len(names) + 1
            for module, offsets in entries.values()
        )
    except (InputError, ValueError, TypeError, AttributeError):
        return None
    return (str(file.parent), names, entries) if complete else None


def _write(file: Path, made: FormKernels) -> None:
    """Write the index; without it the forms are built the next time."""
    entries = {
        form: (kernel.owner.__name__, kernel.offsets.tolist())
        for form, kernel in made.kernels.items()
    }
    with suppress(OSError):
        replace_file(file, [json.dumps([made.names, entries]).encode()])


def _loaded(folder: str, name: str, offsets: list[int], batched: bool) -> Kernel | None:
    """The kernel of a compiled module; None if the module cannot be loaded."""
    loader = ExtensionFileLoader(name, str(Path(folder) / f"{name}{EXTENSION_SUFFIXES[0]}"))
    spec = spec_from_loader(name, loader)
    if spec is None:
        return None
    try:
        module = module_from_spec(spec)
        loader.exec_module(module)
        (form,) = (known for known in dir(module.lib) if known.startswith("form_"))
    except (ImportError, OSError, ValueError):
        return None
    positions = np.array(offsets, dtype=np.int64)
    return kernel_at(module, getattr(module.lib, form), positions, batched=batched)
