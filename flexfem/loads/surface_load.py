# SPDX-License-Identifier: LGPL-3.0-or-later
"""Force per area of a shell."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy.typing as npt

from flexfem._types import FloatArray, IntArray
from flexfem.core.load import Amplitude
from flexfem.loads.shell_load import ShellLoad

if TYPE_CHECKING:
    from flexfem.mesh.surface_mesh import SurfaceMesh


@dataclass(frozen=True, eq=False, init=False)
class SurfaceLoad(ShellLoad):
    """Uniform dead force per area at the start on a whole shell.

    Attributes:
        name: Unique name in the model.
        shell: Name of the shell.
        force: In inertial axes, shape (3,), N/m^2.
        amplitude: Factor as a function of time, None for the constant 1.
    """

    name: str
    shell: str
    force: FloatArray
    amplitude: Amplitude | None

    def __init__(
        self,
        name: str,
        shell: str,
        force_per_area: npt.ArrayLike,
        *,
        amplitude: Amplitude | None = None,
    ) -> None:
        """Create the load.

        Raises:
            TypeError: An argument has the wrong type.
            ValueError: An argument has the wrong shape or is not finite.
        """
        self._assign(name, shell, "force_per_area", force_per_area, amplitude)

    def elements(self, mesh: SurfaceMesh, body: str) -> IntArray:
        """See :meth:`flexfem.loads.shell_load.ShellLoad.elements`."""
        return mesh.triangles[mesh.bodies[body]]
