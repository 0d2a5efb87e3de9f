# SPDX-License-Identifier: LGPL-3.0-or-later
"""Solids solved by Krylov methods: the same motions as with factors, failures, refusals."""

from typing import Any

from petsc4py import PETSc

import numpy as np
import pytest

import flexfem as ff
from flexfem.la.krylov import KrylovFactor
from flexfem.la.linear_solver import SolveCounts
from flexfem.simulation.dynamics import simulate
from tests.unit.refusals import assert_on_page

RUBBER = ff.laws.NeoHookean.from_young(1e6, 0.3)


def _bar(counts: tuple[int, int, int] = (4, 1, 1), **options: Any) -> ff.Solid:
    mesh = ff.SolidMesh.box((0.4, 0.1, 0.1), counts, "tetrahedron")
    return ff.Solid("bar", RUBBER, mesh, density=1100.0, **options)


def _pendulum() -> ff.Model:
    """A bar on a ball joint with a rigid body at its end, which falls."""
    bar = _bar()
    model = ff.Model("pendulum")
    model.add(
        bar,
        ff.RigidBody("bob", 0.5, (1e-3, 1e-3, 1e-3), position=(0.5, 0.05, 0.05)),
        ff.Spherical("hinge", ff.Ground((0.0, 0.05, 0.05)), bar.surface_marker("x0")),
        ff.Rigid("bond", bar.surface_marker("x1"), ff.Marker("bob", offset=(-0.1, 0.0, 0.0))),
        ff.Gravity((0.0, 3.0, -9.81)),
        ff.PositionProbe("end", ff.Marker("bob")),
        ff.EnergyProbe("energy"),
        ff.ReactionProbe("force", "hinge"),
    )
    return model


def _run(model: ff.Model, steps: int = 5, **options: Any) -> Any:
    return simulate(
        model, ff.RunOptions(dt=2e-3, t_end=steps * 2e-3, quiet=True, split_above=1, **options)
    )


@pytest.mark.parametrize("matrix", [pytest.param("auto", marks=pytest.mark.three_ranks), "updated"])
def test_motions_forces_and_energies_are_those_with_factors(matrix: str) -> None:
    """Joints, a rigid body beside, and a solid that is split over the ranks."""
    found, exact = (
        _run(_pendulum(), linear_solver=kind, iteration_matrix=matrix, tolerance=1e-9)
        for kind in ("iterative", "direct")
    )
    assert found.summary["linear_iterations"] > found.summary["linear_solves"] > 0
    assert exact.summary["linear_solves"] == 0
    assert found.summary["rejected_steps"] == found.summary["fallbacks"] == 0
    for name, values in exact.history.items():
        size = max(1e-3, float(np.abs(values).max()))
        # solves to 1e-2 would leave 1e-6 of the forces, a response left out far more
        np.testing.assert_allclose(found.history[name], values, rtol=0.0, atol=1e-8 * size)


@pytest.mark.serial
def test_iterations_do_not_grow_with_the_mesh() -> None:
    """Of a cantilever in a step that is so long that its matrix is its stiffness."""
    counts = []
    for mesh in ((4, 1, 1), (8, 2, 2)):
        model = ff.Model("cantilever")
        model.add(_bar(mesh, fixed={"x0": "xyz"}), ff.Gravity((0.0, 0.0, -0.01)))
        options = ff.RunOptions(dt=0.1, t_end=0.1, quiet=True, linear_solver="iterative")
        summary = simulate(model, options).summary
        counts.append(summary["linear_iterations"] / summary["linear_solves"])
    # 25 and 29; 32 and 44 with translations alone near the null space, 84 and 159 without multigrid
    assert counts[1] < 1.3 * counts[0]
    assert counts[1] < 36.0


