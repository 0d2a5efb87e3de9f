# SPDX-License-Identifier: LGPL-3.0-or-later
"""Distribution of forces among redundant actuators: the ones of least norm."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from flexfem import _checks
from flexfem._types import FloatArray
from flexfem.core.marker import Marker

__all__ = ["Distribution", "DriveState", "LeastEffort", "LeastJointForces", "LeastPower"]

#: Rates of drives, relative to the largest of all times, that count as rest.
_REST = 1e-9


@dataclass(frozen=True)
class DriveState:
    """State of the mechanism at one time, as distributions see it.

    Attributes:
        names: of the actuators.
        rates, accelerations: (k,) of their coordinates, m/s or rad/s, m/s^2 or rad/s^2.
        joint_forces: (3 m,) forces of the joints at the markers asked for while actuators do
            nothing, N.
        by_force: (3 m, k) their derivatives by the actuators' forces.
    """

    names: tuple[str, ...]
    rates: FloatArray
    accelerations: FloatArray
    joint_forces: FloatArray
    by_force: FloatArray


class Distribution(Protocol):
    """Chooses the forces tau that make ``|W tau + w|`` least among those that drive the motion."""

    @property
    def markers(self) -> tuple[Marker, ...]:
        """Markers whose joint forces it needs."""
        ...

    def norm(self, state: DriveState) -> tuple[FloatArray, FloatArray]:
        """W (m, k) and w (m,)."""
        ...


@dataclass(frozen=True)
class LeastEffort:
    """Least Euclidean norm of the actuators' forces and torques, each divided by its scale.

    With equal scales ``tau = J (J^T J)^-1 F``, J from the rates of the outputs to those of the
    actuators (Nahon, Angeles, ASME J. Mech. Des. 114 (1992) 25-31).

    Attributes:
        scales: one for each actuator, N or N m; 1 for all when empty.
    """

    scales: Sequence[float] = ()

    def __post_init__(self) -> None:
        """Check the scales.

        Raises:
            TypeError: they are no numbers.
            ValueError: one is not positive.
        """
        for scale in self.scales:
            _checks.number("LeastEffort", "scales", scale, positive=True)

    @property
    def markers(self) -> tuple[Marker, ...]:
        """See :class:`Distribution`."""
        return ()

    def norm(self, state: DriveState) -> tuple[FloatArray, FloatArray]:
        """See :class:`Distribution`.

        Raises:
            ValueError: another number of scales than actuators.
        """
        count = len(state.names)
        scales = np.array(self.scales or [1.0] * count)
        if len(scales) != count:
            raise ValueError(f"LeastEffort: {len(scales)} scales for {count} actuators")
        return np.diag(1.0 / scales), np.zeros(count)


@dataclass(frozen=True)
class LeastPower:
    """Least Euclidean norm of the powers of the actuators, force times rate.

    Where all of them rest, rates are about to be in the ratio of the accelerations, which then
    count instead; where these vanish too, the norm is that of the forces.
    """

    @property
    def markers(self) -> tuple[Marker, ...]:
        """See :class:`Distribution`."""
        return ()

    def norm(self, state: DriveState) -> tuple[FloatArray, FloatArray]:
        """See :class:`Distribution`."""
        count = len(state.names)
        for weights, size in ((state.rates, _REST), (state.accelerations, _REST)):
            largest = float(np.abs(weights).max(initial=0.0))
            if largest > size:
                return np.diag(weights / largest), np.zeros(count)
        return np.eye(count), np.zeros(count)


@dataclass(frozen=True)
class LeastJointForces:
    """Least Euclidean norm of the forces that joints exert on bodies at some markers.

    Attributes:
        at: the markers, at each of which all joints count together. A force of a joint between two
            markers acts on both: give one of them, or it counts twice.
    """

    at: Sequence[Marker]

    def __post_init__(self) -> None:
        """Check the markers.

        Raises:
            TypeError: one is no marker on a body.
            ValueError: there are none.
        """
        for marker in self.at:
            _checks.instance("LeastJointForces", "at", marker, Marker)
        if not self.at:
            raise ValueError("LeastJointForces: at must hold at least one marker, got none")

    @property
    def markers(self) -> tuple[Marker, ...]:
        """See :class:`Distribution`."""
        return tuple(self.at)

    def norm(self, state: DriveState) -> tuple[FloatArray, FloatArray]:
        """See :class:`Distribution`."""
        return state.by_force, state.joint_forces
