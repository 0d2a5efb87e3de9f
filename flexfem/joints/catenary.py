# SPDX-License-Identifier: LGPL-3.0-or-later
"""Elastic cable that hangs under its weight between two points."""

from collections.abc import Sequence

import numpy as np

from flexfem._fields import declared, number, vector
from flexfem.core.joint import Joint, distance, unit
from flexfem.core.laws import Law, LawKind
from flexfem.core.pose import Pose
from flexfem.core.row import Row, RowKind, Term

__all__ = ["Catenary"]


@declared
class Catenary(Joint):
    """An elastic cable with weight that hangs between two markers: the exact elastic catenary.

    It has the forces and the stiffness of the equilibrium between its ends (Irvine 1981, "Cable
    Structures", chapter 2), taut or slack, and no inertia: waves along a cable need beams with
    little bending stiffness. Its energy, of strain and of its weight above marker a's height zero,
    counts as strain energy. The weight acts in full from the start, also where statics let gravity
    grow.

    Attributes:
        length: unstretched, m.
        weight: of the cable per unstretched length, N/m.
        axial_stiffness: EA, N.
        up: direction against gravity, inertial axes; any length but zero.

    Raises:
        TypeError: an argument is not a number.
        ValueError: a number is not positive, or the direction is zero.
    """

    length: float = number(positive=True)
    weight: float = number(positive=True)
    axial_stiffness: float = number(positive=True)
    up: Sequence[float] = vector(default=(0.0, 0.0, 1.0), nonzero=True, as_given=True)

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`; raises ValueError when both markers start at one point."""
        distance(self.owner, poses)
        data = np.array([self.length, self.axial_stiffness, 0.0])
        term = Term(RowKind.CATENARY, u=self.weight * unit(self.up), v=data)
        return (Row((term,), 0.0, Law(LawKind.POTENTIAL, first=1.0)),)
