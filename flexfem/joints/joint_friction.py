# SPDX-License-Identifier: LGPL-3.0-or-later
"""Friction in a joint."""

from collections.abc import Callable, Sequence

from flexfem import _checks
from flexfem._fields import declared, number
from flexfem.core.joint import Joint, JointAction
from flexfem.core.laws import friction
from flexfem.core.pose import Pose
from flexfem.core.row import Row
from flexfem.core.user_function import FunctionKind, UserFunction

__all__ = ["JointFriction"]


@declared
class JointFriction(JointAction):
    """Regularised Coulomb friction and viscous drag on the motion that another joint leaves.

    It acts against the relative velocity v with ``F_c tanh(v / v_0) + c v``, where ``F_c`` is
    given, or ``mu N``, or ``mu r N`` for a rotation; N is the resultant of the joint's constraint
    forces at its markers. Sticking surfaces creep at less than ``v_0``.

    Attributes:
        joint: the joint with friction; in the model too.
        motion: "translation" along or "rotation" about its axis; None if it leaves only one.
        force: F_c, N or N m, or a function of abs(v) that returns it; None with a coefficient.
        coefficient: mu, or a function of abs(v) that returns it (a Stribeck curve, for example);
            None with a force. Functions are plain Python with arithmetic on numbers and the
            functions of ``math``, NumPy or UFL, compiled with their derivatives, or a `Curve`.
        radius: r of the rubbing surface, m; for a rotation with a coefficient.
        velocity: v_0, m/s or rad/s.
        viscous: c, N s/m or N m s/rad.

    Raises:
        TypeError: an argument has the wrong type.
        ValueError: the joint leaves no such motion, not just one of force and coefficient, a
            negative number, ``v_0`` not positive, a radius missing or out of place.
    """

    force: float | Callable[[float], float] | None = None
    coefficient: float | Callable[[float], float] | None = None
    radius: float | None = None
    velocity: float = number(default=1e-3, positive=True, as_given=True)
    viscous: float = number(default=0.0, nonnegative=True, as_given=True)

    def __post_init__(self) -> None:
        """Check the arguments against one another."""
        super().__post_init__()
        if len(self.motions) != 1:
            raise ValueError(
                f"{self.owner}: motion must be translation or rotation, got {self.motion}"
            )
        if (self.force is None) == (self.coefficient is None):
            raise ValueError(
                f"{self.owner}: needs either force or coefficient, got {self.force} and "
                f"{self.coefficient}"
            )
        for what in ("force", "coefficient"):
            value = getattr(self, what)
            if callable(value):
                _ = self._user(what)
            elif value is not None:
                _checks.number(self.owner, what, value, nonnegative=True)
        arm = self.coefficient is not None and self.motions == ("rotation",)
        if arm:
            _checks.number(self.owner, "radius", self.radius, positive=True)
        elif self.radius is not None:
            raise ValueError(
                f"{self.owner}: radius goes with the coefficient of a rotation, got {self.radius}"
            )

    def _user(self, what: str) -> UserFunction | None:
        """The function that gives the force or the coefficient, None where it is a number."""
        value = getattr(self, what)
        if not callable(value):
            return None
        return UserFunction.checked(self.owner, what, value, FunctionKind.SPEED)

    @property
    def partner(self) -> Joint:
        """See :attr:`Joint.partner`."""
        return self.joint

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`."""
        arm = 1.0 if self.radius is None else self.radius
        normal = self.coefficient is not None
        what = "coefficient" if normal else "force"
        user, size = self._user(what), getattr(self, what)
        factor = arm if user is not None else arm * (size or 0.0)
        law = friction(factor, self.velocity, self.viscous, normal, user)
        return tuple(Row((term,), 0.0, law) for term in self.terms(poses))
