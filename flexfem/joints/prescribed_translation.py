# SPDX-License-Identifier: LGPL-3.0-or-later
"""Prescribed relative translation."""

from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._fields import declared, vector
from flexfem._types import FloatArray
from flexfem.core.joint import Joint, unit
from flexfem.core.pose import Pose
from flexfem.core.row import Row, RowKind, Term

__all__ = ["PrescribedTranslation"]


@declared
class PrescribedTranslation(Joint):
    """Drives the position of marker b relative to marker a; one or three constraints.

    Attributes:
        displacement: function of time (s); with an ``axis`` the displacement along it (m), else the
            displacement vector (m), shape (3,), in the axes of marker a. Added to the position at
            the start.
        axis: direction fixed in marker a, given in inertial axes at the start; None for all three
            components.

    Raises:
        TypeError: the displacement is not a function.
        ValueError: the axis is zero, or the displacement at t = 0 has the wrong shape.
    """

    displacement: Callable[[float], npt.ArrayLike] = lambda t: 0.0
    axis: Sequence[float] | None = vector(default=None, nonzero=True, as_given=True)

    driven: ClassVar[bool] = True

    def __post_init__(self) -> None:
        """Check the function."""
        super().__post_init__()
        shape = () if self.axis is not None else (3,)
        _checks.function(self.owner, "displacement", self.displacement, shape)

    def turned(self, turns: Sequence[FloatArray]) -> Mapping[str, FloatArray]:
        """See :meth:`Joint.turned`."""
        return {} if self.axis is None else {"axis": turns[0] @ unit(self.axis)}

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`."""
        pairs = zip(self._directions(poses[0]), self.targets(poses, t), strict=True)
        return tuple(Row((Term(RowKind.ALONG, u=u),), target) for u, target in pairs)

    def targets(self, poses: Sequence[Pose], t: float) -> tuple[float, ...]:
        """See :meth:`Joint.targets`."""
        a, b = poses
        start = a.rotation.T @ (b.position - a.position)
        shape = (3,) if self.axis is None else ()
        values = np.atleast_1d(_checks.returned("displacement", self.displacement(t), shape))
        return tuple(
            float(u @ start + value) for u, value in zip(self._directions(a), values, strict=True)
        )

    def _directions(self, a: Pose) -> FloatArray:
        """Driven directions (1 or 3, 3) in the axes of marker a."""
        if self.axis is None:
            return np.eye(3)
        driven: FloatArray = (a.rotation.T @ unit(self.axis))[np.newaxis]
        return driven
