# SPDX-License-Identifier: LGPL-3.0-or-later
"""Force per length along a line of a shell."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy.typing as npt

from flexfem import _checks
from flexfem._types import FloatArray, IntArray
from flexfem.core.load import Amplitude
from flexfem.loads.shell_load import ShellLoad
from flexfem.mesh.surface_topology import sides_along

if TYPE_CHECKING:
    from flexfem.mesh.surface_mesh import SurfaceMesh


@dataclass(frozen=True, eq=False, init=False)
class EdgeLoad(ShellLoad):
    """Uniform dead force per length at the start along a line of a shell.

    Attributes:
        name: Unique name in the model.
        shell: Name of the shell.
        line: Name of a line of the surface mesh, at the shell's boundary or inside it.
        force: In inertial axes, shape (3,), N/m.
        amplitude: Factor as a function of time, None for the constant 1.
    """

    name: str
    shell: str
    line: str
    force: FloatArray
    amplitude: Amplitude | None

    def __init__(
        self,
        name: str,
        shell: str,
        line: str,
        force_per_length: npt.ArrayLike,
        *,
        amplitude: Amplitude | None = None,
    ) -> None:
        """Create the load.

        Raises:
            TypeError: An argument has the wrong type.
            ValueError: An argument has the wrong shape or is not finite.
        """
        self._assign(name, shell, "force_per_length", force_per_length, amplitude)
        _checks.assign(self, line=_checks.text(self._check(), "line", line))

    def check(self, mesh: SurfaceMesh, body: str) -> None:
        """See :meth:`flexfem.loads.shell_load.ShellLoad.check`."""
        owner = f'EdgeLoad "{self.name}"'
        if self.line not in mesh.lines:
            known = _checks.show(", ".join(mesh.lines) or "none", 200)
            raise ValueError(f'{owner}: line "{self.line}" is not in the mesh, which has {known}')
        triangles = mesh.triangles[mesh.bodies[body]]
        if (sides_along(triangles, mesh.lines[self.line], len(mesh.points)) < 0).any():
            raise ValueError(f'{owner}: line "{self.line}" is not on Shell "{self.shell}"')

    def elements(self, mesh: SurfaceMesh, body: str) -> IntArray:
        """See :meth:`flexfem.loads.shell_load.ShellLoad.elements`."""
        return mesh.lines[self.line]
