# SPDX-License-Identifier: LGPL-3.0-or-later
"""Force per length along a line of a shell."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._types import FloatArray, IntArray
from flexfem.core.load import Amplitude
from flexfem.loads.shell_load import ShellLoad, summed
from flexfem.mesh.topology import edge_keys

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
        _checks.assign(self, name=name, shell=shell, line=line, amplitude=amplitude)
        owner = self._check()
        _checks.text(owner, "shell", shell)
        _checks.text(owner, "line", line)
        _checks.assign(self, force=_checks.vector(owner, "force_per_length", force_per_length))

    def check(self, mesh: SurfaceMesh, body: str) -> None:
        """See :meth:`flexfem.loads.shell_load.ShellLoad.check`."""
        owner = f'EdgeLoad "{self.name}"'
        if self.line not in mesh.lines:
            known = _checks.show(", ".join(mesh.lines) or "none", 200)
            raise ValueError(f'{owner}: line "{self.line}" is not in the mesh, which has {known}')
        rows, count = mesh.triangles[mesh.bodies[body]], len(mesh.points)
        own = [edge_keys(rows[:, [k, (k + 1) % 3]], count) for k in range(3)]
        if not np.isin(edge_keys(mesh.lines[self.line], count), np.concatenate(own)).all():
            raise ValueError(f'{owner}: line "{self.line}" is not on Shell "{self.shell}"')

    def shares(self, mesh: SurfaceMesh, body: str) -> tuple[IntArray, FloatArray]:
        """See :meth:`flexfem.loads.shell_load.ShellLoad.shares`."""
        pairs = mesh.lines[self.line]
        lengths = np.linalg.norm(mesh.points[pairs[:, 1]] - mesh.points[pairs[:, 0]], axis=1)
        return summed(pairs, lengths)
