# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sections of gmsh files of the formats 2 to 2.2, 4.0 and 4.1: nodes, elements and entities."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple, NoReturn

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.mesh.imported.gmsh_types import ELEMENTS
from flexfem.mesh.imported.numbers import Numbers

__all__ = ["FORMATS", "Block", "Contents", "Entity", "Section"]

#: Dimension and number.
type Entity = tuple[int, int]


class Block(NamedTuple):
    """Elements of one type of one entity.

    Attributes:
        kind: Number of the type.
        entity: Dimension and number.
        nodes: (m, k) numbers of the nodes.
        groups: Rows of the elements in each physical group of this dimension; None for the groups
            of the entity.
    """

    kind: int
    entity: Entity
    nodes: IntArray
    groups: dict[int, IntArray] | None = None


@dataclass
class Contents:
    """Contents of a gmsh file.

    Attributes:
        nodes: Numbers of the nodes, in pieces.
        points: (n, 3) their positions, in pieces.
        blocks: The elements.
        groups: Physical groups of each entity.
    """

    nodes: list[IntArray] = field(default_factory=list)
    points: list[FloatArray] = field(default_factory=list)
    blocks: list[Block] = field(default_factory=list)
    groups: dict[Entity, list[int]] = field(default_factory=dict)


type Section = Callable[[Numbers, Contents], None]


def _nodes_of_type(numbers: Numbers, kind: int) -> int:
    if kind not in ELEMENTS:
        raise ValueError(f"{numbers.owner}: elements of type {kind} cannot be read")
    return ELEMENTS[kind][2]


def _check_total(numbers: Numbers, what: str, said: int, found: int) -> None:
    if said != found:
        raise ValueError(f"{numbers.owner}: it says that there are {said} {what}, and has {found}")


# --- formats 2 to 2.2 ----------------------------------------------------------------------------


def _nodes_2(numbers: Numbers, contents: Contents) -> None:
    tags, points = numbers.records(numbers.counted(), ("int", 1), ("double", 3))
    contents.nodes.append(tags[:, 0])
    contents.points.append(points)


def _parametric_nodes_2(numbers: Numbers, contents: Contents) -> None:
    """Take nodes that are followed by an entity and their places on it, one by one: rarely used."""
    for _ in range(numbers.counted()):
        tags, points, entity = numbers.records(1, ("int", 1), ("double", 3), ("int", 2))
        numbers.records(1, ("double", int(entity[0, 0]) if entity[0, 0] in (1, 2) else 0))
        contents.nodes.append(tags[:, 0])
        contents.points.append(points)


def _elements_2(numbers: Numbers, contents: Contents) -> None:
    said = numbers.counted()
    values = numbers.rest()
    binary = values.dtype != np.int64
    runs = _binary_runs(numbers, values, said) if binary else _text_runs(numbers, values, said)
    used = 0
    for kind, tags, rows, length in runs:
        used += length
        contents.blocks += _split(kind, rows[:, 1 : 1 + tags], rows[:, 1 + tags :])
    numbers.skip(used)


type _Run = tuple[int, int, IntArray, int]


def _text_runs(numbers: Numbers, values: IntArray, count: int) -> Iterator[_Run]:
    """Yield type, number of tags, rows and length of elements of one type: number, tags, nodes."""
    start = 0
    while count > 0:
        _, kind, tags = _head(numbers, values[start : start + 3])
        width = 3 + tags + _nodes_of_type(numbers, kind)
        rows = _alike(values[start : start + count * width], width, [1, 2])
        if not len(rows):
            _cut_off(numbers)
        yield kind, tags, np.delete(rows, [1, 2], axis=1), rows.size
        start += rows.size
        count -= len(rows)


