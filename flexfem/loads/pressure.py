# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pressure on a shell."""

from dataclasses import KW_ONLY

from flexfem._fields import declared, number, text
from flexfem._types import FloatArray
from flexfem.core.load import NOTHING, Amplitude, Load


@declared
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

    Raises:
        TypeError: An argument has the wrong type.
        ValueError: The pressure is not finite.
    """

    name: str
    shell: str = text()
    pressure: float = number()
    _: KW_ONLY
    amplitude: Amplitude | None = None

    follower = True
    _owner = property(Load._check)

    @property
    def shells(self) -> tuple[str, ...]:
        """See :attr:`flexfem.core.load.Load.shells`."""
        return (self.shell,)

    @property
    def wrench(self) -> tuple[FloatArray, FloatArray]:
        """See :attr:`flexfem.core.load.Load.wrench`: no force of fixed components."""
        return NOTHING, NOTHING
