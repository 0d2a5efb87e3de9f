# SPDX-License-Identifier: LGPL-3.0-or-later
"""Motion of the rigid base that a beam is built into: prescribed, or free."""

from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY, dataclass

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._fields import ZERO, Array, checked, declared, number, vector
from flexfem._types import FloatArray

__all__ = ["FreeBase", "PrescribedBase"]

TimeFunction = Callable[[float], npt.ArrayLike]


def _still(t: float) -> Sequence[float]:
    return (0.0, 0.0, 0.0)


@dataclass(frozen=True, kw_only=True)
class PrescribedBase:
    """Base whose motion is given: functions of time (s) to components along a1, a2, a3.

    Attributes:
        velocity: of the beam's root O, m/s.
        acceleration: derivatives of these components, m/s^2; the acceleration of O is that plus
            omega x velocity.
        angular_velocity: rad/s.
        angular_acceleration: derivatives of its components, rad/s^2.
        position: of O in inertial axes, m, for pictures; None leaves it at the origin.
        rotation: of the axes a1, a2, a3 (columns) in inertial axes, (3, 3), for pictures; None for
            none.
    """

    angular_velocity: TimeFunction = _still
    angular_acceleration: TimeFunction = _still
    velocity: TimeFunction = _still
    acceleration: TimeFunction = _still
    position: TimeFunction | None = None
    rotation: TimeFunction | None = None

    def __post_init__(self) -> None:
        """Check the functions at t = 0, and that rates are those of the velocities.

        Raises:
            TypeError: one is no function.
            ValueError: one returns no three (nine) finite numbers, or a rate is not that of its
                velocity in the first hundredth of a second.
        """
        owner, h = "PrescribedBase", 1e-2
        for what, rate in (
            ("velocity", "acceleration"), ("angular_velocity", "angular_acceleration"),
        ):  # fmt: skip
            for name in (what, rate):
                _checks.function(owner, name, getattr(self, name), (3,))
            # Simpson's rule of the rate against the change of the value
            value, slope = getattr(self, what), getattr(self, rate)
            change = np.subtract(value(h), value(0.0))
            slopes = [np.asarray(slope(t), dtype=np.float64) for t in (0.0, 0.5 * h, h)]
            sum_of = h / 6.0 * (slopes[0] + 4.0 * slopes[1] + slopes[2])
            size = h * np.abs(slopes).max() + np.abs(change).max()
            if not np.abs(change - sum_of).max() <= 0.01 * size + 1e-12:
                raise ValueError(f"{owner}: {rate} is not the rate of {what} near t = 0")
        if self.position is not None:
            _checks.function(owner, "position", self.position, (3,))
        if self.rotation is not None:
            _checks.function(owner, "rotation", self.rotation, (3, 3))

    def twist(self, t: float) -> FloatArray:
        """Velocity of O and angular velocity, (6,)."""
        return np.concatenate([self.velocity(t), self.angular_velocity(t)])

    def rate(self, t: float) -> FloatArray:
        """Derivatives of the components of :meth:`twist`, (6,)."""
        return np.concatenate([self.acceleration(t), self.angular_acceleration(t)])

    def frame(self, t: float) -> FloatArray:
        """Position (3) and rotation (3 x 3, row by row) of the base, (12,)."""
        x = np.zeros(3) if self.position is None else np.asarray(self.position(t), dtype=np.float64)
        r = np.eye(3) if self.rotation is None else np.asarray(self.rotation(t), dtype=np.float64)
        return np.concatenate([x, r.reshape(-1)])


def _inertia(owner: str, what: str, value: npt.ArrayLike) -> FloatArray:
    """Return a checked inertia tensor."""
    whole = np.diag(value) if np.shape(value) == (3,) else value
    moments = _checks.array(owner, what, whole, (3, 3))
    if np.abs(moments - moments.T).max() > 1e-10 * np.abs(moments).max() or (
        np.linalg.eigvalsh(moments)[0] <= 0.0
    ):
        raise ValueError(
            f"{owner}: {what} must be symmetric and positive definite, got "
            f"{_checks.show(moments.tolist())}"
        )
    return moments


@declared
class FreeBase:
    """Rigid body that nothing holds; the beam's root O is its reference point.

    Attributes:
        mass: kg.
        inertia: about the mass centre in the axes a1, a2, a3, (3, 3) or its diagonal, kg m^2.
        centre: mass centre relative to O, m.
        velocity, angular_velocity: at the start, components along a1, a2, a3 (then the inertial
            axes), m/s and rad/s.

    Raises:
        TypeError: one is no number.
        ValueError: a wrong shape, or a mass or an inertia that is not positive.
    """

    _: KW_ONLY
    mass: float = number(positive=True)
    inertia: Array = checked(_inertia)
    centre: Array = vector(default=ZERO)
    velocity: Array = vector(default=ZERO)
    angular_velocity: Array = vector(default=ZERO)
