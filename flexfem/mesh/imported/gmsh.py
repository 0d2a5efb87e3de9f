# SPDX-License-Identifier: LGPL-3.0-or-later
"""Elements and physical groups of a gmsh file, through gmsh."""

from collections import Counter
from pathlib import Path

import numpy as np

from flexfem._types import IntArray
from flexfem.mesh.gmsh_reader import merge, session
from flexfem.mesh.imported.mesh_file import KINDS, MeshFile

__all__ = ["read"]

_POINT = 15
# Kinds by gmsh's numbers
_TYPES = {
    1: "line", 2: "triangle", 3: "quad", 4: "tetra", 5: "hexahedron", 6: "wedge", 7: "pyramid",
    8: "line3", 9: "triangle6", 10: "quad9", 11: "tetra10", 12: "hexahedron27", 16: "quad8",
    17: "hexahedron20", 18: "wedge15", 19: "pyramid13",
}  # fmt: skip
_EDGES = [8, 11, 13, 9, 16, 18, 19, 17, 10, 12, 14, 15]
# gmsh's place of each node of VTK's order; those of wedges and pyramids need corners only
_ORDER = {
    "tetra10": [*range(8), 9, 8],
    "hexahedron20": [*range(8), *_EDGES],
    "hexahedron27": [*range(8), *_EDGES, 22, 23, 21, 24, 20, 25, 26],
}


def read(path: Path) -> MeshFile:
    """Read a .msh file of any version; a gmsh session that is open stays as it is.

    Physical groups are sets of their name; those without are called physical_N after their
    number.

    Raises:
        ValueError: It cannot be read.
    """
    with session("flexfem_read"):
        merge(path)
        return _Model(path).file()


class _Model:
    """Collects the elements of the current gmsh model, group by group."""

    def __init__(self, path: Path) -> None:
        import gmsh

        self.path = path
        tags, xyz, _ = gmsh.model.mesh.getNodes()
        order = np.argsort(tags)
        self.tags = np.asarray(tags, dtype=np.int64)[order]
        self.points = np.asarray(xyz, dtype=np.float64).reshape(-1, 3)[order]
        self.blocks: dict[tuple[int, int], list[tuple[str, IntArray]]] = {}
        self.unused: Counter[str] = Counter()

    def file(self) -> MeshFile:
        """Return all elements, those of groups first."""
        import gmsh

        groups: dict[str, list[tuple[int, int]]] = {}
        node_sets: dict[str, IntArray] = {}
        for dimension, tag in gmsh.model.getPhysicalGroups():
            name = gmsh.model.getPhysicalName(dimension, tag) or f"physical_{tag}"
            entities = gmsh.model.getEntitiesForPhysicalGroup(dimension, tag)
            if dimension == 0:
                node_sets[name] = self._points(entities)
            else:
                groups.setdefault(name, []).extend((dimension, abs(int(e))) for e in entities)
        entities = [entity for found in groups.values() for entity in found]
        for entity in dict.fromkeys([*entities, *gmsh.model.getEntities()]):
            if entity[0] > 0:
                self.blocks[entity] = self._elements(*entity)
        return self._numbered(groups, node_sets)

    def _numbered(
        self, groups: dict[str, list[tuple[int, int]]], node_sets: dict[str, IntArray]
    ) -> MeshFile:
        cells: dict[str, list[IntArray]] = {}
        for blocks in self.blocks.values():
            for kind, nodes in blocks:
                cells.setdefault(kind, []).append(nodes)
        whole = {kind: np.concatenate(parts) for kind, parts in cells.items()}
        counts = np.cumsum([0, *(len(nodes) for nodes in whole.values())]).tolist()
        following = dict(zip(whole, counts, strict=False))
        rows: dict[tuple[int, int], IntArray] = {}
        for entity, blocks in self.blocks.items():
            own = [np.empty(0, dtype=np.int64)]
            for kind, nodes in blocks:
                own.append(np.arange(following[kind], following[kind] + len(nodes)))
                following[kind] += len(nodes)
            rows[entity] = np.concatenate(own)
        return MeshFile(
            self.path,
            self.points,
            whole,
            {name: np.concatenate([rows[e] for e in found]) for name, found in groups.items()},
            node_sets,
            unused=dict(self.unused),
        )

    def _elements(self, dimension: int, tag: int) -> list[tuple[str, IntArray]]:
        """Return kind and nodes of the elements of an entity."""
        import gmsh

        found = []
        for number, own, nodes in zip(*gmsh.model.mesh.getElements(dimension, tag), strict=True):
            kind = _TYPES.get(int(number))
            if kind is None:
                name = gmsh.model.mesh.getElementProperties(int(number))[0]
                self.unused[name] += len(own)
                continue
            rows = np.searchsorted(self.tags, np.asarray(nodes, dtype=np.int64))
            rows = rows.reshape(-1, KINDS[kind].nodes)
            found.append((kind, rows[:, _ORDER[kind]] if kind in _ORDER else rows))
        return found

    def _points(self, entities: IntArray) -> IntArray:
        """Return the nodes of a group of points."""
        import gmsh

        found = [np.empty(0, dtype=np.int64)]
        for entity in entities:
            for number, _, nodes in zip(*gmsh.model.mesh.getElements(0, int(entity)), strict=True):
                if int(number) == _POINT:
                    found.append(np.searchsorted(self.tags, np.asarray(nodes, dtype=np.int64)))
        return np.unique(np.concatenate(found))
