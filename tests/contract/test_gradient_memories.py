# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gradients of motions that carry more than their nodes from step to step."""

from functools import partial

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from tests.contract.test_gradients import compare

#: Numbers of a rope with an elastic branch behind a dashpot.
ROPE = {"stiffness": 20.0, "viscosity": 3.0, "slip": 0.1, "mass": 1.0, "kick": 1.0}


def _pull(t, ends, z, numbers):
    """A spring that stiffens, beside one in series with a dashpot, whose length is the state."""
    stiffness, viscosity = np.moveaxis(numbers, -1, 0)
    z = np.asarray(z).reshape(-1)
    x, v = (a.reshape(-1, 2, 3) for a in (ends.positions, ends.velocities))
    way = x[:, 1] - x[:, 0]
    length = np.linalg.norm(way, axis=1)
    stretch = length - 0.5
    rate = np.einsum("ei,ei->e", way, v[:, 1] - v[:, 0]) / length
    branch = 30.0 * (stretch - z)
    size = stiffness * stretch + 2.0 * stretch**3 + 0.1 * rate + branch
    force = (size / length)[:, np.newaxis] * way
    return np.stack([force, -force], axis=1).reshape(-1, 3), None, (branch / viscosity)


def rope(every, *, stiffness, viscosity, slip, mass, kick) -> ff.Model:
    """Two bodies one below the other, each on such a spring: two elements of one law."""
    first, second = ff.Marker("first", offset=(0.1, 0.0, 0.05)), ff.Marker("second")
    model = ff.Model("rope")

    def law(t, ends, z, numbers):
        forces, moments, rates = _pull(t, ends, z, numbers)
        return forces, moments, rates[:, np.newaxis]

    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.RigidBody(
            "first", mass, (0.01, 0.02, 0.03), position=(0.7, 0.0, 0.0), velocity=(0.0, kick, 0.0),
            angular_velocity=(1.0, 0.3 * kick, 0.0),
        ),
        ff.RigidBody("second", 0.4, (0.01, 0.01, 0.01), position=(1.4, 0.0, 0.0)),
        ff.Force(
            "ropes", [ff.Ground(), first, first, second], law, states=1, initial=[[slip], [0.0]],
            parameters=[stiffness, viscosity], each=2, every=every,
        ),
        ff.PositionProbe("tip", ff.Marker("second", offset=(0.2, 0.1, 0.0))),
    )  # fmt: skip
    return model


STEPS = ff.RunOptions(dt=4e-3, t_end=0.02, tolerance=1e-13)


@pytest.mark.serial
@pytest.mark.parametrize("every", ["iteration", "step"])
def test_states_of_force_elements(every):
    """States that were not carried would leave out 1e-2; with derivatives of Newton's 1e-6."""
    compare(partial(rope, every), ROPE, ["final:tip_x", "mean:tip_z"], STEPS, 1e-8)


@pytest.mark.three_ranks
@pytest.mark.parametrize("build", [partial(rope, "iteration")], ids=["rope"])
def test_ranks_agree(build):
    """A state that two ranks have, counted twice, is a tenth and more."""
    alone, together = (
        ff.gradient(build, "final:tip_z", ROPE, STEPS, accuracy=1e-13, comm=comm, check=True)
        for comm in (MPI.COMM_SELF, MPI.COMM_WORLD)
    )
    # adjoint and tangent are transposes of each other, to rounding
    assert together.check["final:tip_z"] < 1e-12
    for name, value in alone.gradient["final:tip_z"].items():
        assert together.gradient["final:tip_z"][name] == pytest.approx(value, rel=1e-9), name
