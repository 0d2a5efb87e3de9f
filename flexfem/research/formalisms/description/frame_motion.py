# SPDX-License-Identifier: LGPL-3.0-or-later
"""Prescribed motions of floating frames.

The rotation is a product of rotations about given axes, so that Euler parameters and their two time
derivatives are products too: smooth in time over any number of turns, without a sign to choose.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from flexfem import _checks
from flexfem._faults import FAILURES, ReturnError
from flexfem._types import FloatArray
from flexfem.research.formalisms.description.frames import Frame, PlanarFrame

__all__ = ["FrameMotion", "Motion", "check_rates", "values_of"]

#: Value, first and second time derivative of a prescribed motion.
Motion = Callable[[float], tuple[Any, Any, Any]]

#: Times at which rates are compared with differences of values (s), the step of these relative to
#: the time, and the difference that is a mistake.
_TIMES, _STEP, _WRONG = (0.9e-3, 1.1e-2, 1.3e-1), 1e-5, 1e-2


def values_of(owner: str, motion: Motion, t: float, count: int) -> tuple[FloatArray, ...]:
    """Value, rate and second rate (count) of a function of time.

    Raises:
        ReturnError: the function returns something else (a ValueError).
    """
    parts = motion(t)
    try:
        shaped = [np.array(np.broadcast_to(part, (count,)), dtype=np.float64) for part in parts]
    except (TypeError, ValueError):
        shaped = []
    if len(shaped) != 3:
        raise ReturnError(
            f"{owner}: motion must return value, rate and second rate of {count} numbers, "
            f"got {_checks.show(parts)}"
        )
    return tuple(shaped)


def check_rates(owner: str, motion: Motion, count: int) -> None:
    """Compare rates and second rates with differences of their integrals.

    One place may have a kink, or lie where the function cannot be called: two must disagree.

    Raises:
        ValueError: they are others.
    """
    found: dict[str, list[str]] = {"rate": [], "second rate": []}
    for t in _TIMES:
        try:
            before, now, after = (
                values_of(owner, motion, t * (1.0 + s * _STEP), count) for s in (-1.0, 0.0, 1.0)
            )
        except FAILURES:  # the run reports it, if it gets there
            continue
        for k, name in enumerate(found, 1):
            h = t * _STEP
            slope = (after[k - 1] - before[k - 1]) / (2.0 * h)
            rounding = 1e-14 * np.abs(now[k - 1]).max() / h
            size = max(np.abs(slope).max(), np.abs(now[k]).max())
            if np.abs(slope - now[k]).max() > _WRONG * size + rounding:
                text = f"{_checks.show(now[k].tolist())} at t = {t:g} s, where differences give "
                found[name].append(text + _checks.show(slope.tolist()))
    for name, wrong in found.items():
        if len(wrong) > 1:
            raise ValueError(f"{owner}: the {name} of its motion is {wrong[0]}")


@dataclass(frozen=True)
class FrameMotion:
    """Motion of a floating frame that is prescribed.

    Every function of time (s) returns value, rate and second rate.

    Args:
        translation: displacement of the frame's origin from where the body is declared, inertial
            axes, m; None for an origin at rest.
        rotations: rotations (axis, angle in rad) one after the other, each about an axis in the
            frame as the previous rotations have left it; the first starts from the declared
            rotation. Turns about space-fixed axes are the same in reverse order.

    Raises:
        TypeError: an argument has the wrong type.
        ValueError: an axis is no direction.
    """

    translation: Motion | None = None
    rotations: Sequence[tuple[Any, Motion]] = field(default=())

    def __post_init__(self) -> None:
        """Check the arguments."""
        if self.translation is not None and not callable(self.translation):
            raise TypeError(
                f"FrameMotion: translation must be a function, got {_checks.show(self.translation)}"
            )
        turns = []
        for turn in self.rotations:
            if not isinstance(turn, (tuple, list)) or len(turn) != 2 or not callable(turn[1]):
                raise TypeError(
                    "FrameMotion: rotations must be pairs of an axis and a function, got "
                    f"{_checks.show(turn)}"
                )
            axis = _checks.vector("FrameMotion", "an axis", turn[0], nonzero=True)
            turns.append((_checks.freeze(axis / np.linalg.norm(axis)), turn[1]))
        object.__setattr__(self, "rotations", tuple(turns))

    def check(self, owner: str, frame: Frame) -> None:
        """Compare rates with differences, and the motion with the degrees of freedom of the frame.

        Raises:
            ValueError: they do not fit.
        """
        if self.translation is not None:
            check_rates(owner, self.translation, 3)
        for _, angle in self.rotations:
            check_rates(owner, angle, 1)
        if isinstance(frame, PlanarFrame):
            flat = all(abs(axis[2]) > 1.0 - 1e-12 for axis, _ in self.rotations)
            if not flat or any(part[2] for part in self._displacement(owner, 0.0)):
                raise ValueError(f"{owner}: its motion leaves the plane of its frame")

    def _displacement(self, owner: str, t: float) -> tuple[FloatArray, ...]:
        if self.translation is None:
            return tuple(np.zeros(3) for _ in range(3))
        return values_of(owner, self.translation, t, 3)

    def coordinates(
        self, owner: str, frame: Frame, start: FloatArray, t: float
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Coordinates of the frame with their first and second rates at t.

        Args:
            owner: prefix of the message about a function that returns something else.
            frame: kind of the frame.
            start: its coordinates as declared.
            t: s.
        """
        moved = self._displacement(owner, t)
        angles = [values_of(owner, angle, t, 1) for _, angle in self.rotations]
        if isinstance(frame, PlanarFrame):
            signs = [np.sign(axis[2]) for axis, _ in self.rotations]
            turned = [
                sum((s * a[k][0] for s, a in zip(signs, angles, strict=True)), 0.0)
                for k in range(3)
            ]
            parts = [np.append(d[:2], a) for d, a in zip(moved, turned, strict=True)]
        else:
            p = (start[3:], np.zeros(4), np.zeros(4))
            for (axis, _), angle in zip(self.rotations, angles, strict=True):
                p = _turned(p, _half_turn(axis, *(float(a[0]) for a in angle)))
            parts = [np.concatenate([d, e]) for d, e in zip(moved, p, strict=True)]
            parts[0][3:] -= start[3:]
        return parts[0] + start, parts[1], parts[2]


Parameters = tuple[FloatArray, FloatArray, FloatArray]


def _half_turn(axis: FloatArray, angle: float, rate: float, second: float) -> Parameters:
    """Euler parameters of a turn about a unit axis, and their rates."""
    c, s = np.cos(0.5 * angle), np.sin(0.5 * angle)
    p, across = np.append(c, s * axis), np.append(-s, c * axis)
    return p, 0.5 * rate * across, 0.5 * second * across - 0.25 * rate**2 * p


def _turned(p: Parameters, q: Parameters) -> Parameters:
    """Product of two rotations with its rates."""
    return (
        _product(p[0], q[0]),
        _product(p[1], q[0]) + _product(p[0], q[1]),
        _product(p[2], q[0]) + 2.0 * _product(p[1], q[1]) + _product(p[0], q[2]),
    )


def _product(p: FloatArray, q: FloatArray) -> FloatArray:
    """Product of quaternions."""
    scalar = p[0] * q[0] - p[1:] @ q[1:]
    return np.append(scalar, p[0] * q[1:] + q[0] * p[1:] + np.cross(p[1:], q[1:]))
