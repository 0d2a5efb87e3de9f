# SPDX-License-Identifier: LGPL-3.0-or-later
"""Force per area of a shell."""

from dataclasses import KW_ONLY, InitVar, field
from typing import TYPE_CHECKING

import numpy.typing as npt

from flexfem import _checks
from flexfem._fields import declared, text
from flexfem._types import FloatArray, IntArray
from flexfem.core.load import Amplitude
from flexfem.loads.shell_load import ShellLoad

if TYPE_CHECKING:
    from flexfem.mesh.surface_mesh import SurfaceMesh


@declared
class SurfaceLoad(ShellLoad):
    """Uniform dead force per area at the start on a whole shell.

    Attributes:
        name: Unique name in the model.
        shell: Name of the shell.
        force: In inertial axes, shape (3,), N/m^2, given as ``force_per_area``.
        amplitude: Factor as a function of time, None for the constant 1.

    Raises:
        TypeError: An argument has the wrong type.
        ValueError: An argument has the wrong shape or is not finite.
    """

    name: str
    shell: str = text()
    force_per_area: InitVar[npt.ArrayLike]
    force: FloatArray = field(init=False)
    _: KW_ONLY
    amplitude: Amplitude | None = None

    def __post_init__(self, force_per_area: npt.ArrayLike) -> None:
        """Take the force."""
        force = _checks.vector(self._owner, "force_per_area", force_per_area)
        _checks.assign(self, force=force)

    def elements(self, mesh: "SurfaceMesh", body: str) -> IntArray:
        """See :meth:`flexfem.loads.shell_load.ShellLoad.elements`."""
        return mesh.triangles[mesh.bodies[body]]
