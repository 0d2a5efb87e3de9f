# SPDX-License-Identifier: LGPL-3.0-or-later
"""The beam on a moving base is the same on one rank and on all of them."""

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem import research
from flexfem.research.equations.run.simulate import simulate_equations

COMM = MPI.COMM_WORLD


@pytest.mark.three_ranks
@pytest.mark.parametrize("theory", ["consistent", "conventional"])
def test_history_is_that_of_one_rank(theory: str) -> None:
    still = research.constant_angle(0.0)
    base = research.manipulator_base(still, research.spin_up_angle(), still, link_1=0.0)
    source = research.MovingBaseBeam(
        properties=research.outboard_link(), base=base, effects=research.effects_of(theory),
        modes=5, elements=6, damping_ratio=0.01, displacement={"u2": 0.1}, velocity={"theta1": 0.1},
    )  # fmt: skip
    options = ff.RunOptions(dt=0.02, t_end=0.5, quiet=True)
    alone = simulate_equations(source, options, comm=MPI.COMM_SELF).history
    together = simulate_equations(source, options, comm=COMM).history
    for name in together:  # on the first rank
        size = np.abs(alone[name]).max()
        # modes whose signs ranks choose by themselves would be as large as the history
        assert np.abs(together[name] - alone[name]).max() <= 1e-9 * size
    assert bool(together) == (COMM.rank == 0)
