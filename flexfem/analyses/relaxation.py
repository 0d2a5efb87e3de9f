# SPDX-License-Identifier: LGPL-3.0-or-later
"""Options of dynamic relaxation."""

from pathlib import Path

from flexfem.analyses.analysis import (
    Analysis,
    fields,
    fields_precision,
    history_format,
    kernels,
    restart,
    split_above,
)
from flexfem.options import Settings, option, settings

__all__ = ["RELAXATION", "RelaxationOptions"]


@settings
class RelaxationOptions(Settings):
    """Settings of dynamic relaxation: a damped motion to an equilibrium, nothing is factorised.

    Raises:
        TypeError: If a value has the wrong type.
        ValueError: If a value is out of range, or no multiple of ``record_every``.
    """

    RESTART_AGREES = ("damping", "masses", "least_mass", "margin", "renew_every", "at_time")

    tolerance: float = option(
        "norm of the forces out of balance at the end, relative to that of the applied forces",
        default=1e-4,
        above=0,
        maximum=0.1,
        note="Norms are roots of the sums of squares over all nodes.",
    )
    step_tolerance: float = option(
        "largest step at the end: displacements by the size of the model, rotations (rad)",
        default=1e-6,
        above=0,
        maximum=0.1,
    )
    max_iterations: int = option(
        "iterations after which the run gives up", default=100_000, minimum=1
    )
    damping: str = option(
        "accelerated: momentum grows until forces oppose it; viscous: from Rayleigh's "
        "quotient of the motion; kinetic: all stops at each energy peak",
        default="accelerated",
        choices=("accelerated", "viscous", "kinetic"),
        note="See ``flexfem.solvers.relaxation.damping``.",
    )
    masses: str = option(
        "fictitious masses of the nodes from their stiffness, or the model's own times one factor",
        default="stiffness",
        choices=("stiffness", "scaled"),
    )
    least_mass: float = option(
        "smallest mass of a node among its directions, relative to the largest; 1: all the same",
        default=0.2,
        above=0,
        maximum=1,
    )
    margin: float = option(
        "masses relative to those that are stable for sure", default=1.2, minimum=0.5
    )
    renew_every: int = option(
        "masses are computed again every N-th iteration", default=200, minimum=1
    )
    at_time: float = option("time at which loads and drives are taken", default=0.0, unit="s")
    record_every: int = option(
        "rows of the history, and tests of convergence, in iterations", default=20, minimum=1
    )
    every: int = option(
        "write the ParaView fields every N-th iteration",
        default=1000,
        minimum=1,
        note="It is a multiple of ``record_every``.",
    )
    fields: str = fields()
    fields_precision: str = fields_precision()
    history_format: str = history_format()
    checkpoint_every: int = option(
        "write a checkpoint every N-th iteration and at the end; 0: only if the run ends early",
        default=0,
        minimum=0,
        note="It is a multiple of ``record_every``. A run ends early that fails or is interrupted.",
    )
    split_above: int = split_above()
    kernels: str = kernels()
    restart: Path | None = restart("")

    def __post_init__(self) -> None:
        """Check every value, and the values against each other."""
        super().__post_init__()
        for name in ("every", "checkpoint_every"):
            value = getattr(self, name)
            if value % self.record_every:
                raise ValueError(
                    f"RelaxationOptions: {name} {value} is no multiple of record_every "
                    f"{self.record_every}"
                )


RELAXATION = Analysis("relaxation", RelaxationOptions, "flexfem.simulation.relaxation:relax")
