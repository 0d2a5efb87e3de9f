# SPDX-License-Identifier: LGPL-3.0-or-later
"""Penalty contacts whose nodes sink in by less than the tolerance of steps while they rub.

Steps end when corrections are below the tolerance: normal forces of nodes that sink in by less are
any. Without friction a wrong one is made good by the next ones; with friction what was rubbed
away too much or too little stays.
"""

import numpy as np

from flexfem.contact.contacts import Contacts
from flexfem.system.system import System

__all__ = ["ShallowContacts"]


class ShallowContacts:
    """Mean penetrations, weighted by forces, of the penalty contacts of a model with friction."""

    def __init__(self, system: System, tolerance: float) -> None:
        """Find the contacts; ``tolerance`` is that of steps, m."""
        self._system, self._tolerance = system, tolerance
        self._groups = [
            group
            for contacts in system.contacts
            if isinstance(contacts, Contacts)
            for group in contacts.groups
            if group.surfaces.contact.friction > 0.0
        ]
        # forces, N, and forces times penetrations, J, of all steps
        self._sums = np.zeros((len(self._groups), 2))

    def look(self) -> None:
        """Look at the accepted state of this rank."""
        for number, group in enumerate(self._groups):
            for made in group.every:
                pushes, stiffness = made.closed.pushes, made.closed.stiffness
                self._sums[number] += pushes.sum(), pushes @ (pushes / stiffness)

    def texts(self) -> list[str]:
        """Warnings, the same on every rank (collective)."""
        sums = np.empty_like(self._sums)
        self._system.comm.Allreduce(self._sums, sums)
        return [
            _text(group.surfaces.contact.name, work / force, self._tolerance)
            for group, (force, work) in zip(self._groups, sums, strict=True)
            if work < self._tolerance * force
        ]


def _text(name: str, depth: float, tolerance: float) -> str:
    return (
        f'Contact "{name}": nodes that rub sink in by {depth:.1e} m, weighted by their forces, '
        f"less than the tolerance of {tolerance:g} m up to which steps are solved: forces and "
        "friction may be off by some per cent; use a smaller tolerance"
    )
