# SPDX-License-Identifier: LGPL-3.0-or-later
"""Forces of a system that depend on both ends of a step, or that elements and rows do not have."""

from __future__ import annotations

import numpy as np

from flexfem.contact.barrier.contacts import BarrierContacts
from flexfem.contact.contacts import Contacts
from flexfem.core.state import State
from flexfem.gradients.equations.unilateral import Unilateral
from flexfem.gradients.unilateral.barriers import Barriers
from flexfem.gradients.unilateral.penalties import Penalties
from flexfem.gradients.unilateral.stops import Stops
from flexfem.integrators.split.step import Split
from flexfem.system.system import System

__all__ = [
    "barriers", "leave_out_barriers", "leave_out_contacts", "recall_penalties",
    "unilateral_forces",
]  # fmt: skip


def unilateral_forces(system: System, split: Split | None) -> list[Unilateral]:
    """Derivatives of these, some of which act by impulses (collective)."""
    found: list[Unilateral] = []
    if split is not None and split.limited:
        found.append(Stops(system, split))
    for contacts in system.contacts:
        if isinstance(contacts, BarrierContacts):
            found.append(Barriers(system, contacts))
        else:
            found.append(Penalties(system, contacts))
    return found


def barriers(system: System) -> list[BarrierContacts]:
    """Contacts of a system by barriers."""
    return [one for one in system.contacts if isinstance(one, BarrierContacts)]


def leave_out_barriers(system: System, *, rubbing: bool = False) -> None:
    """Let barriers, or those that rub alone, have no forces in a step that has begun."""
    for contacts in barriers(system):
        if contacts.rubs or not rubbing:
            contacts.factor = 0.0


def leave_out_contacts(system: System) -> None:
    """Let no contacts act, whatever overlaps."""
    for part in system.parts:
        if part.contacts is not None:
            part.contacts.acts = False


def recall_penalties(motion: System, system: System, state: State) -> None:
    """Give penalties the sides of surfaces of a motion's state, and a stiffness chosen as its own.

    Their nodes are at that state. The stiffness is that of their own model, chosen for the same
    step as the motion's: one that is automatic depends on the size of its first step, and steps are
    visited from the last one on (collective).

    Args:
        motion: system of the motion.
        system: that of another model.
        state: of the motion.
    """
    for own, contacts in zip(motion.contacts, system.contacts, strict=True):
        if isinstance(contacts, Contacts) and isinstance(own, Contacts):
            if own.inertia is not None:
                contacts.prepare(own.inertia)
            stiffness = contacts.stiffness
            contacts.restore(state)
            # none is chosen at the start, whose energy is reported without it
            contacts.set_stiffness(np.where(contacts.stiffness == 0.0, 0.0, stiffness))
