# SPDX-License-Identifier: LGPL-3.0-or-later
"""What an iteration on many ranks sends, counted for a model without them.

The distribution of a model and the fronts of the rows between ranks do not need the ranks: one
process finds what each of them would send.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cache

import numpy as np

from flexfem.constraints.connect import all_ends
from flexfem.layout.node_key import NodeKey
from flexfem.layout.numbered_model import NumberedModel
from flexfem.layout.placement import Placement, place
from flexfem.mesh.distributed.rank_tree import merges

__all__ = ["RankCosts", "SentByRank", "rank_costs", "table"]

#: Numbers that are sent of a node: frame, increment, and velocity.
_NODE = 12 + 6 + 6
_BYTES = 8
_TITLE = "largest counts of a rank in an iteration"
_APART = "besides: closed contacts, bodies that are split over ranks, GMRES, full Newton iterations"

type _Shared = Mapping[tuple[int, ...], int]


@dataclass
class SentByRank:
    """Counts of one rank.

    Attributes:
        largest_front: number of rows of its largest front of rows between ranks.
        messages, bytes: sent in an iteration with kept factors of the multipliers' system: nodes of
            joints, and right-hand sides of rows.
        factor_messages, factor_bytes: sent besides in an iteration that factorises that system.
            Right-hand sides go with the fronts, but for models with contacts.
        front_flops: floating-point operations of its fronts then.
    """

    largest_front: int = 0
    messages: int = 0
    bytes: int = 0
    factor_messages: int = 0
    factor_bytes: int = 0
    front_flops: float = 0.0

    def send(self, messages: int, size: int) -> None:
        """Add messages of some numbers each to those of an iteration."""
        self.messages += messages
        self.bytes += _BYTES * messages * size


@dataclass(frozen=True)
class RankCosts:
    """Counts of a model on some ranks.

    Attributes:
        share: weight of the elements of the rank with most of it over the mean.
        shared_rows: number of constraint equations between ranks.
        of_ranks: counts of each rank.
    """

    share: float
    shared_rows: int
    of_ranks: tuple[SentByRank, ...]

    def as_dict(self) -> dict[str, float]:
        """Number of ranks, and each count of the rank with the most of it."""
        largest = {
            one.name: max(getattr(rank, one.name) for rank in self.of_ranks)
            for one in fields(SentByRank)
        }
        sizes = {"share": self.share, "shared_rows": self.shared_rows}
        return {"ranks": len(self.of_ranks)} | sizes | largest


def rank_costs(serial: NumberedModel, ranks: int, split_above: int) -> RankCosts:
    """Count what iterations send.

    Messages within bodies that are split over ranks are not among it.

    Args:
        serial: serial data of a model.
        ranks: number of ranks.
        split_above: bodies with more elements may be split.

    Raises:
        ValueError: a joint cannot be placed.
    """
    families = list(serial.families.values())
    joints = [(joint, end.rows) for joint, end in zip(serial.joints, all_ends(serial), strict=True)]
    placement = place(families, joints, ranks, split_above)
    shared = Counter[tuple[int, ...]]()
    for joint, rows in joints:
        on = placement.joint_ranks(joint)
        if len(on) > 1:
            shared[on] += rows
    found = tuple(SentByRank() for _ in range(ranks))
    _count_nodes(serial, placement, found)
    _count_fronts(shared, found, alone=bool(serial.model.contacts))
    return RankCosts(_largest_share(serial, placement, ranks), sum(shared.values()), found)


def table(costs: Sequence[RankCosts]) -> str:
    """The counts as text, a line for each number of ranks."""
    names = (
        "ranks", "share", "shared rows", "largest front", "messages", "bytes", "with factors",
        "bytes more",
    )  # fmt: skip
    lines = []
    for one in (costs_of.as_dict() for costs_of in costs):
        factors = f"+{one['factor_messages']}", str(one["factor_bytes"])
        rows = str(one["shared_rows"]), str(one["largest_front"])
        sent = str(one["messages"]), str(one["bytes"])
        lines.append((str(one["ranks"]), f"{one['share']:.2f}", *rows, *sent, *factors))
    widths = [max(map(len, column)) for column in zip(names, *lines, strict=True)]
    text = ["  ".join(map(str.rjust, line, widths)) for line in (names, *lines)]
    return "\n".join([_TITLE, *text, _APART])


def _largest_share(serial: NumberedModel, placement: Placement, ranks: int) -> float:
    """Largest weight of the elements of a rank over the mean."""
    loads = np.zeros(ranks)
    for kind, family in serial.families.items():
        costs = family.costs()
        count, cost = np.array([costs[body.name] for body in family.own]).T
        loads += np.bincount(placement.elements[kind], np.repeat(cost, count), minlength=ranks)
    return float(loads.max() / loads.mean()) if loads.any() else 1.0


def _count_nodes(serial: NumberedModel, placement: Placement, found: Sequence[SentByRank]) -> None:
    """Add what owners of nodes send to the ranks whose joints need them."""
    needed = dict[NodeKey, set[int]]()
    for joint, end in zip(serial.joints, all_ends(serial), strict=True):
        for key in end.keys:
            needed.setdefault(key, set()).update(placement.joint_ranks(joint))
    sent = Counter[tuple[int, int]]()
    for (kind, node), ranks in needed.items():
        body = serial.body(kind, int(serial.bodies(kind, np.array([node]))[0]))
        owner = placement.body_ranks[body.name][0]
        sent.update((owner, rank) for rank in ranks if rank != owner)
    for (owner, _), nodes in sent.items():
        found[owner].send(1, _NODE * nodes)


def _count_fronts(shared: _Shared, found: Sequence[SentByRank], *, alone: bool) -> None:
    """Add what ranks send, and calculate, to eliminate the rows between them.

    Fronts are sent ``alone``, or with right-hand sides.
    """

    @cache
    def left(half: tuple[int, int]) -> frozenset[tuple[int, ...]]:
        """Ranks of the rows that a half has left: those that are in it, and others."""
        first, end = half
        return frozenset(
            on
            for on in shared
            if any(first <= rank < end for rank in on) and not first <= on[0] <= on[-1] < end
        )

    @cache
    def rows(*halves: tuple[int, int]) -> int:
        """Number of rows that halves have left together."""
        return sum(shared[on] for on in frozenset().union(*map(left, halves)))

    for rank, one in enumerate(found):
        for merge in merges(rank, len(found)):
            size, front = rows(merge.own), rows(*sorted((merge.own, merge.other)))
            one.largest_front = max(one.largest_front, front)
            if size:
                one.send(len(merge.to), size)
            one.factor_messages += len(merge.to) if alone or not size else 0
            one.factor_bytes += len(merge.to) * _BYTES * (size**2 + 1)
            one.front_flops += 2.0 / 3.0 * (front**3 - rows(merge.whole) ** 3)
