# SPDX-License-Identifier: LGPL-3.0-or-later
"""Drives that jump while a motion lasts."""

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.inspection.finding import Finding
from flexfem.inspection.inspection import Inspection

#: Times at which drives are sampled, before the largest change is refined.
_LOOKS = 200
#: A jump is so many times the changes in the steps before and after it.
_TIMES = 5.0
#: Jump, relative to the size of the model or in rad, that is no mistake.
_NOTHING = 1e-4


def find(inspection: Inspection) -> Iterator[Finding]:
    """Drives whose largest change happens within a single step; at the start see ``velocities``."""
    dt, t_end = (getattr(inspection.options, name, None) for name in ("dt", "t_end"))
    if dt is None or t_end is None or not any(joint.driven for joint in inspection.model.joints):
        return
    rows, steps = inspection.rows.rows, max(round(t_end / dt), 1)

    def targets(step: int) -> FloatArray:
        rows.set_time(t_end * step / steps)
        return rows.targets.copy()

    looks = np.unique(np.linspace(0, steps, _LOOKS + 1).round().astype(np.int64))
    values = np.array([targets(int(step)) for step in looks])
    turning = inspection.turning
    for row in np.flatnonzero(rows.rigid & (np.ptp(values, axis=0) > 0.0)).tolist():
        size, step = _largest(partial(_one, targets, row), looks, values[:, row])
        around = [float(targets(k)[row]) for k in range(max(step - 2, 0), min(step + 2, steps + 1))]
        beside = np.abs(np.diff(around))
        beside[min(step - 1, 1)] = 0.0
        scale = 1.0 if turning[row] else inspection.scale
        if size > max(_TIMES * float(beside.max(initial=0.0)), _NOTHING * scale) and steps > 2:
            joint = inspection.rows.joints[rows.joint_of_row[row]]
            yield Finding(
                "drives", joint.owner,
                f"it jumps by {size:.4g} {'rad' if turning[row] else 'm'} in the step to "
                f"t = {t_end * step / steps:.6g} s",
                "let it change smoothly over many steps (SmoothStep, Spline)",
            )  # fmt: skip
    inspection.rows.at(0.0)


def _one(targets: Callable[[int], FloatArray], row: int, step: int) -> float:
    return float(targets(step)[row])


def _largest(
    value: Callable[[int], float], looks: IntArray, values: FloatArray
) -> tuple[float, int]:
    """Largest change within a step, and the number of that step, found by halving."""
    k = int(np.argmax(np.abs(np.diff(values))))
    (low, high), (left, right) = looks[k : k + 2].tolist(), values[k : k + 2].tolist()
    while high - low > 1:
        middle = (low + high) // 2
        between = value(middle)
        if abs(between - left) > abs(right - between):
            high, right = middle, between
        else:
            low, left = middle, between
    return abs(right - left), high
