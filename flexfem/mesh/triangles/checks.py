# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checks of triangles, their bodies and the lines on them."""

from collections.abc import Mapping

import numpy as np

from flexfem import _checks
from flexfem._types import FloatArray, IntArray
from flexfem.mesh.geometry.topology import edge_keys
from flexfem.mesh.triangles.topology import Sides, match_sides, turned_triangles, vector_areas

__all__ = ["body_numbers", "body_rows", "check_triangles", "line_pairs", "oriented"]

_OWNER = "SurfaceMesh"

# Height of a triangle relative to its longest edge
_FLAT = 1e-10


def body_rows(name: object, rows: object, limit: int) -> tuple[str, IntArray]:
    """Return checked name and ascending triangles of a body.

    Raises:
        TypeError: The rows are no whole numbers or the name is no string.
        ValueError: No triangle, or one out of range.
    """
    key = _checks.text(_OWNER, "name of a body", name)
    found = np.unique(_checks.indices(_OWNER, f'body "{key}"', rows, limit, 1))
    if len(found) == 0:
        raise ValueError(f'{_OWNER}: body "{key}" must hold at least one triangle, got none')
    return key, _checks.freeze(found, np.int64)


def body_numbers(bodies: Mapping[str, IntArray], count: int) -> IntArray:
    """Return the number of each triangle's body in their order, shape (m,).

    Raises:
        ValueError: A triangle belongs to no body or to two.
    """
    body = np.full(count, -1, dtype=np.int64)
    names = list(bodies)
    for number, (name, rows) in enumerate(bodies.items()):
        if (taken := body[rows] >= 0).any():
            row = int(rows[np.argmax(taken)])
            raise ValueError(
                f'{_OWNER}: triangle {row} belongs to body "{names[body[row]]}" and to body '
                f'"{name}"'
            )
        body[rows] = number
    if (body < 0).any():
        raise ValueError(f"{_OWNER}: triangle {int(np.argmax(body < 0))} belongs to no body")
    return body


def check_triangles(points: FloatArray, triangles: IntArray) -> None:
    """Raise ValueError for triangles without area or given twice, and nodes without triangle."""
    corners = points[triangles]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    double = 2.0 * np.linalg.norm(vector_areas(points, triangles), axis=1)
    if (flat := double <= _FLAT * longest**2).any():
        row = int(np.argmax(flat))
        raise ValueError(
            f"{_OWNER}: triangle {row} between nodes {_listed(triangles[row])} has no area: "
            f"{0.5 * double[row]:.3g} m^2 with edges up to {longest[row]:.3g} m"
        )
    ordered = np.sort(triangles, axis=1)
    order = np.lexsort(ordered.T)
    same = (np.diff(ordered[order], axis=0) == 0).all(axis=1)
    if same.any():
        at = int(np.argmax(same))
        first, second = sorted(order[at : at + 2].tolist())
        raise ValueError(
            f"{_OWNER}: triangles {first} and {second} have the same nodes "
            f"{_listed(triangles[first])}"
        )
    lonely = np.bincount(triangles.ravel(), minlength=len(points)) == 0
    if lonely.any():
        raise ValueError(f"{_OWNER}: node {int(np.argmax(lonely))} belongs to no triangle")


def oriented(
    points: FloatArray, triangles: IntArray, body: IntArray, names: list[str]
) -> tuple[IntArray, Sides]:
    """Return the triangles, those flipped that run against the first of their connected part.

    A triangle (a, b, c) is flipped to (a, c, b).

    Raises:
        ValueError: An edge has more than two triangles of one body, or a body has one side only.
    """
    sides = match_sides(triangles, body, len(points))
    if (sides.counts > 2).any():
        _report_branch(points, triangles, [names[number] for number in body], sides)
    turn, wrong = turned_triangles(triangles, sides)
    if wrong >= 0:
        raise ValueError(
            f'{_OWNER}: body "{names[body[wrong]]}" has one side only: the triangles joined to '
            f"triangle {wrong} cannot be turned to the same side"
        )
    if not turn.any():
        return triangles, sides
    result = np.where(turn[:, np.newaxis], triangles[:, [0, 2, 1]], triangles)
    return result, match_sides(result, body, len(points))


def line_pairs(name: object, pairs: object, edges: IntArray, nodes: int) -> tuple[str, IntArray]:
    """Return checked name and node pairs of a line, shape (k, 2).

    Args:
        name: Of the line.
        pairs: To be checked.
        edges: Keys of all edges, ascending.
        nodes: Number of nodes.

    Raises:
        TypeError: The pairs are no whole numbers or the name is no string.
        ValueError: No pair, a wrong shape, a node out of range, a pair given twice or one that is
            no edge of a triangle.
    """
    key = _checks.text(_OWNER, "name of a line", name)
    found = _checks.indices(_OWNER, f'line "{key}"', pairs, nodes, 2)
    if len(found) == 0:
        raise ValueError(f'{_OWNER}: line "{key}" must hold at least one node pair, got none')
    keys = edge_keys(found, nodes)
    there = edges[np.minimum(np.searchsorted(edges, keys), len(edges) - 1)] == keys
    if not there.all():
        a, b = found[np.argmin(there)]
        raise ValueError(f'{_OWNER}: line "{key}": nodes {a} and {b} are no edge of a triangle')
    values, counts = np.unique(keys, return_counts=True)
    if (counts > 1).any():
        low, high = divmod(int(values[np.argmax(counts > 1)]), nodes)
        raise ValueError(
            f'{_OWNER}: line "{key}": the edge between nodes {low} and {high} occurs twice'
        )
    return key, found


def _report_branch(points: FloatArray, triangles: IntArray, names: list[str], sides: Sides) -> None:
    """Raise for the first edge with more than two sides."""
    edge = int(np.argmax(sides.counts > 2))
    start = sides.starts[edge]
    rows = sides.order[start : start + sides.counts[edge]] // 3
    side = sides.order[start]
    nodes = np.delete(triangles[side // 3], side % 3)
    places = " and ".join(f"({', '.join(f'{x:.6g}' for x in points[node])})" for node in nodes)
    raise ValueError(
        f'{_OWNER}: body "{names[rows[0]]}" branches at the edge between nodes {nodes[0]} and '
        f"{nodes[1]}, from {places}: triangles {_listed(rows)} meet there, at most two may"
    )


def _listed(values: IntArray) -> str:
    return ", ".join(str(value) for value in values)
