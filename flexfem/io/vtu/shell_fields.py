# SPDX-License-Identifier: LGPL-3.0-or-later
"""Shells as triangles for ParaView."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from flexfem.io.vtu.field_choice import EVERYTHING, FieldChoice
from flexfem.io.vtu.series import VtuSeries

if TYPE_CHECKING:
    from mpi4py import MPI

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

COMPONENTS = {
    "strain": ("eps11", "eps22", "gamma12", "kappa11", "kappa22", "2kappa12"),
    "resultant": ("n11", "n22", "n12", "m11", "m22", "m12"),
}


@dataclass(frozen=True)
class ShellFields:
    """This rank's triangles and their nodes at one instant; arrays may have no rows.

    Attributes:
        position: Node positions (n, 3), inertial, m.
        displacement: Node displacements (n, 3), inertial, m.
        velocity: Node velocities (n, 3), inertial, m/s.
        cells: Node numbers (m, 3).
        body: Number of each triangle's shell (m,).
        strain: Membrane strains and curvatures (m, 6) along the material axes, 1 and 1/m.
        resultant: Forces in N/m and moments in N (m, 6).
        thickness: Of each triangle (m,), m.
        energy: Strain energies of membrane, bending and shear per area at the start (m, 3), J/m^2.
    """

    position: FloatArray
    displacement: FloatArray
    velocity: FloatArray
    cells: IntArray
    body: IntArray
    strain: FloatArray
    resultant: FloatArray
    thickness: FloatArray
    energy: FloatArray

    @classmethod
    def empty(cls) -> ShellFields:
        """Fields of a rank without shells."""
        v, s, i = np.zeros((0, 3)), np.zeros((0, 6)), np.zeros(0, dtype=np.int64)
        return cls(v, v, v, np.zeros((0, 3), dtype=np.int64), i, s, s, np.zeros(0), v)


class ShellWriter:
    """Series ``shells``: deformed triangles with strains and stress resultants."""

    def __init__(
        self, folder: Path, comm: MPI.Comm, *, resume: float | None = None,
        fields: FieldChoice = EVERYTHING,
    ) -> None:  # fmt: skip
        """Declare the series; nothing is written yet.

        Args:
            folder: Result folder.
            comm: Communicator; `write` and `close` are collective.
            resume: Keep the instants of an earlier run up to this time (s).
            fields: To write, and their precision.
        """
        self._series = VtuSeries(
            folder, "shells", comm, components=COMPONENTS, resume=resume, fields=fields
        )

    def write(self, time: float, step: int, shells: ShellFields) -> None:
        """Write one instant; collective.

        Args:
            time: Time in s.
            step: Step number.
            shells: This rank's part.
        """
        self._series.write(
            time,
            step,
            shells.position,
            shells.cells,
            "triangle",
            {"displacement": shells.displacement, "velocity": shells.velocity},
            {
                "body": shells.body,
                "strain": shells.strain,
                "resultant": shells.resultant,
                "bending_moment": _largest_moment(shells.resultant),
                "thickness": shells.thickness,
                "membrane_energy": shells.energy[:, 0],
                "bending_energy": shells.energy[:, 1],
            },
        )

    def close(self) -> None:
        """End the series; collective."""
        self._series.close()


def _largest_moment(resultant: FloatArray) -> FloatArray:
    """Principal moment of the largest size (m,), N."""
    first, second, mixed = resultant[:, 3:].T
    largest: FloatArray = np.abs(0.5 * (first + second)) + np.hypot(0.5 * (first - second), mixed)
    return largest
