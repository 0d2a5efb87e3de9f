# SPDX-License-Identifier: LGPL-3.0-or-later
"""Binary tree of the ranks, by which bodies are distributed and rows between ranks eliminated."""

from typing import NamedTuple

__all__ = ["Merge", "merges"]


class Merge(NamedTuple):
    """Two halves of the tree that become one, as a rank of one of them sees it.

    Attributes:
        own, other: first rank of the rank's own half and of the other one, and the rank after each.
        to: ranks of the other half to which the rank sends.
        source: the one from which it receives.
    """

    own: tuple[int, int]
    other: tuple[int, int]
    to: list[int]
    source: int

    @property
    def whole(self) -> tuple[int, int]:
        """First rank of both halves, and the rank after them."""
        return min(self.own[0], self.other[0]), max(self.own[1], self.other[1])


def merges(rank: int, size: int) -> list[Merge]:
    """Merges of a rank's halves, from the leaves of the tree upwards.

    If the upper half has one rank more, the last one of the lower half sends to two.
    """
    found, first, end = [], 0, size
    while end - first > 1:
        half = (end - first) // 2
        middle = first + half
        lower, upper = (first, middle), (middle, end)
        if rank < middle:
            place = rank - first
            last = [end - 1] if place == half - 1 and end - middle > half else []
            found.append(Merge(lower, upper, [middle + place, *last], middle + place))
            end = middle
        else:
            place = rank - middle
            to = [first + place] if place < half else []
            found.append(Merge(upper, lower, to, first + min(place, half - 1)))
            first = middle
    return found[::-1]
