# SPDX-License-Identifier: LGPL-3.0-or-later
"""Force and moment per length along a line of a shell."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._types import FloatArray, IntArray
from flexfem.core.load import NOTHING, Amplitude
from flexfem.loads.shell_load import ShellLoad
from flexfem.mesh.surface_topology import sides_along
from flexfem.mesh.topology import edge_keys

if TYPE_CHECKING:
    from flexfem.mesh.surface_mesh import SurfaceMesh


@dataclass(frozen=True, eq=False, init=False)
class EdgeLoad(ShellLoad):
    """Uniform dead force and bending moment per length at the start along a line of a shell.

    The moment is about the edge and follows it: a positive one turns the edge towards the normal of
    the shell. It acts on the triangles beside the line, which lies at the boundary: in the bending
    that it causes half a triangle is missing, an error of first order in the size of these.

    Attributes:
        name: Unique name in the model.
        shell: Name of the shell.
        line: Name of a line of the surface mesh, at the shell's boundary or inside it.
        force: In inertial axes, shape (3,), N/m.
        moment_per_length: About the edge, N m/m.
        amplitude: Factor as a function of time, None for the constant 1.
    """

    name: str
    shell: str
    line: str
    force: FloatArray
    moment_per_length: float
    amplitude: Amplitude | None

    def __init__(
        self,
        name: str,
        shell: str,
        line: str,
        force_per_length: npt.ArrayLike = NOTHING,
        *,
        moment_per_length: float = 0.0,
        amplitude: Amplitude | None = None,
    ) -> None:
        """Create the load.

        Raises:
            TypeError: An argument has the wrong type.
            ValueError: An argument has the wrong shape or is not finite.
        """
        self._assign(name, shell, "force_per_length", force_per_length, amplitude)
        owner = self._check()
        moment = _checks.number(owner, "moment_per_length", moment_per_length)
        _checks.assign(self, line=_checks.text(owner, "line", line), moment_per_length=moment)

    @property
    def has_moment(self) -> bool:
        """See :attr:`flexfem.core.load.Load.has_moment`."""
        return self.moment_per_length != 0.0

    def check(self, mesh: SurfaceMesh, body: str) -> None:
        """See :meth:`flexfem.loads.shell_load.ShellLoad.check`."""
        owner = f'EdgeLoad "{self.name}"'
        if self.line not in mesh.lines:
            known = _checks.show(", ".join(mesh.lines) or "none", 200)
            raise ValueError(f'{owner}: line "{self.line}" is not in the mesh, which has {known}')
        triangles = mesh.triangles[mesh.bodies[body]]
        if (sides_along(triangles, mesh.lines[self.line], len(mesh.points)) < 0).any():
            raise ValueError(f'{owner}: line "{self.line}" is not on Shell "{self.shell}"')
        pairs = edge_keys(mesh.lines[self.line], len(mesh.points))
        sides = np.concatenate([np.roll(triangles, -k, axis=1)[:, :2] for k in range(3)])
        counts = np.isin(edge_keys(sides, len(mesh.points)), pairs).sum()
        if self.has_moment and counts > len(pairs):
            raise ValueError(
                f'{owner}: line "{self.line}" runs inside Shell "{self.shell}", where a moment has '
                "no side to turn"
            )

    def elements(self, mesh: SurfaceMesh, body: str) -> IntArray:
        """See :meth:`flexfem.loads.shell_load.ShellLoad.elements`."""
        return mesh.lines[self.line]