@pytest.mark.serial
@pytest.mark.parametrize("skew", [0.0, 0.3])
def test_solutions_with_matrices_and_their_transposes(skew: float) -> None:
    """Symmetric ones, and others that conjugate gradients would not solve; of masses and others."""
    n, random = 30, np.random.default_rng(1)
    half = random.standard_normal((n, n))
    dense = half @ half.T / n + np.eye(n) + skew * (half - half.T)
    matrix = PETSc.Mat().createDense((n, n), array=dense, comm=PETSc.COMM_SELF)
    matrix = matrix.convert("aij", PETSc.Mat())
    right, found, counts = random.standard_normal(n), np.zeros(n), SolveCounts()
    factor = KrylovFactor(matrix, np.tile(np.eye(3), n // 3), None, 1e-12, counts)
    for transposed in (False, True):
        factor.solver(right, found, transposed=transposed)()
        own = dense.T if transposed else dense
        np.testing.assert_allclose(found, np.linalg.solve(own, right), atol=1e-10)
    assert (counts.solves, counts.failed) == (2, 0)


@pytest.mark.serial
def test_a_preconditioner_serves_further_matrices_indefinite_ones_too() -> None:
    """Conjugate gradients find a negative direction, and GMRES takes their place."""
    n, random, counts = 40, np.random.default_rng(0), SolveCounts()
    noise = 0.05 * random.standard_normal((n, n))
    first = np.diag(np.where(np.arange(n) % 5 == 0, -1.0, 2.0)) + noise + noise.T
    right, found, factor = random.standard_normal(n), np.zeros(n), None
    for dense in (first, first + 0.01 * np.eye(n), 3.0 * np.eye(n) + noise + noise.T):
        matrix = PETSc.Mat().createDense((n, n), array=dense, comm=PETSc.COMM_SELF)
        matrix = matrix.convert("aij", PETSc.Mat())
        if factor is None:
            factor = KrylovFactor(matrix, None, None, 1e-12, counts)
        else:
            factor.take(matrix, None, None)
        factor.solver(right, found)()
        np.testing.assert_allclose(found, np.linalg.solve(dense, right), atol=1e-10)
    assert (counts.solves, counts.failed, counts.setups) == (3, 0, 1)


@pytest.mark.serial
def test_solves_without_convergence_leave_no_solution() -> None:
    singular = PETSc.Mat().createAIJ((2, 2), comm=PETSc.COMM_SELF)
    singular.setUp()
    for at, value in (((0, 0), 1.0), ((0, 1), -1.0), ((1, 0), -1.0), ((1, 1), 1.0)):
        singular.setValue(*at, value)
    singular.assemble()
    found, counts = np.zeros(2), SolveCounts()
    KrylovFactor(singular, None, None, 1e-12, counts).solver(np.ones(2), found)()
    assert np.isnan(found).all()
    assert counts.failed == 1


@pytest.mark.serial
@pytest.mark.parametrize("first", [np.nan, 1.0])
def test_matrices_that_are_not_finite_fail_and_the_next_ones_are_solved(first: float) -> None:
    n, counts, factor = 30, SolveCounts(), None
    right, found = np.arange(1.0, n + 1.0), np.zeros(n)
    for value in (first, np.inf, 2.0):
        matrix = PETSc.Mat().createDense(
            (n, n), array=np.diag(np.full(n, value)), comm=PETSc.COMM_SELF
        )
        matrix = matrix.convert("aij", PETSc.Mat())
        motions = np.tile(np.eye(3), n // 3)
        if factor is None:
            factor = KrylovFactor(matrix, motions, None, 1e-12, counts)
        else:
            factor.take(matrix, motions, None)
        factor.solver(right, found)()
        np.testing.assert_allclose(found, right / value if np.isfinite(value) else np.nan)
    assert (counts.solves, counts.failed) == (3, 2 if np.isnan(first) else 1)


def test_runs_end_where_solves_do_not_converge(monkeypatch: pytest.MonkeyPatch) -> None:
    solve = KrylovFactor._converges

    def fail(self: KrylovFactor, *arguments: Any) -> bool:
        return solve(self, *arguments) and self._motions is None  # masses alone are solved

    monkeypatch.setattr(KrylovFactor, "_converges", fail)
    monkeypatch.setattr("flexfem.simulation.motion.step_control.HALVINGS", 2)
    model = ff.Model("falling")
    model.add(_bar(), ff.Gravity((0.0, 0.0, -9.81)))
    outcome = _run(model, 1, linear_solver="iterative")
    assert outcome.summary["status"].startswith("the iterative solution of linear equations")
    assert outcome.summary["rejected_steps"] > 0
    assert outcome.summary["steps"] == 0
    assert_on_page(outcome.summary["status"])


@pytest.mark.serial
def test_iterative_solvers_are_refused_where_they_do_not_fit() -> None:
    model = ff.Model("rigid")
    model.add(ff.RigidBody("a", 1.0, (1.0, 1.0, 1.0)))
    with pytest.raises(ValueError, match="linear_solver 'iterative' is for models with") as caught:
        _run(model, linear_solver="iterative")
    assert_on_page(str(caught.value))
    for name, value in (("start", "equilibrium"), ("integrator", "independent_coordinates")):
        with pytest.raises(ValueError, match=f"cannot be used with {name} '{value}'") as caught:
            _run(model, linear_solver="iterative", **{name: value})
        assert_on_page(str(caught.value))


def test_a_solid_on_one_rank_alone() -> None:
    """Another rank, if there is one, has nothing to solve for, and waits."""
    model = ff.Model("falling")
    bar = _bar((4, 1, 1), fixed={"x0": "xyz"})
    model.add(
        bar, ff.Gravity((0.0, 0.0, -9.81)), ff.PositionProbe("p", ff.Marker("bar", (0.4, 0.0, 0.0)))
    )
    found, exact = (
        simulate(model, ff.RunOptions(dt=2e-3, t_end=4e-3, quiet=True, linear_solver=kind))
        for kind in ("iterative", "direct")
    )
    for name, values in exact.history.items():  # of the first rank; the end falls by 1e-4 m
        np.testing.assert_allclose(found.history[name], values, rtol=0.0, atol=1e-11)


@pytest.mark.serial
def test_too_many_multipliers_for_iterative_solvers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("flexfem.solvers.linear.iterative.MOST_MULTIPLIERS", 8)
    with pytest.raises(ValueError, match="at most 8, and the model has 9") as caught:
        _run(_pendulum(), linear_solver="iterative")
    assert_on_page(str(caught.value))
    # left to itself the run takes factors
    assert _run(_pendulum(), 1).summary["linear_solves"] == 0


@pytest.mark.slow_on_ranks
def test_masses_of_large_solids_are_never_factorised(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("flexfem.la.linear_solver._LARGE_MASSES", 100)
    found, exact = _run(_pendulum()), _run(_pendulum(), linear_solver="direct")
    assert found.summary["linear_solves"] > 0
    for name in exact.history:
        size = max(1e-3, float(np.abs(exact.history[name]).max()))
        # accelerations at the start to 1e-2 would leave 1e-5 of the positions
        np.testing.assert_allclose(
            found.history[name], exact.history[name], rtol=0.0, atol=1e-8 * size
        )
