# SPDX-License-Identifier: LGPL-3.0-or-later
"""Locking of smooth NURBS beams in the shape at the end of a run."""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.families.beam_nurbs.curves import NurbsLines
from flexfem.families.beam_nurbs.elements import NurbsBeams
from flexfem.families.beam_nurbs.family import NurbsBeamFamily
from flexfem.inspection.checks.locking import excess, percent, stiffened
from flexfem.inspection.finding import owner_of
from flexfem.layout.numbered_model import NumberedModel
from flexfem.system.system import System

__all__ = ["locked_shapes"]


def locked_shapes(serial: NumberedModel, system: System) -> list[str]:
    """A line for each beam that locks in its present shape, on every rank (collective)."""
    family = serial.family(NurbsBeamFamily)
    if family is None:
        return []
    curves = family.curves
    return [
        f"{owner_of(beam)}: its smooth elements lock in the final shape, where it is too stiff by "
        f"about {percent(share)} %; use its curve with_continuity(0), more elements or a higher "
        "degree"
        for beam, share in stiffened(curves, system.comm.allreduce(_own_excess(curves, system)))
    ]


def _own_excess(curves: NurbsLines, system: System) -> FloatArray:
    """Energies of every beam (n, 2) in the elements of this rank."""
    points = np.zeros((len(curves.frames), 3))
    cells: list[IntArray] = [np.empty(0, dtype=np.int64) for _ in curves.beams]
    for part in system.parts:
        if not isinstance(part.elements, NurbsBeams):
            continue
        ids = np.asarray(part.block.node_ids)
        points[ids] = part.block.frames[:, :3]
        groups = part.elements.connectivity
        first = np.concatenate([ids[group[:, 0]] for group in groups])  # each begins at another
        for beam, (parts, start) in enumerate(zip(curves.parts, curves.first_node, strict=False)):
            cells[beam] = np.flatnonzero(np.isin(parts.nodes[:, 0] + start, first))
    return excess(curves, points, 0.0, cells)
