# SPDX-License-Identifier: LGPL-3.0-or-later
"""Inverted elements: solutions of the equations that are not physical.

Linear laws resist compression to zero length with a finite force. Beyond it the equations may have
further solutions, e.g. of an arm that rotates faster than it can bear.
"""

from dataclasses import dataclass

import numpy as np

from flexfem.inspection.finding import owner_of
from flexfem.layout.numbered_model import NumberedModel
from flexfem.system.system import System

__all__ = ["InsideOut", "inside_out"]

_DIGITS = 6


@dataclass(frozen=True, order=True)
class InsideOut:
    """The worst cell on this rank.

    Attributes:
        stretch: its size relative to that at the start, see ``ElementFamily.stretches``.
        kind, body: family and body of which it is a part.
    """

    stretch: float
    kind: int
    body: int

    @classmethod
    def worst(cls, system: System) -> "InsideOut | None":
        """The worst cell of this rank in the trial state, None if none is inverted."""
        found = []
        for part in system.parts:
            if part.elements is None or not len(part.elements.body):
                continue
            # round-off must not choose between equal bodies
            stretches = np.round(part.elements.stretches(part.block.frames), _DIGITS)
            least = float(stretches.min())
            if least <= 0.0:
                body = int(part.elements.body[stretches == least].min())
                found.append(cls(least, part.kind, body))
        return min(found, default=None)

    def text(self, serial: NumberedModel) -> str:
        """Body and stretch as text."""
        return (
            f"{owner_of(serial.body(self.kind, self.body))}: an element is inverted "
            f"(its size is {self.stretch:.3g} times that at the start)"
        )


def inside_out(serial: NumberedModel, system: System) -> str:
    """Text for an inverted element in the trial state, empty if there is none (collective)."""
    found = InsideOut.worst(system)
    every = [found] if system.comm.size == 1 else system.comm.allgather(found)
    worst = min((one for one in every if one is not None), default=None)
    return "" if worst is None else worst.text(serial)
