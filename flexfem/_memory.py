# SPDX-License-Identifier: LGPL-3.0-or-later
"""Available memory, and refusal of models that do not fit before they are allocated."""

import os
import resource
from collections.abc import Iterator
from pathlib import Path

from flexfem import launch
from flexfem._checks import InputError

__all__ = [
    "DOUBT",
    "ITERATED",
    "LINE_NODE",
    "PROGRAM",
    "SHEET",
    "UNKNOWN",
    "available",
    "check_room",
    "check_run",
    "peak",
    "shown",
    "together",
]

#: Bytes that steps take: the program with its libraries on every rank, and a node of a beam. They
#: are those of motions with 1e4 to 6e6 unknowns.
PROGRAM, LINE_NODE = 3e8, 1.56e4
#: The same for an unknown of a shell with directors or a solid, whose factors fill in, and of a
#: rotation-free shell, 12.9 kB of 3e4, 12.3 kB of 1.1e5 and 10.2 kB of 1e6 unknowns on two ranks.
#: Congruent panels that share factors take less. One of a solid that is solved iteratively takes
#: less, and as much from 1e5 to 1e6.
UNKNOWN, SHEET, ITERATED = 1.6e4, 1.1e4, 5.5e3
#: Factor by which these may be too large, but for rotation-free shells, which it would let begin
#: without room.
DOUBT = 1.25

#: Amount below which available memory is not checked.
_LITTLE = 1e9
#: Files of the system: memory limit and memory use of a group of processes, such as a container.
_GROUP = (
    ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory.current"),
    (
        "/sys/fs/cgroup/memory/memory.limit_in_bytes",
        "/sys/fs/cgroup/memory/memory.usage_in_bytes",
    ),
)


def available() -> float:
    """Bytes that this computer, its container and its limits leave; infinite if unknown."""
    return min(_limits(), default=float("inf"))


def peak() -> float:
    """Bytes that this process has had in memory at most."""
    return 1024.0 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss  # Linux counts in kB


def check_room(
    owner: str, needed: float, of: float | None = None, *, what: str = "elements"
) -> None:  # fmt: skip
    """Refuse data that need more memory than available.

    Args:
        owner: prefix of messages, and the large object, such as ``LineMesh: 10 elements``.
        needed: bytes.
        of: bytes that there are; those of :func:`available` by default.
        what: those of which there are too many, for the advice.

    Raises:
        InputError: they are too many.
    """
    if needed <= _LITTLE:
        return
    room = available() if of is None else of
    if needed > room:
        raise InputError(
            f"{owner} would need about {shown(needed)} of memory, {shown(room)} are available; "
            f"reduce the number of {what}"
        )


def check_run(owner: str, nodes: float, each: float) -> None:
    """Refuse a mesh with which no step would have room, where it is written and not an hour later.

    Args:
        owner: prefix of messages, and the large object, such as
            ``NurbsCurve: a step with 10 elements``.
        nodes: number of nodes, at least.
        each: bytes that a step needs for one.

    Raises:
        InputError: they are too many.
    """
    if nodes * each > _LITTLE:
        check_room(owner, together(PROGRAM + nodes * each, *launch.ranks_here()) / DOUBT)


def together(needed: float, here: int, all_ranks: int) -> float:
    """Bytes that steps take on one computer, about.

    Args:
        needed: memory on one rank, bytes.
        here: ranks on the computer.
        all_ranks: those of the run, which share the model.
    """
    return needed * here / all_ranks + PROGRAM * (here - 1)


def shown(size: float) -> str:
    """Bytes in words."""
    for unit, name in ((1e12, "TB"), (1e9, "GB")):
        if size >= unit:
            return f"{size / unit:.3g} {name}"
    return f"{size / 1e6:.3g} MB"


def _limits() -> Iterator[float]:
    fields = dict(line.partition(":")[::2] for line in _text("/proc/meminfo").splitlines())
    kilobytes = fields.get("MemAvailable", "").split()[:1]
    if kilobytes:
        yield 1024.0 * float(kilobytes[0])
    elif "SC_PHYS_PAGES" in os.sysconf_names:
        yield float(os.sysconf("SC_PHYS_PAGES")) * os.sysconf("SC_PAGE_SIZE")
    for limit, used in _GROUP:
        texts = _text(limit).strip(), _text(used).strip()
        if all(text.isdecimal() for text in texts):
            yield max(0.0, float(texts[0]) - float(texts[1]))
    soft, _ = resource.getrlimit(resource.RLIMIT_AS)
    if soft != resource.RLIM_INFINITY:
        yield float(soft)


def _text(path: str) -> str:
    try:
        return Path(path).read_text(encoding="ascii")
    except OSError:
        return ""
