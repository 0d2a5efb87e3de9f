# SPDX-License-Identifier: LGPL-3.0-or-later
"""Loads and drives that change faster than steps follow, which see values at their ends only."""

from collections.abc import Callable, Iterator
from dataclasses import fields

import numpy as np

from flexfem._faults import FAILURES
from flexfem._types import FloatArray
from flexfem.core.joint import Joint
from flexfem.inspection.finding import Finding, owner_of
from flexfem.inspection.inspection import Inspection

#: Steps that are looked into, spread over the motion, and where within each.
_LOOKS, _WITHIN = 60, 0.382
#: A value counts if it is off the line between the ends of its step by more than this part of all
#: changes; four steps in a period make 0.15, three make 0.25. One step in so many may be like that:
#: single jumps and pulses are no vibrations.
_OFF, _SHARE = 0.2, 0.25
#: Part of the values themselves that is rounding.
_ROUNDING = 1e-9
#: Larger values are no numbers to compute with.
_HUGE = 1e100


def find(inspection: Inspection) -> Iterator[Finding]:
    """Functions of time whose values within many steps are not near those at their ends."""
    options = inspection.options
    dt, t_end = (getattr(options, name, None) for name in ("dt", "t_end"))
    if dt is None or t_end is None or getattr(options, "adaptive", False):
        return
    steps = max(round(t_end / dt), 1)
    first = np.unique(np.linspace(0, steps - 1, _LOOKS).round())
    times = t_end / steps * (first[:, np.newaxis] + [0.0, _WITHIN, 1.0])
    for load in inspection.model.loads:
        amplitude = load.amplitude
        if amplitude is not None and not hasattr(amplitude, "breakpoints"):
            yield from _between(owner_of(load), amplitude, times)
    for joint in inspection.model.joints:
        if joint.driven:
            for function in _functions(joint):
                yield from _between(joint.owner, function, times)


def _functions(joint: Joint) -> Iterator[Callable[[float], object]]:
    """Functions of a drive that do not tell where they jump."""
    values = (getattr(joint, field.name) for field in fields(joint))
    return (f for f in values if callable(f) and not hasattr(f, "breakpoints"))


def _between(
    owner: str, function: Callable[[float], object], times: FloatArray
) -> Iterator[Finding]:
    """Compare a function within steps with the lines between its values at their ends."""
    try:
        values = np.array([[float(function(t)) for t in row] for row in times.tolist()])  # type: ignore[arg-type]
    except FAILURES:  # of several values, of more than time, or wrong: the run says so
        return
    if not np.abs(values).max() < _HUGE:  # nor what is not finite
        return
    change = float(np.ptp(values))
    line = values[:, 0] + _WITHIN * (values[:, 2] - values[:, 0])
    off = np.abs(values[:, 1] - line)
    if not change > _ROUNDING * np.abs(values).max() or len(times) < 4:
        return
    if np.mean(off > _OFF * change) <= _SHARE:
        return
    worst = int(np.argmax(off))
    begin, within, end = values[worst].tolist()
    yield Finding(
        "unresolved", owner,
        f"within a step it is {within:.4g} at t = {times[worst, 1]:.6g} s, and {begin:.4g} and "
        f"{end:.4g} at the step's ends, which are all that the motion sees",
        "take five steps or more in each period (smaller dt), or means over the steps",
    )  # fmt: skip
