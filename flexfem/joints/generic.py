# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joint with any of six relative degrees of freedom."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from flexfem import _checks
from flexfem.core.joint import Joint, check_limits, equal_rotation, turn_angles
from flexfem.core.laws import Law, limit
from flexfem.core.pose import Pose
from flexfem.core.row import Row, RowKind, Term

__all__ = ["Generic"]

_TRANSLATIONS, _ROTATIONS = ("x", "y", "z"), ("rx", "ry", "rz")


@dataclass(frozen=True, eq=False)
class Generic(Joint):
    """Leaves chosen relative degrees of freedom in the axes of marker a, and fixes the others.

    Fixed translations keep the origin of b on the planes, line or point through that of a. Of the
    rotations, with none free the relative rotation stays as at the start; one free rotation is
    about that axis of a, which stays common to both markers; two free are those of a universal
    joint with one arm along the first free axis of a, the other fixed in b along the second at the
    start.

    Attributes:
        free: free degrees of freedom, any of "x", "y", "z" (along the axes of marker a) and "rx",
            "ry", "rz" (about them).
        limits: stops on free ones: (lower, upper, stiffness, damping), see ``LimitStop``; lower or
            upper may be None. Displacements (m) are components in the axes of marker a, angles
            (rad) those between the projections of the axes of both markers, from the start.
    """

    free: Sequence[str] = ()
    limits: Mapping[str, tuple[float | None, float | None, float, float]] = field(
        default_factory=dict
    )

    def __post_init__(self) -> None:
        """Check degrees of freedom and limits.

        Raises:
            TypeError: degrees of freedom are no list of names, limits no mapping, or a limit is not
                a number.
            ValueError: an unknown degree of freedom or one given twice, a limit on a fixed one or
                without sense.
        """
        super().__post_init__()
        _checks.instance(self.owner, "free", self.free, (list, tuple))
        _checks.instance(self.owner, "limits", self.limits, Mapping)
        for name in self.free:
            if name not in (*_TRANSLATIONS, *_ROTATIONS) or list(self.free).count(name) > 1:
                raise ValueError(
                    f"{self.owner}: free must name x, y, z, rx, ry or rz once each, got "
                    f"{_checks.show(name)}"
                )
        for name, values in self.limits.items():
            if name not in self.free:
                raise ValueError(f'{self.owner}: limits on "{name}", which is not free')
            if not isinstance(values, (tuple, list)) or len(values) != 4:
                shown = _checks.show(values)
                raise ValueError(f'{self.owner}: limits on "{name}" must be four, got {shown}')
            check_limits(self.owner, *values)

    def _law(self, name: str) -> Law | None:
        return limit(*self.limits[name]) if name in self.limits else None

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`."""
        a, b = poses
        rows = []
        for name, e in zip(_TRANSLATIONS, np.eye(3), strict=True):
            if name not in self.free or name in self.limits:
                rows.append(Row((Term(RowKind.ALONG, u=e),), 0.0, self._law(name)))
        turning = [i for i, name in enumerate(_ROTATIONS) if name in self.free]
        axes, relative = np.eye(3), a.rotation.T @ b.rotation
        if not turning:
            rows += equal_rotation(a, b)
        elif len(turning) == 1:
            k = turning[0]
            rows += [
                Row((Term(RowKind.AXES, u=axes[i], v=relative[k].copy()),))
                for i in range(3)
                if i != k
            ]
        elif len(turning) == 2:
            i, j = turning
            rows.append(Row((Term(RowKind.AXES, u=axes[i], v=relative[j].copy()),)))
        angles = turn_angles(a, b)
        for k in turning:
            law = self._law(_ROTATIONS[k])
            if law is not None:
                rows.append(Row((angles[k],), 0.0, law))
        return tuple(rows)
