# SPDX-License-Identifier: LGPL-3.0-or-later
"""Lock of a joint."""

from collections.abc import Sequence

from flexfem._fields import declared, flag
from flexfem.core.joint import Joint, JointAction
from flexfem.core.pose import Pose
from flexfem.core.row import Row, RowKind

__all__ = ["Lock"]


@declared
class Lock(JointAction):
    """Constrains the motion that another joint leaves, while it is locked; no effect when released.

    It is switched during a run by events, which lock it in the position reached.

    Attributes:
        joint: the joint to be locked; in the model too.
        motion: "translation" along or "rotation" about its axis; None for all that it leaves.
        locked: True if it is locked at the start.

    Raises:
        TypeError: ``joint`` is none, or ``locked`` is not a truth value.
        ValueError: the joint leaves no such motion.
    """

    locked: bool = flag(default=False)

    @property
    def partner(self) -> Joint:
        """See :attr:`Joint.partner`."""
        return self.joint

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`."""
        a, b = poses
        apart = a.rotation.T @ (b.position - a.position)
        return tuple(
            Row(
                (term,),
                float(term.u @ apart) if term.kind is RowKind.ALONG else 0.0,
                switchable=True,
                locked=self.locked,
            )
            for term in self.terms(poses)
        )
