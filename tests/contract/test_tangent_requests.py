# SPDX-License-Identifier: LGPL-3.0-or-later
"""Every family honours a request in all of its calls: residual, matrix and action agree."""

import numpy as np
import pytest

import flexfem as ff
from flexfem.layout.tangent_request import EXACT, TangentRequest
from flexfem.lie import se3
from flexfem.simulation.run.setup import set_up
from flexfem.solvers.linear.tangent import part_pattern, part_values
from flexfem.system.mechanics import END_POINT
from flexfem.system.system import BlockPart, Shifts, System
from tests.unit.particle_body import bar

pytestmark = pytest.mark.serial
STEEL = ff.Material(2.1e11, 0.3, 7850.0)
FAMILIES = ("se3", "varying", "nurbs", "varying_nurbs", "rotation_free", "director", "floating")
#: velocity, acceleration and stiffness: no term dominates
MOVING = {"velocity": 12.0, "acceleration": 7e3, "scale": 0.3}


def _model(family: str, damping: float) -> ff.Model:
    """A body of a family, 1 m long."""
    if family == "floating":
        model = ff.Model("one")
        model.add(ff.FloatingBody("body", bar(modes=4)))
        return model
    if family in ("se3", "varying", "nurbs", "varying_nurbs"):
        mesh = ff.LineMesh.straight({"body": ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))}, elements=3)
        model, degree = ff.Model("one", mesh=mesh), 3 if "nurbs" in family else None
        section = ff.Section.rectangle(0.03, 0.02, STEEL)
        if "varying" in family:
            model.add(
                ff.Beam("body", lambda s: ff.Section.circle(0.04 - 0.02 * s, STEEL),
                        twist=lambda s: s, prestrain=1e-2 * np.ones(6),
                        damping=damping * np.arange(1.0, 7.0),
                        formulation="nurbs" if degree else "se3", degree=degree)
            )  # fmt: skip
        else:
            model.add(
                ff.Beam("body", section, formulation=family, degree=degree, damping=damping)
            )  # fmt: skip
        return model
    x = np.linspace(0.0, 1.0, 3)
    model = ff.Model("one", surface=ff.SurfaceMesh.grid("body", x, x))
    section = ff.ShellSection.isotropic(0.02, STEEL)
    heat = ff.ThermalStrain(1e-3, 5.0, gradient_z=200.0)
    model.add(ff.Shell("body", section, element=family, damping=damping, prestrain=heat))
    return model


def _moving(family: str, damping: float) -> tuple[System, BlockPart]:
    """The system of a body that is strongly deformed and moves, and its part."""
    system = set_up(_model(family, damping), None, 10_000)[1]
    (part,) = system.parts
    random, block = np.random.default_rng(1), part.block
    twists = 0.05 * random.normal(size=block.velocity.shape)
    twists[:, block.width :] = 0.0
    block.increment[:] = twists
    block.frames[:] = se3.retract(block.frames, twists)
    for rates in (block.velocity, block.acceleration, block.step):
        rates[:, : block.width] = block.hold(random.normal(size=twists.shape)[:, : block.width])
    return system, part


def _requests(part: BlockPart) -> dict[str, TangentRequest]:
    """All that a solver may ask for, by a name."""
    assert part.elements is not None
    steps = 0.1 * np.random.default_rng(2).normal(size=part.block.velocity.shape)
    continued = part.elements.continued_strains(part.block.frames, steps)
    return {
        "present": EXACT,
        "continued": TangentRequest(continued),
        "unstressed": TangentRequest(part.elements.unstressed()),
        "no compression": TangentRequest(drop_compression=True),
        "local": TangentRequest(local=True),
        "all": TangentRequest(continued, drop_compression=True, local=True),
    }


@pytest.mark.parametrize("damping", [0.0, 1e-3])
@pytest.mark.parametrize(
    "family", [pytest.param(f, marks=[pytest.mark.slow] * ("varying" in f)) for f in FAMILIES]
)
def test_action_is_the_matrix_times_the_step(family: str, damping: float) -> None:
    system, part = _moving(family, damping)
    block, width, shifts = part.block, part.block.width, Shifts(**MOVING)
    rows, columns = part_pattern(part)
    own = np.zeros(len(part.masses.nodes) + len(part.forces.nodes))
    assert not own.size, "masses and forces at nodes have no request"
    step, found = block.step[:, :width].ravel(), {}
    for name, request in _requests(part).items():
        values = part_values(system, part, shifts, request)
        product = np.bincount(rows, values * step[columns], step.size)
        block.residual[:] = 0.0
        END_POINT.add_cells(system, part, shifts, request, 1.0)
        action = block.residual[:, :width].ravel()
        # round-off; a part of the request that one of them ignores is off by 1e-4 and more
        np.testing.assert_allclose(action, product, rtol=0, atol=1e-11 * np.abs(product).max())
        found[name] = action.copy()
    largest = np.abs(found["present"]).max()
    changed = {n for n, a in found.items() if np.abs(a - found["present"]).max() > 1e-9 * largest}
    # else the requests would say nothing
    expected = {
        "floating": {"local", "all"},
        "rotation_free": {"continued", "unstressed", "no compression", "all"},
    }.get(family, {"continued", "unstressed", "local", "all"})
    assert changed == expected


@pytest.mark.parametrize("family", FAMILIES)
def test_residual_has_the_stresses_of_the_strains(family: str) -> None:
    """Stresses of present strains are the present ones; without stresses inertia is left."""
    part = _moving(family, 0.0)[1]
    elements, block = part.elements, part.block
    assert elements is not None

    def forces(request: TangentRequest) -> np.ndarray:
        block.residual[:] = 0.0
        elements.add_residual(block, np.zeros(3), 1.0, request)
        return block.residual.copy()

    present = forces(EXACT)
    largest = np.abs(present).max()
    steps = np.zeros_like(block.velocity)
    same = forces(TangentRequest(elements.continued_strains(block.frames, steps)))
    # round-off of strains of 1e-2 in stiff sections
    np.testing.assert_allclose(same, present, rtol=0, atol=1e-9 * largest)
    if elements.unstressed() is not None:
        rest = forces(TangentRequest(elements.unstressed()))
        block.velocity[:], block.acceleration[:] = 0.0, 0.0
        still = forces(TangentRequest(elements.unstressed()))
        np.testing.assert_allclose(still, 0.0, atol=1e-9 * largest)
        assert np.abs(rest).max() > 1e-9 * largest
