# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid connection of points of several bodies to one body."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexfem.core.pose import Pose
from flexfem.core.row import Row, RowKind, Term
from flexfem.joints.rigid_nodes import RigidNodes

__all__ = ["RigidPoints"]


@dataclass(frozen=True, eq=False)
class RigidPoints(RigidNodes):
    """Keeps the positions of several markers fixed to marker a; three constraints each.

    A surface of a solid is bonded to a body by all of its nodes, which have no axes:
    ``nodes=solid.node_markers("surface")``. Forces reach marker a over rigid massless arms; a
    :class:`ReactionProbe` has the resultant of all on marker a's body.

    Attributes:
        nodes: the markers whose positions follow marker a.
    """

    @property
    def second(self) -> int:
        """See :attr:`Joint.second`: marker a, on which all points act."""
        return 0

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`."""
        a, *others = poses
        rows: list[Row] = []
        for k, b in enumerate(others, start=1):
            arm = a.rotation.T @ (b.position - a.position)
            rows += [Row((Term(RowKind.ALONG, u=e, b=k),), float(e @ arm)) for e in np.eye(3)]
        return tuple(rows)
