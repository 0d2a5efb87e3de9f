# SPDX-License-Identifier: LGPL-3.0-or-later
"""Series for ParaView of nets of cables, with their tensions."""

from collections.abc import Sequence
from pathlib import Path

from mpi4py import MPI

import numpy as np

from flexfem.families.cable_net.elements import CableElements
from flexfem.io.vtu.field_choice import EVERYTHING, FieldChoice
from flexfem.io.vtu.series import VtuSeries
from flexfem.layout.numbered_model import NumberedModel
from flexfem.lie import se3
from flexfem.system.system import BlockPart

__all__ = ["NetSeries"]


class NetSeries:
    """Cables with displacements, velocities, elastic tensions (N) and strains.

    See ``flexfem.io.paraview.family_series.Series``. Strains of slack cables are negative.
    """

    shown_as = ("cable_nets",)

    def __init__(
        self, folder: Path, comm: MPI.Intracomm, parts: Sequence[BlockPart], serial: NumberedModel,
        resume: float | None, fields: FieldChoice = EVERYTHING,
    ) -> None:  # fmt: skip
        """See ``flexfem.io.paraview.family_series.Series``."""
        self._parts = list(parts)
        self._series = VtuSeries(folder, "cable_nets", comm, resume=resume, fields=fields)

    def write(self, time: float, step: int) -> None:
        """See ``flexfem.io.paraview.family_series.Series``."""
        for part in self._parts:
            block, elements = part.block, part.elements
            assert isinstance(elements, CableElements)
            x, turn = se3.position(block.frames), se3.rotation(block.frames)
            strain, tension = elements.resultants(block.frames)
            self._series.write(
                time, step, x, elements.support, "line",
                {
                    "displacement": x - se3.position(block.start_frames),
                    "velocity": np.einsum("nij,nj->ni", turn, block.velocity[:, :3]),
                },
                {"body": elements.body, "tension": tension[:, 0], "strain": strain[:, 0]},
            )  # fmt: skip

    def close(self) -> None:
        """See ``flexfem.io.paraview.family_series.Series``."""
        self._series.close()
