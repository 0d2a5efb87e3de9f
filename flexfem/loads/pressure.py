# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pressure on a shell."""

from dataclasses import dataclass

from flexfem import _checks
from flexfem._types import FloatArray
from flexfem.core.load import NOTHING, Amplitude, Load


@dataclass(frozen=True, eq=False, init=False)
class Pressure(Load):
    """Uniform pressure on a whole shell: it stays normal to the shell and acts on its present area.

    A positive pressure pushes along the unit normal of the triangles, as that of a gas inside a
    body whose normals point outwards. The normal is on the side from which the nodes of a triangle
    run counterclockwise; see :class:`flexfem.SurfaceMesh`.

    Attributes:
        name: Unique name in the model.
        shell: Name of the shell.
        pressure: Pa.
        amplitude: Factor as a function of time, None for the constant 1.
    """

    name: str
    shell: str
    pressure: float
    amplitude: Amplitude | None
    follower = True

    def __init__(
        self,
        name: str,
        shell: str,
        pressure: float,
        *,
        amplitude: Amplitude | None = None,
    ) -> None:
        """Create the load.

        Raises:
            TypeError: An argument has the wrong type.
            ValueError: The pressure is not finite.
        """
        _checks.assign(self, name=name, shell=shell, amplitude=amplitude)
        owner = self._check()
        _checks.text(owner, "shell", shell)
        _checks.assign(self, pressure=_checks.number(owner, "pressure", pressure))

    @property
    def shells(self) -> tuple[str, ...]:
        """See :attr:`flexfem.core.load.Load.shells`."""
        return (self.shell,)

    @property
    def wrench(self) -> tuple[FloatArray, FloatArray]:
        """See :attr:`flexfem.core.load.Load.wrench`: no force of fixed components."""
        return NOTHING, NOTHING
