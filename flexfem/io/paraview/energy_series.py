# SPDX-License-Identifier: LGPL-3.0-or-later
"""Series for ParaView of bodies with an energy in UFL: their cells with energy densities."""

from collections.abc import Sequence
from pathlib import Path

from mpi4py import MPI

import numpy as np

from flexfem._types import IntArray
from flexfem.families.ufl_body.elements import EnergyCells, EnergyElements, Points
from flexfem.io.vtu.field_choice import EVERYTHING, FieldChoice
from flexfem.io.vtu.series import VtuSeries
from flexfem.layout.numbered_model import NumberedModel
from flexfem.lie import se3
from flexfem.system.system import BlockPart

__all__ = ["EnergySeries"]

#: Name of the series and type of the cells by the number of their corners.
_SERIES = {
    2: ("energy_lines", "line"),
    3: ("energy_triangles", "triangle"),
    4: ("energy_solids", "tetra"),
}
#: Straight pieces of quadratic cells by the number of their nodes, in the order of Basix.
_PIECES = {
    (2, 3): [[0, 2], [2, 1]],
    (3, 6): [[0, 5, 4], [5, 1, 3], [4, 3, 2], [3, 4, 5]],
    (4, 10): [
        [0, 9, 8, 7], [9, 1, 6, 5], [8, 6, 2, 4], [7, 5, 4, 3],
        [9, 8, 7, 5], [9, 6, 8, 5], [8, 6, 4, 5], [8, 4, 7, 5],
    ],
}  # fmt: skip


class EnergySeries:
    """Cells with displacements, velocities and energies.

    See ``flexfem.io.paraview.family_series.Series``.

    Energies are those per length, area or volume at the start, J/m, J/m^2 or J/m^3.
    """

    shown_as = tuple(name for name, _ in _SERIES.values())

    def __init__(
        self, folder: Path, comm: MPI.Intracomm, parts: Sequence[BlockPart], serial: NumberedModel,
        resume: float | None, fields: FieldChoice = EVERYTHING,
    ) -> None:  # fmt: skip
        """See ``flexfem.io.paraview.family_series.Series``."""
        self._parts = list(parts)
        bodies = [body for part in parts for body in part.family.bodies]
        self._written = sorted({body.mesh.dimension + 1 for body in bodies})
        self._series = {
            corners: VtuSeries(folder, name, comm, resume=resume, fields=fields)
            for corners, (name, _) in _SERIES.items()
        }

    def write(self, time: float, step: int) -> None:
        """See ``flexfem.io.paraview.family_series.Series``."""
        for part in self._parts:
            elements = part.elements
            assert isinstance(elements, EnergyElements)
            for corners in self._written:
                own = [group for group in elements.groups if group.corners == corners]
                self._write(time, step, part, corners, own)

    def _write(
        self, time: float, step: int, part: BlockPart, corners: int, groups: Sequence[EnergyCells]
    ) -> None:
        """Cells with so many corners."""
        block = part.block
        x = np.ascontiguousarray(se3.position(block.frames))
        at, turn = Points(points=x), se3.rotation(block.frames)
        cells, body, energy = [], [], []
        for group in groups:
            pieces = _pieces(group)
            count = len(pieces) // max(len(group.nodes), 1)
            cells.append(pieces)
            body.append(np.repeat(group.body, count))
            energy.append(np.repeat(group.energies(at) / group.size, count))
        self._series[corners].write(
            time, step, x, np.concatenate(cells), _SERIES[corners][1],
            {
                "displacement": x - se3.position(block.start_frames),
                "velocity": np.einsum("nij,nj->ni", turn, block.velocity[:, :3]),
            },
            {"body": np.concatenate(body), "energy": np.concatenate(energy)},
        )  # fmt: skip

    def close(self) -> None:
        """See ``flexfem.io.paraview.family_series.Series``."""
        for series in self._series.values():
            series.close()


def _pieces(group: EnergyCells) -> IntArray:
    """Straight cells that a group is drawn as, those of a cell one after the other."""
    nodes = group.nodes.astype(np.int64)
    known = _PIECES.get((group.corners, nodes.shape[1]))
    return nodes if known is None else nodes[:, known].reshape(-1, group.corners)
