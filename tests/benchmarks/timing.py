# SPDX-License-Identifier: LGPL-3.0-or-later
"""Processor times of calls that are compared with each other."""

import time
from collections.abc import Callable, Mapping

__all__ = ["paired"]

#: Blocks of calls, of which the fastest counts, and the least time that a block takes, s.
BLOCKS, LEAST = 40, 2e-3


def paired(calls: Mapping[str, Callable[[], object]]) -> dict[str, float]:
    """Least processor time of a call, s, of blocks of them in turns."""
    counts = {}
    for name, call in calls.items():
        call()  # compile
        begin = time.process_time()
        call()
        counts[name] = max(1, int(LEAST / max(time.process_time() - begin, 1e-6)))
    least = dict.fromkeys(calls, float("inf"))
    for _ in range(BLOCKS):
        for name, call in calls.items():
            begin = time.process_time()
            for _ in range(counts[name]):
                call()
            least[name] = min(least[name], (time.process_time() - begin) / counts[name])
    return least
