# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pairs of one body that are near each other in its reference shape, and hence are left out.

Where they are left out, others count otherwise than in the whole complex: those that remain are a
complex of their own, with a boundary, and the coefficients of inclusion and exclusion are those of
this complex (see ``complexes``). A pair of cells of two polylines is a cell of their product.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.contact.primitives.candidates import (
    Boxes,
    Motion,
    crossing_kind,
    crossing_points,
    vertex_kind,
    vertex_points,
)
from flexfem.contact.primitives.closest import closest_pairs
from flexfem.contact.primitives.complexes import Surface
from flexfem.kernels.compiled import kernel

__all__ = ["Neighbourhoods", "Overrides"]

_NO_LINKS = np.zeros((0, 2), np.int64)


@dataclass(frozen=True)
class Overrides:
    """Coefficients of some pairs of cells that differ from those of the whole complex.

    Attributes:
        cells: Number of cells.
        keys: Pairs as first cell times the number of cells plus second one, ascending, shape (k,).
        values: Their coefficients, shape (k,).
    """

    cells: int
    keys: IntArray
    values: FloatArray

    def apply(self, first: IntArray, second: IntArray, usual: FloatArray) -> FloatArray:
        """Coefficients (m,) of pairs, of what they are in the whole complex."""
        result = usual.copy()
        _replace(self.keys, self.values, first * self.cells + second, result)
        return result


