# SPDX-License-Identifier: LGPL-3.0-or-later
"""Force and moment per length along a line of a shell."""

from dataclasses import KW_ONLY, InitVar, field
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._fields import ZERO, declared, number, text
from flexfem._types import FloatArray, IntArray
from flexfem.core.load import Amplitude
from flexfem.loads.shell_load import ShellLoad
from flexfem.mesh.geometry.topology import edge_keys
from flexfem.mesh.triangles.topology import sides_along

if TYPE_CHECKING:
    from flexfem.mesh.surface_mesh import SurfaceMesh


@declared
class EdgeLoad(ShellLoad):
    """Uniform dead force and bending moment per length at the start along a line of a shell.

    The moment is about the edge and follows it: a positive one rotates the edge towards the normal
    of the shell. It acts on the triangles beside the line, which lies at the boundary: in the
    bending that it causes half a triangle is missing, an error of first order in the size of these.

    Attributes:
        name: Unique name in the model.
        shell: Name of the shell.
        line: Name of a line of the surface mesh, at the shell's boundary or inside it.
        force: In inertial axes, shape (3,), N/m, given as ``force_per_length``.
        moment_per_length: About the edge, N m/m.
        amplitude: Factor as a function of time, None for the constant 1.

    Raises:
        TypeError: An argument has the wrong type.
        ValueError: An argument has the wrong shape or is not finite.
    """

    name: str
    shell: str = text()
    line: str = text()
    force_per_length: InitVar[npt.ArrayLike] = ZERO
    force: FloatArray = field(init=False)
    _: KW_ONLY
    moment_per_length: float = number(default=0.0)
    amplitude: Amplitude | None = None

    def __post_init__(self, force_per_length: npt.ArrayLike) -> None:
        """Take the force."""
        force = _checks.vector(self._owner, "force_per_length", force_per_length)
        _checks.assign(self, force=force)

    @property
    def has_moment(self) -> bool:
        """See :attr:`flexfem.core.load.Load.has_moment`."""
        return self.moment_per_length != 0.0

    def check(self, mesh: "SurfaceMesh", body: str) -> None:
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

    def elements(self, mesh: "SurfaceMesh", body: str) -> IntArray:
        """See :meth:`flexfem.loads.shell_load.ShellLoad.elements`."""
        return mesh.lines[self.line]
