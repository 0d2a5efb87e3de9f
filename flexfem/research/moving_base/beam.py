# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cantilever beam on a moving base, as a case's model.

Three theories with assumed modes, and when each fails:

- *consistent* (Kane, Ryan, Banerjee 1987): the stretch of the axis is a coordinate, not the axial
  displacement, sections rotate by theta1 about a1, then theta2 about a2, then theta3 about a3, and
  velocities are linearised only after what has to be differentiated has been. Spinning stiffens the
  beam. The equations are linear in the modal coordinates: deflections must be small against the
  length, twist and slopes against one radian. Of forces that grow with the deformation only those
  are there on which the second order of the kinematics works. What is missing first is that a
  section which twists takes its bending axes along, and that bending in two planes twists: thin
  open sections feel it long before deflections are large. Spun up to 6 rad/s 8 m from the axis, the
  channel of ``manipulator.py`` twists by 33 degrees, exact elements by 43, which bend out of the
  plane by 0.03 m to the other side on the way. From 8 s on the twist is within 2.5 degrees, the lag
  is 4 per cent less at its peak, and the steady state agrees.
- *premature*: axial displacement, deflection and rotation of sections are linear in the coordinates
  from the start. The softening by the spin is there, the stiffening that outweighs it is not: the
  lowest bending mode in the plane of rotation diverges once the spin exceeds its frequency. Out of
  the plane frequencies do not change with the spin at all.
- *conventional*: besides, mass points on the axis move with the base, as in early codes for
  flexible bodies: no moments of inertia of sections, no eccentric mass centres. The functions are
  still modes of the whole beam; the mass matrix is that of the points, so that modes which twist
  have hardly any mass. It diverges at the same spin, and eccentric masses do not twist it.

Which rotation is linear in theta makes a difference of second order in the place of eccentric mass
centres, on which the forces of the undeformed beam work. With sections that rotate about the vector
theta (``Effects(rotations="vector")``) the channel is twisted by 41 degrees, but still by 28 at 10
s, where exact elements have 6 and the published sequence has 8.

All use the modes of the cantilever at rest; fast spinning needs more of them than the frequencies
of interest suggest, as its shapes become those of a string.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from flexfem import _checks
from flexfem.research.equations.vector_equations import DRIVER, VectorEquations
from flexfem.research.moving_base.base import FreeBase, PrescribedBase
from flexfem.research.moving_base.effects import Effects
from flexfem.research.moving_base.initial import Shape, check_shape
from flexfem.research.moving_base.properties import BeamProperties

__all__ = ["MovingBaseBeam"]


@dataclass(frozen=True, kw_only=True, eq=False)
class MovingBaseBeam:
    """A beam built into a rigid base; a case's ``build`` may return it.

    Attributes:
        properties: the beam's sections.
        base: motion of the base.
        effects: effects that the theory takes into account.
        modes: number of modes; two static functions of the stretch come on top.
        elements: about as many finite elements for them.
        analytic: numbers of analytic functions of s, u2, u3 and theta1 instead; None for modes.
        damping_ratio: of every function with the base at rest, or one for each, lowest frequency
            first; the last one holds for those that follow.
        displacement: relative to the base at the start: values of s, u2, u3 (m) and theta1 (rad)
            at the tip by name, as loads there bend the beam (those of u2, u3 and theta1 that are
            not given are zero), or a function of points x (k,) to all six fields (6, k), which is
            projected on the functions. None: undeformed.
        velocity: the same per second. None: at rest relative to the base.
    """

    properties: BeamProperties
    base: PrescribedBase | FreeBase
    effects: Effects = field(default_factory=Effects)
    modes: int = 10
    elements: int = 24
    analytic: Sequence[int] | None = None
    damping_ratio: float | Sequence[float] = 0.0
    displacement: Shape | None = None
    velocity: Shape | None = None

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
        stretch = " and 2 static functions" if self.effects.extension else ""
        functions = f"{self.modes} modes{stretch} of {self.elements} elements"
        if self.analytic is not None:
            functions = f"{', '.join(map(str, self.analytic))} functions of s, u2, u3, theta1"
        return "\n".join(
            [
                f"{self!r} on a {type(self.base).__name__}",
                f"  length {self.properties.length:.5g} m, segments: {segments}",
                f"  mass {mass:.5g} kg, mass centre {centre:.5g} m from the base",
                f"  {functions}",
                f"  effects left out: {', '.join(self.effects.left_out) or 'none'}",
                f"  rotations of sections: {self.effects.rotations}",
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
        ratios = np.atleast_1d(np.asarray(self.damping_ratio, dtype=object))
        if ratios.ndim != 1 or not len(ratios):
            raise ValueError(f"{owner}: damping_ratio must be a number or a list of them")
        for ratio in ratios.tolist():
            _checks.number(owner, "damping_ratio", ratio, nonnegative=True)
        for what in ("displacement", "velocity"):
            check_shape(owner, what, getattr(self, what))
        for what in ("modes", "elements"):
            if getattr(self, what) < 1:
                raise ValueError(f"{owner}: {what} must be at least 1, got {getattr(self, what)}")

    def equations(self, comm: Any = None) -> VectorEquations:
        """Modes, their integrals and the equations; every rank computes the same.

        Raises:
            ValueError: a property is out of range, or there are not as many modes.
        """
        from flexfem.research.moving_base.basis import analytic_basis, modal_basis
        from flexfem.research.moving_base.equations import (
            FreeBaseEquations,
            PrescribedBaseEquations,
            Setting,
        )
        from flexfem.research.moving_base.inertia import inertia_of

        if self.analytic is None:
            basis = modal_basis(self.properties, self.effects, self.modes, self.elements)
        else:
            basis = analytic_basis(self.properties, self.effects, self.analytic)
        inertia = inertia_of(basis, self.effects)
        setting = Setting(self.effects, self.damping_ratio, self.displacement, self.velocity)
        if isinstance(self.base, FreeBase):
            return FreeBaseEquations(basis, inertia, self.base, setting)
        return PrescribedBaseEquations(basis, inertia, self.base, setting)
