# SPDX-License-Identifier: LGPL-3.0-or-later
"""Smooth NURBS beams that lock in the shape that a run has bent them to."""

import numpy as np

from flexfem._types import FloatArray
from flexfem.inspection.checks.locking import stiffened
from flexfem.inspection.finding import owner_of
from flexfem.system.assembly import Assembly
from flexfem.system.placement import NURBS
from flexfem.system.system import System

__all__ = ["locked_shapes"]


def locked_shapes(serial: Assembly, system: System) -> list[str]:
    """A line for each beam that is too stiff as it is bent now, on every rank (collective)."""
    if serial.curves is None:
        return []
    points = _control_points(system, len(serial.curves.frames))
    return [
        f"{owner_of(beam)}: as it is bent at the end, its smooth elements lock: it is too stiff "
        f"there, by about {100.0 * min(share, 1.0):.1g} %; take its curve with_continuity(0), more "
        "elements or a higher degree"
        for beam, share in stiffened(serial.curves, points, bent=0.0)
    ]


def _control_points(system: System, count: int) -> FloatArray:
    """Present places (n, 3) of the control points of all curves, beam after beam (collective)."""
    points = np.zeros((count, 3))
    for part in system.parts:
        if part.kind == NURBS:
            own = slice(part.block.owned)
            points[part.block.node_ids[own]] = part.block.frames[own, :3]
    return np.asarray(system.comm.allreduce(points))
