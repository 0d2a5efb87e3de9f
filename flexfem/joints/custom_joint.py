# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joint whose constraints are a function of the user's."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from flexfem.core.joint import Joint
from flexfem.core.pose import Pose
from flexfem.core.row import Row, RowKind, Term
from flexfem.core.user_function import FunctionKind, UserFunction

__all__ = ["CustomJoint"]


@dataclass(frozen=True, eq=False)
class CustomJoint(Joint):
    """Keeps functions of the relative position and rotation of its markers at zero.

    The function is plain Python with arithmetic on numbers and the functions of ``math`` or NumPy.
    It is compiled, its first and second derivatives by hyper-dual numbers, and called in the same
    loops as the joints of the package. A constraint in metres has a multiplier in newtons.

    Attributes:
        function: ``function(p, R)`` or ``function(p, R, parameters)`` that returns a number or a
            tuple of numbers, each of which is kept at zero; their number is constant. ``p`` are the
            three coordinates of marker b in the axes of marker a (m), ``R[i][j]`` the component
            along axis i of marker a of axis j of marker b.
        parameters: up to eight numbers that the function is given as a tuple. Functions are
            compiled once and can be shared by joints with other parameters.
    """

    function: Callable[..., float | tuple[float, ...]] = lambda p, R: p
    parameters: Sequence[float] = ()

    def __post_init__(self) -> None:
        """Check the function and the parameters.

        Raises:
            TypeError: the function is none, or parameters are no numbers.
            ValueError: the function takes other arguments, or there are too many parameters.
        """
        super().__post_init__()
        _ = self._user

    @property
    def _user(self) -> UserFunction:
        kind = FunctionKind.POSE
        return UserFunction.checked(self.owner, "function", self.function, kind, self.parameters)

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`; raises ValueError where the function fails at the start."""
        a, b = poses
        user = self._user
        p = tuple((a.rotation.T @ (b.position - a.position)).tolist())
        R = tuple(tuple(row) for row in (a.rotation.T @ b.rotation).tolist())
        count = len(user.tried(p, R))
        return tuple(
            Row((Term(RowKind.FUNCTION, function=user, component=k),)) for k in range(count)
        )
