# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contents of a mesh file, in a form that does not depend on its format."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from flexfem import _checks
from flexfem._types import BoolArray, FloatArray, IntArray

__all__ = ["KINDS", "Kind", "MeshFile", "checked_names", "shown", "without_copies"]


class Kind(NamedTuple):
    """Cells of one kind: their dimension, numbers of corners and of nodes, and a plural."""

    dimension: int
    corners: int
    nodes: int
    plural: str


#: By the names of meshio; nodes in the order of VTK, corners first.
KINDS = {
    "line": Kind(1, 2, 2, "lines"),
    "line3": Kind(1, 2, 3, "lines of second order"),
    "triangle": Kind(2, 3, 3, "triangles"),
    "triangle6": Kind(2, 3, 6, "triangles of second order"),
    "quad": Kind(2, 4, 4, "quadrilaterals"),
    "quad8": Kind(2, 4, 8, "quadrilaterals of second order"),
    "quad9": Kind(2, 4, 9, "quadrilaterals of second order"),
    "tetra": Kind(3, 4, 4, "tetrahedra"),
    "tetra10": Kind(3, 4, 10, "tetrahedra of second order"),
    "hexahedron": Kind(3, 8, 8, "hexahedra"),
    "hexahedron20": Kind(3, 8, 20, "hexahedra of second order"),
    "hexahedron27": Kind(3, 8, 27, "hexahedra of second order"),
    "wedge": Kind(3, 6, 6, "wedges"),
    "wedge15": Kind(3, 6, 15, "wedges of second order"),
    "pyramid": Kind(3, 5, 5, "pyramids"),
    "pyramid13": Kind(3, 5, 13, "pyramids of second order"),
}


def shown(names: Iterable[str]) -> str:
    """Return names for a message, "none" when there are none."""
    text = ", ".join(names) or "none"
    return text if len(text) <= 200 else text[:197] + "..."


