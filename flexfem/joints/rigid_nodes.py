# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid connection of several nodes to one body."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from flexfem import _checks
from flexfem.core.joint import Joint, equal_rotation
from flexfem.core.marker import Attachment
from flexfem.core.pose import Pose
from flexfem.core.row import Row, RowKind, Term

__all__ = ["RigidNodes"]


@dataclass(frozen=True, eq=False)
class RigidNodes(Joint):
    """Keeps several markers as they are at the start relative to marker a; six constraints each.

    The markers need not coincide: forces reach marker a over rigid massless arms.

    Attributes:
        nodes: the markers that follow marker a, such as nodes of beams on a rigid hub.
    """

    b: Attachment = field(init=False)
    nodes: Sequence[Attachment] = ()

    def __post_init__(self) -> None:
        """Check the markers.

        Raises:
            TypeError: they are no list, or one of them is not a Marker or Ground.
            ValueError: there are none, or one is given twice.
        """
        _checks.instance(self.owner, "nodes", self.nodes, (list, tuple))
        if len(self.nodes) == 0:
            raise ValueError(f"{self.owner}: nodes must hold at least one marker, got none")
        _checks.assign(self, b=self.nodes[0])
        super().__post_init__()
        for k, node in enumerate(self.nodes):
            if any(node is other for other in (self.a, *self.nodes[:k])):
                raise ValueError(f"{self.owner}: nodes[{k}] is given twice, {node}")

    @property
    def places(self) -> tuple[tuple[str, Attachment], ...]:
        """See :attr:`Joint.places`."""
        return ("a", self.a), *((f"nodes[{k}]", node) for k, node in enumerate(self.nodes))

    @property
    def pairs(self) -> tuple[tuple[int, int], ...]:
        """See :attr:`Joint.pairs`."""
        return tuple((0, k + 1) for k in range(len(self.nodes)))

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`."""
        a, *others = poses
        rows: list[Row] = []
        for k, b in enumerate(others, start=1):
            arm = a.rotation.T @ (b.position - a.position)
            rows += [Row((Term(RowKind.ALONG, u=e, b=k),), float(e @ arm)) for e in np.eye(3)]
            rows += equal_rotation(a, b, number=k)
        return tuple(rows)
