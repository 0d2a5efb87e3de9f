# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gradients of motions whose steps differ: between kinks of loads, and adaptive ones."""

from functools import partial

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from tests.contract.gradient_examples import NUMBERS, body
from tests.contract.test_gradients import differences


def pushed(kind, times=(0.0013, 0.0041), **numbers):
    """A body with a force that has kinks within steps, which it is cut at."""
    model, bob = body(kind, **numbers), ff.Marker("bob")
    force = ff.Table([0.0, *times, 1.0], [0.0, 1.0, 0.3, 0.3])
    model.add(ff.PointForce("push", bob, (0.0, 3.0, 40.0), amplitude=force))
    return model


def compare(build, numbers, of, options, accuracy, step=1e-3):
    """Adjoint, tangent, and differences of motions that end with Newton steps of 1e-13."""
    found = ff.gradient(build, of, numbers, options, accuracy=1e-13, check=True)
    own = np.array([[by[name] for name in numbers] for by in found.gradient.values()])
    # a lead of accelerations that is left out, or put to another state, gives 1e-5 and more
    assert max(found.check.values()) < 1e-12
    expected = differences(build, numbers, of, options, step)
    values = np.array(list(numbers.values()))
    scale = np.abs(expected * values).max(axis=1, keepdims=True)
    # the same; coefficients of a whole step in one of its parts give 1e-2
    assert (np.abs(own - expected) * values / scale).max() < accuracy
    return found


@pytest.mark.serial
@pytest.mark.parametrize("kind", ["se3", "damped"])
def test_kinks_of_loads_within_steps(kind):
    options = ff.RunOptions(dt=1e-3, t_end=6e-3, tolerance=1e-13)
    of = ["final:tip_z", "mean:speed"]
    found = compare(partial(pushed, kind), NUMBERS, of, options, 1e-8)
    # four sizes of parts, whose factors the motion does not keep
    assert found.factorizations_backward <= 4


@pytest.mark.serial
def test_adaptive_steps():
    """Histories of adaptive motions have all steps; those of the differences are the same ones."""
    options = ff.RunOptions(
        dt=4e-3, t_end=12e-3, tolerance=1e-13, adaptive=True, error_tolerance=1e-5
    )
    of = ["final:tip_z", "mean:speed"]
    found = compare(partial(body, "se3"), NUMBERS, of, options, 1e-8, step=1e-4)
    assert len(np.unique(np.diff(found.history["t"]).round(9))) > 1
    assert found.factorizations_backward == 0


@pytest.mark.three_ranks
def test_ranks_agree_on_parts_of_steps():
    """All ranks together find what each finds by itself, and with states computed again."""
    options = ff.RunOptions(dt=1e-3, t_end=5e-3, tolerance=1e-13, split_above=1)
    build = partial(pushed, "se3")
    alone = ff.gradient(
        build, "mean:tip_z", NUMBERS, options, accuracy=1e-13, comm=MPI.COMM_SELF
    ).gradient["mean:tip_z"]
    for memory in (2e9, 3e4):
        found = ff.gradient(build, "mean:tip_z", NUMBERS, options, accuracy=1e-13, memory=memory)
        for name, value in alone.items():
            # a share that is missing, or a part that is taken again with another size, is 1e-3
            assert found.gradient["mean:tip_z"][name] == pytest.approx(value, rel=1e-9)
