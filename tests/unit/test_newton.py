# SPDX-License-Identifier: LGPL-3.0-or-later
"""Newton iteration: when it ends."""

from itertools import zip_longest
from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest

from flexfem.core.status import Status
from flexfem.solvers.newton.iteration import NewtonOptions, _largest, iterate
from flexfem.system.moving_apart import Moved
from flexfem.system.system import Shifts


def _end(*sizes: float, parts: tuple[float, ...] = ()) -> tuple[Status, int]:
    """Status after steps of given sizes, of which contacts let parts pass, and their number."""
    steps = iter([Moved(*step) for step in zip_longest(sizes, parts, fillvalue=1.0)])
    system = SimpleNamespace(
        comm=MPI.COMM_SELF,
        counters=SimpleNamespace(newton_iterations=0),
        contacts=(),
        linear=SimpleNamespace(counts=SimpleNamespace(failed=0)),
        constraints=SimpleNamespace(multipliers=np.zeros(0)),
        accepted_strains=lambda **_: (),
        continued_strains=lambda **_: (),
    )
    equations = SimpleNamespace(
        evaluate=lambda system, shifts: None,
        correct=lambda system, again: next(steps),
    )
    options = NewtonOptions(tolerance=1e-6, max_iterations=len(sizes))
    shifts = Shifts(1.0, 1.0, 1.0, 1.0, False)
    status = iterate(
        system, shifts, lambda *_: (True, np.zeros(0)), options, equations=equations
    )  # fmt: skip
    return status, system.counters.newton_iterations


@pytest.mark.serial
@pytest.mark.parametrize(
    ("sizes", "expected"),
    [
        ((1e-2, 1e-4, 1e-8), (Status.OK, 3)),
        ((1e-3, 3e-3, 9e-3, 1.0), (Status.DIVERGED, 3)),
        # a first step may be small by chance
        ((1e-5, 1e-3, 1e-4, 1e-8), (Status.OK, 4)),
        # a step that was solved for badly is small, and the next one larger, but not than both
        ((1e-3, 1e-4, 1e-3, 1e-5, 1e-8), (Status.OK, 5)),
        ((1e-3, 1e-4, 3e-3, 1.0), (Status.DIVERGED, 3)),
        # round-off near the tolerance grows and falls
        ((1e-3, 2e-6, 2e-6, 8e-6, 1e-7), (Status.OK, 5)),
        ((1e-3, 9e-4, 8e-4), (Status.NOT_CONVERGED, 3)),
        ((1e-3, np.nan, 1.0), (Status.DIVERGED, 2)),
    ],
)
def test_sizes_of_steps_decide(sizes, expected):
    assert _end(*sizes) == expected


@pytest.mark.serial
@pytest.mark.parametrize(
    ("sizes", "parts", "expected"),
    [
        # wild ones, as of a shell that snaps through in too large a step: contacts alone hold it,
        # and without an end the rest of the iterations would be spent on them
        ((0.1, 12.0, 70.0, 1e3), (1.0, 0.02, 0.01, 1e-4), (Status.DIVERGED, 3)),
        ((0.1, 3.0, 2.0, 2.0), (1.0, 0.1, 0.1, 0.1), (Status.DIVERGED, 3)),
        # one is what a contact that closes makes
        ((1e-4, 3e-3, 2e-4, 1e-8), (1.0, 0.6, 1.0, 1.0), (Status.OK, 4)),
        # long ones from the start are cut until the contact pushes
        ((0.1, 0.1, 0.2, 1e-4, 1e-8), (0.1, 0.1, 0.3, 1.0, 1.0), (Status.OK, 5)),
        # a part of a small correction is not the solution
        ((1e-3, 1e-8, 1e-9), (1.0, 0.5, 1.0), (Status.OK, 3)),
    ],
)
def test_corrections_that_contacts_cut_short(sizes, parts, expected):
    assert _end(*sizes, parts=parts) == expected


@pytest.mark.three_ranks
@pytest.mark.parametrize("size", [np.inf, np.nan])
def test_steps_that_are_no_numbers_on_one_rank(size):
    comm = MPI.COMM_WORLD
    last = comm.rank == comm.size - 1
    found = _largest(comm, Moved(1.0), np.array([size if last else 2.0]), True, False)
    # the largest number instead of infinity would be a step that ends no iteration
    assert found[0] == 1.0
    assert not np.isfinite(found[1])