def _binary_runs(numbers: Numbers, values: IntArray, count: int) -> Iterator[_Run]:
    """Yield the same of blocks of several elements, or of many that each have a head."""
    start = 0
    while count > 0:
        kind, length, tags = _head(numbers, values[start : start + 3])
        width = 1 + tags + _nodes_of_type(numbers, kind)
        if length == 1:
            heads = _alike(values[start : start + count * (3 + width)], 3 + width, [0, 1, 2])
            rows, used = heads[:, 3:], heads.size
        else:
            if not 0 < length <= count:
                _check_total(numbers, "elements", count, length)
            rows = values[start + 3 : start + 3 + length * width]
            rows, used = rows[: len(rows) // width * width].reshape(-1, width), 3 + length * width
            if len(rows) < length:
                _cut_off(numbers)
        if not len(rows):
            _cut_off(numbers)
        yield kind, tags, rows.astype(np.int64), used
        start += used
        count -= len(rows)


def _head(numbers: Numbers, values: IntArray) -> list[int]:
    if len(values) < 3 or not 0 <= values[2] < 1000:
        _cut_off(numbers)
    return [int(value) for value in values]


def _cut_off(numbers: Numbers) -> NoReturn:
    raise ValueError(f"{numbers.owner}: it has fewer elements than it says")


def _alike(values: IntArray, width: int, columns: list[int]) -> IntArray:
    """Return the first rows of a width that agree in some columns."""
    rows = values[: len(values) // width * width].reshape(-1, width)
    count, step = min(1, len(rows)), 64
    while count < len(rows):  # in growing pieces: each of many short runs must not look at all
        same = (rows[count : count + step][:, columns] == rows[0, columns]).all(axis=1)
        if not same.all():
            return rows[: count + int(np.argmin(same))]
        count, step = count + len(same), 2 * step
    return rows


def _split(kind: int, tags: IntArray, nodes: IntArray) -> Iterator[Block]:
    """Yield the elements of each entity; one that is in several groups is written once for each."""
    dimension = ELEMENTS[kind][1]
    none = np.zeros(len(tags), dtype=np.int64)
    physical = np.abs(tags[:, 0]) if tags.shape[1] else none
    entity = tags[:, 1] if tags.shape[1] > 1 else none
    order = np.argsort(entity, kind="stable")
    found, starts = np.unique(entity[order], return_index=True)
    for number, mine in zip(found.tolist(), np.split(order, starts[1:]), strict=True):
        yield _entity_block(kind, (dimension, number), nodes[mine], physical[mine])


def _entity_block(kind: int, entity: Entity, nodes: IntArray, physical: IntArray) -> Block:
    groups = np.unique(physical).tolist()
    row = np.arange(len(nodes))
    if len(groups) > 1:
        _, first, row = np.unique(nodes, axis=0, return_index=True, return_inverse=True)
        order = np.argsort(first)
        nodes = nodes[first[order]]
        row = np.argsort(order)[row.ravel()]
    return Block(
        kind, entity, nodes, {group: row[physical == group] for group in groups if group != 0}
    )


# --- formats 4.0 and 4.1 -------------------------------------------------------------------------


def _nodes_40(numbers: Numbers, contents: Contents) -> None:
    blocks, said = numbers.whole("size", "size")
    found = 0
    for _ in range(blocks):
        _, dimension, parametric, count = numbers.whole("int", "int", "int", "size")
        extra = dimension if parametric else 0
        tags, points = numbers.records(count, ("int", 1), ("double", 3 + _extra(numbers, extra)))
        contents.nodes.append(tags[:, 0])
        contents.points.append(points[:, :3])
        found += count
    _check_total(numbers, "nodes", said, found)


def _elements_40(numbers: Numbers, contents: Contents) -> None:
    blocks, said = numbers.whole("size", "size")
    found = 0
    for _ in range(blocks):
        entity, dimension, kind, count = numbers.whole("int", "int", "int", "size")
        (rows,) = numbers.records(count, ("int", 1 + _nodes_of_type(numbers, kind)))
        contents.blocks.append(Block(kind, (dimension, entity), rows[:, 1:]))
        found += count
    _check_total(numbers, "elements", said, found)


def _nodes_41(numbers: Numbers, contents: Contents) -> None:
    blocks, said, _, _ = numbers.whole("size", "size", "size", "size")
    found = 0
    for _ in range(blocks):
        dimension, _, parametric, count = numbers.whole("int", "int", "int", "size")
        extra = dimension if parametric else 0
        (tags,) = numbers.records(count, ("size", 1))
        (points,) = numbers.records(count, ("double", 3 + _extra(numbers, extra)))
        contents.nodes.append(tags[:, 0])
        contents.points.append(points[:, :3])
        found += count
    _check_total(numbers, "nodes", said, found)


def _elements_41(numbers: Numbers, contents: Contents) -> None:
    blocks, said, _, _ = numbers.whole("size", "size", "size", "size")
    found = 0
    for _ in range(blocks):
        dimension, entity, kind, count = numbers.whole("int", "int", "int", "size")
        (rows,) = numbers.records(count, ("size", 1 + _nodes_of_type(numbers, kind)))
        contents.blocks.append(Block(kind, (dimension, entity), rows[:, 1:]))
        found += count
    _check_total(numbers, "elements", said, found)


def _extra(numbers: Numbers, dimension: int) -> int:
    if not 0 <= dimension <= 3:
        raise ValueError(f"{numbers.owner}: an entity has the dimension {dimension}")
    return dimension


def _entities(numbers: Numbers, contents: Contents, point: int, parts: bool = False) -> None:
    """Take the physical groups of all entities.

    Args:
        numbers: Of the section.
        contents: Contents that are extended.
        point: Number of coordinates of a point, those of a box or its own.
        parts: True if the entities are parts of others.
    """
    if parts:
        _, ghosts = numbers.whole("size", "size")
        numbers.records(ghosts, ("int", 2))
    for dimension, count in enumerate(numbers.whole("size", "size", "size", "size")):
        for _ in range(count):
            (tag,) = numbers.whole("int")
            if parts:
                _, _, among = numbers.whole("int", "int", "size")
                numbers.records(among, ("int", 1))
            _, physicals = numbers.records(
                1, ("double", point if dimension == 0 else 6), ("size", 1)
            )
            (groups,) = numbers.records(int(physicals[0, 0]), ("int", 1))
            contents.groups[dimension, tag] = np.abs(groups[:, 0]).tolist()
            if dimension > 0:
                (bounds,) = numbers.whole("size")
                numbers.records(bounds, ("int", 1))


def _with(take: Callable[..., None], **options: Any) -> Section:
    return lambda numbers, contents: take(numbers, contents, **options)


_FORMAT_2: dict[str, Section] = {
    "Nodes": _nodes_2,
    "ParametricNodes": _parametric_nodes_2,
    "Elements": _elements_2,
}
_FORMAT_40: dict[str, Section] = {
    "Entities": _with(_entities, point=6),
    "PartitionedEntities": _with(_entities, point=6, parts=True),
    "Nodes": _nodes_40,
    "Elements": _elements_40,
}
_FORMAT_41: dict[str, Section] = {
    "Entities": _with(_entities, point=3),
    "PartitionedEntities": _with(_entities, point=3, parts=True),
    "Nodes": _nodes_41,
    "Elements": _elements_41,
}

#: Sections that are read by version; all others are left out.
FORMATS = {
    "2": _FORMAT_2,
    "2.0": _FORMAT_2,
    "2.1": _FORMAT_2,
    "2.2": _FORMAT_2,
    "4": _FORMAT_40,
    "4.0": _FORMAT_40,
    "4.1": _FORMAT_41,
}
