# SPDX-License-Identifier: LGPL-3.0-or-later
"""Lines and named physical groups out of gmsh; gmsh is imported only when it is used."""

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path

import numpy as np

from flexfem._types import FloatArray, IntArray

# gmsh's number of the two-node line element
_LINE = 1

_LineData = tuple[FloatArray, IntArray, dict[str, IntArray], dict[str, int]]


@contextmanager
def session(name: str) -> Iterator[None]:
    """Provide a fresh, quiet gmsh model and leave gmsh as it was.

    A session that the user has opened keeps its models, its current model and its options;
    otherwise gmsh is initialised and finalised.

    Args:
        name: Name of the model.
    """
    import gmsh

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


def merge(path: Path) -> None:
    """Read a file into the current gmsh model.

    Raises:
        ValueError: The file does not exist or gmsh cannot read it.
    """
    import gmsh

    if not path.is_file():
        raise ValueError(f'mesh file "{path}" does not exist')
    if path.suffix != ".msh":
        raise ValueError(f'mesh file "{path}" must end in .msh')
    try:
        gmsh.merge(str(path))
    except Exception as error:  # gmsh raises nothing more specific
        reason = " ".join(str(error).split())
        raise ValueError(f'mesh file "{path}" cannot be read: {reason}') from None


def line_data() -> _LineData:
    """Return the arguments of a LineMesh from the current gmsh model.

    Only lines in named physical groups are taken, and the nodes these use. Points that lie on
    none of these lines are left out.

    Raises:
        ValueError: No lines, no named group of lines, elements of higher order, or a physical
            point group that holds several nodes.
    """
    import gmsh

    curves = _named_entities(1)
    if not curves:
        if len(gmsh.model.mesh.getElementsByType(_LINE)[0]) == 0:
            raise ValueError("gmsh model: the mesh has no line elements of first order")
        raise ValueError("gmsh model: the mesh has no named physical group of lines")
    blocks: dict[int, IntArray] = {}
    groups: dict[str, IntArray] = {}
    total = 0
    rows: dict[int, IntArray] = {}
    for name, entities in curves.items():
        for entity in entities:
            if entity not in blocks:
                blocks[entity] = _entity_lines(name, entity)
                rows[entity] = np.arange(total, total + len(blocks[entity]))
                total += len(blocks[entity])
        groups[name] = np.concatenate([rows[entity] for entity in entities])
        if len(groups[name]) == 0:
            raise ValueError(f'gmsh model: group "{name}" has no line elements')
    tags, cells = np.unique(np.concatenate(list(blocks.values())), return_inverse=True)
    return _coordinates(tags), cells.reshape(-1, 2), groups, _point_nodes(tags)


def _named_entities(dimension: int) -> dict[str, list[int]]:
    """Return the entities of the named physical groups of a dimension."""
    import gmsh

    groups = {}
    for dim, tag in gmsh.model.getPhysicalGroups(dimension):
        name = gmsh.model.getPhysicalName(dim, tag)
        if name:
            entities = gmsh.model.getEntitiesForPhysicalGroup(dim, tag)
            groups[name] = [abs(int(entity)) for entity in entities]
    return groups


def _entity_lines(name: str, entity: int) -> IntArray:
    """Return the node tags of the lines of a curve, shape (m, 2)."""
    import gmsh

    types, _, nodes = gmsh.model.mesh.getElements(1, entity)
    other = [int(kind) for kind in types if kind != _LINE]
    if other:
        properties = gmsh.model.mesh.getElementProperties(other[0])
        raise ValueError(
            f'gmsh model: group "{name}" has elements "{properties[0]}", only lines of first '
            "order can be used"
        )
    return np.asarray(nodes[0] if len(nodes) else [], dtype=np.int64).reshape(-1, 2)


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
