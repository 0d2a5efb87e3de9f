# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cells whose boxes overlap, and their points as those of pairs."""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.contact.detection.broad_phase import overlaps
from flexfem.contact.primitives.complexes import Complex, Surface
from flexfem.contact.primitives.data import Kind
from flexfem.kernels.compiled import kernel

__all__ = ["Boxes", "Motion", "crossing_kind", "crossing_points", "vertex_kind", "vertex_points"]


#: Largest number of kinds of bodies that are searched apart from each other.
_KINDS = 4
#: Size of a cell in parts of the usual one from which it is searched apart from others.
_LARGE = 16.0


@dataclass(frozen=True)
class Motion:
    """Positions between which pairs may come into contact.

    Attributes:
        before: Positions at the start, shape (n, 3), metres.
        after: Positions at the end, shape (n, 3), metres.
        skin: Way by which two cells may approach farther, metres.
        known: Points whose positions are known here, shape (n,); cells with others have no pairs.
            None: all.
    """

    before: FloatArray
    after: FloatArray
    skin: float = 0.0
    known: BoolArray | None = None


@dataclass(frozen=True)
class Boxes:
    """Boxes around the motions of all cells.

    Attributes:
        surface: the cells.
        touching: Bodies that touch each other, shape (b, b); on the diagonal themselves.
        low: Lower corners, shape (c, 3), metres.
        high: Upper corners, shape (c, 3), metres.
        here: Cells whose boxes are known, shape (c,); the others have no pairs.
    """

    surface: Surface
    touching: BoolArray
    low: FloatArray
    high: FloatArray
    here: BoolArray

    @classmethod
    def of(cls, surface: Surface, touching: BoolArray, motion: Motion) -> "Boxes":
        """Boxes of a motion, enlarged so that those of pairs that may act overlap."""
        cells = surface.complex.points
        low, high = np.empty((2, len(cells), 3))
        margins = surface.cell_radius + 0.5 * (surface.cell_dhat + motion.skin)
        _sweep(motion.before, motion.after, cells, margins, low, high)
        known = motion.known
        here = np.ones(len(cells), np.bool_) if known is None else known[cells].all(axis=1)
        return cls(surface, touching, low, high, here)

    @property
    def complex(self) -> Complex:
        """The cells."""
        return self.surface.complex

    def _between(self, cells: IntArray, others: IntArray) -> tuple[IntArray, IntArray]:
        """Pairs of cells that overlap, of bodies that touch."""
        cells, others = cells[self.here[cells]], others[self.here[others]]
        found = [
            self._overlaps(i, j)
            for one, other in self._partners(cells, others)
            for i in self._by_size(one) for j in self._by_size(other)
        ]  # fmt: skip
        first, second = (np.concatenate(pairs) for pairs in zip(*found, strict=True))
        label = self.surface.cell_label
        meet = self.touching[label[first], label[second]]
        return first[meet], second[meet]

    @cached_property
    def _sizes(self) -> FloatArray:
        """Longest side (c,) of each box, m."""
        ways = self.high - self.low
        return np.maximum(np.maximum(ways[:, 0], ways[:, 1]), ways[:, 2])

    @cached_property
    def _kinds(self) -> tuple[BoolArray, IntArray]:
        """Kinds of bodies: which ones they touch, (k, b), and the kind of each body, (b,)."""
        rows, kind = np.unique(self.touching, axis=0, return_inverse=True)
        return rows, kind.ravel()

    def _partners(self, cells: IntArray, others: IntArray) -> list[tuple[IntArray, IntArray]]:
        """Cells and others that they may touch, by kinds of bodies that touch the same ones."""
        label, (rows, kind) = self.surface.cell_label, self._kinds
        if len(rows) > _KINDS:
            return [(cells, others)]
        return [
            (cells[kind[label[cells]] == k], others[row[label[others]]])
            for k, row in enumerate(rows)
        ]

    def _by_size(self, cells: IntArray) -> list[IntArray]:
        """Cells of usual size, and those that are much larger, such as the sides of a box."""
        sizes = self._sizes[cells]
        large = sizes > _LARGE * np.median(sizes) if len(cells) else np.zeros(0, np.bool_)
        return [cells[~large], cells[large]] if large.any() else [cells]

    def _overlaps(self, cells: IntArray, others: IntArray) -> tuple[IntArray, IntArray]:
        """Pairs of cells whose boxes overlap."""
        starts, found = overlaps(
            self.low[cells], self.high[cells], self.low[others], self.high[others]
        )
        return np.repeat(cells, np.diff(starts)), others[found]

    def vertices(self, acting: IntArray) -> tuple[IntArray, IntArray]:
        """Pairs (m,) of acting vertices with all cells, sorted by the vertex."""
        v, e = len(self.complex.vertices), len(self.complex.edges)
        ends = (0, v, v + e, self.complex.count)
        found = [self._between(acting, np.arange(i, j)) for i, j in pairwise(ends)]
        first, second = (np.concatenate(cells) for cells in zip(*found, strict=True))
        order = np.argsort(first, kind="stable")
        return first[order], second[order]

    def lines(self) -> tuple[IntArray, IntArray]:
        """Pairs (m,) of vertices and edges of polylines, edges first, each pair once."""
        cells = np.flatnonzero(self.complex.on_lines)
        first, second = self._between(cells, cells)
        once = first > second
        return first[once], second[once]

    def piercing(self) -> tuple[IntArray, IntArray]:
        """Pairs (m,) of all edges with triangles."""
        v, e = len(self.complex.vertices), len(self.complex.edges)
        return self._between(np.arange(v, v + e), np.arange(v + e, self.complex.count))

    def edges(self) -> tuple[IntArray, IntArray]:
        """Pairs (m,) of edges of triangles with edges of triangles and polylines, once each."""
        first, second = self._between(*self.complex.crossing)
        of_triangles = np.zeros(self.complex.count, np.bool_)
        of_triangles[first] = True
        once = (first < second) | ~of_triangles[second]
        return first[once], second[once]


@kernel
def _sweep(
    before: FloatArray, after: FloatArray, cells: IntArray, margins: FloatArray, low: FloatArray,
    high: FloatArray,
) -> None:  # fmt: skip
    """Write the boxes (c, 3) around the motions of cells (c, 3), each enlarged by its margin."""
    for c in range(len(cells)):
        for a in range(3):
            least, most = np.inf, -np.inf
            for k in range(3):
                x, y = before[cells[c, k], a], after[cells[c, k], a]
                least, most = min(least, x, y), max(most, x, y)
            low[c, a], high[c, a] = least - margins[c], most + margins[c]


def vertex_kind(cells: Complex, second: IntArray) -> IntArray:
    """Kind (m,) of the pairs of a vertex with other cells."""
    v, e = len(cells.vertices), len(cells.edges)
    return (second >= v).astype(np.int64) + (second >= v + e)


def vertex_points(cells: Complex, first: IntArray, second: IntArray) -> IntArray:
    """Points (m, 4) of the pairs of a vertex with other cells."""
    return np.concatenate([cells.points[first, :1], cells.points[second]], axis=1)


def crossing_kind(cells: Complex, first: IntArray, second: IntArray) -> IntArray:
    """Kind (m,) of the pairs of edges and vertices that cross."""
    v = len(cells.vertices)
    return int(Kind.EDGE_EDGE) + (first < v).astype(np.int64) + (second < v)


def crossing_points(cells: Complex, first: IntArray, second: IntArray) -> IntArray:
    """Points (m, 4) of the pairs of edges and vertices that cross."""
    return np.concatenate([cells.points[first, :2], cells.points[second, :2]], axis=1)
