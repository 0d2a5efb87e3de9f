# SPDX-License-Identifier: LGPL-3.0-or-later
"""The flat public interface."""

import subprocess
import sys

import pytest

import flexfem as ff
from flexfem import research

pytestmark = pytest.mark.serial

NUMERICAL = {
    "relax", "simulate", "solve_static", "Outcome", "find_modes", "sweep_rotor", "sweep_spin",
    "linearize",
    "LinearModel", "LinearBody", "MassField", "solid_body", "plane_body", "beam_body", "shell_body",
    "euler_bernoulli_body",
    "reduce_body", "assemble", "inverse_dynamics", "InverseDynamics", "describe", "Description",
    "check", "gradient", "tangent_motion", "Gradient", "TangentMotion",
    "minimize", "Optimum", "identify", "Identification", "uncertainty", "Uncertainty",
    "jax_function", "torch_function",
    "ParameterSearch", "FoundParameters",
}  # fmt: skip
RESEARCH_NUMERICAL = {
    "floating_model", "simulate_mechanism", "compare_formalisms", "ElementMatrices",
    "InertiaIntegrals", "element_matrices",
}  # fmt: skip
#: Names of studies in version 0.1 that others have now.
TAKEN = {"Solid"}


@pytest.mark.parametrize("name", sorted(set(ff.__all__) - NUMERICAL))
def test_every_public_name_is_there(name: str) -> None:
    assert name in dir(ff)
    assert getattr(ff, name) is not None


@pytest.mark.parametrize("name", sorted(set(research.__all__) - RESEARCH_NUMERICAL - TAKEN))
def test_names_of_studies_are_there_and_former_ones_lead_there(name: str) -> None:
    assert name in dir(research)
    assert name not in dir(ff)
    with pytest.warns(DeprecationWarning, match=f"flexfem.{name} is flexfem.research.{name} now"):
        former = getattr(ff, name)
    assert former is getattr(research, name)


def test_unknown_names_are_refused() -> None:
    with pytest.raises(AttributeError, match="'Bream'"):
        _ = research.Bream
    with pytest.raises(AttributeError, match="'Bream'"):
        _ = ff.Bream


def test_models_are_declared_without_dolfinx_petsc_and_numba() -> None:
    names = sorted(set(ff.__all__) - NUMERICAL)
    studies = sorted(set(research.__all__) - RESEARCH_NUMERICAL - TAKEN)
    program = (
        f"import sys, flexfem, flexfem.research\nfor name in {names!r}: getattr(flexfem, name)\n"
        f"for name in {studies!r}: getattr(flexfem.research, name)\n"
        "print(*(set(sys.modules) & {'dolfinx', 'petsc4py', 'mpi4py', 'numba', 'ufl', 'gmsh'}))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == []
