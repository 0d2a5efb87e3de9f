# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cantilever beam on a moving base, as a case's model.

Two theories with assumed modes, and when each fails:

- *consistent* (Kane, Ryan, Banerjee 1987): the stretch of the axis is a coordinate, not the axial
  displacement, and velocities are linearised only after what has to be differentiated has been.
  Spinning stiffens the beam. The equations are linear in the modal coordinates: deflections must be
  small against the length, twist and slopes against one radian. Of forces that grow with the
  deformation only the axial one is there. What is missing first is that a section which twists
  takes its bending axes along, and that bending in two planes twists: thin open sections feel it
  long before deflections are large. Spun up by 6 rad/s 8 m from the axis, the channel of
  ``manipulator.py`` twists by 41 degrees; exact elements have 43, but leave the twist much earlier
  and bend out of the plane by 0.03 m to the other side on the way. Lag (3 per cent), stretch and
  the steady state (1 per cent) agree.
- *conventional*: as in early codes for flexible bodies, axial displacement and deflection are
  independent and linear. The softening by the spin is there, the stiffening that outweighs it is
  not: the lowest bending mode in the plane of rotation diverges once the spin exceeds its
  frequency. Out of the plane frequencies do not change with the spin at all.

Both use the modes of the cantilever at rest; fast spinning needs more of them than the frequencies
of interest suggest, as its shapes become those of a string.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, ClassVar

from flexfem import _checks
from flexfem.core.equations import DRIVER, Equations
from flexfem.moving_base.base import FreeBase, PrescribedBase
from flexfem.moving_base.effects import Effects
from flexfem.moving_base.properties import BeamProperties

__all__ = ["MovingBaseBeam"]


@dataclass(frozen=True, kw_only=True, eq=False)
class MovingBaseBeam:
    """A beam built into a rigid base; what a case's ``build`` may return.

    Attributes:
        properties: the beam's sections.
        base: how the base moves.
        effects: what the theory takes into account.
        modes: number of modes; two static functions of the stretch come on top.
        elements: about as many finite elements for them.
        analytic: numbers of analytic functions of s, u2, u3 and theta1 instead; None for modes.
        damping_ratio: of every mode with the base at rest.
    """

    properties: BeamProperties
    base: PrescribedBase | FreeBase
    effects: Effects = field(default_factory=Effects)
    modes: int = 10
    elements: int = 24
    analytic: Sequence[int] | None = None
    damping_ratio: float = 0.0

    drivers: ClassVar[Mapping[str, str]] = {"dynamics": DRIVER}

    def __repr__(self) -> str:
        """Short name for messages."""
        return "MovingBaseBeam"

    def __str__(self) -> str:
        """Length, mass, number of functions and the effects that are left out."""
        segments = len(self.properties.breaks) - 1
        x, lengths = self.properties.gauss_points()
        values = self.properties.at(x)
        mass = float(lengths @ values["mass_per_length"])
        centre = float(lengths @ (values["mass_per_length"] * x)) / mass
        functions = f"{self.modes} modes of {self.elements} elements"
        if self.analytic is not None:
            functions = f"{', '.join(map(str, self.analytic))} functions of s, u2, u3, theta1"
        left_out = [f.name for f in fields(self.effects) if not getattr(self.effects, f.name)]
        return "\n".join(
            [
                f"{self!r} on a {type(self.base).__name__}",
                f"  length {self.properties.length:.5g} m, segments: {segments}",
                f"  mass {mass:.5g} kg, mass centre {centre:.5g} m from the base",
                f"  {functions}",
                f"  effects left out: {', '.join(left_out) or 'none'}",
            ]
        )

    def validate(self) -> None:
        """Check the data.

        Raises:
            TypeError: something has the wrong type.
            ValueError: a number is out of range.
        """
        owner = "MovingBaseBeam"
        _checks.instance(owner, "properties", self.properties, BeamProperties)
        _checks.instance(owner, "base", self.base, (PrescribedBase, FreeBase))
        _checks.instance(owner, "effects", self.effects, Effects)
        _checks.number(owner, "damping_ratio", self.damping_ratio, nonnegative=True)
        for what in ("modes", "elements"):
            if getattr(self, what) < 1:
                raise ValueError(f"{owner}: {what} must be at least 1, got {getattr(self, what)}")

    def equations(self, comm: Any = None) -> Equations:
        """Modes, their integrals and the equations; every rank computes the same.

        Raises:
            ValueError: a property is out of range, or there are not as many modes.
        """
        from flexfem.moving_base.basis import analytic_basis, modal_basis
        from flexfem.moving_base.equations import FreeBaseEquations, PrescribedBaseEquations
        from flexfem.moving_base.inertia import inertia_of

        if self.analytic is None:
            basis = modal_basis(self.properties, self.effects, self.modes, self.elements)
        else:
            basis = analytic_basis(self.properties, self.effects, self.analytic)
        inertia = inertia_of(basis, self.effects)
        more = (self.effects.stiffening, self.damping_ratio)
        if isinstance(self.base, FreeBase):
            return FreeBaseEquations(basis, inertia, self.base, *more)
        return PrescribedBaseEquations(basis, inertia, self.base, *more)
