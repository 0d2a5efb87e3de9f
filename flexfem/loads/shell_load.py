# SPDX-License-Identifier: LGPL-3.0-or-later
"""Common parts of dead forces spread over a shell or along a line of it."""

from typing import TYPE_CHECKING

from flexfem._types import FloatArray, IntArray
from flexfem.core.load import NOTHING, Load

if TYPE_CHECKING:
    from flexfem.mesh.surface_mesh import SurfaceMesh

__all__ = ["ShellLoad"]


class ShellLoad(Load):
    """Load on a shell: a dead force per length or area at the start.

    Attributes:
        name: Unique name in the model.
        shell: Name of the shell.
        force: In inertial axes, shape (3,), per metre or square metre.
        amplitude: Factor as a function of time, None for the constant 1.
    """

    shell: str
    force: FloatArray
    follower = False
    _owner = property(Load._check)

    @property
    def shells(self) -> tuple[str, ...]:
        """See :attr:`flexfem.core.load.Load.shells`."""
        return (self.shell,)

    @property
    def wrench(self) -> tuple[FloatArray, FloatArray]:
        """See :attr:`flexfem.core.load.Load.wrench`."""
        return self.force, NOTHING

    def check(self, mesh: "SurfaceMesh", body: str) -> None:
        """Check the shell's body in the mesh for this load.

        Raises:
            ValueError: It is not there; the message begins with the load.
        """

    def elements(self, mesh: "SurfaceMesh", body: str) -> IntArray:
        """Return the nodes in the mesh of the edges (m, 2) or triangles (m, 3) that carry it."""
        raise NotImplementedError
