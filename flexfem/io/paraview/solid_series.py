# SPDX-License-Identifier: LGPL-3.0-or-later
"""Series for ParaView of nonlinear solids: curved cells with fields at their nodes."""

from collections.abc import Sequence
from pathlib import Path

from mpi4py import MPI

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.families.solid.cells import SolidCells
from flexfem.families.solid.elements import SolidElements
from flexfem.families.solid.family import SolidFamily
from flexfem.families.solid.forms import FIELDS
from flexfem.families.solid.meshes.lagrange import CELLS, reference_points, shapes
from flexfem.families.solid.sensors import von_mises
from flexfem.io.vtu.field_choice import EVERYTHING, FieldChoice
from flexfem.io.vtu.series import VtuSeries
from flexfem.layout.numbered_model import NumberedModel
from flexfem.lie import se3
from flexfem.system.system import BlockPart

__all__ = ["SolidSeries"]

#: Names of the series by shape and degree of the cells.
_SERIES = {(cell, degree): f"solid_cells_{cell}_{degree}" for cell in CELLS for degree in (1, 2, 3)}
#: Components of symmetric tensors.
_TENSOR = ("xx", "yy", "zz", "yz", "xz", "xy")


class SolidSeries:
    """Surfaces (``solids``) and cells (``solid_cells_SHAPE_DEGREE``) with stresses and strains.

    Cauchy stresses (Pa), von Mises' stress, Green's strains and J at nodes are means of the cells
    around them; energies are per volume at the start, J/m^3. See
    ``flexfem.io.paraview.family_series.Series``.
    """

    shown_as = ("solids", *_SERIES.values())

    def __init__(
        self, folder: Path, comm: MPI.Intracomm, parts: Sequence[BlockPart], serial: NumberedModel,
        resume: float | None, fields: FieldChoice = EVERYTHING,
    ) -> None:  # fmt: skip
        """See ``flexfem.io.paraview.family_series.Series``."""
        self._parts = list(parts)
        bodies = [body for part in parts for body in part.family.bodies]
        self._written = sorted({(body.mesh.cell, body.degree) for body in bodies})
        components = {"stress": _TENSOR, "strain": [f"e{pair}" for pair in _TENSOR]}
        self._series = {
            kind: VtuSeries(folder, name, comm, resume=resume, fields=fields, components=components)
            for kind, name in _SERIES.items()
        }
        self._means = [_NodalMeans(part.block) for part in parts]
        self._surface = VtuSeries(
            folder, "solids", comm, resume=resume, fields=fields, components=components
        )
        self._triangles = [_triangles(part) for part in parts]

    def write(self, time: float, step: int) -> None:
        """See ``flexfem.io.paraview.family_series.Series``."""
        for part, means, (triangles, body) in zip(
            self._parts, self._means, self._triangles, strict=True
        ):
            block, elements = part.block, part.elements
            assert isinstance(elements, SolidElements)
            values = elements.fields(block)
            nodal = means.of(elements.groups, values)
            energies = elements.energies(block.frames) / elements.size
            x, data = _nodal_fields(block, nodal)
            self._surface.write(time, step, x, triangles, "triangle", data, {"body": body})
            for kind in self._written:
                self._write(time, step, kind, elements.groups, (x, data), energies)

    def _write(
        self, time: float, step: int, kind: tuple[str, int], groups: Sequence[SolidCells],
        nodal: tuple[FloatArray, dict[str, FloatArray]], energies: FloatArray,
    ) -> None:  # fmt: skip
        """Cells of a kind, those of all groups."""
        order = _vtk_order(*kind)
        cells, body, energy, first = [np.empty((0, len(order)), np.int64)], [], [], 0
        for group in groups:
            rows = slice(first, first + len(group.nodes))
            first += len(group.nodes)
            if (group.kind.cell, group.kind.degree) == kind:
                cells.append(group.nodes[:, order].astype(np.int64))
                body.append(group.body)
                energy.append(energies[rows])
        of_cells = {
            "body": np.concatenate([np.empty(0, np.int64), *body]),
            "energy": np.concatenate([np.empty(0), *energy]),
        }
        x, data = nodal
        name = f"{kind[0]}_{kind[1]}"
        self._series[kind].write(time, step, x, np.concatenate(cells), name, data, of_cells)

    def close(self) -> None:
        """See ``flexfem.io.paraview.family_series.Series``."""
        for series in (self._surface, *self._series.values()):
            series.close()


def _nodal_fields(block: FrameBlock, nodal: FloatArray) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Positions of the nodes, and their fields from means (n, 13) of the cells around."""
    x, turn = np.ascontiguousarray(se3.position(block.frames)), se3.rotation(block.frames)
    stress, strain, J = np.split(nodal, np.cumsum(list(FIELDS.values()))[:2], axis=1)
    return x, {
        "displacement": x - se3.position(block.start_frames),
        "velocity": np.einsum("nij,nj->ni", turn, block.velocity[:, :3]),
        "stress": stress,
        "von_mises": von_mises(stress),
        "strain": strain,
        "J": J[:, 0],
    }


def _triangles(part: BlockPart) -> tuple[IntArray, IntArray]:
    """Triangles (t, 3) of the surfaces of this rank's cells, local nodes, and their bodies (t,)."""
    family, elements = part.family, part.elements
    assert isinstance(family, SolidFamily)
    assert isinstance(elements, SolidElements)
    own = np.concatenate([np.empty(0, np.int64), *(g.number for g in elements.groups)])
    found, bodies = [np.empty((0, 3), np.int64)], [np.empty(0, np.int64)]
    for k, body in enumerate(family.bodies):
        cells = own[(own >= family.first_cell[k]) & (own < family.first_cell[k + 1])]
        triangles = body.figure.boundary_of(np.sort(cells) - family.first_cell[k])
        found.append(part.block.local_index(family.first[k] + triangles))
        bodies.append(np.full(len(triangles), k))
    return np.concatenate(found), np.concatenate(bodies)


class _NodalMeans:
    """Means of the cells around nodes, over ranks."""

    def __init__(self, block: FrameBlock) -> None:
        """Allocate the sums (collective)."""
        from dolfinx import la

        width = sum(FIELDS.values()) + 1
        self._block, self._vector = block, la.vector(block.index_map, width)
        self._sums: FloatArray = self._vector.array.reshape(-1, width)
        self._add = la.InsertMode.add

    def of(self, groups: Sequence[SolidCells], values: Sequence[FloatArray]) -> FloatArray:
        """Means (n, 13) of fields (m, j, 13) of groups (collective)."""
        self._sums[:] = 0.0
        for group, own in zip(groups, values, strict=True):
            kind = group.kind
            points = reference_points(kind.cell, kind.degree)
            at = shapes(kind.cell, kind.degree - 1, points)[0] if kind.degree > 1 else None
            nodal = np.repeat(own, group.nodes.shape[1], axis=1) if at is None else at @ own
            np.add.at(self._sums[:, :-1], group.nodes, nodal)
            np.add.at(self._sums[:, -1], group.nodes, 1.0)
        if self._block.has_ghosts:
            self._vector.scatter_reverse(self._add)
            self._vector.scatter_forward()
        means: FloatArray = self._sums[:, :-1] / np.maximum(self._sums[:, -1:], 1.0)
        return means


def _vtk_order(cell: str, degree: int) -> IntArray:
    """Positions of the nodes of a cell in the order of VTK."""
    from dolfinx.io.utils import cell_perm_vtk
    from dolfinx.mesh import CellType

    count = len(reference_points(cell, degree))
    return np.argsort(cell_perm_vtk(CellType[cell], count)).astype(np.int64)
