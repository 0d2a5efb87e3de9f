# SPDX-License-Identifier: LGPL-3.0-or-later
"""Shells and membranes as triangles, beams as polylines."""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.contact.surfaces.collected import Collected, CollisionBody
from flexfem.layout.family import ContactLine, Family

__all__ = ["add_beam", "add_surfaces"]

#: Most parts of an edge between further stations.
_MOST = 10


def add_surfaces(made: Collected, family: Family, names: set[str]) -> dict[str, int]:
    """Add the triangles of some bodies of a family; returns the numbers of the bodies by name.

    Raises:
        ValueError: a body has no thickness.
    """
    surface = family.contact_surface()
    if surface is None:
        return {}
    chosen = [k for k, body in enumerate(surface.bodies) if body.name in names]
    taken = np.isin(surface.body, chosen)
    corners = surface.triangles[taken]
    used = np.unique(corners)
    at = np.searchsorted(surface.nodes, used)
    rows = made.fixed(family.kind, used, surface.start[at], held=surface.held[at])
    number = np.full(int(surface.nodes.max(initial=-1)) + 1, -1)
    number[used] = rows
    found = {}
    for k in chosen:
        body, mine = surface.bodies[k], surface.body == k
        label, radius = f'{type(body).__name__} "{body.name}"', float(surface.radius[mine].min())
        if radius <= 0.0 and not surface.closed:
            raise ValueError(f"{label}: contact needs a thickness, got {2.0 * radius:g}")
        numbers = family.surface_numbers(body, radius)
        found[body.name] = made.body(CollisionBody(label, body.name, False, False, *numbers))
        triangles = number[surface.triangles[mine]]
        made.touching(np.unique(triangles), radius, found[body.name])
        made.triangles(triangles, found[body.name], surface.element[mine])
    return found


def add_beam(
    made: Collected, family: Family, body: object, name: str, radius: float, spacing: float
) -> int:
    """Add the polyline of a beam; returns the number of the body.

    Args:
        made: takes it.
        family: of the beam.
        body: the beam.
        name: its name.
        radius: at which it touches, m.
        spacing: distance between stations that is aimed at, m.
    """
    line = family.contact_line(name)
    assert line is not None
    label = f'{type(body).__name__} "{name}"'
    numbers = family.surface_numbers(body, radius)
    number = made.body(CollisionBody(label, name, False, False, *numbers))
    used, at = np.unique(line.nodes, return_inverse=True)
    places = family.frames[used, :3]
    nodes = made.fixed(family.kind, used, places, held=family.held[used])
    parents = nodes[at.reshape(line.nodes.shape)]
    vertices = parents[:, 0] if line.nodes.shape[1] == 1 else made.means(parents, line.weights)
    points = np.einsum("vk,vka->va", line.weights, family.frames[line.nodes, :3])
    lengths = np.linalg.norm(np.diff(points[line.edges], axis=1)[:, 0], axis=1)
    parts = _parts(line, lengths, spacing)
    piece = 2.0 * radius * lengths / parts
    ends = np.bincount(line.edges.ravel(), np.repeat(0.5 * piece, 2), len(points))
    made.touching(vertices, radius, number, ends)
    made.edges(vertices[line.edges], number)
    if (parts > 1).any():
        _add_stations(made, parents[line.edges, 0], parts, piece, radius, number)
    return number


def _parts(line: ContactLine, lengths: FloatArray, spacing: float) -> IntArray:
    """Parts (e,) of the edges of a beam between stations; edges between means stay whole."""
    if line.nodes.shape[1] > 1:
        return np.ones(len(lengths), dtype=np.int64)
    return np.clip(np.ceil(lengths / spacing - 1e-9), 1, _MOST).astype(np.int64)


def _add_stations(
    made: Collected, ends: IntArray, parts: IntArray, piece: FloatArray, radius: float, body: int
) -> None:
    """Add the further stations between the ends (e, 2) of edges."""
    inner = np.concatenate([np.arange(1, count) / count for count in parts.tolist()])
    parents = np.repeat(ends, parts - 1, axis=0)
    rows = made.means(parents, np.column_stack([1.0 - inner, inner]))
    made.touching(rows, radius, body, np.repeat(piece, parts - 1), vertex=False)