@dataclass(frozen=True, eq=False)
class MeshFile:
    """Nodes, cells and named sets of a file.

    Cells are numbered through all kinds, in the order of `cells`.

    Attributes:
        path: The file.
        points: Node positions, shape (n, 3), metres.
        cells: Node rows, shape (m, k), by kind; the kinds are the keys of `KINDS`.
        element_sets: Cell numbers by name, in the order of the file.
        node_sets: Node rows by name, in the order of the file.
        facet_sets: Corner nodes of faces or edges by name, each a row of some length.
        optional: Sets of elements, lines or faces that are taken on request only.
        unused: Number of elements of types without a place in a mesh.
        skipped: Why a set that the file defines is not among those above, by its name.
    """

    path: Path
    points: FloatArray
    cells: Mapping[str, IntArray]
    element_sets: Mapping[str, IntArray]
    node_sets: Mapping[str, IntArray]
    facet_sets: Mapping[str, Sequence[tuple[int, ...]]] = field(default_factory=dict)
    optional: frozenset[str] = frozenset()
    unused: Mapping[str, int] = field(default_factory=dict)
    skipped: Mapping[str, str] = field(default_factory=dict)

    @property
    def owner(self) -> str:
        """Begin of all messages."""
        return f'mesh file "{self.path}"'

    @property
    def dimensions(self) -> IntArray:
        """Dimension of each cell."""
        counts = [len(nodes) for nodes in self.cells.values()]
        return np.repeat([KINDS[kind].dimension for kind in self.cells], counts).astype(np.int64)

    def numbered(self, kind: str) -> IntArray:
        """Numbers of the cells of a kind."""
        first = 0
        for name, nodes in self.cells.items():
            if name == kind:
                return np.arange(first, first + len(nodes))
            first += len(nodes)
        return np.empty(0, dtype=np.int64)

    def contents(self) -> str:
        """Contents of the file as text, for messages."""
        kinds = [f"{len(nodes)} {KINDS[k].plural}" for k, nodes in self.cells.items() if len(nodes)]
        others = [f"{count} {name} (not used)" for name, count in self.unused.items()]
        return ", ".join(kinds + others) or "no elements"

    def chosen(
        self, what: str, dimension: int, names: Sequence[str] | None, *, disjoint: bool
    ) -> dict[str, IntArray]:
        """Return the cells of a dimension in named sets.

        Without names, all sets are taken that have such cells, except the optional ones and, where
        they must not overlap, all but the last of those that have the same; all such cells, under
        the name of the file, if no set has any.

        Args:
            what: Name of the argument, for messages.
            dimension: Of the cells.
            names: Requested names, None for all.
            disjoint: True if a cell may be in one set only.

        Raises:
            TypeError: The names are no sequence of strings.
            ValueError: No such cells, a set that is not there, is empty or has none of them, or
                sets that share some although they must not.
        """
        mine = self.dimensions == dimension
        plural = {1: "lines", 2: "triangles or quadrilaterals", 3: "solid elements"}[dimension]
        if not mine.any():
            raise ValueError(f"{self.owner}: no {plural}; it has {self.contents()}")
        groups = {name: rows[mine[rows]] for name, rows in self.element_sets.items()}
        groups = {name: rows for name, rows in groups.items() if len(rows)}
        if names is None:
            found = {k: rows for k, rows in groups.items() if k not in self.optional}
            if disjoint:
                found = without_copies(found)
            found = found or {self.path.stem: np.flatnonzero(mine)}
        else:
            found = {}
            for name in checked_names(self.owner, what, names):
                if name not in groups:
                    raise ValueError(f"{self.owner}: {self._missing(name, plural, groups)}")
                found[name] = groups[name]
        if disjoint:
            self._check_disjoint(what, found)
        return found

    def _missing(self, name: str, plural: str, groups: Mapping[str, IntArray]) -> str:
        known = f"sets with {plural} are {shown(groups)}"
        rows = self.element_sets.get(name)
        if rows is None:
            why = f": {self.skipped[name]}" if name in self.skipped else ""
            kind = " (but a node set of this name)" if name in self.node_sets else ""
            return f'there is no element set "{name}"{kind}{why}; {known}'
        if len(rows) == 0:
            return f'element set "{name}" is empty; {known}'
        return f'element set "{name}" has no {plural}; {known}'

    def _check_disjoint(self, what: str, found: Mapping[str, IntArray]) -> None:
        """Raise when two sets share a cell."""
        owner = np.full(len(self.dimensions), -1)
        names = list(found)
        for number, (name, rows) in enumerate(found.items()):
            if (taken := owner[rows] >= 0).any():
                other = owner[rows[np.argmax(taken)]]
                raise ValueError(
                    f'{self.owner}: element sets "{names[other]}" and "{name}" share '
                    f"{(owner[rows] == other).sum()} elements: choose those that are needed, "
                    f"{what}=[...], from {shown(names)}"
                )
            owner[rows] = number

    def one_nodes(self, what: str, names: Sequence[str] | None, used: BoolArray) -> dict[str, int]:
        """Return single nodes by name.

        Without names, all node sets that have one used node. Sets with several of them that are
        requested give NAME_1, NAME_2 and so on, in the order of the file.

        Args:
            what: Name of the argument, for messages.
            names: Requested names, None for all.
            used: Which nodes of the file are in the mesh.

        Raises:
            TypeError: The names are no sequence of strings.
            ValueError: A set that is not there, or has no node of the mesh.
        """
        sets = {name: rows[used[rows]] for name, rows in self.node_sets.items()}
        if names is None:
            return {name: int(rows[0]) for name, rows in sets.items() if len(rows) == 1}
        found: dict[str, int] = {}
        for name in checked_names(self.owner, what, names):
            rows = sets.get(name, np.empty(0, dtype=np.int64))
            if len(rows) == 0:
                raise ValueError(f"{self.owner}: {self._missing_nodes(name, sets)}")
            if len(rows) == 1:
                found[name] = int(rows[0])
            else:
                found |= {f"{name}_{i + 1}": int(row) for i, row in enumerate(rows)}
        return found

    def _missing_nodes(self, name: str, sets: Mapping[str, IntArray]) -> str:
        known = f"node sets there are {shown(k for k, rows in sets.items() if len(rows))}"
        if name not in self.node_sets:
            why = f": {self.skipped[name]}" if name in self.skipped else ""
            return f'there is no node set "{name}"{why}; {known}'
        if len(self.node_sets[name]) == 0:
            return f'node set "{name}" is empty; {known}'
        return f'node set "{name}" has no node of this mesh; {known}'


def without_copies(groups: Mapping[str, IntArray]) -> dict[str, IntArray]:
    """Return the groups without those that a later one repeats."""
    last = {np.unique(rows, axis=0).tobytes(): name for name, rows in groups.items()}
    return {name: rows for name, rows in groups.items() if name in last.values()}


def checked_names(owner: str, what: str, names: object) -> list[str]:
    """Return the names requested by a user.

    Raises:
        TypeError: They are no sequence of strings.
        ValueError: A name occurs twice, or there is none.
    """
    if isinstance(names, str) or not isinstance(names, Iterable):
        raise TypeError(f"{owner}: {what} must be a list of names, got {_checks.show(names)}")
    found = list(names)
    for name in found:
        if not isinstance(name, str):
            raise TypeError(f"{owner}: {what} must be a list of names, got {_checks.show(names)}")
    if twice := [name for name, count in Counter(found).items() if count > 1]:
        raise ValueError(f'{owner}: {what} has "{twice[0]}" twice')
    return found
