# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sliding joint along a line."""

from collections.abc import Sequence

from flexfem import _checks
from flexfem._fields import declared, flag, number
from flexfem.core.joint import Joint, displacement, equal_rotation
from flexfem.core.marker import Carrier
from flexfem.core.pose import Pose
from flexfem.core.row import Row, RowKind, Term

__all__ = ["Sliding"]


@declared
class Sliding(Joint):
    """Marker b slides on a line of a body; two constraints, five when tied.

    The force is at right angles to the deformed line. The position of the slider is its arc length
    zeta (m) from the carrier's start in the undeformed state; ``SlideStop``, ``PrescribedSlide``,
    ``JointFriction`` and ``Lock`` with this joint act on zeta. A slider that leaves its carrier
    ends the run as failed, unless a ``SlideStop`` keeps it near the end or an event acts before;
    ``beyond`` lets it continue, along the continuation of the line's last element.

    The lines of NURBS beams of degree 2 and more are smooth. Those of SE(3) beams have a kink at a
    node of the difference of the shear strains on both sides, the shear force's jump over GA (1e-3
    rad in a thin rubber beam): a slider that passes at speed gets an impulse of that size, its
    momentum times this angle. NURBS beams of degree 2 are the choice for wires and cables: a weight
    of 5 N moved slowly along a rubber cable with 30 N of tension meets corners of 0.011 rad on
    SE(3) elements, none on NURBS elements; in a steel wire, whose corners are negligible, its path
    over coarse elements is ten times smoother.

    Attributes:
        a: ``Carrier``: a beam, or a line of a rigid body or of a body in a floating frame.
        b: marker that slides; on the line at the start.
        tied: it keeps its rotation relative to the carrier's section (prismatic joint).
        beyond: largest distance beyond either end of the carrier, m.

    Raises:
        TypeError: a is not a ``Carrier``, b not a marker on something else, or ``tied`` not
            a truth value.
        ValueError: the name is empty, or ``beyond`` negative.
    """

    a: Carrier
    tied: bool = flag(default=False)
    beyond: float = number(default=0.0, nonnegative=True, as_given=True)

    slides = True
    leaves = ("translation",)

    def __post_init__(self) -> None:
        """Check that a line slides on something else."""
        super().__post_init__()
        _checks.instance(self.owner, "a", self.a, Carrier)
        if isinstance(self.b, Carrier):
            raise TypeError(f'{self.owner}: b must be a Marker or Ground, got Carrier "{self.b}"')

    def motion_term(self, kind: str, poses: Sequence[Pose]) -> Term:
        """See :meth:`Joint.motion_term`: zeta."""
        return Term(RowKind.ARC)

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`."""
        a, b = poses
        across = tuple(displacement(a.rotation[:, i], a) for i in (1, 2))
        rotation = equal_rotation(a, b) if self.tied else ()
        return (*across, *rotation)
