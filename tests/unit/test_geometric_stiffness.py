# SPDX-License-Identifier: LGPL-3.0-or-later
"""Iteration matrices without geometric stiffness: what is left, the same motions, their counts."""

import numpy as np
import pytest

import flexfem as ff
from flexfem.layout.tangent_request import Strains, TangentRequest
from flexfem.lie import se3
from flexfem.simulation.run.setup import set_up
from flexfem.solvers.linear.tangent import part_pattern, part_values
from flexfem.system.system import Shifts
from tests.unit.refusals import assert_on_page

STEEL = ff.Material(2.1e11, 0.3, 7850.0)
STILL = Shifts(velocity=0.0, acceleration=0.0, scale=1.0)
FAMILIES = ("se3", "nurbs", "rotation_free", "director")


def _body(family: str, damping: float) -> ff.Model:
    """A body of a family, 1 m long."""
    if family in ("se3", "nurbs"):
        mesh = ff.LineMesh.straight({"body": ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))}, elements=3)
        model, degree = ff.Model("one", mesh=mesh), 3 if family == "nurbs" else None
        section = ff.Section.rectangle(0.03, 0.02, STEEL)
        body = ff.Beam("body", section, formulation=family, degree=degree, damping=damping)
    else:
        x = np.linspace(0.0, 1.0, 3)
        model = ff.Model("one", surface=ff.SurfaceMesh.grid("body", x, x))
        section = ff.ShellSection.isotropic(0.02, STEEL)
        body = ff.Shell("body", section, element=family, damping=damping)
    model.add(body)
    return model


def _disturbed(family: str, damping: float):
    """The system of a body that is strongly deformed and at rest, and its part."""
    system = set_up(_body(family, damping), None, 10_000)[1]
    (part,) = system.parts
    twists = 0.05 * np.random.default_rng(1).normal(size=part.block.velocity.shape)
    part.block.frames[:] = se3.retract(part.block.frames, twists)
    return system, part


@pytest.mark.serial
@pytest.mark.parametrize("family", FAMILIES)
def test_what_is_left_resists_as_a_viscosity_does(family):
    """``B^T D B u`` is the force of a viscosity of one second at the velocities ``u``."""
    forces = []
    for damping in (1.0, 0.0):
        system, part = _disturbed(family, damping)
        block, width = part.block, part.block.width
        steps = np.random.default_rng(2).normal(size=block.velocity.shape)
        steps[:, width:] = 0.0
        steps[:, :width] = block.hold(steps[:, :width].copy())
        block.velocity[:] = steps
        part.add_residual(np.zeros(3), np.zeros(0), 1.0)
        forces.append(block.hold(block.residual[:, :width].copy()))
    viscous = forces[0] - forces[1]
    block.velocity[:] = 0.0
    rows, columns = part_pattern(part)

    def action(strains: Strains | None = None) -> np.ndarray:
        matrices = part_values(system, part, STILL, TangentRequest(strains))
        values = matrices * steps[:, :width].ravel()[columns]
        return block.hold(np.bincount(rows, values, steps[:, :width].size).reshape(viscous.shape))

    exact = action()
    largest = np.abs(viscous).max()
    # round-off of terms that cancel; a stiffness at other places would be off by percents
    np.testing.assert_allclose(
        action(part.elements.unstressed()), viscous, rtol=0, atol=1e-9 * largest
    )
    # else the study would compare a matrix with itself
    assert np.abs(exact - viscous).max() > 1e-3 * largest


def _bent(formulation: str) -> ff.Model:
    """A cantilever that a force at its end bends by 0.4 of its length."""
    mesh = ff.LineMesh.straight({"beam": ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))}, elements=4)
    section = ff.Section.rectangle(0.01, 0.005, STEEL)
    model = ff.Model("bent", mesh=mesh)
    model.add(
        ff.Beam("beam", section, formulation=formulation),
        ff.Rigid("clamp", ff.Ground(), ff.Marker("beam", "start")),
        ff.PointForce("force", ff.Marker("beam", "end"), (0.0, 0.0, 100.0)),
        ff.PositionProbe("tip", ff.Marker("beam", "end")),
    )
    return model


@pytest.mark.parametrize("formulation", [pytest.param("se3", marks=pytest.mark.serial), "nurbs"])
def test_bent_beams_move_alike_in_other_numbers_of_iterations(formulation):
    outcomes = {
        matrix: ff.simulate(
            _bent(formulation),
            ff.RunOptions(dt=1e-3, t_end=0.03, iteration_matrix=matrix, tolerance=1e-9, quiet=True),
        )
        for matrix in ("updated", "material")
    }
    exact, material = outcomes["updated"], outcomes["material"]
    for name, column in exact.history.items():
        # both stop at steps below 1e-9; stresses left out of the residual move the tip by 0.1
        np.testing.assert_allclose(material.history[name], column, atol=1e-8)
    counts = [outcome.summary["newton_iterations"] for outcome in (exact, material)]
    # stresses of the iterates in place of continued ones take 139 and 148 of 137 and 167
    assert counts[0] < 0.85 * counts[1]
    assert material.summary["fallbacks"] == material.summary["rejected_steps"] == 0
    assert material.summary["factorizations"] == counts[1]
    if exact.history:  # on the first rank
        assert exact.history["tip_z"].max() > 0.4


def test_without_geometric_stiffness_nothing_can_be_left_out():
    model = ff.Model("rigid")
    model.add(ff.RigidBody("body", 1.0, (1.0, 1.0, 1.0)), ff.Gravity((0.0, 0.0, -9.81)))
    options = ff.RunOptions(dt=1e-3, t_end=1e-2, iteration_matrix="material")
    with pytest.raises(ValueError, match="but the model has none") as error:
        ff.simulate(model, options)
    assert_on_page(str(error.value))
    with pytest.raises(ValueError, match="'energy_momentum'") as error:
        ff.RunOptions(
            dt=1e-3, t_end=1e-2, iteration_matrix="material", integrator="energy_momentum"
        )
    assert_on_page(str(error.value))
