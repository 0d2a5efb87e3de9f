# SPDX-License-Identifier: LGPL-3.0-or-later
"""Common parts of dead forces spread over a shell or along a line of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy.typing as npt

from flexfem import _checks
from flexfem._types import FloatArray, IntArray
from flexfem.core.load import NOTHING, Amplitude, Load

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

    def _assign(
        self, name: str, shell: str, what: str, value: npt.ArrayLike, amplitude: Amplitude | None
    ) -> None:
        """Check and store the fields; messages call the force `what`.

        Raises:
            TypeError: A field has the wrong type.
            ValueError: The value has the wrong shape or is not finite.
        """
        _checks.assign(self, name=name, shell=shell, amplitude=amplitude)
        owner = self._check()
        _checks.text(owner, "shell", shell)
        _checks.assign(self, force=_checks.vector(owner, what, value))

    @property
    def shells(self) -> tuple[str, ...]:
        """See :attr:`flexfem.core.load.Load.shells`."""
        return (self.shell,)

    @property
    def wrench(self) -> tuple[FloatArray, FloatArray]:
        """See :attr:`flexfem.core.load.Load.wrench`."""
        return self.force, NOTHING

    def check(self, mesh: SurfaceMesh, body: str) -> None:
        """Check what the load needs of its shell's body in the mesh.

        Raises:
            ValueError: It is not there; the message begins with the load.
        """

    def elements(self, mesh: SurfaceMesh, body: str) -> IntArray:
        """Return the nodes in the mesh of the edges (m, 2) or triangles (m, 3) that carry it."""
        raise NotImplementedError
