# SPDX-License-Identifier: LGPL-3.0-or-later
"""Dampings of dynamic relaxation on single vibrations, whose motion is known, and together."""

import numpy as np
import pytest

from flexfem.solvers.relaxation.damping import DAMPINGS, Accelerated, Motion
from flexfem.solvers.relaxation.kernels import SUMS, drive, measure

pytestmark = pytest.mark.serial


def relax(name: str, stiffness: np.ndarray, steps: int, memory: float = 0.0) -> np.ndarray:
    """Displacements after each step of masses 1 on springs, from 1."""
    damping = DAMPINGS[name]()
    damping.memory = [memory, 0.0]
    inverse = np.ones((len(stiffness), 1))
    x, v, before = np.ones_like(inverse), np.zeros_like(inverse), np.zeros_like(inverse)
    residual, step, sums = np.zeros((len(x), 6)), np.zeros((len(x), 6)), np.zeros(SUMS)
    path = np.empty((steps + 1, len(x)))
    path[0] = 1.0
    for k in range(steps):
        residual[:, 0] = stiffness * x[:, 0]
        if k == 0:
            before[:] = residual[:, :1]
        sums[:] = 0.0
        measure(residual, before, v, inverse, sums)
        factors = damping.factors(Motion(energy=0.5 * sums[1], uphill=sums[4]))
        drive(residual, before, inverse, *factors, v, step)
        x += v
        path[k + 1] = x[:, 0]
    return path


@pytest.mark.parametrize("name", list(DAMPINGS))
def test_steps_are_stable_up_to_the_limit(name: str) -> None:
    # momentum that has grown for long is the worst; restarts and peaks would hide what is unstable
    damping = DAMPINGS[name]()
    limit = damping.stable
    for factor, grows in ((0.98, False), (1.02, True)):
        keep, smooth, push = (1.0, 0.5, 1.0) if name == "accelerated" else (1.0, 0.0, 1.0)
        # eigenvalues of the map from two displacements to the next ones
        own = 1.0 + keep - (push + smooth) * factor * limit
        roots = np.roots([1.0, -own, keep - smooth * factor * limit])
        # a limit that is off by 2 % is found: masses would be too small, or needlessly large
        assert (np.abs(roots).max() > 1.0 + 1e-9) == grows, name


def test_factors_with_much_momentum_are_those_of_the_limit() -> None:
    damping = Accelerated()
    damping.memory = [1e9, 0.0]
    keep, smooth, push = damping.factors(Motion(energy=1.0, uphill=-1.0))
    # a part of the change of forces other than that behind the limit makes steps unstable
    assert (push + 2.0 * smooth) * damping.stable == pytest.approx(2.0 * (1.0 + keep), rel=1e-6)


def test_quick_vibrations_die_while_slow_motions_go_on() -> None:
    path = relax("accelerated", np.array([0.5, 1e-6]), 60, memory=1e3)
    # without the damping of changes of the force, as in viscous damping of the slow one: 0.9
    assert np.abs(path[-10:, 0]).max() < 1e-3
    slow = relax("viscous", np.array([0.5, 1e-6]), 60, memory=1e-6)
    assert np.abs(slow[-10:, 0]).max() > 0.5
    assert path[-1, 1] > 0.99


def test_momentum_is_dropped_uphill() -> None:
    damping = Accelerated()
    for _ in range(5):
        keep, _, _ = damping.factors(Motion(energy=1.0, uphill=-1.0))
    assert keep > 0.5
    # one contact that closes may not cost all momentum: a slow slide would never gather any
    assert damping.factors(Motion(energy=1.0, uphill=1.0))[0] > keep
    damping.factors(Motion(energy=1.0, uphill=1.0))
    # momentum that is kept climbs on, and rests at no minimum for long
    assert damping.factors(Motion(energy=1.0, uphill=1.0)) == (0.0, 0.0, 1.0)


def test_steps_grow_with_the_root_of_the_condition() -> None:
    counts = []
    for condition in (1e2, 1e4):
        stiffness = np.geomspace(1.0 / condition, 1.0, 20)
        path = relax("accelerated", stiffness, 4000)
        force = np.linalg.norm(stiffness * path, axis=1)
        counts.append(int(np.flatnonzero(force > 1e-6 * force[0])[-1]))
    # plain gradient steps: 1.4e3 and 1.4e5
    assert counts[0] < 300
    assert counts[1] < 3000


@pytest.mark.parametrize("stiffness", [1e-3, 1e-4])
def test_viscous_damping_is_critical(stiffness: float) -> None:
    """Steps of the vibration at hand take ``exp(-sqrt(stiffness))`` each, with equal roots."""
    damping = DAMPINGS["viscous"]()
    damping.learn(stiffness)
    keep, smooth, push = damping.factors(Motion(energy=1.0, uphill=-1.0))
    assert smooth == 0.0
    rates = -np.log(np.abs(np.roots([1.0, push * stiffness - 1.0 - keep, keep])))
    # steps of the size of the period add 3 %; half of the damping takes half, twice of it both
    # less and more
    np.testing.assert_allclose(rates, stiffness**0.5, rtol=0.04)
    # a constant force drives on with the force by the damping
    assert push / (1.0 - keep) == pytest.approx(0.5 * stiffness**-0.5, rel=1e-12)
