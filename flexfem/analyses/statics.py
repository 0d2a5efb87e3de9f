# SPDX-License-Identifier: LGPL-3.0-or-later
"""Options of statics."""

from pathlib import Path

from flexfem.analyses.analysis import (
    Analysis,
    fields,
    fields_precision,
    history_format,
    kernels,
    linear_solver,
    linear_tolerance,
    restart,
    split_above,
)
from flexfem.options import Settings, TargetsOption, option, settings

__all__ = ["StaticOptions"]

#: Options that count pivots, or pass singular matrices.
_NEED_FACTORS = ("arc_length", "critical_points", "buckling_modes", "stabilise")

#: Options of paths, which a linear solution is none of.
_NOT_LINEAR = (
    "arc_length", "stop_column", "critical_points", "branch", "buckling_modes", "stabilise",
    "checkpoint_every", "restart",
)  # fmt: skip


@settings
class StaticOptions(Settings):
    """Settings of static equilibria; the load factor t takes the place of time.

    Loads without amplitude are multiplied by t, those with one by their amplitude at t; drives take
    their motion at t.

    Raises:
        TypeError: If a value has the wrong type.
        ValueError: If a value is out of range, or two of them do not go together.
    """

    RESTART_AGREES = ("gravity_load", "stabilise")

    load_steps: int = option(
        "equal steps of the load factor; failing ones are cut", default=10, minimum=1
    )
    t_end: float = option("load factor at the end", default=1.0, above=0)
    gravity_load: str = option(
        "gravity grows with the load factor, or is there from the start (constant)",
        default="proportional",
        choices=("proportional", "constant"),
    )
    tolerance: float = option(
        "largest Newton step at the end: rotations (rad), displacements by the size of the model",
        default=1e-8,
        above=0,
        maximum=1e-3,
    )
    max_iterations: int = option("iterations after which a step is cut", default=30, minimum=1)
    linear: bool = option(
        "one linear solution from the start instead: small displacements, rotations and contacts "
        "that do not change",
        default=False,
        note="It is found at the load factors of ``output_at`` as well. The columns of the history "
        "are of first order in it, exact for small loads; fields show the moved shape, whose "
        "strains hold the stretch of second order that rotations make. The summary says under "
        "``linear`` which part of it the next iteration would change, and its largest rotation "
        "(rad) or displacement relative to the model's size.",
    )
    arc_length: float = option(
        "follow the path over limit points; first step as a fraction of t_end, 0 for load steps",
        default=0.0,
        minimum=0,
        maximum=1,
    )
    max_step: float = option(
        "largest arc-length step: rotation (rad), or displacement relative to the model's size",
        default=0.15,
        above=0,
        maximum=1,
    )
    max_steps: int = option(
        "arc-length steps after which the run gives up", default=1000, minimum=1
    )
    stop_column: str = option(
        "column of the history that ends the run at a value",
        default="none",
        note='"none" for none.',
    )
    stop_value: float = option("value of the column at which the run ends", default=0.0)
    output_at: str = option(
        "points of the path with fields: load factors and values of columns; t=0.5,1;tip_z=-0.1",
        kind=TargetsOption,
        default="none",
        note="The path has a point there every time that it passes, with a row in the history. A "
        'mapping such as ``{"t": [0.5, 1.0]}`` will do as well.',
    )
    critical_points: bool = option(
        "find bifurcation points, too, by counting unstable directions in every step",
        default=False,
        note="Limit points are found in any case.",
    )
    branch: float = option(
        "leave the first bifurcation along its mode: largest rotation (rad) or relative "
        "displacement of the first step, 0 to stay on the path",
        default=0.0,
        minimum=0,
        maximum=0.5,
    )
    buckling_modes: int = option(
        "linearised buckling loads and modes from the first and the last equilibrium",
        default=0,
        minimum=0,
    )
    stabilise: bool = option(
        "regularise motions without stiffness, and search stable equilibria only",
        default=False,
        note="Those of bodies that come to rest on others are found, too, from some lengths of "
        "elements away.",
    )
    every: int = option("write the ParaView fields every N-th step", default=1, minimum=1)
    fields: str = fields()
    fields_precision: str = fields_precision()
    history_format: str = history_format()
    checkpoint_every: int = option(
        "write a checkpoint every N-th load step and at the end; 0: only if the run ends early",
        default=0,
        minimum=0,
        note="A run ends early that fails or is interrupted. There are none along arc lengths.",
    )
    split_above: int = split_above()
    linear_solver: str = linear_solver()
    linear_tolerance: float = linear_tolerance()
    kernels: str = kernels()
    restart: Path | None = restart()

    def __post_init__(self) -> None:
        """Check every value, and the values against each other."""
        super().__post_init__()
        if self.branch > 0.0 and self.arc_length == 0.0:
            raise ValueError(f"StaticOptions: branch {self.branch:g} needs an arc_length above 0")
        if self.stop_value != 0.0 and self.stop_column == "none":
            raise ValueError(f"StaticOptions: stop_value {self.stop_value:g} needs a stop_column")
        if self.linear:
            self._check_linear()
        if self.linear_solver == "iterative":
            for name in self.factored:
                raise ValueError(
                    f"StaticOptions: linear_solver 'iterative' cannot be used with {name} "
                    f"{getattr(self, name)!r}, which needs factors"
                )
        if self.max_step != StaticOptions.max_step and self.arc_length == 0.0:
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

    @property
    def factored(self) -> list[str]:
        """Names of the options that are set and need factors."""
        return [name for name in _NEED_FACTORS if getattr(self, name)]

    def _check_linear(self) -> None:
        """Raise for options that a single linear solution has no use for."""
        for name in _NOT_LINEAR:
            if getattr(self, name) != getattr(StaticOptions, name):
                raise ValueError(
                    f"StaticOptions: linear takes no {name}, got {getattr(self, name)!r}"
                )


STATICS = Analysis("statics", StaticOptions, "flexfem.simulation.statics:solve_static")
