# SPDX-License-Identifier: LGPL-3.0-or-later
"""Partition of bodies over ranks.

Bodies stay whole, so that their factors and solves are local to a rank and only joints cross ranks.
They are the vertices of a graph whose edges count the rows of joints between two bodies; rows
between ranks are solved for by all of them together. The graph is bisected again and again: halves
are grown from one of its ends, divided between two of them, or taken from the order of the model,
and improved by moving one body after another (Fiduccia, Mattheyses 1982,
10.1109/DAC.1982.1585498). Weights are integers and ties go to the body that comes first, so that
every rank finds the same. A body is cut only when it is larger than a rank's share and large enough
to be worth it.

PT-SCOTCH and KaHIP, of DOLFINx or petsc4py, find as few rows or fewer where all bodies are equal,
but take no weights of vertices from Python: one of two ranks gets 1.9 times the mean weight of a
chain with large and small bodies (``tests/benchmarks/partitioners.py``).
"""

import heapq
from collections.abc import Mapping, Sequence
from itertools import combinations, count
from typing import NamedTuple

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.mesh.surface_mesh import SurfaceMesh

__all__ = ["ordered_along", "partition_bodies", "strips"]

#: Cost of n rows between ranks, in elements: n / 6 + n^2 / 500, solved for as a full matrix.
_ROW, _ROW_SQUARED = 1.0 / 6.0, 1.0 / 500.0
#: On the way to better halves they may be uneven by this part, moves in vain after which a pass
#: ends, and passes.
_UNEVEN, _IN_VAIN, _PASSES = 0.05, 200, 8


def partition_bodies(
    elements: Sequence[int], weights: Sequence[int], links: Mapping[tuple[int, int], int],
    ranks: int, split_above: int,
) -> list[IntArray]:  # fmt: skip
    """Distribute bodies over ranks: even weights, few rows between ranks.

    Bodies that are split fill the first ranks, the others share the rest.

    Args:
        elements: numbers of elements of the bodies, in the order of the model.
        weights: of one element of each body.
        links: numbers of rows between two bodies.
        ranks: number of ranks.
        split_above: a body may be split if it has more elements than this and more weight than a
            rank's share.

    Returns:
        For each body the rank of each of its elements, ascending along the body.
    """
    if ranks == 1:
        return [np.zeros(number, dtype=np.int64) for number in elements]
    whole = np.array(elements, dtype=np.int64) * np.array(weights, dtype=np.int64)
    share = max(int(whole.sum()), 1) / ranks
    split = (np.array(elements) > split_above) & (whole > share)
    room, start = np.full(ranks, share), 0.0
    rank: list[IntArray] = [np.empty(0, dtype=np.int64) for _ in elements]
    for body in np.flatnonzero(split).tolist():
        middle = start + weights[body] * (np.arange(elements[body]) + 0.5)
        rank[body] = (middle / share).astype(np.int64)
        room -= weights[body] * np.bincount(rank[body], minlength=ranks)
        start += whole[body]
    kept = np.flatnonzero(~split).tolist()
    found = _partition(whole.tolist(), links, kept, np.maximum(room, 0.0))
    if not split.any():
        found = _renumbered(found)
    for body, own in zip(kept, found.tolist(), strict=True):
        rank[body] = np.full(elements[body], own, dtype=np.int64)
    return rank


def _renumbered(ranks: IntArray) -> IntArray:
    """Ranks numbered in order of appearance, so that ranks without bodies are the last."""
    _, first, number = np.unique(ranks, return_index=True, return_inverse=True)
    place = np.argsort(np.argsort(first))
    return place[number]


def ordered_along(points: FloatArray, cells: IntArray) -> IntArray:
    """Cells (m, k) of a body ordered along its longest extent; ``points`` (n, 3), m."""
    middles = points[cells].mean(axis=1)
    offsets = middles - middles.mean(axis=0)
    _, _, axes = np.linalg.svd(offsets, full_matrices=False)
    return np.argsort(np.round(offsets @ axes[0], 12), kind="stable")


