# SPDX-License-Identifier: LGPL-3.0-or-later
"""Modes of rotating models are counted, so that one that was not found is named."""

import dataclasses

from mpi4py import MPI

import numpy as np
import pytest
import scipy.linalg

import flexfem as ff
from tests.unit.refusals import assert_on_page
from tests.verification.test_modes import _rotor

FIELDS = ("values", "vectors", "zero", "errors", "noise")


@pytest.fixture
def sparse(monkeypatch):
    """The iteration, also for problems that are small enough to be solved densely."""
    from flexfem.solvers.modal import modes as solver

    monkeypatch.setattr(solver, "_DENSE_FOR_MANY", 0)
    monkeypatch.setattr(solver, "_DENSE", 0)
    return solver


def _reduced(linearization):
    """K, C and M of free motions."""
    from flexfem.la.dense import gather_rows

    given, n = linearization.matrices(), linearization.unknowns
    K, C, M = (gather_rows(m) for m in (given.stiffness, given.damping, given.mass))
    free = scipy.linalg.null_space(K[n:, :n])
    return [free.T @ matrix[:n, :n] @ free for matrix in (K, C, M)]


@pytest.mark.serial
@pytest.mark.parametrize(("spin", "backward"), [(5.0, 0), (20.0, 1)])
def test_negative_pivots_are_modes_by_the_sign_of_their_energy(spin, backward):
    """N(b) - N(a) of the Hermitian matrix against LAPACK's eigenvalues and their energies."""
    from flexfem.solvers.modal.mode_count import gyroscopic_count
    from flexfem.solvers.modal.pencil import Pencil

    outcome = ff.find_modes(_rotor(elements=3), ff.ModeOptions(modes=1, spin=spin, quiet=True))
    pencil = Pencil.of(outcome.modes.linearization)
    assert pencil.gyroscopic
    assert pencil.symmetric
    K, C, M = _reduced(pencil.linearization)
    n, eye = len(K), np.eye(len(K))
    values, vectors = scipy.linalg.eig(
        np.block([[0 * eye, eye], [-K, -C]]), scipy.linalg.block_diag(eye, M)
    )
    upper = np.flatnonzero(values.imag > 0.0)
    assert len(upper) == n  # all of them oscillate
    omega, u = values.imag[upper], vectors[:n, upper]
    k, m = (np.einsum("ik,ij,jk->k", u.conj(), A, u).real for A in (K, M))
    energy = np.sign(k + omega**2 * m)
    # above the critical speed the forward whirl takes energy away: a count without signs is two off
    assert np.sum(energy < 0.0) == backward
    edges = np.sort(omega)
    start = gyroscopic_count(pencil, 0.1 * edges[0])
    assert start == 2 * backward
    for end in 0.5 * (edges[1:9] + edges[:8]):
        expected = energy[omega < end].sum()
        assert gyroscopic_count(pencil, end) - start == expected
        matrix = K - end**2 * M + 1j * end * C
        assert gyroscopic_count(pencil, end) == np.sum(np.linalg.eigvalsh(matrix) < 0.0)


@pytest.mark.parametrize(("spin", "target"), [
    pytest.param(5.0, 0.0, marks=pytest.mark.serial),
    (20.0, 0.0),
    pytest.param(5.0, 6.0, marks=pytest.mark.serial),
])  # fmt: skip
def test_lost_modes_of_rotors_are_named(spin, target, sparse, monkeypatch):
    """Below a critical speed and above it, where a mode of negative energy may be the lost one."""
    if target:
        monkeypatch.setattr("flexfem.la.whole.LARGEST", 0)  # as if it were large: ranks share it
    options = ff.ModeOptions(modes=4, spin=spin, target=target, split_above=1, quiet=True)
    whole = ff.find_modes(_rotor(elements=4), options)
    assert whole.status == "ok"
    checks = whole.summary["checks"]
    assert (checks["missing"], checks["not_counted"]) == (0, None)
    solve = sparse._solve
    for lost in (0, 2) if MPI.COMM_WORLD.size == 1 else (2,):

        def forgetful(*arguments, lost=lost):
            found = solve(*arguments)
            kept = np.arange(len(found.values)) != lost
            return dataclasses.replace(found, **{f: getattr(found, f)[kept] for f in FIELDS})

        monkeypatch.setattr(sparse, "_solve", forgetful)
        outcome = ff.find_modes(_rotor(elements=4), options)
        # residuals of the others are as small as ever: nothing else would tell
        assert outcome.status.startswith("1 modes in the range of the 4 found were missed; ")
        assert_on_page(outcome.status)


@pytest.mark.serial
@pytest.mark.parametrize(("damping", "target", "why"), [
    (2e-4, 0.0, "damping"),
    # the forward whirl of negative energy may be anywhere
    (0.0, 6.0, "the stiffness is not positive"),
])  # fmt: skip
def test_why_modes_are_not_counted(damping, target, why, sparse):
    options = ff.ModeOptions(modes=4, spin=20.0, target=target, quiet=True)
    outcome = ff.find_modes(_rotor(damping, 4), options)
    assert outcome.status == "ok"
    assert outcome.summary["checks"]["missing"] is None
    assert outcome.summary["checks"]["not_counted"] == outcome.modes.uncounted == why
