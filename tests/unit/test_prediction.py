# SPDX-License-Identifier: LGPL-3.0-or-later
"""Choice of the prediction of the next step."""

from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest

from flexfem.core.nodes.prediction import Prediction
from flexfem.system.evaluation import largest_misses
from flexfem.system.system import System


@pytest.mark.parametrize(
    ("misses", "chosen"),
    [
        # at rest all are equal up to rounding
        ((1.0, 1.0, 1.0), Prediction.VELOCITY),
        ((1.0, 1.0 + 1e-5, 1.0 - 1e-5), Prediction.VELOCITY),
        ((1.0 - 1e-5, 1.0, 1.0), Prediction.VELOCITY),
        ((0.0, 0.0, 0.0), Prediction.VELOCITY),
        ((3.0, 2.0, 1.0), Prediction.ACCELERATION),
        ((3.0, 1.0, 2.0), Prediction.VELOCITY),
        ((1.0, 3.0, 2.0), Prediction.REST),
    ],
)
def test_the_best_prediction_is_chosen(
    misses: tuple[float, float, float], chosen: Prediction
) -> None:
    """The largest error on any rank counts; velocities decide between equal ones.

    What is to be done while errors travel is done once, on one rank too.
    """
    comm = MPI.COMM_WORLD
    own = misses if comm.rank == comm.size - 1 else (0.0, 0.0, 0.0)
    system = SimpleNamespace(comm=comm)
    done: list[int] = []
    System.choose_prediction(system, own, lambda: done.append(1))  # type: ignore[arg-type]
    assert system.prediction is chosen
    assert done == [1]


def test_the_largest_errors_of_all_blocks_count() -> None:
    """Each kind of prediction has its own block that misses most."""
    misses = np.array([[1.0, 5.0, 0.0], [4.0, 2.0, 0.0], [3.0, 3.0, 6.0]])
    assert largest_misses(misses) == (4.0, 5.0, 6.0)
    assert largest_misses(np.zeros((0, 3))) == (0.0, 0.0, 0.0)
