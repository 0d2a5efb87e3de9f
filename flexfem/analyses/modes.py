# SPDX-License-Identifier: LGPL-3.0-or-later
"""Modes, their change with the speed of rotation, and linear models."""

import math
from pathlib import Path

from flexfem import _checks
from flexfem._files import number_in
from flexfem.analyses.analysis import Analysis, kernels, split_above
from flexfem.options import Settings, option, setting, settings

__all__ = [
    "CAMPBELL", "MODES", "ROTOR", "CampbellOptions", "LinearOptions", "ModeOptions", "RotorOptions",
    "StateOptions",
]  # fmt: skip

_AXES = {"x": "1,0,0", "y": "0,1,0", "z": "0,0,1"}


@settings
class StateOptions(Settings):
    """The state about which a model is linearised.

    Raises:
        TypeError: If a value has the wrong type.
        ValueError: If a value is out of range, or the axis is zero.
    """

    start: str = option(
        "about the given configuration at rest, or about the equilibrium under all loads",
        default="rest",
        choices=("rest", "equilibrium"),
        note="The given configuration need not be in equilibrium.",
    )
    spin: float = option(
        "speed of a steady rotation, always in equilibrium",
        default=0.0,
        unit="rad/s",
        note="The equilibrium is the relative one.",
    )
    axis: str = option("axis of the rotation: x, y, z or three numbers A,B,C", default="z")
    centre: str = option("a point on the axis: three numbers X,Y,Z", default="0,0,0", unit="m")
    time: float = option(
        "instant at which loads and drives are taken", default=0.0, unit="s", minimum=0
    )
    split_above: int = split_above()
    kernels: str = kernels()
    state: Path | None = setting(
        "checkpoint of a motion or relaxation of the same model, whose state is looked at",
        default=None,
        note="Its time takes the place of that given; the motion itself does not count.",
    )

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


@settings
class ModeOptions(StateOptions):
    """Settings of a search for modes."""

    modes: int = option("number of modes", default=10, minimum=1)
    target: float = option(
        "frequency the modes shall be nearest to, 0 for the lowest",
        default=0.0,
        unit="Hz",
        minimum=0,
        note="It is relative to axes that rotate with the model.",
    )
    accuracy: float = option(
        "relative residual of eigenvalues",
        default=1e-10,
        minimum=1e-15,
        maximum=1e-2,
        note="There the iteration stops. The residuals of those found are computed again, of those "
        "about an equilibrium also after one more step towards it; ten times as much is a failure, "
        "unless rounding allows no better.",
    )
    amplitude: float = option(
        "largest displacement in pictures of the modes, relative to the size of the model",
        default=0.05,
        above=0,
    )
    frames: int = option("pictures of each mode per period, 0 for none", default=16, minimum=0)


@settings
class CampbellOptions(ModeOptions):
    """Settings of modes over the speed of a steady rotation; ``spin`` is the first speed."""

    spin_end: float = option("last speed", unit="rad/s")
    speeds: int = option("number of speeds from spin to spin_end", default=11, minimum=2)
    frames: int = 0

    def __post_init__(self) -> None:
        """Check every value, and the values against each other."""
        super().__post_init__()
        if self.spin_end == self.spin:
            raise ValueError(f"CampbellOptions: spin_end must differ from spin {self.spin:g} rad/s")


@settings
class RotorOptions(CampbellOptions):
    """Settings of modes of a rotor on a support over its speed, in multiblade coordinates."""

    blades: str = option("names of its identical blades A,B,C, at least three", default="")
    rotor: str = option(
        "names of the other bodies A,B that rotate",
        default="",
        note="The axis moves with the first one, to which the torque is applied that keeps the "
        "speed.",
    )
    variation: float = option(
        "change of forces and eigenvalues with the azimuth, relative, that is accepted",
        default=1e-3,
        above=0,
        note="Results are those at the azimuth of the start. A support that yields turns the axis "
        "out of the flow a little.",
    )
    start: str = "equilibrium"
    accuracy: float = 1e-8

    def __post_init__(self) -> None:
        """Check every value, and the values against each other."""
        super().__post_init__()
        if len(self.blade_names) < 3:
            raise ValueError(f"RotorOptions: blades must name three or more, got {self.blades!r}")
        if not self.rotor_names:
            raise ValueError("RotorOptions: rotor must name the body that carries the blades")
        twice = sorted(n for n in self.names if self.names.count(n) > 1)
        if twice:
            raise ValueError(f"RotorOptions: blades and rotor name '{twice[0]}' twice")

    @property
    def blade_names(self) -> tuple[str, ...]:
        """Names of the blades."""
        return _words(self.blades)

    @property
    def rotor_names(self) -> tuple[str, ...]:
        """Names of the other rotating bodies."""
        return _words(self.rotor)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all rotating bodies."""
        return self.rotor_names + self.blade_names


def _words(text: str) -> tuple[str, ...]:
    return tuple(word for word in text.replace(" ", "").split(",") if word)


@settings
class LinearOptions(StateOptions):
    """Settings of a linear model."""

    modes: int = option("reduce to this many modes; 0 keeps every freedom", default=0, minimum=0)


MODES = Analysis("modes", ModeOptions, "flexfem.simulation.modes:find_modes")
CAMPBELL = Analysis("campbell", CampbellOptions, "flexfem.simulation.campbell:sweep_spin")
ROTOR = Analysis("campbell", RotorOptions, "flexfem.simulation.rotor:sweep_rotor")
