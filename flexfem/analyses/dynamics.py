# SPDX-License-Identifier: LGPL-3.0-or-later
"""Motion in time."""

from dataclasses import dataclass
from pathlib import Path

from flexfem.analyses.analysis import KERNELS, SPLIT_ABOVE, Analysis
from flexfem.options import Option, Settings

__all__ = ["DYNAMICS", "INTEGRATORS", "RunOptions"]

#: Time integrators by name: "module:class", see ``flexfem.integrators.integrator``.
INTEGRATORS = {
    "generalized_alpha": "flexfem.integrators.generalized_alpha:GeneralizedAlpha",
    "energy_momentum": "flexfem.integrators.energy_momentum:EnergyMomentum",
    "stabilized_index2": "flexfem.integrators.stabilized_index2:StabilizedIndex2",
    "independent_coordinates": (
        "flexfem.integrators.independent_coordinates:IndependentCoordinates"
    ),
}
#: Those whose iteration matrix is that of the elements, from which stresses can be left out.
_WITH_STRESSES = ("generalized_alpha", "stabilized_index2")
MAX_STEPS = 1e9  # more steps than anyone waits for: dt or t_end was mistyped

# dt and t_end have no default, each case sets its own.
_RUN_OPTIONS = (
    Option("dt", float, None, "time step", unit="s", above=0),
    Option("t_end", float, None, "end of the simulated time", unit="s", above=0),
    Option(
        "integrator",
        str,
        "generalized_alpha",
        "scheme in time: stabilized_index2 satisfies the constraints on velocities as well, "
        "energy_momentum keeps the energy with --rho-inf 1 and never adds to it, "
        "independent_coordinates has no multipliers and is for small systems",
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
        "keep one factorisation (frozen), renew it each iteration (updated) or when needed (auto); "
        "material: each iteration without geometric stiffness, to study what that is for",
        choices=("auto", "frozen", "updated", "material"),
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
    SPLIT_ABOVE,
    KERNELS,
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
        iteration_matrix: "auto", "frozen", "updated" or "material": every iteration with a fresh
            matrix without the geometric stiffness of beams and shells.
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
        kernels: "fast" for hand-written loops over shells, "ufl" for the derivatives of their UFL
            forms; the results are the same.
        restart: Checkpoint to go on from; None starts at t = 0.

    Raises:
        TypeError: If a value has the wrong type.
        ValueError: If a value is out of range, or the run would exceed 1e9 steps.
    """

    OPTIONS = _RUN_OPTIONS
    PATHS = ("output", "restart")
    RESTART_AGREES = ("dt", "integrator", "rho_inf", "redundant_constraints", "start")

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
    kernels: str = _DEFAULTS["kernels"]
    restart: Path | None = None

    def __post_init__(self) -> None:
        """Check every value, and the values against each other."""
        super().__post_init__()
        if self.dt > self.t_end:
            raise ValueError(f"RunOptions: dt {self.dt:g} s exceeds t_end {self.t_end:g} s")
        if self.iteration_matrix == "material" and self.integrator not in _WITH_STRESSES:
            raise ValueError(
                f"RunOptions: iteration_matrix 'material' needs the integrator "
                f"{' or '.join(_WITH_STRESSES)}, got {self.integrator!r}"
            )
        if self.iteration_matrix != "auto" and self.integrator == "independent_coordinates":
            raise ValueError(
                f"RunOptions: iteration_matrix must be 'auto' with the integrator "
                f"{self.integrator!r}, got {self.iteration_matrix!r}"
            )
        if self.t_end > MAX_STEPS * self.dt:
            raise ValueError(
                f"RunOptions: dt {self.dt:g} s up to t_end {self.t_end:g} s takes more than "
                f"{MAX_STEPS:g} steps"
            )


DYNAMICS = Analysis("dynamics", RunOptions, "flexfem.simulation.dynamics:simulate")