def strips(surface: SurfaceMesh, rows: IntArray, parts: IntArray) -> IntArray:
    """Cut a body of a surface mesh into strips across the coordinate axis where it is longest.

    Few triangles have neighbours in other strips then, however they are numbered.

    Args:
        surface: the mesh.
        rows: triangles of the body.
        parts: (m,) part of each triangle, ascending along the body.

    Returns:
        (m,) part of each of ``rows``.
    """
    centres = surface.points[surface.triangles[rows]].mean(axis=1)
    along = centres[:, np.argmax(np.ptp(centres, axis=0))]
    found = np.empty(len(rows), dtype=np.int64)
    found[np.argsort(along, kind="stable")] = parts
    return found


def _partition(
    weights: Sequence[int], links: Mapping[tuple[int, int], int], bodies: list[int],
    room: FloatArray,
) -> IntArray:  # fmt: skip
    """The rank of each of some bodies; ``room`` is the weight that each rank is to take."""
    rank = np.zeros(len(weights), dtype=np.int64)
    graph = _Graph.of(weights, links)
    waiting = [(bodies, 0, len(room))]
    while waiting:
        members, first, end = waiting.pop()
        free = room[first:end]
        if end - first < 2 or not members:
            rank[members] = first
            continue
        half = len(free) // 2
        rooms = float(free[:half].sum()), float(free[half:].sum())
        low = _bisect(graph.among(members), rooms, len(free))
        low_half = [body for body, is_low in zip(members, low, strict=True) if is_low]
        high_half = [body for body, is_low in zip(members, low, strict=True) if not is_low]
        waiting += [(low_half, first, first + half), (high_half, first + half, end)]
    return rank[bodies]


class _Graph(NamedTuple):
    """Weights of the bodies, and the neighbours of each with the rows between them."""

    weights: list[int]
    near: list[list[tuple[int, int]]]

    @classmethod
    def of(cls, weights: Sequence[int], links: Mapping[tuple[int, int], int]) -> "_Graph":
        near: list[list[tuple[int, int]]] = [[] for _ in weights]
        for (a, b), rows in links.items():
            near[a].append((b, rows))
            near[b].append((a, rows))
        return cls(list(weights), near)

    def among(self, bodies: Sequence[int]) -> "_Graph":
        """The graph of some of the bodies, in their order."""
        number = {body: i for i, body in enumerate(bodies)}
        near = [
            [(number[other], rows) for other, rows in self.near[body] if other in number]
            for body in bodies
        ]
        return _Graph([self.weights[body] for body in bodies], near)

    def from_the_end(self) -> list[int]:
        """Bodies in the order of their distance from one that is far from the others."""
        return self._by_distance([self._by_distance(range(len(self.near)))[0][-1]])[0]

    def across(self, ends: Sequence[int]) -> list[list[int]]:
        """Orders of bodies by how much nearer they are to one of three than to another one.

        These are the first and the last body of an order, and one that is as far from both as
        possible. Cuts across a net or a grid are straight then, and oblique from one end on.
        """
        first, last = (self._by_distance([end])[1] for end in (ends[0], ends[-1]))
        between = list(map(min, first, last))  # of a net, largest along a diagonal
        middle = self._by_distance([between.index(max(between))])[1]
        aside = [d - abs(x - y) for d, x, y in zip(middle, first, last, strict=True)]
        third = self._by_distance([aside.index(max(aside))])[1]
        pairs = combinations((first, last, third), 2)
        differences = [[x - y for x, y in zip(*pair, strict=True)] for pair in pairs]
        return [sorted(range(len(ends)), key=found.__getitem__) for found in differences]

    def _by_distance(self, starts: Sequence[int]) -> tuple[list[int], list[int]]:
        """Bodies by their distance from the first start, and the distance of each.

        Other parts of the graph follow, with distances from a body of theirs.
        """
        order = list[int]()
        distance = [-1] * len(self.near)
        for start in (*starts, *range(len(self.near))):
            if distance[start] >= 0:
                continue
            distance[start], at = 0, len(order)
            order.append(start)
            while at < len(order):
                body = order[at]
                for other, _ in self.near[body]:
                    if distance[other] < 0:
                        distance[other] = distance[body] + 1
                        order.append(other)
                at += 1
        return order, distance

    def grown(self, order: Sequence[int]) -> list[int]:
        """Bodies as a half grows: next is always the one that leaves the fewest rows cut."""
        cut = [sum(rows for _, rows in near) for near in self.near]
        taken, found, number = [False] * len(cut), list[int](), count()
        for start in order:
            heap = [(0, next(number), start)]
            while heap:
                change, _, body = heapq.heappop(heap)
                if taken[body] or change not in (0, cut[body]):
                    continue
                taken[body] = True
                found.append(body)
                for other, rows in self.near[body]:
                    if not taken[other]:
                        cut[other] -= 2 * rows
                        heapq.heappush(heap, (cut[other], next(number), other))
        return found

    def first(self, order: Sequence[int], part: float) -> list[bool]:
        """Return flags of the bodies in a half that takes this part of the weight in some order."""
        half, target, weight = [False] * len(order), part * sum(self.weights), 0
        for body in order:
            weight += self.weights[body]
            half[body] = weight - 0.5 * self.weights[body] <= target
        return half


