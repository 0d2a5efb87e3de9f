# SPDX-License-Identifier: LGPL-3.0-or-later
"""Elements and physical groups of a gmsh file, read here and not by gmsh.

Gmsh executes any file that does not begin as a mesh, and the options in a file beside it: both may
hold commands for the system. Its library is not needed here.
"""

import re
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import NoReturn

import numpy as np

from flexfem import _checks
from flexfem._files import read_bytes
from flexfem._types import FloatArray, IntArray
from flexfem.mesh.imported.gmsh_sections import FORMATS, Block, Contents, Entity, Section
from flexfem.mesh.imported.gmsh_types import CELLS, ELEMENTS, ORDER, POINT
from flexfem.mesh.imported.limits import LARGEST, decoded
from flexfem.mesh.imported.mesh_file import MeshFile
from flexfem.mesh.imported.numbers import BinaryNumbers, TextNumbers

__all__ = ["read"]

_BEGIN = re.compile(rb"\s*\$([A-Za-z]+)[^\n]*\n?")
_FORMAT = re.compile(rb"\s*(\d{1,4}(?:\.\d{1,4})?)\s+([01])\s+([48])[ \t\r]*\n")
_NAME = re.compile(rb'\s*([0-3])\s+(-?\d{1,9})\s+"(.*)"\s*')
_OLD = ("NOD", "NOE", "ELM", "PARA", "PTS")


def read(path: Path) -> MeshFile:
    """Read a .msh file of the formats 2 to 2.2, 4.0 and 4.1, text or binary.

    Physical groups are sets of their name; those without are called physical_N after their
    number.

    Raises:
        ValueError: It cannot be read.
    """
    owner = f'mesh file "{path}"'
    file = _File(owner, read_bytes(f"{owner} cannot be read", path, LARGEST, _BEGIN))
    return _Mesh(path, file.contents, file.names).file()


class _File:
    """Takes the sections of a file one after another.

    Attributes:
        contents: Nodes, elements and entities.
        names: Of physical groups by dimension and number.
    """

    def __init__(self, owner: str, content: bytes) -> None:
        self.owner, self.content = owner, content
        self.contents = Contents()
        self.names: dict[Entity, str] = {}
        self.version = ""
        self.order, self.sizes = "", 8
        position, found = 0, set()
        while match := _BEGIN.match(content, position):
            name = match[1].decode()
            if name in found and (name in self._known or name == "MeshFormat"):
                self._fail(f"it has section ${name} twice")
            found.add(name)
            position = self._section(name, match.end())
        if not self.version:
            self._fail("it does not begin with $MeshFormat; scripts of gmsh are not executed")
        if rest := content[position : position + 40].strip():
            self._fail(f"{_checks.show(decoded(rest[:20]))} is in place of a section")
        for names in (("Nodes", "ParametricNodes"), ("Elements",)):
            if not found.intersection(names):
                self._fail(f"it has no section ${names[0]}; was it written to its end?")

    @property
    def _known(self) -> dict[str, Section]:
        return FORMATS.get(self.version, {})

    def _section(self, name: str, start: int) -> int:
        """Read a section and return its end."""
        if name == "MeshFormat":
            return self._end(name, self._format(start))
        if not self.version and name in _OLD:
            self._fail(_version("1.0"))
        if not self.version and name != "Comments":
            self._fail(f"it begins with ${name}, not with $MeshFormat")
        owner = f"{self.owner}, section ${name}"
        if self.order and name in self._known:
            binary = BinaryNumbers(owner, self.content, start, self.sizes, self.order)
            self._known[name](binary, self.contents)
            return self._end(name, binary.position)
        end = self.content.find(b"$End" + name.encode(), start)
        body = self.content[start : max(end, start)]
        after = self._end(name, end if end >= 0 else len(self.content))
        if name == "PhysicalNames":
            self._take_names(owner, body)
        elif name in self._known:
            text = TextNumbers(owner, body)
            self._known[name](text, self.contents)
            text.finish()
        return after

    def _end(self, name: str, position: int) -> int:
        """Return where the end of a section ends that must be at a position."""
        match = re.compile(rb"\s*\$End" + name.encode() + rb"[ \t\r]*(\n|$)").match(
            self.content, position
        )
        if match is None:
            self._fail(f"section ${name} has no end where it should be; is the file cut off?")
        return match.end()

    def _format(self, start: int) -> int:
        """Take version, kind and order of the bytes and return where these end."""
        match = _FORMAT.match(self.content, start)
        if match is None:
            self._fail("section $MeshFormat has no version, kind and size of numbers")
        version = match[1].decode()
        if version not in FORMATS:
            self._fail(_version(version))
        self.version, self.sizes = version, int(match[3])
        if match[2] == b"0":
            return match.end()
        if version in ("4", "4.0"):
            self._fail("files of format 4.0 are text only")
        if version != "4.1" and self.sizes != 8:
            self._fail(f"its numbers have {self.sizes} bytes")
        one = self.content[match.end() : match.end() + 4]
        orders = {b"\1\0\0\0": "<", b"\0\0\0\1": ">"}
        if one not in orders:
            self._fail("its byte order is unknown")
        self.order = orders[one]
        return match.end() + 4

    def _take_names(self, owner: str, body: bytes) -> None:
        first, *lines = body.strip().split(b"\n")
        if not first.strip().isdigit() or int(first[:9]) != len(lines):
            raise ValueError(f"{owner}: it has {len(lines)} names, and says {decoded(first[:20])}")
        for line in lines:
            match = _NAME.fullmatch(line)
            if match is None:
                raise ValueError(
                    f"{owner}: {_checks.show(decoded(line))} is no dimension, number and name"
                )
            self.names[int(match[1]), abs(int(match[2]))] = decoded(match[3])

    def _fail(self, reason: str) -> NoReturn:
        raise ValueError(f"{self.owner} cannot be read: {reason}")


