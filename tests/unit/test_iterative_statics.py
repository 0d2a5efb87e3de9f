# SPDX-License-Identifier: LGPL-3.0-or-later
"""Statics of solids by Krylov methods: equilibria, forces, refusals are those with factors."""

import os
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import flexfem as ff
from flexfem.la.krylov import KrylovFactor
from flexfem.launch import Interrupted
from flexfem.simulation.statics import solve_static
from tests.unit.refusals import assert_on_page

RUBBER = ff.laws.NeoHookean.from_young(1e6, 0.3)
GRAVITY = ff.Gravity((0.0, 3.0, -9.81))


def _bar(**options: Any) -> ff.Solid:
    mesh = ff.SolidMesh.box((0.4, 0.1, 0.1), (4, 1, 1), "tetrahedron")
    return ff.Solid("bar", RUBBER, mesh, density=1100.0, **options)


def _cantilever() -> ff.Model:
    model = ff.Model("cantilever")
    model.add(
        _bar(fixed={"x0": "xyz"}), GRAVITY,
        ff.PositionProbe("end", ff.Marker("bar", (0.4, 0.0, 0.0))),
    )  # fmt: skip
    return model


def _tied(hold: type[ff.Rigid] | type[ff.Spherical] = ff.Rigid) -> ff.Model:
    """A bar that a joint alone holds, with a body that it carries, and one on springs to that."""
    bar, model = _bar(), ff.Model("tied")
    model.add(
        bar, GRAVITY,
        ff.RigidBody("bob", 0.2, (1e-3, 1e-3, 1e-3), position=(0.5, 0.05, 0.05)),
        ff.RigidBody("end", 0.2, (1e-3, 1e-3, 1e-3), position=(0.7, 0.05, 0.05)),
        hold("hold", ff.Ground((0.0, 0.05, 0.05)), bar.surface_marker("x0")),
        ff.Rigid("bond", bar.surface_marker("x1"), ff.Marker("bob", offset=(-0.1, 0.0, 0.0))),
        ff.Bushing(
            "soft", ff.Marker("bob"), ff.Marker("end", offset=(-0.2, 0.0, 0.0)),
            stiffness=(50.0, 50.0, 50.0, 2.0, 2.0, 2.0),
        ),
        ff.PositionProbe("at", ff.Marker("end")),
        ff.ReactionProbe("force", "hold"),
    )  # fmt: skip
    return model


def _run(model: ff.Model, **options: Any) -> Any:
    return solve_static(model, ff.StaticOptions(load_steps=1, quiet=True, split_above=1, **options))


@pytest.mark.parametrize("linear", [False, True])
@pytest.mark.parametrize("make", [pytest.param(_cantilever, marks=pytest.mark.three_ranks), _tied])
def test_equilibria_and_reactions_are_those_with_factors(make: Any, *, linear: bool) -> None:
    """Of a bar that is fixed, and of one whose own matrix is singular, split over the ranks."""
    found, exact = (
        _run(make(), linear=linear, linear_solver=kind) for kind in ("iterative", "direct")
    )
    assert found.summary["status"] == exact.summary["status"] == "ok"
    assert found.summary["linear_solver"] == "iterative"
    assert exact.summary["linear_solver"] == "direct"
    assert found.summary["linear_iterations"] > found.summary["linear_solves"] > 0
    # a hierarchy serves several matrices of Newton's iteration
    assert 0 < found.summary["linear_hierarchies"] <= 3
    assert found.summary["linear_solves"] < 150  # 166 with an elimination of joints for each matrix
    assert found.summary["newton_iterations"] == exact.summary["newton_iterations"]
    assert found.summary["peak_memory"] > 1e7
    for name, values in exact.history.items():
        size = max(1.0, float(np.abs(values).max()))
        # solves to 1e-8 would leave 6e-10 m of a linear solution, those to 1e-10 do 6e-12
        np.testing.assert_allclose(found.history[name], values, rtol=0.0, atol=2e-10 * size)


def _pulled(force: float, *, held_by_joint: bool) -> ff.Model:
    """A thin bar that a traction (N/m^2) on its end bends down."""
    mesh = ff.SolidMesh.box((0.4, 0.05, 0.05), (5, 1, 1), "tetrahedron")
    fixed = {} if held_by_joint else {"x0": "xyz"}
    bar, model = ff.Solid("bar", RUBBER, mesh, density=1100.0, fixed=fixed), ff.Model("pulled")
    model.add(
        bar, ff.Gravity((0.0, 0.0, -9.81)),
        ff.SurfaceTraction("pull", "bar", "x1", (0.0, 0.0, -force)),
        ff.PositionProbe("end", ff.Marker("bar", (0.4, 0.0, 0.0))),
    )  # fmt: skip
    if held_by_joint:
        model.add(ff.Rigid("hold", ff.Ground((0.0, 0.025, 0.025)), bar.surface_marker("x0")))
    return model


def _ends(model: ff.Model, **options: Any) -> Any:
    """Outcome and end of a bar by Krylov methods, where factors find it as well."""
    settings = {"quiet": True, "split_above": 1} | options
    found, exact = (
        solve_static(model, ff.StaticOptions(linear_solver=kind, **settings))
        for kind in ("iterative", "direct")
    )
    assert found.status == exact.status == "ok"
    for name, values in exact.history.items():  # of the first rank
        assert found.history[name][-1] == pytest.approx(values[-1], abs=1e-9)
    return found


