# SPDX-License-Identifier: LGPL-3.0-or-later
"""Modes, their change with the speed of rotation, and linear models."""

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

from flexfem import _checks
from flexfem._files import number_in
from flexfem.analyses.analysis import KERNELS, SPLIT_ABOVE, Analysis
from flexfem.options import Option, Settings

__all__ = ["CAMPBELL", "MODES", "CampbellOptions", "LinearOptions", "ModeOptions", "StateOptions"]

_STATE_OPTIONS: tuple[Option, ...] = (
    Option(
        "start",
        str,
        "rest",
        "about the given configuration at rest, or about the equilibrium under all loads",
        choices=("rest", "equilibrium"),
    ),
    Option("spin", float, 0.0, "speed of a steady rotation, always in equilibrium", unit="rad/s"),
    Option("axis", str, "z", "axis of the rotation: x, y, z or three numbers A,B,C"),
    Option("centre", str, "0,0,0", "a point on the axis: three numbers X,Y,Z", unit="m"),
    Option("time", float, 0.0, "instant at which loads and drives are taken", unit="s", minimum=0),
    SPLIT_ABOVE,
    KERNELS,
)
_MODE_OPTIONS: tuple[Option, ...] = (
    Option("modes", int, 10, "number of modes", minimum=1),
    Option(
        "target",
        float,
        0.0,
        "frequency the modes shall be nearest to, 0 for the lowest",
        unit="Hz",
        minimum=0,
    ),
    *_STATE_OPTIONS,
    Option(
        "accuracy", float, 1e-10, "relative residual of eigenvalues", minimum=1e-15, maximum=1e-2
    ),
    Option(
        "amplitude",
        float,
        0.05,
        "largest displacement in pictures of the modes, relative to the size of the model",
        above=0,
    ),
    Option("frames", int, 16, "pictures of each mode per period, 0 for none", minimum=0),
)
_CAMPBELL_OPTIONS: tuple[Option, ...] = (
    *(replace(o, default=0) if o.name == "frames" else o for o in _MODE_OPTIONS),
    Option("spin_end", float, None, "last speed", unit="rad/s"),
    Option("speeds", int, 11, "number of speeds from spin to spin_end", minimum=2),
)
_LINEAR_OPTIONS: tuple[Option, ...] = (
    *_STATE_OPTIONS,
    Option("modes", int, 0, "reduce to this many modes; 0 keeps every freedom", minimum=0),
)

_AXES = {"x": "1,0,0", "y": "0,1,0", "z": "0,0,1"}


@dataclass(frozen=True, kw_only=True)
class StateOptions(Settings):
    """About which state a model is linearised.

    Args:
        start: "rest" (the given configuration, which need not be in equilibrium) or "equilibrium".
        spin: Speed of a steady rotation, rad/s; with one the state is the relative equilibrium.
        axis: Axis of the rotation, "x", "y", "z" or three numbers separated by commas.
        centre: A point on it, m.
        time: Instant at which loads and drives are taken, s.
        split_above: Elements above which one beam may be split over ranks.
        kernels: "fast" for hand-written loops over shells, "ufl" for the derivatives of their UFL
            forms; the results are the same.
        state: Checkpoint of a motion of the same model, whose configuration and time take the place
            of those given; the motion itself does not count.

    Raises:
        TypeError: If a value has the wrong type.
        ValueError: If a value is out of range, or the axis is zero.
    """

    OPTIONS: ClassVar[tuple[Option, ...]] = _STATE_OPTIONS
    PATHS = ("output", "state")

    start: str = "rest"
    spin: float = 0.0
    axis: str = "z"
    centre: str = "0,0,0"
    time: float = 0.0
    split_above: int = SPLIT_ABOVE.default
    kernels: str = KERNELS.default
    state: Path | None = None

    def __post_init__(self) -> None:
        """Check every value."""
        super().__post_init__()
        if self.state is not None and self.time != 0.0:
            raise ValueError(
                f"{type(self).__name__}: a state has its own time, got time {self.time:g}"
            )
        _checks.vector(type(self).__name__, "axis", self.axis_vector, nonzero=True)
        self._numbers("centre", self.centre)

    @property
    def axis_vector(self) -> tuple[float, ...]:
        """The axis as three numbers of any length."""
        return self._numbers("axis", _AXES.get(self.axis, self.axis))

    @property
    def centre_vector(self) -> tuple[float, ...]:
        """The point on the axis, m."""
        return self._numbers("centre", self.centre)

    def _numbers(self, what: str, text: str) -> tuple[float, ...]:
        try:
            values = tuple(number_in(word) for word in text.split(","))
        except ValueError:
            values = ()
        if len(values) != 3 or not all(map(math.isfinite, values)):
            kinds = "x, y, z or three" if what == "axis" else "three"
            raise ValueError(
                f"{type(self).__name__}: {what} must be {kinds} finite numbers with commas, "
                f"got {text!r}"
            )
        return values


@dataclass(frozen=True, kw_only=True)
class ModeOptions(StateOptions):
    """How to find modes.

    Args:
        modes: How many.
        target: Frequency the modes shall be nearest to, Hz, in axes that turn with the model; 0 for
            the lowest.
        accuracy: Relative residual of the eigenvalues at which the iteration stops. The residuals
            of those found are computed anew, of those about an equilibrium also after one more step
            towards it; ten times as much is a failure, unless rounding allows no better.
        amplitude: Largest displacement in pictures relative to the size of the model.
        frames: Pictures of each mode per period; 0 writes none.
    """

    OPTIONS = _MODE_OPTIONS

    modes: int = 10
    target: float = 0.0
    accuracy: float = 1e-10
    amplitude: float = 0.05
    frames: int = 16


@dataclass(frozen=True, kw_only=True)
class CampbellOptions(ModeOptions):
    """How to follow modes over the speed of a steady rotation.

    Args:
        spin_end: Last speed, rad/s; ``spin`` is the first.
        speeds: Number of equally spaced speeds.
    """

    OPTIONS = _CAMPBELL_OPTIONS

    spin_end: float
    speeds: int = 11
    frames: int = 0

    def __post_init__(self) -> None:
        """Check every value, and the values against each other."""
        super().__post_init__()
        if self.spin_end == self.spin:
            raise ValueError(f"CampbellOptions: spin_end must differ from spin {self.spin:g} rad/s")


@dataclass(frozen=True, kw_only=True)
class LinearOptions(StateOptions):
    """How to make a linear model.

    Args:
        modes: Reduce to that many modes; 0 keeps every freedom.
    """

    OPTIONS = _LINEAR_OPTIONS

    modes: int = 0


MODES = Analysis("modes", ModeOptions, "flexfem.simulation.modes:find_modes")
CAMPBELL = Analysis("campbell", CampbellOptions, "flexfem.simulation.campbell:sweep_spin")
