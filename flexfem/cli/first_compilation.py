# SPDX-License-Identifier: LGPL-3.0-or-later
"""Message that a first run waits for the compilation of kernels."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from numba.core import event

__all__ = ["announcing_compilation"]

#: Seconds of compilation after which the message is printed.
_SHORT = 1.0
_WORDS = (
    "compiling kernels, which are kept: a first run waits for half a minute or more, later ones "
    "start at once"
)


class _Listener(event.Listener):
    """Listener that sums the time of compilations, and reports once."""

    def __init__(self, tell: Callable[[str], None]) -> None:
        self._tell, self._begun, self._depth, self._spent = tell, 0.0, 0, 0.0
        self._told = False

    def on_start(self, event: event.Event) -> None:
        """Note the begin of a compilation, which may be within another one."""
        if self._depth == 0:
            self._begun = time.monotonic()
        self._depth += 1
        if not self._told and self._spent + time.monotonic() - self._begun > _SHORT:
            self._told = True
            self._tell(_WORDS)

    def on_end(self, event: event.Event) -> None:
        """Note the end of a compilation, and report if the time is up."""
        self._depth -= 1
        if self._depth == 0:
            self._spent += time.monotonic() - self._begun


@contextmanager
def announcing_compilation(tell: Callable[[str], None]) -> Iterator[None]:
    """Context in which ``tell`` is called once, with a line, if numba compiles for over a second.

    Loading from the cache on disk is not counted.
    """
    listener = _Listener(tell)
    event.register("numba:compile", listener)
    try:
        yield
    finally:
        event.unregister("numba:compile", listener)