def _bisect(graph: _Graph, rooms: tuple[float, float], ranks: int) -> list[bool]:
    """Bisect a graph: flags of the first half; ``rooms`` are the weights of both halves."""
    ends = graph.from_the_end()
    part = rooms[0] / max(sum(rooms), 1e-300)
    grown = graph.grown(ends), graph.grown(ends[::-1])[::-1]
    orders = (range(len(ends)), ends, *grown, *graph.across(ends))
    tried = [_Halves(graph, graph.first(order, part), rooms, ranks) for order in orders]
    for halves in tried:
        halves.improve()
    return min(tried, key=lambda halves: halves.cost).low


class _Halves:
    """Two halves of a graph, and their improvement.

    Attributes:
        low: True for each body in the first half.
    """

    def __init__(
        self, graph: _Graph, low: list[bool], rooms: tuple[float, float], ranks: int
    ) -> None:
        self._graph, self.low, self._rooms = graph, low, rooms
        self._share = sum(rooms) / ranks
        total = sum(graph.weights)
        self._target = total * rooms[0] / max(sum(rooms), 1e-300)
        self._farthest = _UNEVEN * total + max(graph.weights)
        self._weight = sum(w for w, is_low in zip(graph.weights, low, strict=True) if is_low)
        self._high = total - self._weight
        self._cut = sum(
            rows for body, near in enumerate(graph.near) for other, rows in near
            if low[body] and not low[other]
        )  # fmt: skip

    @property
    def cost(self) -> tuple[float, float]:
        """Least for the best halves: of a step, in elements of the busiest rank, and that alone."""
        load = self._share * max(
            weight / max(room, 1e-300)
            for weight, room in zip((self._weight, self._high), self._rooms, strict=True)
        )
        return load + _ROW * self._cut + _ROW_SQUARED * self._cut**2, load

    def improve(self) -> None:
        """Move bodies as long as that makes the halves better."""
        for _ in range(_PASSES):
            if not self._pass():
                return

    def _pass(self) -> bool:
        """Move each body at most once, the best one first, and go back to the best halves."""
        gain = [
            sum(rows if self.low[other] != self.low[body] else -rows for other, rows in near)
            for body, near in enumerate(self._graph.near)
        ]
        heap = [(-value, body) for body, value in enumerate(gain)]
        heapq.heapify(heap)
        free, moved = [True] * len(gain), list[int]()
        least, kept = self.cost, 0
        while heap and len(moved) < kept + _IN_VAIN:
            value, body = heapq.heappop(heap)
            if not free[body] or value != -gain[body] or self._too_far(body):
                continue
            free[body] = False
            moved.append(body)
            for other in self._move(body, gain):
                if free[other]:
                    heapq.heappush(heap, (-gain[other], other))
            if self.cost < least:
                least, kept = self.cost, len(moved)
        for body in reversed(moved[kept:]):
            self._move(body, gain)
        return kept > 0

    def _too_far(self, body: int) -> bool:
        """Return True if a move unbalances the halves more than useful moves need."""
        weight = self._graph.weights[body]
        off = self._weight - self._target + (-weight if self.low[body] else weight)
        return abs(off) > self._farthest

    def _move(self, body: int, gain: list[int]) -> list[int]:
        """Move a body to the other half; its neighbours, whose gains have changed."""
        weight = -self._graph.weights[body] if self.low[body] else self._graph.weights[body]
        self._weight, self._high = self._weight + weight, self._high - weight
        self._cut -= gain[body]
        self.low[body] = not self.low[body]
        gain[body] = -gain[body]
        for other, rows in self._graph.near[body]:
            gain[other] += 2 * rows if self.low[other] != self.low[body] else -2 * rows
        return [other for other, _ in self._graph.near[body]]