@pytest.mark.slow_on_ranks
def test_load_steps_that_turn_cells_inside_out_are_divided() -> None:
    """The matrix there is not finite, and of such a one PETSc makes no hierarchy."""
    found = _ends(_pulled(5000.0, held_by_joint=False), load_steps=1)
    assert 0 < found.summary["rejected_steps"] < 6


@pytest.mark.serial
def test_solves_go_on_from_restarts_with_a_residual_that_rounding_has_moved() -> None:
    """A bar that a joint alone holds: PETSc's GMRES gives up there, and all steps would fail."""
    found = _ends(_pulled(300.0, held_by_joint=True), load_steps=2)
    assert found.summary["rejected_steps"] == 0


@pytest.mark.serial
def test_large_solids_iterate_by_themselves_where_nothing_needs_factors(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("flexfem.la.linear_solver._LARGE", 100)
    assert _run(_cantilever()).summary["linear_solver"] == "iterative"
    assert _run(_cantilever(), linear_solver="direct").summary["linear_solver"] == "direct"
    assert _run(_cantilever(), buckling_modes=1).summary["linear_solver"] == "direct"


@pytest.mark.serial
@pytest.mark.parametrize(
    ("name", "value"),
    [("arc_length", 0.1), ("critical_points", True), ("buckling_modes", 1), ("stabilise", True)],
)
def test_what_needs_factors_refuses_iterative_solvers(name: str, value: Any) -> None:
    with pytest.raises(ValueError, match=f"cannot be used with {name} {value}, which") as caught:
        ff.StaticOptions(linear_solver="iterative", **{name: value})
    assert_on_page(str(caught.value))


def test_mechanisms_are_found_without_factors() -> None:
    """Their only stiffness is that of the shift; a bar on a ball joint turns with what it holds."""
    with pytest.raises(ValueError, match="can move without any stiffness") as found:
        _run(_tied(ff.Spherical), linear_solver="iterative")
    with pytest.raises(ValueError, match="can move without any stiffness") as exact:
        _run(_tied(ff.Spherical), linear_solver="direct")
    assert str(found.value) == str(exact.value)


def _rubber(bulk_over_shear: float) -> ff.Model:
    """A bar of nearly incompressible rubber that a joint alone holds."""
    mesh = ff.SolidMesh.box((0.4, 0.1, 0.1), (4, 1, 1), "tetrahedron")
    law = ff.laws.NeoHookean(4e5, 4e5 * bulk_over_shear)
    bar, model = ff.Solid("bar", law, mesh, density=1100.0, formulation="dilatation"), ff.Model("r")
    model.add(
        bar, GRAVITY, ff.Rigid("hold", ff.Ground((0.0, 0.05, 0.05)), bar.surface_marker("x0"))
    )
    return model


@pytest.mark.three_ranks
@pytest.mark.parametrize("linear", [False, True])
def test_runs_end_at_the_first_solve_that_does_not_converge(
    monkeypatch: pytest.MonkeyPatch, *, linear: bool
) -> None:
    """Larger rubber bodies take more than the 1000 iterations that there are, here 20."""
    monkeypatch.setattr("flexfem.la.krylov._MOST", 20)
    outcome = _run(_rubber(1e4), linear_solver="iterative", linear=linear)
    assert outcome.summary["status"].startswith("the iterative solution of linear equations")
    assert "use linear_solver direct" in outcome.summary["status"]
    assert "nearly incompressible" in outcome.summary["status"]
    assert_on_page(outcome.summary["status"])
    # one of the check that all is held, one of the step: not one for each of 6 constraints
    assert outcome.summary["linear_solves"] == 2


@pytest.mark.serial
def test_nearly_incompressible_solids_iterate_only_if_asked(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Up to a hundred shear moduli, and auto takes factors beyond."""
    monkeypatch.setattr("flexfem.la.linear_solver._LARGE", 100)
    for ratio, kind in ((99.0, "iterative"), (101.0, "direct")):
        assert _run(_rubber(ratio), linear=True).summary["linear_solver"] == kind


def test_signals_end_solves_with_a_checkpoint(
    monkeypatch: pytest.MonkeyPatch, shared_tmp_path: Path
) -> None:
    """One that comes in the elimination of constraints, which may take hours, ends it."""
    solve, left = KrylovFactor._solve, [3]

    def interrupted(*args: Any) -> None:
        if callable(signal.getsignal(signal.SIGTERM)):  # in a step
            left[0] -= 1
        if left[0] == 0:
            os.kill(os.getpid(), signal.SIGTERM)
        solve(*args)

    monkeypatch.setattr(KrylovFactor, "_solve", interrupted)
    with pytest.raises(Interrupted, match=r'interrupted at t = 0, go on with restart="') as caught:
        _run(_tied(), linear_solver="iterative", output=shared_tmp_path / "a")
    assert caught.value.checkpoint is not None
    assert left[0] == 0  # nothing is solved after it


@pytest.mark.serial
def test_statics_without_solids_refuse_iterative_solvers() -> None:
    model = ff.Model("rigid")
    model.add(ff.RigidBody("a", 1.0, (1.0, 1.0, 1.0)))
    with pytest.raises(ValueError, match="linear_solver 'iterative' is for models with"):
        _run(model, linear_solver="iterative")
