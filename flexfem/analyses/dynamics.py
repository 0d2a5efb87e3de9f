# SPDX-License-Identifier: LGPL-3.0-or-later
"""Motion in time."""

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
from flexfem.options import Settings, option, settings

__all__ = ["DYNAMICS", "INTEGRATORS", "RunOptions"]

#: Time integrators by name: "module:class", see ``flexfem.integrators.integrator``.
INTEGRATORS = {
    "generalized_alpha": "flexfem.integrators.generalized_alpha:GeneralizedAlpha",
    "energy_momentum": "flexfem.integrators.energy_momentum.scheme:EnergyMomentum",
    "stabilized_index2": "flexfem.integrators.stabilized_index2:StabilizedIndex2",
    "independent_coordinates": (
        "flexfem.integrators.independent_coordinates:IndependentCoordinates"
    ),
}
#: Those whose iteration matrix is that of the elements, from which stresses can be left out.
_WITH_STRESSES = ("generalized_alpha", "stabilized_index2")
MAX_STEPS = 1e9  # more steps than anyone waits for: dt or t_end was mistyped


@settings
class RunOptions(Settings):
    """Settings of a motion in time.

    Raises:
        TypeError: If a value has the wrong type.
        ValueError: If a value is out of range, or the run would exceed 1e9 steps.
    """

    RESTART_AGREES = ("dt", "integrator", "rho_inf", "redundant_constraints", "start")

    dt: float = option("time step", unit="s", above=0)
    t_end: float = option("end of the simulated time", unit="s", above=0)
    integrator: str = option(
        "scheme in time: stabilized_index2 satisfies the constraints on velocities as well, "
        "energy_momentum keeps the energy with --rho-inf 1 and never adds to it, "
        "independent_coordinates has no multipliers and is for small systems",
        default="generalized_alpha",
        choices=tuple(INTEGRATORS),
    )
    rho_inf: float = option(
        "spectral radius of the integrator at infinite frequency: 1 dissipates nothing, 0 the most",
        default=0.9,
        minimum=0,
        maximum=1,
    )
    iteration_matrix: str = option(
        "keep one factorisation (frozen), renew it each iteration (updated) or when needed (auto); "
        "material: each iteration without geometric stiffness, to study what that is for",
        default="auto",
        choices=("auto", "frozen", "updated", "material"),
        note="The geometric stiffness left out is that of beams and shells.",
    )
    tolerance: float = option(
        "largest Newton step of positions, rotations (rad) and beta h^2 x multipliers at the end",
        default=1e-6,
        unit="m",
        above=0,
        maximum=0.1,
    )
    redundant_constraints: str = option(
        "redundant constraints: refuse them by name, or distribute their forces (least_norm)",
        default="refuse",
        choices=("refuse", "least_norm"),
        note="They are carried with the smallest forces that do.",
    )
    start: str = option(
        "start as the model says (given), or at rest in equilibrium with the loads at t = 0",
        default="given",
        choices=("given", "equilibrium"),
        note="Gravity is one of the loads.",
    )
    adaptive: bool = option(
        "halve and double steps below dt so that each keeps the error tolerance",
        default=False,
        note="Steps are ``dt`` or ``2^-k`` of it.",
    )
    error_tolerance: float = option(
        "with adaptive: largest local error of a position or rotation (rad) in a step",
        default=1e-5,
        unit="m",
        above=0,
        maximum=0.1,
        note="It is absolute: choose it relative to the motion of interest, 1e-5 of the size of "
        "the mechanism for example. The error at the end is about that of one step times the "
        "number of steps.",
    )
    every: int = option("write the ParaView fields every N-th time step dt", default=10, minimum=1)
    fields: str = fields()
    fields_precision: str = fields_precision()
    history_format: str = history_format()
    checkpoint_every: int = option(
        "write a checkpoint every N-th step and at the end; 0: only if the run ends early",
        default=0,
        minimum=0,
        note="A run ends early that fails or is interrupted. None is written without an output "
        "folder.",
    )
    split_above: int = split_above()
    linear_solver: str = linear_solver()
    linear_tolerance: float = linear_tolerance()
    kernels: str = kernels()
    restart: Path | None = restart()

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
        if self.linear_solver == "iterative":
            for name, value in (
                ("integrator", "independent_coordinates"), ("start", "equilibrium"),
            ):  # fmt: skip
                if getattr(self, name) == value:
                    raise ValueError(
                        f"RunOptions: linear_solver 'iterative' cannot be used with {name} "
                        f"{value!r}, which needs factors"
                    )
        if self.t_end > MAX_STEPS * self.dt:
            raise ValueError(
                f"RunOptions: dt {self.dt:g} s up to t_end {self.t_end:g} s takes more than "
                f"{MAX_STEPS:g} steps"
            )


DYNAMICS = Analysis("dynamics", RunOptions, "flexfem.simulation.dynamics:simulate")
