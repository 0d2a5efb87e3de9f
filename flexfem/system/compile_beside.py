# SPDX-License-Identifier: LGPL-3.0-or-later
"""Background compilation: processes that compile loops during a first run, before it needs them.

A run compiles its loops one after the other, most of them at its start, on one core. ``loops.txt``
lists loops, first those that nearly all models call: they are compiled while the run loads DOLFINx
and builds its model. Those of the others follow that are in the modules of its kinds of bodies.
``python -m tests.list_loops`` writes the list. A loop that is not in it is compiled when the run
needs it.
"""

import gc
import json
import os
import re
import sys
from collections.abc import Iterator
from contextlib import suppress
from importlib import import_module
from itertools import islice
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from numba import types
from numba.core.dispatcher import Dispatcher
from numba.core.registry import cpu_target

from flexfem import _beside
from flexfem.core.marker import Carrier
from flexfem.kernels.caching import sources
from flexfem.kernels.compile_once import busy

if TYPE_CHECKING:  # the processes do not need it
    from flexfem.layout.numbered_model import NumberedModel

__all__ = ["compile_beside", "kind_of", "modules_of", "text_of"]

_PACKAGE = Path(__file__).resolve().parents[1]
#: Loops whose absence from the cache indicates a first run, and the number that must be absent.
_LOOKED_AT, _ABSENT = 8, 4
_ARRAY = re.compile(r"(readonly )?array\((\w+), (\d)d, ([ACF])\)")
_NUMBERS = {str(kind): kind for kind in (*types.number_domain, types.boolean)}
#: Option of Linux's prctl for a signal when the parent of this process ends.
_SIGNAL_OF_PARENT = 1


def compile_beside(model: "NumberedModel", ranks: int) -> None:
    """Start the processes if most of the loops that a model needs were never compiled.

    If the command has started them already, they are sent the modules of these loops.

    Args:
        model: the model of the run.
        ranks: number of ranks, which wait for one another while one of them compiles.
    """
    if not _beside.started():
        first = [entry.resolved() for entry in islice(_listed(), _LOOKED_AT)]
        absent = [not loop._cache._cache_file._load_index() for loop, _ in filter(None, first)]
        if sum(absent) < _ABSENT:
            return
        _beside.start(ranks)
    _beside.tell(modules_of(model))


def modules_of(model: "NumberedModel") -> set[str]:
    """Modules of the package without those for families, contact and lines that a model lacks.

    Markers between nodes may need lines as well: these loops are compiled by the run.
    """
    of_families = {
        path
        for family in model.families.values()
        for path in sources(Path(sys.modules[type(family).__module__].__file__ or ""))
    }
    contact = bool(model.model.contacts)
    joints = model.model.joints
    lines = any(isinstance(marker, Carrier) for joint in joints for marker in joint.markers)

    def needed(name: str) -> bool:
        if name.startswith("flexfem.families."):
            return _PACKAGE.joinpath(*name.split(".")[1:]).with_suffix(".py") in of_families
        if name.startswith("flexfem.contact."):
            return contact
        return lines or not name.startswith("flexfem.constraints.lines.")

    return {name for name in sys.modules if name.startswith("flexfem.") and needed(name)}


class _Entry(NamedTuple):
    """A line of the list.

    Attributes:
        module: module of the loop.
        function: its name, with that of a kernel written by hand whose address it returns.
        usual: True if nearly all models call it.
        kinds: types of its arguments, as :func:`text_of` writes them.
    """

    module: str
    function: str
    usual: bool
    kinds: list[Any]

    def resolved(self) -> tuple[Any, tuple[Any, ...]] | None:
        """The loop and the types of its arguments; None if there is no such loop."""
        try:
            loop = attrgetter(self.function)(import_module(self.module))
            kinds = tuple(kind_of(kind) for kind in self.kinds)
        except (AttributeError, ImportError, ValueError):
            return None
        return (loop, kinds) if isinstance(loop, Dispatcher) else None


def _listed() -> Iterator[_Entry]:
    """All lines of the list."""
    for line in _beside.LIST.read_text(encoding="ascii").splitlines():
        yield _Entry(*json.loads(line))


def text_of(kind: Any) -> Any:
    """Entry of the list for a type of arguments: texts, and mappings for tuples.

    Raises:
        ValueError: the type cannot be listed.
    """
    if isinstance(kind, types.BaseTuple):
        parts: Any = kind
        named = getattr(kind, "instance_class", None)
        name = "" if named is None else f"{named.__module__}:{named.__qualname__}"
        text: Any = {name: [text_of(part) for part in parts.types]}
    else:
        text = str(kind)
    if kind_of(text) != kind:
        raise ValueError(f"{kind} cannot be listed")
    return text


def kind_of(text: Any) -> Any:
    """The type for a result of :func:`text_of`.

    Raises:
        ValueError: there is none.
    """
    if isinstance(text, dict):
        ((name, parts),) = text.items()
        kinds = [kind_of(part) for part in parts]
        return types.BaseTuple.from_types(kinds, _named_tuple(name) if name else None)
    if found := _ARRAY.fullmatch(text):
        readonly, scalar, dimensions = found.groups()[:3]
        layout: Any = found[4]
        if scalar in _NUMBERS:
            kind = _NUMBERS[scalar]
            return types.Array(kind, int(dimensions), layout, readonly=bool(readonly))
    if text == "none":
        return types.none
    if text not in _NUMBERS:
        raise ValueError(f"{text} is no type of arguments")
    return _NUMBERS[text]


def _named_tuple(name: str) -> Any:
    """A class of the package.

    Raises:
        ValueError: there is none.
    """
    module, _, names = name.partition(":")
    if not module.startswith("flexfem."):
        raise ValueError(f"{name} is no class of flexfem")
    found = getattr(import_module(module), names, None)
    if not (isinstance(found, type) and issubclass(found, tuple) and hasattr(found, "_fields")):
        raise ValueError(f"{name} is no named tuple")
    return found


def _kept(loop: Any, signature: Any) -> bool:
    """True if a loop is in the cache already, which needs no loading here."""
    cache = loop._cache
    return cache._index_key(signature, cpu_target.target_context.codegen()) in (
        cache._cache_file._load_index()
    )


def _compile(entries: list[_Entry], run: int) -> None:
    """Compile loops that no other process is compiling or has compiled, until the run ends."""
    for entry in entries:
        if os.getppid() != run:
            sys.exit()
        if (found := entry.resolved()) is not None:
            loop, signature = found
            if not (_kept(loop, signature) or busy(loop, signature)):
                loop.compile(signature)


def _end_with(run: int) -> None:
    """Make the operating system end this process with the run in any case."""
    import ctypes
    import signal

    with suppress(OSError, AttributeError):  # not Linux: the end is noticed after the next loop
        ctypes.CDLL(None).prctl(_SIGNAL_OF_PARENT, signal.SIGTERM)
    if os.getppid() != run:
        sys.exit()


def _main() -> None:
    """Compile loops that nearly all models need, then others in the modules of the run."""
    run = int(sys.argv[1])
    _end_with(run)
    import mpi4py

    mpi4py.rc.initialize = False
    gc.disable()  # no object of this process is released
    listed = list(_listed())
    _compile([entry for entry in listed if entry.usual], run)
    modules = set(sys.stdin.read().split())
    _compile([entry for entry in listed if entry.module in modules and not entry.usual], run)


if __name__ == "__main__":
    _main()
