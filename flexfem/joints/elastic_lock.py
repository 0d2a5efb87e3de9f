# SPDX-License-Identifier: LGPL-3.0-or-later
"""Locks of those elastic coordinates that a body in a floating frame does not have."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexfem.core.joint import Joint
from flexfem.core.pose import Pose
from flexfem.core.row import Row, RowKind, Term

__all__ = ["ElasticLock"]


@dataclass(frozen=True, eq=False)
class ElasticLock(Joint):
    """Keeps an interface (b) as it is at rest relative to the floating frame (a) of its body.

    The axes of marker a are those of the body at rest. A body in one plane does not move out of it:
    the model adds the locks that its bodies need.

    Attributes:
        locked: constrained components of displacement (3) and rotation (3), as numbers from 0 to 5.
    """

    locked: Sequence[int] = ()

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`."""
        a, b = poses
        start, axes = a.rotation.T @ (b.position - a.position), np.eye(3)
        turned = a.rotation.T @ b.rotation
        rows = []
        for i in self.locked:
            if i < 3:
                rows.append(Row((Term(RowKind.ALONG, u=axes[i]),), float(start[i])))
                continue
            p, q = (i - 2) % 3, (i - 1) % 3
            rows.append(
                Row(
                    (
                        Term(RowKind.AXES, u=axes[q], v=turned[p].copy(), factor=0.5),
                        Term(RowKind.AXES, u=axes[p], v=turned[q].copy(), factor=-0.5),
                    )
                )
            )
        return tuple(rows)
