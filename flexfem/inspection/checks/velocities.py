# SPDX-License-Identifier: LGPL-3.0-or-later
"""Initial velocities that joints and drives do not allow."""

from collections.abc import Iterator

import numpy as np

from flexfem._types import FloatArray
from flexfem.analyses.modes import StateOptions
from flexfem.inspection.finding import Finding
from flexfem.inspection.inspection import Inspection

#: Span over which drives are differentiated, s, and in time steps, the shorter one.
_STEP, _PART = 1e-5, 1e-2
#: Speed, relative to the largest of all nodes and drives, that is taken for rounding, and the same
#: for what differences of drives leave, relative to the size of the model in a second.
_ROUNDING, _NOTHING = 1e-3, 1e-6


def find(inspection: Inspection) -> Iterator[Finding]:
    """The joints of a motion whose rows change at the start."""
    if inspection.moves is False or isinstance(inspection.options, StateOptions):
        return
    rests = not any(family.moving for family in inspection.serial.families.values())
    if rests and not inspection.rows.driven:
        return
    rows = inspection.rows.rows
    rates = np.where(rows.rigid, rows.rates() + drive_rates(inspection), 0.0)
    turning = inspection.turning
    way = np.abs(rates) * np.where(turning, inspection.scale, 1.0)
    scale = max(_fastest(inspection), float(way.max(initial=0.0)))
    wrong = way > max(_ROUNDING * scale, _NOTHING * inspection.scale)
    for number in np.unique(rows.joint_of_row[wrong]):
        own = np.flatnonzero(wrong & (rows.joint_of_row == number))
        row, joint = own[np.argmax(way[own])], inspection.rows.joints[number]
        unit = "rad/s" if turning[row] else "m/s"
        cause = "its drive and the initial velocities" if joint.driven else "initial velocities"
        yield Finding(
            "velocities", joint.owner,
            f"{cause} differ by {abs(rates[row]):.4g} {unit} at the start",
            "a run begins with the nearest consistent velocities; give consistent ones, or let the "
            "drive begin smoothly (SmoothStep)",
        )  # fmt: skip


def drive_rates(inspection: Inspection) -> FloatArray:
    """(r,) rates of the rows by drives at the start, at constant positions.

    Exact for motions of third degree: a smooth step begins with none.
    """
    if not inspection.rows.driven:
        return np.zeros(inspection.rows.rows.size)
    values, h = [], min(_STEP, _PART * getattr(inspection.options, "dt", 1.0))
    for k in range(4):
        inspection.rows.at(k * h)
        values.append(inspection.rows.rows.values.copy())
    inspection.rows.at(0.0)
    total = -11.0 * values[0] + 18.0 * values[1] - 9.0 * values[2] + 2.0 * values[3]
    return np.asarray(total / (6.0 * h))


def _fastest(inspection: Inspection) -> float:
    """Largest speed of nodes with joints; rotations count as angle times model size, m/s."""
    twists = np.abs(inspection.rows.rows.interface.velocities)
    turn = inspection.scale * float(twists[:, 3:].max(initial=0.0))
    return max(float(twists[:, :3].max(initial=0.0)), turn)
