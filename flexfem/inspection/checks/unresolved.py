# SPDX-License-Identifier: LGPL-3.0-or-later
"""Loads and drives that change faster than steps resolve, which use values at their ends only."""

from collections.abc import Callable, Iterator
from dataclasses import fields

import numpy as np

from flexfem._faults import FAILURES
from flexfem._types import FloatArray
from flexfem.inspection.finding import Finding, owner_of
from flexfem.inspection.inspection import Inspection
from flexfem.loads.amplitude import Spline
from flexfem.model.model import Model

#: Sampled steps, spread over the motion, and the times within each.
_LOOKS, _WITHIN = 60, 0.382
#: A value counts if it is off the line between the ends of its step by more than this part of all
#: changes; four steps in a period make 0.15, three make 0.25. One step in so many may be like that:
#: single jumps and pulses are no vibrations.
_OFF, _SHARE = 0.2, 0.25
#: Number of steps below which vibrations cannot be judged.
_FEW = 3
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
    for owner, function in _functions(inspection.model):
        if isinstance(function, Spline):
            around = _around(function, t_end / steps, t_end)
            yield from _between(owner, function, around, 0.0, float(np.ptp(function.values)))
        elif not hasattr(function, "breakpoints") and len(times) > _FEW:
            yield from _between(owner, function, times, _SHARE)


def _functions(model: Model) -> Iterator[tuple[str, Callable[[float], object]]]:
    """Functions of time of loads and drives, and their owners."""
    for load in model.loads:
        if load.amplitude is not None:
            yield owner_of(load), load.amplitude
    for joint in model.joints:
        if joint.driven:
            values = (getattr(joint, field.name) for field in fields(joint))
            yield from ((joint.owner, value) for value in values if callable(value))


def _around(spline: Spline, h: float, t_end: float) -> FloatArray:
    """(n, 3) values of a smooth spline within steps of h (s), each between the step's ends.

    Steps meet kinks, at the ends of the spline or of degree 1, anyway.
    """
    inner = spline.times[1:-1] if spline.degree > 1 else spline.times[:0]
    inner = inner[(inner > 0.0) & (inner < t_end)]
    begin = h * np.floor(inner / h)
    rows: FloatArray = np.stack([begin, inner, begin + h], axis=1)
    return rows


def _between(
    owner: str,
    function: Callable[[float], object],
    times: FloatArray,
    share: float,
    range_of_values: float = 0.0,
) -> Iterator[Finding]:
    """Compare a function within steps with the lines between its values at their ends.

    Args:
        owner: its owner.
        function: the function.
        times: (n, 3) beginning of a step, a time within it, end of the step.
        share: part of them that may be off.
        range_of_values: of the function, as far as it is known; that at the times counts, too.
    """
    if not len(times):
        return
    try:
        values = np.array([[float(function(t)) for t in row] for row in times.tolist()])  # type: ignore[arg-type]
    except FAILURES:  # of several values, of more than time, or wrong: the run says so
        return
    if not np.abs(values).max() < _HUGE:  # nor values that are not finite
        return
    change = max(float(np.ptp(values)), range_of_values)
    within = (times[:, 1] - times[:, 0]) / (times[:, 2] - times[:, 0])
    line = values[:, 0] + within * (values[:, 2] - values[:, 0])
    off = np.abs(values[:, 1] - line)
    if not change > _ROUNDING * np.abs(values).max():
        return
    if np.mean(off > _OFF * change) <= share:
        return
    worst = int(np.argmax(off))
    begin, inside, end = values[worst].tolist()
    yield Finding(
        "unresolved", owner,
        f"within a step it is {inside:.4g} at t = {times[worst, 1]:.6g} s, and {begin:.4g} and "
        f"{end:.4g} at the step's ends, the only values that the integrator uses",
        "use five steps or more in each period (smaller dt), or means over the steps",
    )  # fmt: skip
