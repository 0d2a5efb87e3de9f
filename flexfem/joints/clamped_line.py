# SPDX-License-Identifier: LGPL-3.0-or-later
"""Clamped connection along a line of a shell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.core.joint import Joint, perpendicular, turn_angle, unit
from flexfem.core.laws import Law, spring
from flexfem.core.node_row import NodeRow
from flexfem.core.pose import Pose
from flexfem.core.row import Row, RowKind, Term
from flexfem.joints.hinge_line import HingeLine, LinePart

__all__ = ["ClampedLine"]

#: Number of the line and its carrier among the numbers of nodes.
_BODY = -1


@dataclass(frozen=True, eq=False)
class ClampedLine(HingeLine):
    """Joins a line of a shell to that of another, or to a body or the ground, without a hinge.

    It adds to the constraints of ``HingeLine`` the bending of the shells at the line, as if they
    continued beyond it. Triangles of rotation-free shells are free of moments where their shell
    ends; rotating them about a segment of the line takes the moment ``2 D / d`` per angle and
    length, D being the bending stiffness across the line and d the height of the triangle. So one
    elastic row a segment of the line with more nodes acts on the angle between the slopes on both
    sides, with the stiffness of both in series: where meshes match it is that of an inner edge of
    one shell. Moments that curvature along the line makes across it, by Poisson's ratio, are left
    out.

    With directors, and where the triangle on a line inside a shell has a neighbour beyond it, the
    angle between triangles is constrained rigidly. Segments whose triangles are constrained by
    others already, as of two that share their third node, are left out then.
    """

    def parts(self, lines: Sequence[NodeRow | None]) -> Sequence[Joint]:
        """See :meth:`Joint.parts`."""
        parts = list(super().parts(lines))
        first, second = lines
        assert first is not None
        fine, coarse = first, second
        if second is not None and second.count > first.count:
            fine, coarse = second, first
        midpoints = 0.5 * (fine.points[1:] + fine.points[:-1])
        found = [(0, 0.0) if coarse is None else coarse.closest(x)[:2] for x in midpoints]
        rigid: list[tuple[int, int, int]] = []
        for k, (at, along) in enumerate(found):
            law = _law(fine, k, coarse, at)
            if law is None:
                far = _BODY if coarse is None else int(coarse.apexes[at])
                rigid.append((k, int(fine.apexes[k]), far))
                continue
            own = fine.tilted(k, 0.5)
            other = [(self.b, 1.0)] if coarse is None else coarse.tilted(at, along)
            angle = _Bending(fine.sides[k], law, [w for _, w in other], [w for _, w in own])
            markers = [marker for marker, _ in (*other, *own)]
            parts.append(LinePart(
                self.name, markers[0], markers[-1], self, angle,
                swapped=coarse is None or fine is first, between=tuple(markers),
            ))  # fmt: skip
        carried = fine.nodes if coarse is None else np.append(fine.nodes, coarse.nodes)
        for k in _independent(rigid, carried):
            far_end = self.b if coarse is None else coarse.midpoint(found[k][0])
            parts.append(LinePart(
                self.name, far_end, fine.midpoint(k), self, _Angle(fine.sides[k]),
                swapped=coarse is None or fine is first,
            ))  # fmt: skip
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


@dataclass(frozen=True)
class _Bending:
    """Elastic row of the angle about a segment.

    Attributes:
        side: (3,) vector along the segment at the start.
        law: of the moment.
        first, second: weights of the markers on both sides.
    """

    side: FloatArray
    law: Law
    first: Sequence[float]
    second: Sequence[float]

    def __call__(self, poses: Sequence[Pose]) -> tuple[Row, ...]:
        """The weighted mean of the angles between the sides."""
        axis, count = unit(self.side), len(self.first)
        terms = [
            replace(turn_angle(axis, poses[i], poses[count + j], (i, count + j)), factor=w * v)
            for i, w in enumerate(self.first)
            for j, v in enumerate(self.second)
        ]
        return (Row(tuple(terms), law=self.law),)


def _law(fine: NodeRow, k: int, coarse: NodeRow | None = None, at: int = 0) -> Law | None:
    """Law of the angle at segment k of a line, beside segment ``at`` of another; None: rigid."""
    length = float(np.linalg.norm(fine.sides[k]))
    ends = [(fine, k)] if coarse is None else [(fine, k), (coarse, at)]
    sides = [(1.0 / (length * row.stiffness[n]), row.damping) for row, n in ends]
    total = sum(compliance for compliance, _ in sides)
    if total == 0.0:
        return None
    times = sum(compliance * damping for compliance, damping in sides) / total
    return spring(1.0 / total, times / total)


def _independent(ends: Sequence[tuple[int, int, int]], carried: IntArray) -> list[int]:
    """Segments whose angles do not follow from those of others.

    Args:
        ends: segment and the third nodes of the triangles on both sides, which a constrained angle
            ties.
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
