# SPDX-License-Identifier: LGPL-3.0-or-later
"""Factors of the multipliers' system that serve several steps."""

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem.solvers.linear import kept_factors, multiplier_system
from flexfem.solvers.linear.kept_factors import KeptFactors, with_kept_factors
from flexfem.solvers.linear.multiplier_system import InterfaceSystem
from tests.unit.test_rank_costs import net

NOTHING = np.zeros(0, dtype=np.int64)


@pytest.fixture
def eager(monkeypatch: pytest.MonkeyPatch) -> None:
    """Keep factors of small systems, too."""
    monkeypatch.setattr(kept_factors, "_SMALL", 0.0)
    monkeypatch.setattr(kept_factors, "_LEAST", 0.0)
    monkeypatch.setattr(kept_factors, "_FASTER", 1e-3)


@pytest.mark.serial
@pytest.mark.usefixtures("eager")
def test_solutions_are_those_of_the_present_values(rng: np.random.Generator) -> None:
    """Old factors serve while values change little, and are renewed when they change much."""
    matrix = rng.normal(size=(70, 70)) + 30.0 * np.eye(70)
    i, j = np.indices(matrix.shape).reshape(2, -1)
    comm = MPI.COMM_SELF
    system = InterfaceSystem(comm, i, j, 70, NOTHING, NOTHING)
    kept = with_kept_factors(comm, system, i, j)
    assert isinstance(kept, KeptFactors)
    for factor, renewals in ((1.0, 1), (1.01, 1), (1.02, 1), (9.0, 2)):
        present = matrix * (1.0 + (factor - 1.0) * rng.random(matrix.shape))
        assert kept.factor(present.ravel(), True)
        right = rng.normal(size=70)
        x = right.copy()
        kept.solve(x)
        expected = np.linalg.solve(present, right)
        # solutions with the first values are off by 1e-2
        np.testing.assert_allclose(x, expected, rtol=0.0, atol=1e-7 * np.abs(expected).max())
        assert kept.renewals == renewals
    assert kept.factor(present.ravel(), True)
    assert kept.factor(np.zeros(matrix.size), True)
    x = np.ones(70)
    kept.solve(x)
    assert np.isnan(x).all()  # singular values


@pytest.mark.serial
@pytest.mark.usefixtures("eager")
def test_old_factors_are_tried_less_often_while_they_fail(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After 1, 3, 7, 15 other values, and for all again once they have served."""
    i, j = np.indices((70, 70)).reshape(2, -1)
    system = InterfaceSystem(MPI.COMM_SELF, i, j, 70, NOTHING, NOTHING)
    kept = with_kept_factors(MPI.COMM_SELF, system, i, j)
    solves: list[int] = []
    solve = InterfaceSystem.solve
    monkeypatch.setattr(
        InterfaceSystem, "solve", lambda self, right: solves.append(1) or solve(self, right)
    )
    tried = []
    for step in range(34):
        values = rng.normal(size=(70, 70)) + 30.0 * np.eye(70)
        present = values if step < 16 else np.eye(70)
        assert kept.factor(present.ravel(), True)
        solves.clear()
        kept.solve(np.ones(70))
        tried.append(len(solves) > 1)  # new factors take one solve
    # without pauses all but the first are tried, in vain
    assert np.flatnonzero(tried).tolist() == [1, 3, 7, 15, 31, 32, 33]


@pytest.mark.serial
def test_factors_are_renewed_when_that_costs_least(rng: np.random.Generator) -> None:
    """Values drift, so that old factors take more and more solves: the best time to renew them."""
    matrix, drift = rng.normal(size=(2, 70, 70))
    matrix += 30.0 * np.eye(70)
    i, j = np.indices(matrix.shape).reshape(2, -1)
    system = InterfaceSystem(MPI.COMM_SELF, i, j, 70, NOTHING, NOTHING)
    steps, worth = 60, 8.0

    def further_solves(worth: float) -> tuple[list[int], int]:
        """Solves for each of the values beyond one, and the number of factorisations."""
        kept, more = KeptFactors(MPI.COMM_SELF, system, i, j, worth), []
        for step in range(steps):
            assert kept.factor((matrix + 0.006 * step * drift).ravel(), True)
            kept.solve(np.ones(70))
            more.append(kept._more)
        return more, kept.renewals

    alone, renewals = further_solves(np.inf)
    assert renewals == 1
    assert max(alone) >= worth
    best = min((worth + sum(alone[:n])) / n for n in range(1, steps))
    more, renewals = further_solves(worth)
    # kept until a single one takes as long as a factorisation they cost 1.5 times the best
    assert (worth * renewals + sum(more)) / steps < 1.2 * best


@pytest.mark.three_ranks
@pytest.mark.usefixtures("eager")
def test_a_net_moves_as_with_new_factors(monkeypatch: pytest.MonkeyPatch) -> None:
    """With a factorisation of the multipliers' system in less than every fifth step."""
    monkeypatch.setattr(multiplier_system, "_WIDEST", 0)  # fronts, as in large nets
    calls: list[int] = []
    factor = InterfaceSystem.factor_and_solve
    monkeypatch.setattr(
        InterfaceSystem,
        "factor_and_solve",
        lambda self, *args: calls.append(1) or factor(self, *args),
    )
    found, counts = [], []
    for least in (0.0, np.inf):
        monkeypatch.setattr(kept_factors, "_LEAST", least)
        calls.clear()
        model = net(3)
        model.add(ff.PositionProbe("far", ff.Marker("x_2_3", "end")))
        found.append(ff.simulate(model, ff.RunOptions(dt=1e-3, t_end=0.03, quiet=True)).history)
        counts.append(len(calls))
    assert counts[0] < 0.2 * 30 < 30 <= counts[1]
    for name in found[0]:
        # solves that take the old values are off by 1e-6, the tolerance of the iteration
        np.testing.assert_allclose(found[0][name], found[1][name], rtol=0.0, atol=1e-9)
