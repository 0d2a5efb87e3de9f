# SPDX-License-Identifier: LGPL-3.0-or-later
"""Work of accelerations that damping has ended at a start, which is what damping takes.

A motion that begins with the accelerations w in place of a, see ``integrators.start``, lacks the
forces ``y = M (w - a)`` in the balance of its start: as if damping had the forces -y there already,
which it has as soon as the accelerations have ended. Over the first step, of increments n, the mean
forces of both ends do the work ``n y / 2``, which is in no energy and in no other account: without
it a bar that is loaded at once lost a tenth to three quarters of its energy nowhere. Schemes that
do not go on with the accelerations of the start have no such work.
"""

from collections.abc import Sequence

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.state import State
from flexfem.system.system import System

__all__ = ["count_ended", "ended_state", "keep_ended", "restore_ended"]


def keep_ended(system: System, forces: Sequence[FloatArray]) -> None:
    """Keep the forces y (n_owned, width) of each part, in the axes of nodes, for the next step."""
    system.ended = _nothing(system)
    for part, kept, own in zip(system.parts, system.ended, forces, strict=True):
        kept[: part.block.owned, : part.block.width] = own


def count_ended(system: System) -> None:
    """Count the work in the step from the accepted to the trial state, which is to be accepted."""
    if not system.ended:
        return
    for part, forces, withheld in zip(system.parts, system.ended, system.withheld, strict=True):
        block, own = part.block, forces[: part.block.owned]
        if not own.any():
            continue
        way = block.increment[: block.owned].copy()
        if block.inertial:
            turns = block.frames0[: block.owned, 3:].reshape(-1, 3, 3)
            way[:, :3] = np.einsum("nji,nj->ni", turns, way[:, :3])
        withheld[:] += 0.5 * np.einsum("ni,ni->n", own, way)
    system.ended = []


def ended_state(system: System) -> State:
    """The forces, which count in the next step; of systems that may have some (collective)."""
    if not system.may_decay():
        return State()
    rows = zip(system.parts, system.ended or _nothing(system), strict=True)
    return State({}, {part.block.name: {"ended": own} for part, own in rows})


def restore_ended(system: System, state: State) -> None:
    """Restore a result of :func:`ended_state` (collective)."""
    if system.may_decay():
        system.ended = [state.rows[part.block.name]["ended"].copy() for part in system.parts]


def _nothing(system: System) -> list[FloatArray]:
    return [np.zeros_like(part.block.step) for part in system.parts]
