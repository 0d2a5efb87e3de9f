# SPDX-License-Identifier: LGPL-3.0-or-later
"""The tests' own fixtures, which every parallel test leans on."""

from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest


@pytest.mark.three_ranks
def test_all_ranks_share_one_folder(shared_tmp_path: Path) -> None:
    comm = MPI.COMM_WORLD
    (shared_tmp_path / str(comm.rank)).touch()
    comm.Barrier()
    names = {path.name for path in shared_tmp_path.iterdir()}
    assert names == {str(rank) for rank in range(comm.size)}


@pytest.mark.three_ranks
def test_all_ranks_draw_the_same_numbers(rng: np.random.Generator) -> None:
    numbers = rng.random(3)
    assert all(np.array_equal(numbers, other) for other in MPI.COMM_WORLD.allgather(numbers))
