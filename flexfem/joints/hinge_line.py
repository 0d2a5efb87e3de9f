# SPDX-License-Identifier: LGPL-3.0-or-later
"""Hinge along a line of a shell."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from flexfem import _checks
from flexfem._fields import declared, number
from flexfem._types import FloatArray
from flexfem.core.joint import Joint, coincidence
from flexfem.core.marker import Attachment, ShellLine
from flexfem.core.node_row import NodeRow
from flexfem.core.pose import Pose
from flexfem.core.row import Row, RowKind, Term

__all__ = ["HingeLine", "LinePart", "match"]

#: Gap relative to the length of a row that is round-off: it is closed, not kept.
_ROUNDING = 1e-9


@declared
class HingeLine(Joint):
    """Joins a line of a shell to that of another, or to a body or the ground; it leaves rotations.

    Between two lines, every node of the one with more nodes stays at its place on the edges of the
    other, which is a node where both meshes match. Parts without a node of the finer line, such as
    an end beyond it, are free. On a body or the ground, every node stays at its place in the axes
    of marker b, wherever this is.

    It has three constraints a node. It counts as many joints of one name: events lock and release
    all of them. Shells whose bodies share the nodes of a line are hinged there without a joint.

    Attributes:
        a: line of a shell.
        b: line of a shell, or a marker on the carrier of the nodes of a.
        tolerance: largest distance of the two lines at the start, relative to the length of a.

    Raises:
        TypeError: a is no line of a shell, or the tolerance no number.
        ValueError: the tolerance is not positive.
    """

    a: ShellLine
    tolerance: float = number(default=1e-6, positive=True, as_given=True)

    joins_lines = True

    def __post_init__(self) -> None:
        """Check the line."""
        super().__post_init__()
        _checks.instance(self.owner, "a", self.a, ShellLine)

    def parts(self, lines: Sequence[NodeRow | None]) -> Sequence[Joint]:
        """See :meth:`Joint.parts`."""
        first, second = lines
        assert first is not None
        if second is None:
            return [
                LinePart(self.name, self.b, first.node(k), self, _carried, swapped=True)
                for k in range(first.count)
            ]
        fine, coarse = (first, second) if first.count >= second.count else (second, first)
        parts = []
        for k, (segment, along, offset) in enumerate(match(self, fine, coarse)):
            place = coarse.place(segment, along, offset)
            if place.nodes == (int(fine.nodes[k]),):
                raise ValueError(
                    f"{self.owner}: {first.name} and {second.name} share node {place.nodes[0]}, "
                    "where they are hinged without a joint"
                )
            parts.append(
                LinePart(self.name, place, fine.node(k), self, _together, swapped=fine is first)
            )
        return parts


@dataclass(frozen=True, eq=False)
class LinePart(Joint):
    """Part of a joint of lines.

    Attributes:
        whole: that joint.
        law: its rows as a function of the poses of its markers at the start.
        swapped: marker a is on the body of marker b of the whole.
        between: its markers where they are more than a and b, those on the side of a first.
    """

    whole: Joint
    law: Callable[[Sequence[Pose]], tuple[Row, ...]]
    swapped: bool
    between: tuple[Attachment, ...] = ()

    @property
    def places(self) -> tuple[tuple[str, Attachment], ...]:
        """See :attr:`Joint.places`."""
        named = tuple((f"place {k}", marker) for k, marker in enumerate(self.between))
        return named or super().places

    @property
    def pairs(self) -> tuple[tuple[int, int], ...]:
        """See :attr:`Joint.pairs`."""
        return ((0, len(self.places) - 1),)

    @property
    def second(self) -> int:
        """See :attr:`Joint.second`."""
        return 0 if self.swapped else len(self.places) - 1

    @property
    def owner(self) -> str:
        """See :attr:`Joint.owner`."""
        return self.whole.owner

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`."""
        return self.law(poses)


def match(joint: HingeLine, fine: NodeRow, coarse: NodeRow) -> list[tuple[int, float, FloatArray]]:
    """Segment, place in it and gap (m) on one line for every node of another.

    Gaps of the size of round-off are none.

    Raises:
        ValueError: a gap is larger than the joint's tolerance.
    """
    length = fine.length
    found = []
    for k in range(fine.count):
        segment, along, gap = coarse.closest(fine.points[k])
        size = float(np.linalg.norm(gap))
        if size > joint.tolerance * length:
            raise ValueError(
                f"{joint.owner}: node {fine.nodes[k]} of {fine.name} is {size:.3g} m away from "
                f"{coarse.name}, more than {joint.tolerance:g} of the length {length:.6g} m"
            )
        found.append((segment, along, gap if size > _ROUNDING * length else np.zeros(3)))
    return found


def _together(poses: Sequence[Pose]) -> tuple[Row, ...]:
    """Rows that keep a node at its place on the other line."""
    return coincidence()


def _carried(poses: Sequence[Pose]) -> tuple[Row, ...]:
    """Rows that keep a node at its place in the axes of its carrier."""
    a, b = poses
    arm = a.rotation.T @ (b.position - a.position)
    return tuple(Row((Term(RowKind.ALONG, u=e),), float(e @ arm)) for e in np.eye(3))
