# SPDX-License-Identifier: LGPL-3.0-or-later
"""Options of statics."""

from dataclasses import dataclass
from pathlib import Path

from flexfem.analyses.analysis import KERNELS, SPLIT_ABOVE, Analysis
from flexfem.options import Option, Settings, TargetsOption

__all__ = ["StaticOptions"]

_OPTIONS = (
    Option(
        "load_steps", int, 10, "equal steps of the load factor; failing ones are cut", minimum=1
    ),
    Option("t_end", float, 1.0, "load factor at the end", above=0),
    Option(
        "gravity_load",
        str,
        "proportional",
        "gravity grows with the load factor, or is there from the start (constant)",
        choices=("proportional", "constant"),
    ),
    Option(
        "tolerance",
        float,
        1e-8,
        "largest Newton step at the end: rotations (rad), displacements by the size of the model",
        above=0,
        maximum=1e-3,
    ),
    Option("max_iterations", int, 30, "iterations after which a step is cut", minimum=1),
    Option(
        "linear",
        bool,
        False,
        "one linear solution from the start instead: small displacements, rotations and contacts "
        "that do not change",
    ),
    Option(
        "arc_length",
        float,
        0.0,
        "follow the path over limit points; first step as a fraction of t_end, 0 for load steps",
        minimum=0,
        maximum=1,
    ),
    Option(
        "max_step",
        float,
        0.15,
        "largest arc-length step: rotation (rad), or displacement relative to the model's size",
        above=0,
        maximum=1,
    ),
    Option("max_steps", int, 1000, "arc-length steps after which the run gives up", minimum=1),
    Option("stop_column", str, "none", "column of the history that ends the run at a value"),
    Option("stop_value", float, 0.0, "value of the column at which the run ends"),
    TargetsOption(
        "output_at",
        str,
        "none",
        "points of the path with fields: load factors and values of columns; t=0.5,1;tip_z=-0.1",
    ),
    Option(
        "critical_points",
        bool,
        False,
        "find bifurcation points, too, by counting unstable directions in every step",
    ),
    Option(
        "branch",
        float,
        0.0,
        "leave the first bifurcation along its mode: largest rotation (rad) or relative "
        "displacement of the first step, 0 to stay on the path",
        minimum=0,
        maximum=0.5,
    ),
    Option(
        "buckling_modes",
        int,
        0,
        "linearised buckling loads and modes from the first and the last equilibrium",
        minimum=0,
    ),
    Option(
        "stabilise",
        bool,
        False,
        "hold motions without stiffness, and search stable equilibria only",
    ),
    Option("every", int, 1, "write the ParaView fields every N-th step", minimum=1),
    Option(
        "checkpoint_every",
        int,
        0,
        "write a checkpoint every N-th load step and at the end; 0: only if the run ends early",
        minimum=0,
    ),
    SPLIT_ABOVE,
    KERNELS,
)
#: Options of paths, which a linear solution is none of.
_NOT_LINEAR = (
    "arc_length", "stop_column", "critical_points", "branch", "buckling_modes", "stabilise",
    "checkpoint_every", "restart",
)  # fmt: skip
_DEFAULTS = {option.name: option.default for option in _OPTIONS}


