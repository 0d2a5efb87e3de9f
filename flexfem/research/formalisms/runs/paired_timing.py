# SPDX-License-Identifier: LGPL-3.0-or-later
"""Times of alternatives that are compared: measured in turns, the least of repeats of each.

Other work on the machine slows one measurement or another by any factor. Alternatives that take
turns meet the same load, the least of several repeats is the nearest to the undisturbed time, and
the ratios of the repeats show whether a difference is one of the alternatives or of the load.
"""

import time
from collections.abc import Callable, Mapping, Sequence

import numpy as np

__all__ = ["least", "ratio_range", "timed_in_turns"]

#: Seconds over which an evaluation is timed, and how often: short and often, so that some of the
#: repeats pass undisturbed.
_SECONDS, REPEATS = 0.0015, 15


def timed_in_turns(calls: Mapping[str, Callable[[], object]]) -> dict[str, list[float]]:
    """Seconds of a call of each alternative, one for each repeat."""
    often = {}
    for name, call in calls.items():
        call()
        begin = time.perf_counter()
        call()
        often[name] = max(1, int(_SECONDS / max(time.perf_counter() - begin, 1e-9)))
    found: dict[str, list[float]] = {name: [] for name in calls}
    for turn in range(REPEATS):
        for name in list(calls)[:: -1 if turn % 2 else 1]:
            call, count = calls[name], often[name]
            begin = time.perf_counter()
            for _ in range(count):
                call()
            found[name].append((time.perf_counter() - begin) / count)
    return found


def least(times: Sequence[float]) -> float:
    """The least of some repeats; NaN if there are none."""
    return min(times, default=float("nan"))


def ratio_range(times: Sequence[float], others: Sequence[float]) -> tuple[float, float]:
    """Quartiles of the ratios of repeats that were taken in turns; NaN if there are none."""
    if not len(times) or len(times) != len(others):
        return float("nan"), float("nan")
    low, high = np.quantile(np.divide(times, others), [0.25, 0.75])
    return float(low), float(high)
