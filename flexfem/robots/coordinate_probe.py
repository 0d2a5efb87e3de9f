# SPDX-License-Identifier: LGPL-3.0-or-later
"""Coordinates of joints in the history."""

from collections.abc import Sequence
from math import atan2

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.joint import perpendicular
from flexfem.model.probes.base import MarkerState, Probe
from flexfem.robots.connections import Connection

__all__ = ["coordinate_probe"]


class _Coordinate:
    """Coordinate and rate of one joint from the states of its markers."""

    def __init__(self, it: Connection) -> None:
        self._turns, self._start = it.motion == "rotation", it.start.value
        axis = np.array(it.axis)
        p, q = perpendicular(axis)
        # directions fixed in either marker
        self._axis, self._p, self._q = (it.a.rotation.T @ x for x in (axis, p, q))
        self._b: FloatArray = it.b.rotation.T @ p

    def __call__(self, a: MarkerState, b: MarkerState) -> tuple[float, float]:
        axis = a.rotation @ self._axis
        if self._turns:
            arm = a.rotation.T @ (b.rotation @ self._b)
            angle = atan2(float(self._q @ arm), float(self._p @ arm))
            return self._start + angle, float(axis @ (b.angular_velocity - a.angular_velocity))
        apart = b.position - a.position
        speed = b.velocity - a.velocity - np.cross(a.angular_velocity, apart)
        return float(axis @ apart), float(axis @ speed)


def coordinate_probe(name: str, connections: Sequence[Connection]) -> Probe:
    """A probe with coordinate and rate of each joint; angles are continuous."""
    coordinates = [_Coordinate(it) for it in connections]

    def values(t: float, *states: MarkerState) -> list[float]:
        pairs = zip(coordinates, states[::2], states[1::2], strict=True)
        return [value for of, a, b in pairs for value in of(a, b)]

    return Probe(
        name,
        [marker for it in connections for marker in (it.a, it.b)],
        [column for it in connections for column in (it.name, f"{it.name}_rate")],
        values,
        unwrap=[it.name for it in connections if it.motion == "rotation"],
    )
