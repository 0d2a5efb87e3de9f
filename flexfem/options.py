# SPDX-License-Identifier: LGPL-3.0-or-later
"""Options of a run: what a value may be, said once for the command line and for Python callers."""

import math
import operator
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

#: Time integrators by name: "module:class", see ``flexfem.integrators.integrator``.
INTEGRATORS = {
    "generalized_alpha": "flexfem.integrators.generalized_alpha:GeneralizedAlpha",
    "energy_momentum": "flexfem.integrators.energy_momentum:EnergyMomentum",
    "stabilized_index2": "flexfem.integrators.stabilized_index2:StabilizedIndex2",
}
MAX_STEPS = 1e9  # more steps than anyone waits for: dt or t_end was mistyped


@dataclass(frozen=True)
class Option:
    """One named value with its type, default, unit and admissible range.

    Args:
        name: Python identifier; ``beam_length`` becomes ``--beam-length`` on the command line.
        kind: ``int``, ``float``, ``str`` or ``bool`` (a bool becomes ``--name`` / ``--no-name``).
        default: Value when the option is not given.
        help: One line for ``--help``.
        unit: Physical unit shown in ``--help``; None for pure numbers.
        minimum: Smallest admissible number.
        maximum: Largest admissible number.
        above: The number must be strictly greater than this one.
        choices: Admissible values; empty when any is.

    Raises:
        ValueError: If the name, the type or the default is not admissible.
    """

    name: str
    kind: type[int] | type[float] | type[str] | type[bool]
    default: Any
    help: str
    unit: str | None = None
    minimum: float | None = None
    maximum: float | None = None
    above: float | None = None
    choices: Sequence[Any] = ()

    def __post_init__(self) -> None:
        """Check the declaration itself."""
        if not self.name.isidentifier() or self.name.startswith("_"):
            raise ValueError(f"Option '{self.name}': the name is not a plain Python identifier")
        if self.kind not in (int, float, str, bool):
            raise ValueError(
                f"Option '{self.name}': type {self.kind!r} is not int, float, str, bool"
            )
        if self.default is not None:
            try:
                self.check(self.default)
            except (TypeError, ValueError) as error:
                raise ValueError(f"Option '{self.name}': the default {error}") from None

    @property
    def flag(self) -> str:
        """The option as written on a command line."""
        return "--" + self.name.replace("_", "-")

    def parse(self, text: str) -> Any:
        """Turn command-line text into a checked value.

        Raises:
            ValueError: If the text is no admissible value; the message starts with "must be".
        """
        try:
            return self.check(self.kind(text))
        except ValueError:
            raise ValueError(f"must be {self.describe()}, got '{text}'") from None

    def check(self, value: Any) -> Any:
        """Return the value as the option's own type.

        Raises:
            TypeError: If the value has another type.
            ValueError: If the value is NaN, infinite or out of range.
        """
        converted = self._convert(value)
        inside = not self.choices or converted in self.choices
        if self.kind in (int, float):
            inside = inside and math.isfinite(converted) and self._in_range(converted)
        if not inside:
            raise ValueError(f"must be {self.describe()}, got {value!r}")
        return converted

    def _convert(self, value: Any) -> Any:
        """Accept NumPy scalars as numbers, but neither truth values nor text."""
        try:
            if isinstance(value, bool) is not (self.kind is bool) or (
                isinstance(value, str) is not (self.kind is str)
            ):
                raise TypeError
            return operator.index(value) if self.kind is int else self.kind(value)
        except (TypeError, ValueError, OverflowError):
            raise TypeError(f"must be {self.describe()}, got {value!r}") from None

    def _in_range(self, value: float) -> bool:
        return (
            (self.minimum is None or value >= self.minimum)
            and (self.maximum is None or value <= self.maximum)
            and (self.above is None or value > self.above)
        )

    def describe(self) -> str:
        """Name the admissible values, e.g. "a finite number > 0 [s]"."""
        if self.choices:
            return "one of " + ", ".join(map(str, self.choices))
        kinds = {
            int: "a whole number",
            float: "a finite number",
            str: "text",
            bool: "True or False",
        }
        bounds = [
            f"{sign} {bound:g}"
            for sign, bound in ((">", self.above), (">=", self.minimum), ("<=", self.maximum))
            if bound is not None
        ]
        text = " ".join([kinds[self.kind], " and ".join(bounds)]).strip()
        return f"{text} [{self.unit}]" if self.unit else text


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Numerical options of one kind of analysis; subclasses have one field for each option.

    Args:
        output: Folder of the results; None writes nothing.
        quiet: No progress bar.
    """

    OPTIONS: ClassVar[tuple[Option, ...]] = ()

    output: Path | None = None
    quiet: bool = False

    def __post_init__(self) -> None:
        """Check every value and turn it into its plain Python type.

        Raises:
            TypeError: If a value has the wrong type.
            ValueError: If a value is out of range.
        """
        for option in self.OPTIONS:
            try:
                value = option.check(getattr(self, option.name))
            except (TypeError, ValueError) as error:
                raise type(error)(f"{type(self).__name__}: {option.name} {error}") from None
            object.__setattr__(self, option.name, value)
        if self.output is not None:
            object.__setattr__(self, "output", Path(self.output))


# dt and t_end have no default, each case sets its own.
_RUN_OPTIONS = (
    Option("dt", float, None, "time step", unit="s", above=0),
    Option("t_end", float, None, "end of the simulated time", unit="s", above=0),
    Option(
        "integrator",
        str,
        "generalized_alpha",
        "scheme in time: stabilized_index2 satisfies the constraints on velocities as well, "
        "energy_momentum keeps the energy with --rho-inf 1 and never adds to it",
        choices=tuple(INTEGRATORS),
    ),
    Option(
        "rho_inf",
        float,
        0.9,
        "spectral radius of the integrator at infinite frequency: 1 dissipates nothing, 0 the most",
        minimum=0,
        maximum=1,
    ),
    Option(
        "iteration_matrix",
        str,
        "auto",
        "keep one factorisation (frozen), renew it every iteration (updated) or when needed (auto)",
        choices=("auto", "frozen", "updated"),
    ),
    Option(
        "tolerance",
        float,
        1e-6,
        "largest Newton step of positions, rotations (rad) and beta h^2 x multipliers at the end",
        unit="m",
        above=0,
        maximum=0.1,
    ),
    Option(
        "redundant_constraints",
        str,
        "refuse",
        "constraints that hold a motion twice: refuse them by name, or carry them (least_norm)",
        choices=("refuse", "least_norm"),
    ),
    Option(
        "start",
        str,
        "given",
        "start as the model says (given), or at rest in equilibrium with the loads at t = 0",
        choices=("given", "equilibrium"),
    ),
    Option(
        "adaptive",
        bool,
        False,
        "halve and double steps below dt so that each keeps the error tolerance",
    ),
    Option(
        "error_tolerance",
        float,
        1e-5,
        "with adaptive: largest local error of a position or rotation (rad) in a step",
        unit="m",
        above=0,
        maximum=0.1,
    ),
    Option("every", int, 10, "write the ParaView fields every N-th time step dt", minimum=1),
    Option(
        "checkpoint_every",
        int,
        0,
        "write a checkpoint every N-th step and at the end; 0: only if the run ends early",
        minimum=0,
    ),
    Option(
        "split_above",
        int,
        4000,
        "a beam with more elements than this and than a rank's share is split over ranks",
        minimum=1,
    ),
)
_DEFAULTS = {option.name: option.default for option in _RUN_OPTIONS}


@dataclass(frozen=True, kw_only=True)
class RunOptions(Settings):
    """How to run a model in time.

    Args:
        dt: Time step, s.
        t_end: End of the simulated time, s.
        integrator: Name of the scheme, one of ``INTEGRATORS``.
        rho_inf: Spectral radius of the scheme at infinite frequency, in [0, 1].
        iteration_matrix: "auto", "frozen" or "updated".
        tolerance: Newton steps of positions (m), rotations (rad) and multipliers times
            ``beta h^2`` must fall below it.
        redundant_constraints: "refuse" names joints that hold the same motion twice; "least_norm"
            carries them with the smallest forces that do.
        start: "given", or "equilibrium": at rest under gravity and the loads at t = 0.
        adaptive: Steps are ``dt`` or ``2^-k`` of it, such that each keeps the error tolerance.
        error_tolerance: Largest estimated local error of a node's position (m) or rotation (rad)
            in one step. It is absolute: choose it relative to the motion of interest, 1e-5 of the
            size of the mechanism for example. The error at the end is about that of one step times
            the number of steps.
        every: Fields are written every that many steps ``dt``.
        checkpoint_every: A checkpoint is written every that many steps and at the end; 0 writes one
            only if the run fails or is interrupted. None is written without an output folder.
        split_above: Elements above which one beam may be split over ranks.
        restart: Checkpoint to go on from; None starts at t = 0.

    Raises:
        TypeError: If a value has the wrong type.
        ValueError: If a value is out of range, or the run would exceed 1e9 steps.
    """

    OPTIONS = _RUN_OPTIONS

    dt: float
    t_end: float
    integrator: str = _DEFAULTS["integrator"]
    rho_inf: float = _DEFAULTS["rho_inf"]
    iteration_matrix: str = _DEFAULTS["iteration_matrix"]
    tolerance: float = _DEFAULTS["tolerance"]
    redundant_constraints: str = _DEFAULTS["redundant_constraints"]
    start: str = _DEFAULTS["start"]
    adaptive: bool = _DEFAULTS["adaptive"]
    error_tolerance: float = _DEFAULTS["error_tolerance"]
    every: int = _DEFAULTS["every"]
    checkpoint_every: int = _DEFAULTS["checkpoint_every"]
    split_above: int = _DEFAULTS["split_above"]
    restart: Path | None = None

    def __post_init__(self) -> None:
        """Check every value, and the values against each other."""
        super().__post_init__()
        if self.restart is not None:
            object.__setattr__(self, "restart", Path(self.restart))
        if self.dt > self.t_end:
            raise ValueError(f"RunOptions: dt {self.dt:g} s exceeds t_end {self.t_end:g} s")
        if self.t_end > MAX_STEPS * self.dt:
            raise ValueError(
                f"RunOptions: dt {self.dt:g} s up to t_end {self.t_end:g} s takes more than "
                f"{MAX_STEPS:g} steps"
            )


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
    Option(
        "split_above",
        int,
        4000,
        "a beam with more elements than this and than a rank's share is split over ranks",
        minimum=1,
    ),
)
_MODE_OPTIONS: tuple[Option, ...] = (
    Option("modes", int, 10, "number of modes", minimum=1),
    Option("target", float, 0.0, "frequency the modes shall be nearest to", unit="Hz", minimum=0),
    *_STATE_OPTIONS,
    Option("accuracy", float, 1e-10, "relative residual of eigenvalues", above=0, maximum=1e-2),
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

    Raises:
        TypeError: If a value has the wrong type.
        ValueError: If a value is out of range, or the axis is zero.
    """

    OPTIONS: ClassVar[tuple[Option, ...]] = _STATE_OPTIONS

    start: str = "rest"
    spin: float = 0.0
    axis: str = "z"
    centre: str = "0,0,0"
    time: float = 0.0
    split_above: int = 4000

    def __post_init__(self) -> None:
        """Check every value."""
        super().__post_init__()
        if not any(self.axis_vector):
            raise ValueError(f"{type(self).__name__}: axis must not be zero, got {self.axis!r}")
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
            values = tuple(float(word) for word in text.split(","))
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
        target: Frequency the modes shall be nearest to, Hz; only at rest without damping.
        accuracy: Relative residual of the eigenvalues at which the iteration stops.
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
