# SPDX-License-Identifier: LGPL-3.0-or-later
"""Spring and damper between two points."""

from collections.abc import Sequence

from flexfem import _checks
from flexfem._fields import declared, number
from flexfem.core.joint import Joint, distance
from flexfem.core.pose import Pose
from flexfem.core.row import Row, RowKind, Term, spring

__all__ = ["SpringDamper"]


@declared
class SpringDamper(Joint):
    """Linear spring and damper along the line between two markers.

    It pulls with ``stiffness * (length - rest_length) + damping * d(length)/dt`` (N) and enters the
    equations as a constraint with compliance, so that any stiffness leaves the frozen factors of
    the bodies as they are.

    Attributes:
        stiffness: N/m.
        damping: N s/m.
        rest_length: m; None for the distance at the start.

    Raises:
        TypeError: an argument is not a number.
        ValueError: stiffness, damping or rest length is negative, or both former are zero.
    """

    stiffness: float = 0.0
    damping: float = 0.0
    rest_length: float | None = number(default=None, nonnegative=True, as_given=True)

    def __post_init__(self) -> None:
        """Check that there is a spring or a damper."""
        super().__post_init__()
        _checks.stiffness_and_damping(self.owner, self.stiffness, self.damping)

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`; raises ValueError when both markers start at one point."""
        length = distance(self.owner, poses)
        rest = length if self.rest_length is None else self.rest_length
        law = spring(self.stiffness, self.damping)
        return (Row((Term(RowKind.DISTANCE),), rest, law),)
