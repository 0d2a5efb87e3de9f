# SPDX-License-Identifier: LGPL-3.0-or-later
"""Clamped connection along a line of a shell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.core.joint import Joint, perpendicular, unit
from flexfem.core.node_row import NodeRow
from flexfem.core.pose import Pose
from flexfem.core.row import Row, RowKind, Term
from flexfem.joints.hinge_line import HingeLine, LinePart

__all__ = ["ClampedLine"]

#: Stands for the line and what carries it among the numbers of nodes.
_BODY = -1


@dataclass(frozen=True, eq=False)
class ClampedLine(HingeLine):
    """Joins a line of a shell to that of another, or to a body or the ground, without a hinge.

    To what ``HingeLine`` holds it adds one constraint a segment of the line with more nodes: the
    triangles on both sides keep the angle between them about this segment. Segments whose triangles
    are held by others already, as of two that share their third node, are left out.

    The triangles at the line do not bend: what is lost is the bending of one row of them, which
    vanishes nearly in proportion to their size where a mesh is refined in both directions. With two
    cells across a strip and ever more along it, the error of its deflection does not vanish: it was
    0.8 % at the finest mesh and growing.
    """

    def parts(self, lines: Sequence[NodeRow | None]) -> Sequence[Joint]:
        """See :meth:`Joint.parts`."""
        parts = list(super().parts(lines))
        first, second = lines
        assert first is not None
        if second is None:
            ends = [(k, int(apex), _BODY) for k, apex in enumerate(first.apexes)]
            held = _independent(ends, first.nodes)
            return parts + [
                LinePart(
                    self.name, self.b, first.middle(k), self, _Angle(first.sides[k]), swapped=True
                )
                for k in held
            ]
        fine, coarse = (first, second) if first.count >= second.count else (second, first)
        middles = 0.5 * (fine.points[1:] + fine.points[:-1])
        found = [coarse.closest(x)[0] for x in middles]
        ends = [
            (k, int(apex), int(coarse.apexes[at]))
            for k, (apex, at) in enumerate(zip(fine.apexes, found, strict=True))
        ]
        for k in _independent(ends, np.append(fine.nodes, coarse.nodes)):
            ends_of = coarse.middle(found[k]), fine.middle(k)
            angle = _Angle(fine.sides[k])
            parts.append(LinePart(self.name, *ends_of, self, angle, swapped=fine is first))
        return parts


@dataclass(frozen=True)
class _Angle:
    """Row that keeps the angle about a segment.

    Attributes:
        side: (3,) vector along the segment at the start.
    """

    side: FloatArray

    def __call__(self, poses: Sequence[Pose]) -> tuple[Row, ...]:
        """Products of two directions at right angles to the segment and to one another."""
        u, v = perpendicular(unit(self.side))
        a, b = poses
        return (Row((Term(RowKind.AXES, u=a.rotation.T @ u, v=b.rotation.T @ v),)),)


def _independent(ends: Sequence[tuple[int, int, int]], carried: IntArray) -> list[int]:
    """Segments whose angles do not follow from those of others.

    Args:
        ends: segment and the third nodes of the triangles on both sides, which a held angle ties.
        carried: nodes on the line, which move with it whatever the angles.
    """
    root = {node: node for _, *pair in ends for node in pair}
    root.update(dict.fromkeys((*carried.tolist(), _BODY), _BODY))

    def find(node: int) -> int:
        while root[node] != node:
            node = root[node]
        return node

    chosen = []
    for segment, *pair in ends:
        first, second = (find(node) for node in pair)
        if first != second:
            # the line and the body stay the root of what they carry
            root[max(first, second)] = min(first, second)
            chosen.append(segment)
    return chosen
