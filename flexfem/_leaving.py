# SPDX-License-Identifier: LGPL-3.0-or-later
"""Exit of MPI ranks: together with the others, or aborting all of them."""

import os
import sys
import threading
import time
from typing import Any

from flexfem.launch import LEFT, LOOK, abort, tell

__all__ = ["leave", "note_exits"]

#: Seconds that a rank which has failed waits for the others when it leaves, and the longest between
#: looks for them; the exit code of Ctrl-C.
_ALONE, _NAP, _INTERRUPTED = 30.0, 0.05, 130
#: Last argument of ``SystemExit``, and numbers of tools that may watch exceptions.
_status: object = None
_TOOLS = (3, 4)


def note_exits() -> None:
    """Keep the exit code of the program for :func:`leave`: Python does not report it.

    Whatever raises ``SystemExit``, ``sys.exit``, ``exit`` or ``raise``, counts until it is caught.
    """
    watch, events = sys.monitoring, sys.monitoring.events
    tool = next((number for number in _TOOLS if watch.get_tool(number) is None), None)
    if tool is None:  # others watch: all codes count as 0
        return

    def keep(status: object) -> None:
        global _status
        if threading.current_thread() is threading.main_thread():
            _status = status

    def raised(code: object, offset: int, error: BaseException) -> None:
        if isinstance(error, SystemExit):
            keep(error.code)

    def caught(code: object, offset: int, error: BaseException) -> None:
        if isinstance(error, SystemExit):
            keep(None)

    watch.use_tool_id(tool, __name__)
    watch.register_callback(tool, events.RAISE, raised)
    watch.register_callback(tool, events.RERAISE, raised)  # behind a "finally" or a "with"
    watch.register_callback(tool, events.EXCEPTION_HANDLED, caught)
    watch.set_events(tool, events.RAISE | events.RERAISE | events.EXCEPTION_HANDLED)


def leave() -> None:
    """Leave the program together with the other ranks; ends all if this one fails alone.

    Others may come to a run later, or wait for this rank in a collective call of their own, in
    which they hear nothing: when it has left with another code than 0 they get some time, else as
    long as they need; a message says so. Nobody has messages left when MPI ends, which it may not
    bear.
    """
    for tool in _TOOLS:  # what the callbacks use is taken down before Python's own last exceptions
        if sys.monitoring.get_tool(tool) == __name__:
            sys.monitoring.set_events(tool, sys.monitoring.events.NO_EVENTS)
            sys.monitoring.free_tool_id(tool)
    try:
        from mpi4py import MPI
    except ImportError:
        return
    if MPI.Is_finalized():
        return
    comm = MPI.COMM_WORLD
    others = [rank for rank in range(comm.size) if rank != comm.rank]
    sent = [comm.isend(None, other, tag=LEFT) for other in others]
    try:
        _wait(comm, others)
    except KeyboardInterrupt:  # the others may hear no signals, nor end by them
        abort(_INTERRUPTED)
        os._exit(_INTERRUPTED)
    MPI.Request.waitall(sent)


def _wait(comm: Any, others: list[int]) -> None:
    """Wait until these have left, too."""
    begin, code, told = time.monotonic(), _code(_status), False
    while others:
        for other in list(others):
            if comm.iprobe(source=other, tag=LEFT):
                comm.recv(source=other, tag=LEFT)
                others.remove(other)
        waited = time.monotonic() - begin
        if others and waited > _ALONE and not told:
            told = True
            _tell_of(others, code)
        time.sleep(min(max(LOOK, 0.01 * waited), _NAP) if others else 0.0)


def _tell_of(others: list[int], code: int) -> None:
    """Say that others have not left; ends all ranks if this one has failed."""
    from mpi4py import MPI

    rank, size = MPI.COMM_WORLD.rank, MPI.COMM_WORLD.size
    if code:
        text = f"failed: rank {rank} of {size} has exited with code {code}, others have not"
        tell(text)
        abort(code)
        os._exit(code)
    elif all(lower in others for lower in range(rank)):
        text = (
            f"warning: rank {rank} of {size} has exited, rank {others[0]} has not for "
            f"{_ALONE:g} s; it never will if it waits in a collective call: exit on all ranks or "
            "on none"
        )
        tell(text)


def _code(status: object) -> int:
    """The exit code of a process that calls ``sys.exit`` with this."""
    if status is None or isinstance(status, int):
        return int(status or 0) & 0xFF
    return 1
