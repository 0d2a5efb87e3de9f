# SPDX-License-Identifier: LGPL-3.0-or-later
"""Points, cells and whole-numbered data of VTK files, through meshio."""

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from flexfem._types import IntArray
from flexfem.mesh.imported.mesh_file import KINDS, MeshFile

__all__ = ["read"]

# What programs write for themselves
_OWN = ("vtk", "Global", "ObjectId", "PedigreeIds")


def read(path: Path) -> MeshFile:
    """Read a .vtu or .vtk file.

    Cells of the value 2 in the data "material" are the element set material_2, and points with
    the value 3 in the data "support" the node set support_3; points with 0 are in no set.

    Raises:
        ValueError: It cannot be read.
    """
    # meshio.read would print and end the process
    module = import_module(f"meshio.{path.suffix[1:].lower()}")
    try:
        mesh = module.read(str(path))
    except (Exception, SystemExit) as error:  # whatever its parsers stumble over
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(f'mesh file "{path}" cannot be read: {reason}') from None
    points = np.zeros((len(mesh.points), 3))
    points[:, : np.shape(mesh.points)[1]] = mesh.points
    used = [block.type in KINDS for block in mesh.cells]
    kinds = list(dict.fromkeys(b.type for b, use in zip(mesh.cells, used, strict=True) if use))
    order = [i for kind in kinds for i, block in enumerate(mesh.cells) if block.type == kind]
    unused: dict[str, int] = {}
    for block, use in zip(mesh.cells, used, strict=True):
        if not use:
            unused[block.type] = unused.get(block.type, 0) + len(block.data)
    cells = {
        kind: np.concatenate([b.data for b in mesh.cells if b.type == kind]).astype(np.int64)
        for kind in kinds
    }
    element_sets: dict[str, IntArray] = {}
    for name, blocks in mesh.cell_data.items():
        if order:
            values = np.concatenate([np.asarray(blocks[i]) for i in order])
            element_sets |= _sets(name, values, zero=True)
    node_sets: dict[str, IntArray] = {}
    for name, values in mesh.point_data.items():
        node_sets |= _sets(name, np.asarray(values), zero=False)
    return MeshFile(path, points, cells, element_sets, node_sets, unused=unused)


def _sets(name: str, values: Any, *, zero: bool) -> dict[str, IntArray]:
    """Return the rows of each value of whole-numbered data of one component."""
    if values.ndim == 2 and values.shape[1] == 1:
        values = values[:, 0]
    if values.ndim != 1 or values.dtype.kind not in "iu" or name.startswith(_OWN):
        return {}
    order = np.argsort(values, kind="stable")
    found, starts = np.unique(values[order], return_index=True)
    return {
        f"{name}_{value}": rows
        for value, rows in zip(found.tolist(), np.split(order, starts[1:]), strict=True)
        if zero or value != 0
    }
