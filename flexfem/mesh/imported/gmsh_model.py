# SPDX-License-Identifier: LGPL-3.0-or-later
"""Lines, triangles and physical groups out of gmsh; gmsh is imported only when it is used."""

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from typing import NamedTuple

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.installation import require
from flexfem.mesh.geometry.topology import edge_keys


class _Kind(NamedTuple):
    """Elements of first order of a dimension: gmsh's number and name."""

    number: int
    plural: str
    elements: str
    groups: str


_KINDS = {
    1: _Kind(1, "lines", "line elements", "lines"),
    2: _Kind(2, "triangles", "triangles", "surfaces"),
}

_LineData = tuple[FloatArray, IntArray, dict[str, IntArray], dict[str, int]]
_SurfaceData = tuple[FloatArray, IntArray, dict[str, IntArray], dict[str, IntArray], dict[str, int]]


@contextmanager
def session(name: str) -> Iterator[None]:
    """Provide a fresh, quiet gmsh model and leave gmsh as it was.

    A session that the user has opened keeps its models, its current model and its options;
    otherwise gmsh is initialised and finalised.

    Args:
        name: Name of the model.

    Raises:
        InstallationError: gmsh is missing, or a system library that it needs.
    """
    gmsh = require("gmsh")
    own = not gmsh.isInitialized()
    if own:
        # Without signal handlers it works in any thread; configuration files are the user's own
        gmsh.initialize(readConfigFiles=False, interruptible=False)
    terminal = gmsh.option.getNumber("General.Terminal")
    previous = None if own else gmsh.model.getCurrent()
    names = set(gmsh.model.list())
    unique = next(text for i in count() if (text := f"{name}#{i}") not in names)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.add(unique)
        yield
    finally:
        if own:
            gmsh.finalize()
        else:
            gmsh.option.setNumber("General.Terminal", terminal)
            gmsh.model.setCurrent(unique)
            gmsh.model.remove()
            if previous in names:
                gmsh.model.setCurrent(previous)


def line_data() -> _LineData:
    """Return the arguments of a LineMesh from the current gmsh model.

    Only lines in named physical groups are taken, and the nodes these use. Points that lie on
    none of these lines are left out.

    Raises:
        ValueError: No lines, no named group of lines, elements of higher order, or a physical
            point group that holds several nodes.
    """
    blocks, groups = _elements(1)
    tags, cells = np.unique(blocks, return_inverse=True)
    return _coordinates(tags), cells.reshape(-1, 2), groups, _point_nodes(tags)


def surface_data() -> _SurfaceData:
    """Return the arguments of a SurfaceMesh from the current gmsh model.

    Only triangles in named physical groups are taken, and the nodes these use. Curves that share
    no edge with these triangles and points that lie on none of them are left out.

    Raises:
        ValueError: No triangles, no named group of surfaces, quadrilaterals, elements of higher
            order, a group of curves that lies on the surfaces only in part, or a physical point
            group that holds several nodes.
    """
    corners, bodies = _elements(2)
    tags, triangles = np.unique(corners, return_inverse=True)
    triangles = triangles.reshape(-1, 3)
    lines = _edge_lines(tags, triangles)
    return _coordinates(tags), triangles, bodies, lines, _point_nodes(tags)


def _named_entities(dimension: int) -> dict[str, list[int]]:
    """Return the entities of the named physical groups of a dimension."""
    import gmsh

    groups = {}
    if hasattr(gmsh.model, "getPhysicalGroupsEntities"):
        tags, members = gmsh.model.getPhysicalGroupsEntities(dimension)
        found = [[entity for _, entity in pairs] for pairs in members]
    else:  # gmsh 4.13, which goes through all entities for each group
        tags = gmsh.model.getPhysicalGroups(dimension)
        found = [gmsh.model.getEntitiesForPhysicalGroup(*group) for group in tags]
    for group, entities in zip(tags, found, strict=True):
        name = gmsh.model.getPhysicalName(*group)
        if name:
            groups[name] = [abs(int(entity)) for entity in entities]
    return groups


