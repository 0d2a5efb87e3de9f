# SPDX-License-Identifier: LGPL-3.0-or-later
"""Options of dynamic relaxation."""

from dataclasses import dataclass
from pathlib import Path

from flexfem.analyses.analysis import KERNELS, SPLIT_ABOVE, Analysis
from flexfem.options import Option, Settings

__all__ = ["RELAXATION", "RelaxationOptions"]

_OPTIONS = (
    Option(
        "tolerance",
        float,
        1e-4,
        "norm of the forces out of balance at the end, relative to that of the applied forces",
        above=0,
        maximum=0.1,
    ),
    Option(
        "step_tolerance",
        float,
        1e-6,
        "largest step at the end: displacements by the size of the model, rotations (rad)",
        above=0,
        maximum=0.1,
    ),
    Option(
        "max_iterations", int, 100_000, "iterations after which the run gives up", minimum=1
    ),
    Option(
        "damping",
        str,
        "accelerated",
        "accelerated: momentum grows until forces turn against it; viscous: from Rayleigh's "
        "quotient of the motion; kinetic: all stops at each energy peak",
        choices=("accelerated", "viscous", "kinetic"),
    ),
    Option(
        "masses",
        str,
        "stiffness",
        "fictitious masses of the nodes from their stiffness, or the model's own times one factor",
        choices=("stiffness", "scaled"),
    ),
    Option(
        "least_mass",
        float,
        0.2,
        "smallest mass of a node among its directions, relative to the largest; 1: all the same",
        above=0,
        maximum=1,
    ),
    Option(
        "margin", float, 1.2, "masses relative to those that are stable for sure", minimum=0.5
    ),
    Option("renew_every", int, 200, "masses are computed anew every N-th iteration", minimum=1),
    Option("at_time", float, 0.0, "time at which loads and drives are taken", unit="s"),
    Option(
        "record_every", int, 20, "rows of the history, and tests of convergence, in iterations",
        minimum=1,
    ),
    Option("every", int, 1000, "write the ParaView fields every N-th iteration", minimum=1),
    Option(
        "checkpoint_every",
        int,
        0,
        "write a checkpoint every N-th iteration and at the end; 0: only if the run ends early",
        minimum=0,
    ),
    SPLIT_ABOVE,
    KERNELS,
)  # fmt: skip
_DEFAULTS = {option.name: option.default for option in _OPTIONS}


@dataclass(frozen=True, kw_only=True)
class RelaxationOptions(Settings):
    """How to find an equilibrium by dynamic relaxation: a damped motion, nothing is factorised.

    Args:
        tolerance: Forces out of balance must fall below it, relative to the applied forces: roots
            of the sums of squares over all nodes.
        step_tolerance: Steps must fall below it: displacements relative to the size of the model,
            rotations in rad.
        max_iterations: Iterations after which the run gives up.
        damping: "accelerated", "viscous" or "kinetic"; see ``flexfem.solvers.relaxation_damping``.
        masses: "stiffness" for masses from the stiffness of each unknown, "scaled" for those of
            the model times one factor.
        least_mass: Smallest mass of a node in one direction relative to its largest.
        margin: Masses relative to those that are stable for sure.
        renew_every: Masses are computed anew every that many iterations.
        at_time: Time at which amplitudes of loads, and drives, are taken, s.
        record_every: The history has a row, and convergence is tested, every that many iterations.
        every: Fields are written every that many iterations, a multiple of ``record_every``.
        checkpoint_every: A checkpoint is written every that many iterations, a multiple of
            ``record_every``, and at the end; 0 writes one only if the run fails or is interrupted.
        split_above: Elements above which one beam may be split over ranks.
        kernels: "fast" for hand-written loops over shells, "ufl" for the derivatives of their UFL
            forms; the results are the same.
        restart: Checkpoint to go on from; None starts anew.

    Raises:
        TypeError: If a value has the wrong type.
        ValueError: If a value is out of range, or no multiple of ``record_every``.
    """

    OPTIONS = _OPTIONS
    PATHS = ("output", "restart")
    RESTART_AGREES = ("damping", "masses", "least_mass", "margin", "renew_every", "at_time")

    tolerance: float = _DEFAULTS["tolerance"]
    step_tolerance: float = _DEFAULTS["step_tolerance"]
    max_iterations: int = _DEFAULTS["max_iterations"]
    damping: str = _DEFAULTS["damping"]
    masses: str = _DEFAULTS["masses"]
    least_mass: float = _DEFAULTS["least_mass"]
    margin: float = _DEFAULTS["margin"]
    renew_every: int = _DEFAULTS["renew_every"]
    at_time: float = _DEFAULTS["at_time"]
    record_every: int = _DEFAULTS["record_every"]
    every: int = _DEFAULTS["every"]
    checkpoint_every: int = _DEFAULTS["checkpoint_every"]
    split_above: int = _DEFAULTS["split_above"]
    kernels: str = _DEFAULTS["kernels"]
    restart: Path | None = None

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
