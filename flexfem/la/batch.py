# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cell kernels that treat several cells in one call.

What FFCx generates for a beam is one long run of additions and products. The same text in a loop
over :data:`LANES` cells, whose data lie side by side, is vectorised by the C compiler: five times
the speed with eight lanes of 512 bits, three times with four.
"""

import hashlib
import importlib.util
import re
import tempfile
from pathlib import Path
from types import ModuleType
from typing import Any

from mpi4py import MPI

__all__ = ["LANES", "compile_batch"]

#: Cells of one call: the width of the largest vectors of today's processors.
LANES = 8

_DECLARATION = (
    "void tabulate_batch(double* A, const double* w, const double* c, const double* points);"
)
_SOURCE = """\
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
void tabulate_batch(double* restrict A, const double* restrict w, const double* restrict c,
                    const double* restrict coordinate_dofs)
{{
#pragma omp simd simdlen({lanes})
for (int lane = 0; lane < {lanes}; ++lane)
{{
{body}
}}
}}
"""
_ARGUMENTS = ["-std=c17", "-fopenmp-simd"]


def compile_batch(comm: MPI.Intracomm, module: Any, arguments: list[str]) -> tuple[int, Any]:
    """Compile the batched variant of a module's only cell kernel (collective; cached on disk).

    The data of lane l of entry k of the coefficients and of the tensor are at ``k LANES + l``;
    constants and coordinates are common to all lanes.

    Args:
        comm: communicator whose first rank compiles.
        module: compiled by DOLFINx's just-in-time compiler, which leaves the C source beside it.
        arguments: arguments of the C compiler.

    Returns:
        Address of the function ``(A, w, c, points)`` and the module that holds it.
    """
    library = Path(module.__file__)
    source = library.with_name(library.name.split(".", 1)[0] + ".c")
    kind = hashlib.blake2b(" ".join(arguments).encode(), digest_size=4).hexdigest()
    name = f"{source.stem}_batch{LANES}_{kind}"
    if comm.rank == 0 and _library(source.parent, name) is None:
        _compile(source, name, [*arguments, *_ARGUMENTS])
    comm.Barrier()
    path = _library(source.parent, name)
    if path is None:
        raise FileNotFoundError(f"{source.parent}: the compiled kernel {name} is not there")
    batch = _load(name, path)
    function = batch.ffi.addressof(batch.lib, "tabulate_batch")
    return int(batch.ffi.cast("uintptr_t", function)), batch


def _library(folder: Path, name: str) -> Path | None:
    return next(iter(sorted(folder.glob(f"{name}.*.so"))), None)


def _compile(source: Path, name: str, arguments: list[str]) -> None:
    """Compile aside and move into place, so that other runs never see half a file."""
    import cffi

    builder = cffi.FFI()
    builder.cdef(_DECLARATION)
    code = _SOURCE.format(lanes=LANES, body=_lane_by_lane(source.read_text()))
    builder.set_source(name, code, extra_compile_args=arguments)
    with tempfile.TemporaryDirectory(dir=source.parent) as folder:
        built = Path(builder.compile(tmpdir=folder))
        built.replace(source.parent / built.name)


def _lane_by_lane(code: str) -> str:
    """Body of the cell kernel with the indices of tensor and coefficients moved to one lane."""
    start = code.index("{", code.index("void tabulate_tensor")) + 1
    end, depth = start, 1
    while depth:
        depth += {"{": 1, "}": -1}.get(code[end], 0)
        end += 1
    body = re.sub(r"//.*", "", code[start : end - 1])
    entry, moved = r"\b([Aw])\[([^\[\]]*)\]", rf"\1[(\2) * {LANES} + lane]"
    if len(re.findall(r"\b[Aw]\b", body)) > len(re.findall(entry, body)):
        raise ValueError("the code that FFCx generates has changed: entries of A or w not found")
    return re.sub(entry, moved, body)


def _load(name: str, path: Path) -> ModuleType:
    specification = importlib.util.spec_from_file_location(name, path)
    assert specification is not None
    assert specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module