def _version(text: str) -> str:
    return f"format {text} of gmsh is not supported; save it in format 2.2, 4.0 or 4.1"


class _Mesh:
    """Puts the elements together, group by group."""

    def __init__(self, path: Path, contents: Contents, names: dict[Entity, str]) -> None:
        self.path, self.names = path, names
        self.owner = f'mesh file "{path}"'
        self.blocks: dict[Entity, list[Block]] = {}
        self.groups: dict[Entity, list[Entity]] = {}
        self.tags, self.points = self._nodes(contents)
        self.unused: Counter[str] = Counter()
        for entity, groups in contents.groups.items():
            self._add(entity, groups)
        for block in contents.blocks:
            name, dimension, _ = ELEMENTS[block.kind]
            entity = (dimension, block.entity[1])
            self._add(entity, block.groups or ())
            if block.kind in CELLS or dimension == 0:
                self.blocks.setdefault(entity, []).append(block)
            else:
                self.unused[name] += len(block.nodes)

    def _add(self, entity: Entity, groups: Iterable[int]) -> None:
        for group in groups:
            self.groups.setdefault((entity[0], group), []).append(entity)

    def _nodes(self, contents: Contents) -> tuple[IntArray, FloatArray]:
        """Return numbers and positions of all nodes, in the order of their numbers."""
        tags = np.concatenate([np.empty(0, dtype=np.int64), *contents.nodes])
        points = np.concatenate([np.empty((0, 3)), *contents.points])
        order = np.argsort(tags, kind="stable")
        tags, points = tags[order], points[order]
        again = np.flatnonzero(np.diff(tags) == 0)
        if (elsewhere := (points[again] != points[again + 1]).any(axis=1)).any():
            number = tags[again[np.argmax(elsewhere)]]
            raise ValueError(f"{self.owner}: node {number} occurs twice, at different places")
        return np.delete(tags, again), np.delete(points, again, axis=0)

    def _rows(self, nodes: IntArray) -> IntArray:
        """Return the rows of nodes by their numbers."""
        rows: IntArray = np.searchsorted(self.tags, nodes)
        known = np.minimum(rows, len(self.tags) - 1)
        lost = self.tags[known] != nodes if len(self.tags) else np.ones(nodes.shape, dtype=np.bool_)
        if lost.any():
            raise ValueError(
                f"{self.owner}: an element has node {nodes[lost][0]}, which is not in the file"
            )
        return rows

    def file(self) -> MeshFile:
        """Return all elements, those of groups first."""
        groups: dict[str, list[tuple[int, Entity]]] = {}
        node_sets: dict[str, IntArray] = {}
        for (dimension, group), entities in sorted(self.groups.items()):
            name = self.names.get((dimension, group)) or f"physical_{group}"
            own = sorted(set(entities))
            if dimension == 0:
                node_sets[name] = self._points(group, own)
            else:
                groups.setdefault(name, []).extend((group, entity) for entity in own)
        grouped = [entity for found in groups.values() for _, entity in found]
        order = dict.fromkeys([*grouped, *sorted(self.blocks)])
        return self._numbered([entity for entity in order if entity[0] > 0], groups, node_sets)

    def _numbered(
        self,
        order: list[Entity],
        groups: dict[str, list[tuple[int, Entity]]],
        node_sets: dict[str, IntArray],
    ) -> MeshFile:
        """Return elements in an order of entities, numbered through all kinds."""
        blocks = [(entity, block) for entity in order for block in self.blocks.get(entity, ())]
        cells: dict[str, list[IntArray]] = {}
        for _, block in blocks:
            cells.setdefault(CELLS[block.kind], []).append(self._rows(block.nodes))
        whole = {kind: np.concatenate(parts) for kind, parts in cells.items()}
        counts = np.cumsum([0, *(len(nodes) for nodes in whole.values())]).tolist()
        following = dict(zip(whole, counts, strict=False))
        rows: dict[Entity, list[tuple[Block, int]]] = {}
        for entity, block in blocks:
            rows.setdefault(entity, []).append((block, following[CELLS[block.kind]]))
            following[CELLS[block.kind]] += len(block.nodes)
        sets = {
            name: [
                first + _members(block, group)
                for group, entity in found
                for block, first in rows.get(entity, ())
            ]
            for name, found in groups.items()
        }
        empty = np.empty(0, dtype=np.int64)
        return MeshFile(
            self.path,
            self.points,
            {k: nodes[:, ORDER[k]] if k in ORDER else nodes for k, nodes in whole.items()},
            {name: np.concatenate([empty, *parts]) for name, parts in sets.items()},
            node_sets,
            unused=dict(self.unused),
        )

    def _points(self, group: int, entities: list[Entity]) -> IntArray:
        """Return the nodes of a group of points."""
        found = [np.empty(0, dtype=np.int64)]
        for entity in entities:
            for block in self.blocks.get(entity, ()):
                if block.kind == POINT:
                    found.append(self._rows(block.nodes[_members(block, group)].ravel()))
        return np.unique(np.concatenate(found))


def _members(block: Block, group: int) -> IntArray:
    """Return the rows of a block's elements that are in a group of its entity."""
    if block.groups is None:
        return np.arange(len(block.nodes))
    return block.groups.get(group, np.empty(0, dtype=np.int64))
