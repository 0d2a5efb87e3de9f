# SPDX-License-Identifier: LGPL-3.0-or-later
"""Force element whose law is a function of the user's."""

from collections.abc import Callable, Sequence

from flexfem._fields import declared, one_of
from flexfem.core.joint import AxisJoint, distance, turn_angle
from flexfem.core.laws import Law, custom
from flexfem.core.pose import Pose
from flexfem.core.row import Row, RowKind, Term

__all__ = ["CustomForce"]

_MOTIONS = ("distance", "translation", "rotation")


@declared
class CustomForce(AxisJoint):
    """Spring, damper or drive between two markers with any law ``F(x, v, t)``.

    A positive force pulls as a stretched spring does: it acts on marker b against a growing x, and
    the other way on marker a. The law is plain Python with arithmetic on numbers and the functions
    of ``math`` or NumPy; it is compiled with its derivatives by hyper-dual numbers, so that it may
    be stiff and enters the equations implicitly. Its work counts as work of applied forces in
    energy probes, since its stored part is unknown.

    Attributes:
        axis: fixed in marker a, inertial axes at the start; not needed for "distance".
        motion: meaning of x: "distance" of the markers (m), displacement of b from a along the axis
            for "translation" (m), or angle since the start about it for "rotation" (rad).
        force: ``force(x, v)``, ``force(x, v, t)`` or ``force(x, v, t, parameters)`` that returns N
            or N m; v is the rate of x, t the time in s.
        parameters: up to eight numbers that the function is given as a tuple. Functions are
            compiled once and can be shared by elements with other parameters.

    Raises:
        TypeError: the force is no function, or parameters are no numbers.
        ValueError: an unknown motion, a function of other arguments, too many parameters.
    """

    motion: str = one_of(_MOTIONS, default="distance")
    force: Callable[..., float] = lambda x, v: 0.0
    parameters: Sequence[float] = ()

    def __post_init__(self) -> None:
        """Check function and parameters."""
        super().__post_init__()
        _ = self._law

    @property
    def _law(self) -> Law:
        return custom(self.owner, self.force, self.parameters)

    def coordinate(self, poses: Sequence[Pose]) -> Term:
        """The distance (m), displacement (m) or angle (rad) that it acts on.

        Raises:
            ValueError: the distance is zero at the start.
        """
        a, b = poses
        if self.motion == "rotation":
            return turn_angle(self.direction, a, b)
        if self.motion == "distance":
            distance(self.owner, poses)
            return Term(RowKind.DISTANCE)
        return Term(RowKind.ALONG, u=a.rotation.T @ self.direction)

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`."""
        return (Row((self.coordinate(poses),), 0.0, self._law),)
