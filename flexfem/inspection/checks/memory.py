# SPDX-License-Identifier: LGPL-3.0-or-later
"""Models whose motion takes most of the memory that is left, at times by a digit too many."""

from collections.abc import Iterator

from flexfem import launch
from flexfem._memory import available, shown, together
from flexfem.inspection.finding import Finding, owner_of
from flexfem.inspection.inspection import Inspection
from flexfem.system.memory import memory_of_run

__all__ = ["find"]

#: Part of the available memory above which a computer may begin to swap: estimates miss contact,
#: which takes some more, and results.
_PART = 0.5
#: Memory below which nothing is reported, bytes.
_LITTLE = 1e9


def find(inspection: Inspection) -> Iterator[Finding]:
    """One finding at most, of this computer."""
    model = inspection.model
    needed, room = together(memory_of_run(model), *launch.ranks_here()), available()
    if needed > max(_PART * room, _LITTLE):
        most = max(inspection.meshes, key=lambda one: len(one.lengths), default=None)
        count = f"; {len(most.lengths)} elements in {owner_of(most.body)}" if most else ""
        yield Finding(
            "memory", repr(model),
            f"a step takes about {shown(needed)} of memory, {shown(room)} are available{count}",
            "reduce the number of elements; runs with too little of it are refused",
        )  # fmt: skip
