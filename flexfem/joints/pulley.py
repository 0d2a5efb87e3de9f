# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rope over two pulleys."""

from collections.abc import Sequence

from flexfem._fields import declared, number
from flexfem.core.joint import Joint, distance
from flexfem.core.marker import Attachment
from flexfem.core.pose import Pose
from flexfem.core.row import Row, RowKind, Term

__all__ = ["Pulley"]


@declared
class Pulley(Joint):
    """Massless rope that does not stretch, from b over a and c to d; one constraint.

    The distance of b from a plus ratio times that of d from c keeps its initial value. The pulleys
    are points, and the rope is taut: it pushes as a rod does where the multiplier, the tension of
    the part from a to b (N), is negative. That of the other part is ratio times as large.

    Attributes:
        c: third marker, the second pulley; may be on the body of a, or on the ground as well.
        d: fourth marker, the other end of the rope.
        ratio: length that a to b gives for one that c to d takes; 2 where the rope from c to d has
            two parts, as in a tackle.

    Raises:
        TypeError: a marker is none, or the ratio is not a number.
        ValueError: the ratio is not positive.
    """

    c: Attachment
    d: Attachment
    ratio: float = number(default=1.0, positive=True, as_given=True)

    @property
    def places(self) -> tuple[tuple[str, Attachment], ...]:
        """See :attr:`Joint.places`."""
        return ("a", self.a), ("b", self.b), ("c", self.c), ("d", self.d)

    @property
    def pairs(self) -> tuple[tuple[int, int], ...]:
        """See :attr:`Joint.pairs`."""
        return (0, 1), (2, 3)

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`; raises ValueError when an end starts at its pulley."""
        owner, ratio = self.owner, self.ratio
        first, other = distance(owner, poses), distance(owner, poses[2:], "c and d")
        terms = Term(RowKind.DISTANCE), Term(RowKind.DISTANCE, a=2, b=3, factor=ratio)
        return (Row(terms, first + ratio * other),)
