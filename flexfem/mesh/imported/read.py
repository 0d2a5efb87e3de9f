# SPDX-License-Identifier: LGPL-3.0-or-later
"""Reading a mesh file of any format, its units and its nodes in one place."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from flexfem import _checks
from flexfem._types import IntArray
from flexfem.mesh.imported import abaqus, gmsh, nastran, surface_files, vtk_legacy, vtk_xml
from flexfem.mesh.imported.limits import check_regular
from flexfem.mesh.imported.mesh_file import KINDS, MeshFile

__all__ = ["FORMATS", "read_mesh_file"]

# Products of such lengths are still numbers
_FAR = 1e50

#: Readers by the end of the file's name.
FORMATS: dict[str, Callable[[Path], MeshFile]] = {
    ".msh": gmsh.read,
    ".inp": abaqus.read,
    ".bdf": nastran.read,
    ".dat": nastran.read,
    ".nas": nastran.read,
    ".vtu": vtk_xml.read,
    ".vtk": vtk_legacy.read,
    ".stl": surface_files.read,
    ".obj": surface_files.read,
}


def read_mesh_file(path: Path, scale: float = 1.0, merge: float | None = None) -> MeshFile:
    """Read a file.

    Args:
        path: The file; its suffix gives the format.
        scale: Metres in a unit of length of the file, 1e-3 for millimetres.
        merge: Make nodes that are at most so far apart one, metres; None leaves them apart.

    Raises:
        TypeError: An argument is of the wrong kind.
        ValueError: The file is missing, of an unknown format or cannot be read, the scale is not
            positive, or merging makes the corners of an element one.
    """
    owner = f'mesh file "{path}"'
    factor = _checks.number(owner, "scale", scale, positive=True)
    check_regular(path)
    reader = FORMATS.get(path.suffix.lower())
    if reader is None:
        raise ValueError(f"{owner} must end in {', '.join(FORMATS)}")
    try:
        file = reader(path)
    except OSError as error:
        raise ValueError(f"{owner} cannot be read: {error.strerror}") from None
    points = _checks.array(owner, "points", file.points, (-1, 3))
    if (far := np.abs(points) > _FAR / factor).any():
        place = ", ".join(f"{x:g}" for x in points[far.any(axis=1)][0])
        raise ValueError(f"{owner}: a node is at ({place}), beyond {_FAR:g} m")
    points = factor * points
    return _merged(replace(file, points=points), merge)


def _merged(file: MeshFile, distance: float | None) -> MeshFile:
    """Return the mesh with nodes that are close together made one, that of the lowest row."""
    if distance is None:
        return file
    reach = _checks.number(file.owner, "merge", distance, nonnegative=True)
    first = _representatives(file, reach)
    cells = {kind: first[nodes] for kind, nodes in file.cells.items()}
    for kind, nodes in cells.items():
        corners = np.sort(nodes[:, : KINDS[kind].corners], axis=1)
        if (same := (np.diff(corners, axis=1) == 0).any(axis=1)).any():
            at = file.points[nodes[np.argmax(same), 0]]
            place = ", ".join(f"{x:.6g}" for x in at)
            raise ValueError(
                f"{file.owner}: merge={reach:g} makes corners of {same.sum()} "
                f"{KINDS[kind].plural} one, the first at ({place}) m"
            )
    return replace(
        file,
        cells=cells,
        node_sets={k: _without_repeats(first[rows]) for k, rows in file.node_sets.items()},
        facet_sets={
            k: [tuple(first[list(nodes)].tolist()) for nodes in facets]
            for k, facets in file.facet_sets.items()
        },
    )


def _representatives(file: MeshFile, reach: float) -> IntArray:
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    count = len(file.points)
    pairs = cKDTree(file.points).query_pairs(reach, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    _, part = connected_components(graph, directed=False)
    _, first = np.unique(part, return_index=True)
    rows: IntArray = first[part].astype(np.int64)
    return rows


def _without_repeats(rows: IntArray) -> IntArray:
    return np.array(list(dict.fromkeys(rows.tolist())), dtype=np.int64)
