# SPDX-License-Identifier: LGPL-3.0-or-later
"""Studies of single papers: a beam on a moving base, mechanisms by four formalisms.

The public names are loaded on first use, as those of the package are::

    from flexfem import research

    base = research.PrescribedBase(
        velocity=lambda t: (0.1 * t, 0.0, 0.0), acceleration=lambda t: (0.1, 0.0, 0.0)
    )

Only the command line of the package depends on these modules.
"""

from importlib import import_module
from typing import Any

_MODULES = {
    "BeamProperties": "moving_base.properties",
    "Piecewise": "moving_base.properties",
    "Effects": "moving_base.effects",
    "effects_of": "moving_base.effects",
    "PrescribedBase": "moving_base.base",
    "FreeBase": "moving_base.base",
    "MovingBaseBeam": "moving_base.beam",
    "exact_model": "moving_base.comparison.exact",
    "floating_model": "moving_base.comparison.floating",
    "segment_sections": "moving_base.comparison.exact",
    "beam_by_theory": "moving_base.comparison.theories",
    "THEORY_OPTIONS": "moving_base.comparison.theories",
    "TIP_COLUMNS": "moving_base.comparison.exact",
    "LINK_OPTIONS": "moving_base.comparison.manipulator",
    "outboard_link": "moving_base.comparison.manipulator",
    "manipulator_base": "moving_base.comparison.manipulator",
    "constant_angle": "moving_base.comparison.manipulator",
    "smooth_turn": "moving_base.comparison.manipulator",
    "spin_up_angle": "moving_base.comparison.manipulator",
    "EnergyBody": "formalisms.description.mechanism",
    "Mechanism": "formalisms.description.mechanism",
    "FORMALISMS": "formalisms.description.mechanism",
    "FormalismStudy": "formalisms.description.study",
    "PlanarFrame": "formalisms.description.frames",
    "SpatialFrame": "formalisms.description.frames",
    "FrameMotion": "formalisms.description.frame_motion",
    "ElementMatrixStudy": "formalisms.description.matrix_study",
    "ElementMatrices": "formalisms.element_matrices",
    "InertiaIntegrals": "formalisms.element_matrices",
    "element_matrices": "formalisms.element_matrices",
    "BeamMatter": "formalisms.description.matter",
    "Matter": "formalisms.description.matter",
    "PlaneStress": "formalisms.description.matter",
    "Solid": "formalisms.description.matter",
    "End": "formalisms.description.joints",
    "Constraint": "formalisms.description.joints",
    "AppliedForce": "formalisms.description.joints",
    "end_angle": "formalisms.description.joints",
    "end_position": "formalisms.description.joints",
    "coincidence": "formalisms.description.joints",
    "on_line": "formalisms.description.joints",
    "parallel": "formalisms.description.joints",
    "simulate_mechanism": "formalisms.runs.comparison",
    "compare_formalisms": "formalisms.runs.comparison",
}
__all__ = [*_MODULES]  # noqa: PLE0604


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used."""
    if name not in _MODULES:
        raise AttributeError(f"module 'flexfem.research' has no attribute '{name}'")
    value = getattr(import_module(f"flexfem.research.{_MODULES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """List the public names, also those not loaded yet."""
    return sorted({*globals(), *_MODULES})