def _elements(dimension: int) -> tuple[IntArray, dict[str, IntArray]]:
    """Return the node tags of the elements of all groups, each once, and the rows of each group."""
    import gmsh

    kind, groups = _KINDS[dimension], _named_entities(dimension)
    if not groups:
        if len(gmsh.model.mesh.getElementsByType(kind.number)[0]) == 0:
            raise ValueError(f"gmsh model: the mesh has no {kind.elements} of first order")
        raise ValueError(f"gmsh model: the mesh has no named physical group of {kind.groups}")
    blocks: dict[int, IntArray] = {}
    rows: dict[int, IntArray] = {}
    found: dict[str, IntArray] = {}
    total = 0
    for name, entities in groups.items():
        for entity in entities:
            if entity not in blocks:
                blocks[entity] = _entity_elements(name, dimension, entity)
                rows[entity] = np.arange(total, total + len(blocks[entity]))
                total += len(blocks[entity])
        found[name] = np.concatenate([rows[entity] for entity in entities])
        if len(found[name]) == 0:
            raise ValueError(f'gmsh model: group "{name}" has no {kind.elements}')
    return np.concatenate(list(blocks.values())), found


def _entity_elements(name: str, dimension: int, entity: int) -> IntArray:
    """Return the node tags of the elements of a curve or surface, shape (m, dimension + 1)."""
    import gmsh

    wanted, plural, *_ = _KINDS[dimension]
    types, _, nodes = gmsh.model.mesh.getElements(dimension, entity)
    other = [int(kind) for kind in types if kind != wanted]
    if other:
        properties = gmsh.model.mesh.getElementProperties(other[0])
        raise ValueError(
            f'gmsh model: group "{name}" has elements "{properties[0]}", only {plural} of first '
            "order can be used"
        )
    tags = nodes[0] if len(nodes) else []
    return np.asarray(tags, dtype=np.int64).reshape(-1, dimension + 1)


def _edge_lines(tags: IntArray, triangles: IntArray) -> dict[str, IntArray]:
    """Return the node pairs of the named curves that follow edges of the triangles."""
    count = len(tags)
    edges = triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    known = edge_keys(edges, count)
    lines = {}
    for name, entities in _named_entities(1).items():
        nodes = np.concatenate([_entity_elements(name, 1, entity) for entity in entities])
        pairs = np.minimum(np.searchsorted(tags, nodes), count - 1)
        keys = edge_keys(pairs, count)
        on_edges = (tags[pairs] == nodes).all(axis=1) & np.isin(keys, known)
        if on_edges.any() and not on_edges.all():
            raise ValueError(
                f'gmsh model: curve group "{name}" follows the triangles with {on_edges.sum()} of '
                f"its {len(nodes)} lines, it must do so with all or none"
            )
        if on_edges.any():
            lines[name] = pairs
    return lines


def _coordinates(tags: IntArray) -> FloatArray:
    """Return the positions of the nodes with the given ascending tags."""
    import gmsh

    known, xyz, _ = gmsh.model.mesh.getNodes()
    order = np.argsort(known)
    found = order[np.searchsorted(known, tags, sorter=order)]
    return np.asarray(xyz, dtype=np.float64).reshape(-1, 3)[found]


def _point_nodes(tags: IntArray) -> dict[str, int]:
    """Return the node indices of the named physical points that are among `tags`."""
    import gmsh

    points = {}
    for name, entities in _named_entities(0).items():
        elements = [gmsh.model.mesh.getElements(0, entity)[2] for entity in entities]
        nodes = np.unique(np.concatenate([e[0] for e in elements if len(e)] or [np.empty(0)]))
        index = np.searchsorted(tags, nodes)
        on_lines = index[(index < len(tags)) & (tags[np.minimum(index, len(tags) - 1)] == nodes)]
        if len(on_lines) > 1:
            raise ValueError(
                f'gmsh model: point group "{name}" must hold one node, got {len(on_lines)}'
            )
        if len(on_lines) == 1:
            points[name] = int(on_lines[0])
    return points
