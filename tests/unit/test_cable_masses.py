# SPDX-License-Identifier: LGPL-3.0-or-later
"""Matrices, refusals and warnings of cables with mass."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import flexfem as ff
from flexfem.simulation.run.setup import set_up
from flexfem.solvers.linear.tangent import part_pattern, part_values
from flexfem.system.mechanics import END_POINT
from flexfem.system.system import Shifts
from tests.unit.refusals import assert_on_page, assert_refused

pytestmark = pytest.mark.serial
A, B, C = ff.Ground((-1.0, 0.0, -1.0)), ff.Marker("one"), ff.Marker("two")
Y = (0.0, 1.0, 0.0)


def model_of(cable: ff.Cable, *things: Any) -> ff.Model:
    """Two bodies under gravity with a cable."""
    model = ff.Model("heavy")
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.RigidBody("one", 2.0, (0.01,) * 3),
        ff.RigidBody("two", 3.0, (0.01,) * 3, position=(1.1, 0.3, -1.0)),
        cable,
        *things,
    )
    return model


def rope(path: Any = None, **given: Any) -> ff.Cable:
    """A cable over a sheave and through an eyelet on moving bodies."""
    eyelet = ff.Eyelet(ff.Marker("two", offset=(0.0, 0.1, 0.4)))
    own = [A, ff.Sheave(B, 0.2, Y), eyelet, ff.Ground((2.0, 0.0, 0.0))] if path is None else path
    return ff.Cable("j", own, mass_per_length=2.0, **{"axial_stiffness": 1e4} | given)


def test_matrices_are_the_derivatives() -> None:
    """Of the residual, with a winch, in motion; and the action is their product with a step."""
    system = set_up(model_of(rope(paid_out=lambda t: 0.3 * t + 2.0 * t**2)), None, 10_000)[1]
    system.set_time(0.1)
    part = next(part for part in system.parts if part.block.name == "cables")
    block, random = part.block, np.random.default_rng(1)
    for rates in (block.velocity, block.acceleration, block.step):
        rates[:, :3] = block.hold(random.normal(size=(len(rates), 3)))
    shifts = Shifts(velocity=12.0, acceleration=300.0, scale=1.0)
    rows, columns = part_pattern(part)
    values = part_values(system, part, shifts, shifts.request())
    step = block.step[:, :3].copy()
    product = np.bincount(rows, values * step.ravel()[columns], step.size).reshape(-1, 3)
    block.residual[:] = 0.0
    END_POINT.add_cells(system, part, shifts, shifts.request(), 1.0)
    free = ~block.dirichlet
    # round-off
    np.testing.assert_allclose(block.residual[:, :3][free], product[free], rtol=1e-10)
    forces, e = [], 1e-6
    state = {name: values.copy() for name, values in block.trial().items()}
    for sign in (-e, e):
        block.frames[:, :3] = state["frames"][:, :3] + sign * step
        block.velocity[:, :3] = state["velocity"][:, :3] + sign * 12.0 * step
        block.acceleration[:, :3] = state["acceleration"][:, :3] + sign * 300.0 * step
        block.residual[:] = 0.0
        part.elements.add_residual(block, system.gravity, 1.0)
        forces.append(block.residual[:, :3].copy())
    exact = (forces[1] - forces[0]) / (2.0 * e)
    # differences leave 1e-7; terms of the flow's speed are parts of 1e-2
    np.testing.assert_allclose(product[free], exact[free], atol=1e-6 * np.abs(exact).max())


REFUSED: dict[str, tuple[Callable[[], object], str]] = {
    "closed": (
        lambda: rope([ff.Sheave(B, 0.1, Y), ff.Sheave(C, 0.1, Y)], closed=True),
        "mass_per_length of 2 kg/m needs closed=False",
    ),
    "drum": (
        lambda: rope([ff.Sheave(B, 0.1, Y, grip=True), C]),
        r"needs path\[0\] without grip; a drum at the first end is a marker with a rest_length or",
    ),
    "friction": (
        lambda: rope([A, ff.Eyelet(B, friction=0.1), C]), r"needs path\[1\] without friction"
    ),
    "negative": (lambda: ff.Cable("j", [A, B], stiffness=1.0, mass_per_length=-1.0), "negative"),
    "shell": (lambda: run(on_a_shell()), r"path\[1\]: with mass_per_length a Sheave is on a rigid"),
    "release": (lambda: run(released()), "one with mass_per_length cannot be released"),
    "energy momentum": (
        lambda: run(model_of(rope()), integrator="energy_momentum"),
        'Cable "j": the integrator energy_momentum is for beams of the formulation "se3"',
    ),
}  # fmt: skip


def released() -> ff.Model:
    """A model whose cable is released."""
    model = model_of(rope())
    model.release("j")
    return model


def on_a_shell() -> ff.Model:
    """A sheave on a node of a shell, which has no axes."""
    x = np.linspace(0.0, 0.1, 2)
    model = ff.Model("heavy", surface=ff.SurfaceMesh.grid("body", x, x))
    steel = ff.Material(2.1e11, 0.3, 7850.0)
    guide = ff.Sheave(ff.Marker("body", (0.0, 0.0, 0.0)), 0.1, Y)
    model.add(
        ff.Shell("body", ff.ShellSection.isotropic(0.02, steel)),
        rope([A, guide, ff.Ground((1.0, 0.0, -1.0))]),
    )
    return model


def run(model: ff.Model, **given: Any) -> ff.Outcome:
    """A short motion."""
    return ff.simulate(model, ff.RunOptions(dt=1e-3, t_end=2e-3, quiet=True, **given))


@pytest.mark.parametrize("name", REFUSED)
def test_refused(name: str) -> None:
    make, text = REFUSED[name]
    assert_refused(make, text)


def test_a_cable_that_would_sag_is_told() -> None:
    """A level part under little tension; not one with enough."""
    level = [ff.Ground((-1.0, 0.0, -1.0)), ff.Marker("two")]
    for preload, told in ((30.0, 1), (4000.0, 0)):
        outcome = run(model_of(rope(level, preload=preload)))
        texts = [text for text in outcome.summary["warnings"] if '"j"' in text]
        assert len(texts) == told
        for text in texts:
            assert_on_page(text)
            # 2 kg/m under g at 30 N on 2.12 m
            assert "from path[0] to path[1] it would sag by 17" in text


def test_what_a_winch_brings_in_is_no_spurious_energy() -> None:
    """A run without an energy probe compares its energies with the work, too."""
    model = ff.Model("hoist")
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.RigidBody("two", 5.0, (0.01,) * 3, position=(0.0, 0.0, -3.0)),
        ff.Cable(
            "j",
            [ff.Ground(), C],
            mass_per_length=30.0,
            tension_only=False,
            paid_out=lambda t: -1.2 * t**2 / (1.0 + t),
        ),
    )
    outcome = ff.simulate(model, ff.RunOptions(dt=1e-2, t_end=1.5, quiet=True))
    # a third of the rope is hauled in, and its energy with it
    assert not outcome.summary["warnings"]
