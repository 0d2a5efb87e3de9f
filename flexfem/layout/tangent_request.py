# SPDX-License-Identifier: LGPL-3.0-or-later
"""Request to a family of elements: the stresses and the velocities of a tangent."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from flexfem._types import FloatArray

__all__ = ["EXACT", "Strains", "TangentRequest"]

#: Strains of all cells of a family, an array for each of its groups; the shape depends on the
#: family.
Strains = Sequence[FloatArray]


@dataclass(frozen=True)
class TangentRequest:
    """The residual or tangent that a family is to compute.

    Attributes:
        strains: Strains whose stresses replace the present ones, see
            ``ElementFamily.continued_strains`` and ``unstressed``; None for the present stresses.
        drop_compression: Omit compressive principal membrane forces from the tangent, if the family
            supports it. Compression is transient, and factors of a matrix that it makes nearly
            singular soon become useless.
        local: Take the derivative at fixed local velocities and accelerations.
    """

    strains: Strains | None = None
    drop_compression: bool = False
    local: bool = False

    def of_group(self, k: int) -> FloatArray | None:
        """Strains of group ``k``, None for the present ones."""
        return None if self.strains is None else self.strains[k]


#: The consistent tangent at the present stresses.
EXACT = TangentRequest()
