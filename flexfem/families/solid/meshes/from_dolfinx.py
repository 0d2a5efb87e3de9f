# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cells of a DOLFINx mesh of all ranks as arrays."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from flexfem import _checks
from flexfem._types import FloatArray, IntArray
from flexfem.families.solid.meshes.lagrange import CELLS, lattice, reference_facets

__all__ = ["gathered"]


def gathered(
    mesh: Any, cell_tags: Any, facet_tags: Any, names: Mapping[str, tuple[int, int]]
) -> tuple[
    FloatArray, IntArray, str, int, IntArray, IntArray, IntArray, dict[str, tuple[int, int]]
]:
    """Points, cells, shape, degree, tags of cells, facets with their tags, and groups (collective).

    Cells are in the order in which the mesh was given, so that they do not depend on the number of
    ranks.

    Raises:
        TypeError: not a mesh of DOLFINx.
        ValueError: cells of another shape, or of several.
    """
    from dolfinx.mesh import Mesh, MeshTags, entities_to_geometry

    owner = "SolidMesh"
    _checks.instance(owner, "mesh", mesh, Mesh)
    for what, tags in (("cell_tags", cell_tags), ("facet_tags", facet_tags)):
        _checks.instance(owner, what, tags, (MeshTags, type(None)))
    for name, group in names.items():
        _checks.indices(owner, f'names["{name}"]', group, np.iinfo(np.int32).max, 1)
        if len(group) != 2:
            raise ValueError(
                f'{owner}: names["{name}"] must be dimension and tag, got {_checks.show(group)}'
            )
    topology, geometry = mesh.topology, mesh.geometry
    shapes = topology.entity_types[topology.dim]
    if len(shapes) > 1:
        kinds = ", ".join(kind.name for kind in shapes)
        raise ValueError(f"{owner}: the mesh has cells of several shapes ({kinds})")
    cell, degree = topology.cell_type.name, int(mesh.geometry.cmaps[0].degree)
    if (
        cell not in CELLS
        or degree > 3
        or geometry.dofmaps[0].shape[1] != len(lattice(cell, degree))
    ):
        raise ValueError(f"{owner}: cannot use cells {cell} with a geometry of degree {degree}")
    comm, d = mesh.comm, topology.dim
    owned = topology.index_map(d).size_local
    given = geometry.input_global_indices
    rows = given[geometry.dofmaps[0][:owned]]
    original = np.asarray(topology.original_cell_index)[:owned]
    values = np.zeros(owned, dtype=np.int64)
    if cell_tags is not None:
        inside = cell_tags.indices < owned
        values[cell_tags.indices[inside]] = cell_tags.values[inside]
    facets: Any = np.empty((0, 2), dtype=np.int64)
    facet_values: Any = np.empty(0, dtype=np.int64)
    if facet_tags is not None:
        topology.create_connectivity(d - 1, d)
        topology.create_connectivity(d, d - 1)
        mine = facet_tags.indices < topology.index_map(d - 1).size_local
        closure = entities_to_geometry(mesh, d - 1, facet_tags.indices[mine])
        corners = closure[:, : len(reference_facets(cell)[0])]  # of curved cells there are more
        facets, facet_values = given[corners], facet_tags.values[mine]
    parts = comm.allgather(
        (given, geometry.x[: len(given)], rows, original, values, facets, facet_values)
    )
    ids, first = np.unique(np.concatenate([part[0] for part in parts]), return_index=True)
    points = np.concatenate([part[1] for part in parts])[first]
    order = np.argsort(np.concatenate([part[3] for part in parts]), kind="stable")
    cells = np.searchsorted(ids, np.concatenate([part[2] for part in parts]))[order]
    tags = np.concatenate([part[4] for part in parts])[order]
    wide = [part[5] for part in parts if len(part[5])]
    places = np.searchsorted(ids, np.concatenate(wide)) if wide else facets
    marks = np.concatenate([part[6] for part in parts]).astype(np.int64)
    return (
        points, cells, cell, degree, tags, places, marks,
        _groups(names, d, tags if cell_tags is not None else tags[:0], marks),
    )  # fmt: skip


def _groups(
    names: Mapping[str, tuple[int, int]], d: int, tags: IntArray, marks: IntArray
) -> dict[str, tuple[int, int]]:
    """Dimension and tag by name; those without a name after their number."""
    groups = {name: (int(dim), int(tag)) for name, (dim, tag) in names.items()}
    known = set(groups.values())
    for dim, found, noun in ((d, tags, "region"), (d - 1, marks, "surface")):
        for tag in np.unique(found).tolist():
            if (dim, tag) not in known:
                groups[f"{noun} {tag}"] = (dim, tag)
    return groups
