# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nodes and elements with numbers and sets of these, as text files of solvers give them."""

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path
from typing import NoReturn

import numpy as np

from flexfem._types import IntArray
from flexfem.mesh.imported.limits import Allowance
from flexfem.mesh.imported.mesh_file import KINDS, MeshFile

__all__ = ["MEMBER", "Deck", "Key", "Run", "Sets", "number_of"]

#: Bytes that a member of a set takes while files are read.
MEMBER = 100

#: Instance, "" for none, and number of a node or element.
type Key = tuple[str, int]
#: The same of all numbers in a range, which may be longer than any memory.
type Run = tuple[str, range]


class Sets:
    """Sets by name; upper and lower case are the same, the first spelling is kept."""

    def __init__(self) -> None:
        """Begin without sets."""
        self._keys: dict[str, dict[Key | Run, None]] = {}
        self._names: dict[str, str] = {}

    def add(self, name: str, keys: Iterable[Key | Run]) -> None:
        """Add members to a set, which is made if there is none."""
        self._names.setdefault(name.lower(), name)
        self._keys.setdefault(name.lower(), {}).update(dict.fromkeys(keys))

    def get(self, name: str) -> list[Key | Run] | None:
        """Return the members of a set in the order they came, None if there is none."""
        found = self._keys.get(name.lower())
        return None if found is None else list(found)

    def copy(self) -> "Sets":
        """Return a copy."""
        other = Sets()
        for name, keys in self.items():
            other.add(name, keys)
        return other

    @property
    def size(self) -> int:
        """Number of members and ranges of all sets together."""
        return sum(map(len, self._keys.values()))

    def items(self) -> Iterator[tuple[str, list[Key | Run]]]:
        """Names and members."""
        return ((self._names[low], list(keys)) for low, keys in self._keys.items())


class Deck:
    """Contents of a file, collected while it is read."""

    def __init__(self, path: Path, allowance: Allowance) -> None:
        """Begin with nothing."""
        self.path = path
        self.allowance = allowance
        self.nodes: dict[Key, tuple[float, float, float]] = {}
        self.elements: dict[Key, tuple[str, tuple[Key, ...]]] = {}
        self.node_sets = Sets()
        self.element_sets = Sets()
        self.facets: dict[str, list[tuple[Key, ...]]] = {}
        self.optional: set[str] = set()
        self.unused: Counter[str] = Counter()
        self.skipped: dict[str, str] = {}

    @property
    def size(self) -> int:
        """Number of nodes, elements, members of sets and facets together."""
        facets = sum(map(len, self.facets.values()))
        sets = self.node_sets.size + self.element_sets.size
        return len(self.nodes) + len(self.elements) + sets + facets

    def copy(self) -> "Deck":
        """Return a copy, to which more can be added."""
        other = Deck(self.path, self.allowance)
        other.nodes, other.elements = dict(self.nodes), dict(self.elements)
        other.node_sets, other.element_sets = self.node_sets.copy(), self.element_sets.copy()
        other.facets = {name: list(facets) for name, facets in self.facets.items()}
        other.optional, other.skipped = set(self.optional), dict(self.skipped)
        other.unused = Counter(self.unused)
        return other

    def fail(self, reason: str, line: int | None = None) -> NoReturn:
        """Raise for an error in the file.

        Raises:
            ValueError: Always.
        """
        place = "" if line is None else f", line {line}"
        raise ValueError(f'mesh file "{self.path}"{place}: {reason}')

    def add_node(self, key: Key, position: tuple[float, float, float], line: int) -> None:
        """Add a node.

        Raises:
            ValueError: There is one of this number elsewhere, or the position is not finite.
        """
        if not np.isfinite(position).all():
            self.fail(f"node {number_of(key)} is at {position}", line)
        if self.nodes.setdefault(key, position) != position:
            self.fail(
                f"node {number_of(key)} occurs twice, at {self.nodes[key]} and {position}", line
            )

    def add_element(self, key: Key, kind: str, nodes: tuple[Key, ...], line: int) -> None:
        """Add an element, of no kind if it has no place in a mesh.

        Raises:
            ValueError: There is one of this number, or it has a corner twice.
        """
        if self.elements.get(key, ("",))[0]:
            self.fail(f"element {number_of(key)} occurs twice", line)
        if kind and len(set(nodes)) < len(nodes):
            self.fail(f"element {number_of(key)} has a node twice: {_numbers(nodes)}", line)
        self.elements[key] = (kind, nodes)

    def mesh_file(self) -> MeshFile:
        """Return nodes, cells and sets by rows.

        Raises:
            ValueError: An element or a set has a node or element that is not in the file.
        """
        if not self.nodes:
            self.fail("no nodes")
        row = {key: i for i, key in enumerate(self.nodes)}
        cells: dict[str, list[list[int]]] = {}
        keys: dict[str, list[Key]] = {}
        for key, (kind, nodes) in self.elements.items():
            if not kind:
                continue
            try:
                rows = [row[node] for node in nodes]
            except KeyError:
                lost = next(node for node in nodes if node not in row)
                self.fail(f"element {number_of(key)}: node {number_of(lost)} is not in the file")
            cells.setdefault(kind, []).append(rows)
            keys.setdefault(kind, []).append(key)
        cell = {key: i for i, key in enumerate(key for kind in cells for key in keys[kind])}
        return MeshFile(
            self.path,
            np.array(list(self.nodes.values()), dtype=np.float64),
            {k: np.array(v, dtype=np.int64).reshape(-1, KINDS[k].nodes) for k, v in cells.items()},
            {
                name: self._rows(f'element set "{name}": element', members, cell, self.elements)
                for name, members in self.element_sets.items()
            },
            {
                name: self._rows(f'node set "{name}": node', members, row, row)
                for name, members in self.node_sets.items()
            },
            {
                name: [tuple(row[node] for node in nodes) for nodes in facets]
                for name, facets in self.facets.items()
            },
            frozenset(self.optional),
            dict(self.unused),
            self.skipped,
        )

    def _rows(
        self,
        what: str,
        members: list[Key | Run],
        rows: Mapping[Key, int],
        known: Collection[Key],
    ) -> IntArray:
        """Return the rows of members that have one; all must be known."""
        found: dict[Key, None] = {}
        for key in self.single(members, known):
            if key not in known:
                self.fail(f"{what} {number_of(key)} is not in the file")
            found[key] = None
        return np.array([rows[key] for key in found if key in rows], dtype=np.int64)

    def single(self, members: Iterable[Key | Run], known: Collection[Key]) -> Iterator[Key]:
        """Yield members one by one, of a range no more than up to the first that is not known.

        Raises:
            ValueError: Ranges name much more than the file has.
        """
        for place, number in members:
            if isinstance(number, int):
                yield place, number
                continue
            self.allowance.take(MEMBER * min(len(number), len(known) + 1), "sets of ranges")
            for one in number:
                yield place, one
                if (place, one) not in known:
                    break


def number_of(key: Key) -> str:
    """Return the number of a node or element, with its instance if it has one."""
    place, number = key
    return f"{place}.{number}" if place else str(number)


def _numbers(keys: Iterable[Key]) -> str:
    return ", ".join(number_of(key) for key in keys)
