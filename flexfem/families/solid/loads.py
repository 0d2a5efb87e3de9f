# SPDX-License-Identifier: LGPL-3.0-or-later
"""Loads on surfaces of solids: pressures that follow them, and dead forces."""

from __future__ import annotations

from dataclasses import KW_ONLY, InitVar, field

import numpy.typing as npt

from flexfem import _checks
from flexfem._fields import declared, number, text
from flexfem._types import FloatArray
from flexfem.core.load import NOTHING, Amplitude, Load

__all__ = ["SurfacePressure", "SurfaceTraction"]


class _OnSurface(Load):
    """Load on a named surface of a solid."""

    solid: str
    surface: str
    _owner = property(Load._check)

    @property
    def bodies(self) -> tuple[str, ...]:
        """See :attr:`flexfem.core.load.Load.bodies`."""
        return (self.solid,)

    @property
    def wrench(self) -> tuple[FloatArray, FloatArray]:
        """See :attr:`flexfem.core.load.Load.wrench`: none at markers."""
        return NOTHING, NOTHING


@declared
class SurfacePressure(_OnSurface):
    """Uniform pressure on a surface of a solid, or on an edge of a plane one.

    It stays normal to the surface and acts on its present area; a positive pressure pushes into the
    solid.

    Attributes:
        name: Unique name in the model.
        solid: Name of the solid.
        surface: Name of the surface in its mesh, or "boundary" for all of it.
        pressure: Pa.
        amplitude: Factor as a function of time, None for the constant 1.

    Raises:
        TypeError: An argument has the wrong type.
        ValueError: The pressure is not finite.
    """

    name: str
    solid: str = text()
    surface: str = text()
    pressure: float = number()
    _: KW_ONLY
    amplitude: Amplitude | None = None

    follower = True


@declared
class SurfaceTraction(_OnSurface):
    """Uniform dead force per area at the start on a surface of a solid, or on an edge.

    Attributes:
        name: Unique name in the model.
        solid: Name of the solid.
        surface: Name of the surface in its mesh, or "boundary" for all of it.
        traction: In inertial axes, shape (3,), N/m^2, given as ``force_per_area``.
        amplitude: Factor as a function of time, None for the constant 1.

    Raises:
        TypeError: An argument has the wrong type.
        ValueError: An argument has the wrong shape or is not finite.
    """

    name: str
    solid: str = text()
    surface: str = text()
    force_per_area: InitVar[npt.ArrayLike]
    traction: FloatArray = field(init=False)
    _: KW_ONLY
    amplitude: Amplitude | None = None

    follower = False

    def __post_init__(self, force_per_area: npt.ArrayLike) -> None:
        """Take the force."""
        traction = _checks.vector(self._owner, "force_per_area", force_per_area)
        _checks.assign(self, traction=traction)