@dataclass(frozen=True, kw_only=True)
class StaticOptions(Settings):
    """How to find static equilibria; the load factor t takes the place of time.

    Loads without amplitude are multiplied by t, those with one by their amplitude at t; drives take
    their motion at t.

    Args:
        load_steps: Equal steps from 0 to ``t_end``.
        t_end: Load factor at the end.
        gravity_load: "proportional" to t, or "constant".
        tolerance: Newton steps must fall below it: displacements relative to the size of the
            model, rotations in rad.
        max_iterations: Iterations after which a step is cut.
        linear: One linear solution from the start, also at the load factors of ``output_at``. The
            columns of the history are of first order in it, exact for small loads; fields show the
            moved shape, whose strains hold the stretch of second order that rotations make. The
            summary says under ``linear`` which part of it the next iteration would change, and its
            largest rotation (rad) or displacement relative to the model's size.
        arc_length: First step along the path as a fraction of ``t_end``; 0 for load steps.
        max_step: Largest rotation (rad) or relative displacement of an arc-length step.
        max_steps: Arc-length steps after which the run gives up.
        stop_column: Column of the history that ends the run, "none" for none.
        stop_value: Value of this column at the end.
        output_at: Load factors ``t`` and values of columns at which the path has a point, with a
            row in the history and fields: text such as "t=0.5,1;tip_z=-0.1", or a mapping such as
            ``{"t": [0.5, 1.0]}``; every time that the path passes them.
        critical_points: Find bifurcation points as well as limit points.
        branch: First step off the path at the first bifurcation (rad or relative); 0 for none.
        buckling_modes: Number of linearised buckling loads.
        stabilise: Hold motions without stiffness, and search stable equilibria only: of bodies that
            come to rest on others, too, from some lengths of elements away.
        every: Fields are written every that many steps.
        checkpoint_every: A checkpoint is written every that many load steps and at the end; 0
            writes one only if the run fails or is interrupted. There are none along arc lengths.
        split_above: Elements above which one beam may be split over ranks.
        kernels: "fast" for hand-written loops over shells, "ufl" for the derivatives of their UFL
            forms; the results are the same.
        restart: Checkpoint to go on from; None starts at t = 0.

    Raises:
        TypeError: If a value has the wrong type.
        ValueError: If a value is out of range, or two of them do not go together.
    """

    OPTIONS = _OPTIONS
    PATHS = ("output", "restart")
    RESTART_AGREES = ("gravity_load", "stabilise")

    load_steps: int = _DEFAULTS["load_steps"]
    t_end: float = _DEFAULTS["t_end"]
    gravity_load: str = _DEFAULTS["gravity_load"]
    tolerance: float = _DEFAULTS["tolerance"]
    max_iterations: int = _DEFAULTS["max_iterations"]
    linear: bool = _DEFAULTS["linear"]
    arc_length: float = _DEFAULTS["arc_length"]
    max_step: float = _DEFAULTS["max_step"]
    max_steps: int = _DEFAULTS["max_steps"]
    stop_column: str = _DEFAULTS["stop_column"]
    stop_value: float = _DEFAULTS["stop_value"]
    output_at: str = _DEFAULTS["output_at"]
    critical_points: bool = _DEFAULTS["critical_points"]
    branch: float = _DEFAULTS["branch"]
    buckling_modes: int = _DEFAULTS["buckling_modes"]
    stabilise: bool = _DEFAULTS["stabilise"]
    every: int = _DEFAULTS["every"]
    checkpoint_every: int = _DEFAULTS["checkpoint_every"]
    split_above: int = _DEFAULTS["split_above"]
    kernels: str = _DEFAULTS["kernels"]
    restart: Path | None = None

    def __post_init__(self) -> None:
        """Check every value, and the values against each other."""
        super().__post_init__()
        if self.branch > 0.0 and self.arc_length == 0.0:
            raise ValueError(f"StaticOptions: branch {self.branch:g} needs an arc_length above 0")
        if self.stop_value != 0.0 and self.stop_column == "none":
            raise ValueError(f"StaticOptions: stop_value {self.stop_value:g} needs a stop_column")
        if self.linear:
            self._check_linear()
        if self.max_step != _DEFAULTS["max_step"] and self.arc_length == 0.0:
            raise ValueError(
                f"StaticOptions: max_step {self.max_step:g} needs an arc_length above 0; load "
                "steps are limited by load_steps"
            )
        if self.arc_length > 0.0 and (self.checkpoint_every or self.restart is not None):
            raise ValueError(
                "StaticOptions: checkpoints are those of load steps, a path by arc_length "
                f"{self.arc_length:g} has none"
            )
        if self.stabilise and self.arc_length > 0.0:
            raise ValueError(
                f"StaticOptions: stabilise searches stable equilibria only, arc_length "
                f"{self.arc_length:g} follows unstable ones as well"
            )

    def _check_linear(self) -> None:
        """Raise for options that a single linear solution has no use for."""
        for name in _NOT_LINEAR:
            if getattr(self, name) != _DEFAULTS.get(name):
                raise ValueError(
                    f"StaticOptions: linear takes no {name}, got {getattr(self, name)!r}"
                )


STATICS = Analysis("statics", StaticOptions, "flexfem.simulation.statics:solve_static")