@dataclass(frozen=True)
class Neighbourhoods:
    """What is left out of the pairs of bodies with themselves.

    Attributes:
        vertices: of vertices with other cells.
        lines: of polylines' edges and vertices, in both orders.
        edges: of edges of triangles with others.
    """

    vertices: Overrides
    lines: Overrides
    edges: Overrides

    @classmethod
    def of(
        cls, surface: Surface, reference: FloatArray, touching: BoolArray,
        links: IntArray = _NO_LINKS,
    ) -> "Neighbourhoods":  # fmt: skip
        """Leave out pairs of one body that are nearer than they touch, or repel, at a shape (n, 3).

        Of different bodies those are left out whose cells are at most an edge away from both points
        of a link: bodies with a thickness overlap beside a hinge.

        Args:
            surface: cells of all bodies.
            reference: positions in the shape without stress.
            touching: bodies that touch each other (b, b); those that do not touch themselves need
                no search.
            links: pairs of points of different bodies that are near each other by a joint, shape
                (l, 2), in both orders.
        """
        place = _Place(surface, reference, _widened(surface, links, len(reference)))
        themselves = np.diag(touching.diagonal())
        every = [Boxes.of(surface, themselves, Motion(reference, reference))]
        if len(links):
            label, linked = surface.label[links], np.zeros_like(touching)
            linked[label[:, 0], label[:, 1]] = touching[label[:, 0], label[:, 1]]
            around = np.isin(surface.complex.vertices[surface.complex.edges], links).any(axis=1)
            ends = surface.complex.vertices[surface.complex.edges[around]]
            edges = np.linalg.norm(reference[ends[:, 1]] - reference[ends[:, 0]], axis=1)
            motion = Motion(reference, reference, 2.0 * float(edges.max(initial=0.0)))
            beside = np.zeros(len(reference), np.bool_)
            beside[place.links // len(reference)] = True
            boxes = Boxes.of(surface, linked, motion)
            every.append(replace(boxes, here=beside[surface.complex.points].any(axis=1)))
        acting = np.flatnonzero(surface.area[surface.complex.vertices] > 0.0)
        return cls(
            _near_vertices(place, _all(boxes.vertices(acting) for boxes in every)),
            _near_lines(place, _all(boxes.lines() for boxes in every)),
            _near_edges(place, _all(boxes.edges() for boxes in every)),
        )


def _all(pairs: Iterable[tuple[IntArray, IntArray]]) -> tuple[IntArray, IntArray]:
    """Return the pairs of several searches as one."""
    first, second = zip(*pairs, strict=True)
    return np.concatenate(first), np.concatenate(second)


def _widened(surface: Surface, links: IntArray, count: int) -> IntArray:
    """Keys, first point times ``count`` plus second, of points an edge away from linked ones."""
    ends = surface.complex.vertices[surface.complex.edges]
    ends = np.concatenate([ends, ends[:, ::-1]])
    ends = ends[np.argsort(ends[:, 0], kind="stable")]
    starts = np.searchsorted(ends[:, 0], np.arange(count + 1))

    def more(one: IntArray, other: IntArray) -> tuple[IntArray, IntArray]:
        times = np.diff(starts)[one]
        row = np.repeat(np.arange(len(one)), times)
        step = np.arange(len(row)) - np.repeat(np.cumsum(times) - times, times)
        beside = ends[starts[one[row]] + step, 1]
        return np.concatenate([one, beside]), np.concatenate([other, other[row]])

    first, second = more(links[:, 0], links[:, 1])
    second, first = more(second, first)
    return np.unique(first * count + second)


@dataclass(frozen=True)
class _Place:
    """Cells at positions (n, 3), and links of points as first point times n plus second one."""

    surface: Surface
    reference: FloatArray
    links: IntArray

    def near(self, kind: IntArray, points: IntArray, pair: tuple[IntArray, IntArray]) -> BoolArray:
        """Return True for the pairs (m,) that are left out."""
        surface, count = self.surface, len(self.reference)
        distances, weights = np.empty(len(kind)), np.empty((len(kind), 4))
        closest_pairs(self.reference, kind, points, np.zeros(len(kind)), weights, distances)
        near = distances < surface.touch(*pair) + surface.reach(*pair)
        other = surface.cell_label[pair[0]] != surface.cell_label[pair[1]]
        at = np.flatnonzero(other)
        first, second = (surface.complex.points[cells[at]] for cells in pair)
        keys = first[:, :, np.newaxis] * count + second[:, np.newaxis, :]
        near[at] = np.isin(keys, self.links).any(axis=(1, 2))
        return near


@kernel
def _replace(keys: IntArray, values: FloatArray, wanted: IntArray, result: FloatArray) -> None:
    """Write the values of wanted keys that are among the sorted ones.

    Wanted keys that begin with the same cell follow each other: a search begins where the last one
    has ended.
    """
    low, last = 0, -1
    for k in range(len(wanted)):
        key = wanted[k]
        low, last = (low if key >= last else 0), key
        high = len(keys)
        while low < high:
            middle = (low + high) // 2
            if keys[middle] < key:
                low = middle + 1
            else:
                high = middle
        if low < len(keys) and keys[low] == key:
            result[k] = values[low]


def _near_vertices(place: _Place, pair: tuple[IntArray, IntArray]) -> Overrides:
    """Those of vertices with cells of their own body."""
    cells = place.surface.complex
    kind, points = vertex_kind(cells, pair[1]), vertex_points(cells, *pair)
    near = place.near(kind, points, pair)
    first, second, kind = pair[0][near], pair[1][near], kind[near]
    v, e, c = len(cells.vertices), len(cells.edges), cells.count
    at = first[:, None] * c
    two, one = kind == 2, kind == 1
    t, side = second[two] - v - e, second[one] - v
    sides = cells.sides[t]
    return _retained(
        c, first * c + second,
        faces=(at[two] + v + sides, at[two][:, None] + cells.edges[sides], at[two]
               + cells.triangles[t]),
        rims=(cells.coefficients[second[one]], at[one] + cells.edges[side]),
        usual=lambda keys: cells.coefficients[keys % c],
    )  # fmt: skip


def _near_lines(place: _Place, pair: tuple[IntArray, IntArray]) -> Overrides:
    """Those of polylines with polylines of their own body, in both orders, and with themselves."""
    cells = place.surface.complex
    kind, points = crossing_kind(cells, *pair), crossing_points(cells, *pair)
    near = place.near(kind, points, pair)
    one, other = pair[0][near], pair[1][near]
    themselves = np.flatnonzero(cells.on_lines)
    first, second = np.concatenate([[one, other], [other, one], [themselves, themselves]], axis=1)
    v, c, usual = len(cells.vertices), cells.count, cells.line_coefficients
    both = (first >= v) & (second >= v)
    e, f = first[both], second[both]
    a, b = c * cells.edges[e - v], cells.edges[f - v]
    borders = np.concatenate([a + f[:, None], c * e[:, None] + b], axis=1)
    corners = a[:, :, None] + b[:, None, :]
    ends = np.concatenate([corners, corners.transpose(0, 2, 1)], axis=1)
    left, right = (first >= v) & (second < v), (first < v) & (second >= v)
    sides = np.concatenate([
        c * cells.edges[first[left] - v] + second[left][:, None],
        c * first[right][:, None] + cells.edges[second[right] - v],
    ])  # fmt: skip
    rims = np.concatenate([np.flatnonzero(left), np.flatnonzero(right)])
    return _retained(
        c, first * c + second,
        faces=(borders, ends, corners.reshape(-1, 4)),
        rims=(usual[first[rims]] * usual[second[rims]], sides),
        usual=lambda keys: usual[keys // c] * usual[keys % c],
    )  # fmt: skip


def _near_edges(place: _Place, pair: tuple[IntArray, IntArray]) -> Overrides:
    """Those of edges of triangles with edges of their own body; others keep their coefficient."""
    cells = place.surface.complex
    kind, points = crossing_kind(cells, *pair), crossing_points(cells, *pair)
    near = place.near(kind, points, pair)
    keys = np.sort(pair[0][near] * cells.count + pair[1][near])
    return Overrides(cells.count, keys, np.zeros(len(keys)))


def _retained(
    cells: int, left_out: IntArray, faces: tuple[IntArray, IntArray, IntArray],
    rims: tuple[FloatArray, IntArray], usual: Callable[[IntArray], FloatArray],
) -> Overrides:  # fmt: skip
    """Coefficients of what remains of a complex of pairs.

    Args:
        cells: number of cells.
        left_out: keys of the pairs that are left out, with each all that contain it.
        faces: of those with two dimensions the keys of their sides (f, k), of the sides' two ends
            (f, k, 2), and of their corners (f, k).
        rims: of those with one dimension the coefficients (r,) and the keys of their ends (r, 2).
        usual: coefficients of keys in the whole complex.
    """
    out = np.unique(left_out)
    sides, ends, corners = faces
    remain = ~np.isin(sides, out)
    # a face that is missing counts no more at its sides and corners; its sides that remain count
    # one more each, hence their ends one less
    keys = [out, sides.ravel(), corners.ravel(), ends[remain].ravel(), rims[1].ravel()]
    change = [
        np.zeros(len(out)), np.ones(sides.size), np.ones(corners.size),
        -np.ones(2 * int(remain.sum())), np.repeat(rims[0], 2),
    ]  # fmt: skip
    found, at = np.unique(np.concatenate(keys), return_inverse=True)
    values = usual(found) + np.bincount(at.ravel(), np.concatenate(change), len(found))
    values[np.isin(found, out)] = 0.0
    return Overrides(cells, found, values)
