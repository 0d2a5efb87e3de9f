# SPDX-License-Identifier: LGPL-3.0-or-later
"""Candidates for pairs of primitives: cells whose boxes around a motion overlap.

Vertices are paired with all triangles, edges and vertices of surfaces and polylines; polylines with
each other by edges and vertices; edges of triangles with those of triangles and polylines, which
counts little: smooth contact is that of vertices. Pairs of one body are those that are not in its
``neighbourhoods``.
"""

from dataclasses import dataclass

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
from flexfem.contact.primitives.complexes import Surface
from flexfem.contact.primitives.data import Pairs
from flexfem.contact.primitives.neighbourhoods import Neighbourhoods

__all__ = ["find_pairs"]

#: Part of the area of edges of triangles that counts where they cross others.
_EDGES = 0.1
#: Part of the area of triangles and lines that counts where they are wound around a sphere: all of
#: them are equally far, so that they do not exclude each other, and their vertices touch it, too.
_PARTS = 0.1


@dataclass(frozen=True)
class _Found:
    """Pairs of cells (m,) with kind, points (m, 4) and weight, sorted by group.

    A group has a number of both cells, or of the vertex and the body that it touches, which is the
    same in every search.
    """

    first: IntArray
    second: IntArray
    kind: IntArray
    points: IntArray
    weight: FloatArray
    group: IntArray


def find_pairs(
    surface: Surface, near: Neighbourhoods, motion: Motion, touching: BoolArray, here: BoolArray
) -> Pairs:
    """Find the pairs that may act during a motion.

    The pairs of a vertex with one body are a group, unless this may be wound around it; every other
    pair is one.

    Args:
        surface: cells of all bodies.
        near: those of one body that are left out, and the coefficients of the others.
        motion: of the points.
        touching: bodies that touch each other, symmetric, shape (b, b); on the diagonal themselves.
        here: points whose groups are found, shape (n,). A group belongs to its vertex, a pair of
            edges to the first point of its first edge.
    """
    boxes = Boxes.of(surface, touching, motion)
    parts = (
        _with_vertices(surface, near, boxes, here),
        _of_lines(surface, near, boxes, here),
        _of_edges(surface, near, boxes, here),
    )
    first, second, kind, points, weight = (
        np.concatenate([getattr(part, name) for part in parts])
        for name in ("first", "second", "kind", "points", "weight")
    )
    starts = [np.flatnonzero(np.diff(part.group, prepend=-1)) for part in parts]
    keys = [len(parts) * parts[k].group[starts[k]] + k for k in range(len(parts))]
    begins = np.cumsum([0, *(len(part.first) for part in parts)])
    kappa = np.maximum(surface.kappa[points[:, 0]], surface.kappa[points[:, 3]])
    return Pairs(
        kind=kind, points=points, weight=weight, touch=surface.touch(first, second),
        dhat=surface.reach(first, second), kappa=kappa,
        starts=np.concatenate([*(s + b for s, b in zip(starts, begins, strict=False)),
                               begins[-1:]]),
        keys=np.concatenate(keys),
    )  # fmt: skip


def _sorted(
    surface: Surface, pair: tuple[IntArray, IntArray], weight: FloatArray,
    group: IntArray, of_vertices: bool = False,
) -> _Found:  # fmt: skip
    """Those that have a weight, sorted by group."""
    acting = np.flatnonzero(weight != 0.0)
    if (np.diff(group[acting]) < 0).any():
        acting = acting[np.argsort(group[acting], kind="stable")]
    first, second, cells = pair[0][acting], pair[1][acting], surface.complex
    if of_vertices:
        kind, points = vertex_kind(cells, second), vertex_points(cells, first, second)
    else:
        kind = crossing_kind(cells, first, second)
        points = crossing_points(cells, first, second)
    return _Found(first, second, kind, points, weight[acting], group[acting])


def _with_vertices(surface: Surface, near: Neighbourhoods, boxes: Boxes, here: BoolArray) -> _Found:
    """Pairs of vertices that act with all cells."""
    cells = surface.complex
    area = surface.area[cells.vertices]
    first, second = boxes.vertices(np.flatnonzero((area > 0.0) & here[cells.vertices]))
    usual = cells.coefficients[second]
    weight = near.vertices.apply(first, second, usual) * area[first]
    wound = np.flatnonzero(surface.winds(first, second))
    weight[wound] = _PARTS * surface.cell_area[second[wound]]
    other = cells.count + surface.cell_label[second]
    other[wound] = second[wound]
    group = _numbers(surface, first, other)
    return _sorted(surface, (first, second), weight, group, of_vertices=True)


def _of_lines(surface: Surface, near: Neighbourhoods, boxes: Boxes, here: BoolArray) -> _Found:
    """Pairs of edges and vertices of polylines."""
    cells = surface.complex
    first, second = boxes.lines()
    chosen = here[cells.points[first, 0]]
    first, second = first[chosen], second[chosen]
    usual = cells.line_coefficients[first] * cells.line_coefficients[second]
    weight = near.lines.apply(first, second, usual) * surface.touch(first, second) ** 2
    return _sorted(surface, (first, second), weight, _numbers(surface, first, second))


def _of_edges(surface: Surface, near: Neighbourhoods, boxes: Boxes, here: BoolArray) -> _Found:
    """Pairs of edges of triangles with those of triangles and polylines."""
    first, second = boxes.edges()
    v = len(surface.complex.vertices)
    chosen = here[surface.complex.points[first, 0]]
    first, second = first[chosen], second[chosen]
    one, other = surface.edge_area[first - v], surface.edge_area[second - v]
    # that of one where the other's points do not act
    area = np.where((one > 0.0) & (other > 0.0), np.minimum(one, other), np.maximum(one, other))
    weight = _EDGES * near.edges.apply(first, second, area)
    return _sorted(surface, (first, second), weight, _numbers(surface, first, second))


def _numbers(surface: Surface, first: IntArray, other: IntArray) -> IntArray:
    """Numbers (m,) of pairs of a cell with another one, or, after all cells, a body."""
    bodies = int(surface.label.max(initial=0)) + 1
    found: IntArray = first * (surface.complex.count + bodies) + other
    return found
