"""Acceleration of an iteration by its own last steps."""

import numpy as np
import pytest

from flexfem.solvers.frozen.secants import Secants

pytestmark = pytest.mark.serial


class Vectors:
    """Steps of one block, on one rank."""

    def __init__(self, size):
        self.step = np.zeros(size)

    def collect(self, correction):
        return np.concatenate([self.step, -correction])

    def put(self, solution):
        self.step = solution[: len(self.step)]
        return solution[len(self.step) :]

    def squares(self, *vectors):
        return np.array([v[: len(self.step)] @ v[: len(self.step)] for v in vectors])

    def gram(self, rows):
        return rows[:, : len(self.step)] @ rows[:, : len(self.step)].T


def iterations(rates, accelerated):
    """Iterations for steps of 1e-12 that leave the parts ``rates`` of the errors, and rows."""
    vectors, error, row = Vectors(len(rates)), np.ones(len(rates)), 1.0
    secants = Secants(vectors)
    for k in range(200):
        vectors.step, correction = (1.0 - rates) * error, np.array([-row + 0.5 * error[0]])
        if accelerated:
            correction = secants.improve(correction)
        error, row = error - vectors.step, row + correction[0]
        if np.abs(vectors.step).max() < 1e-12:
            return k, abs(row)
    return k, abs(row)


def test_few_slow_directions_are_found():
    """And the multipliers of rows follow."""
    slow = np.concatenate([[0.8, 0.6], np.full(20, 1e-3)])
    plain, fast = iterations(slow, False), iterations(slow, True)
    assert plain[0] > 100
    # two for the slow directions and some until they are alone; without them as above
    assert fast[0] < 15
    assert fast[1] < 1e-10


def test_fast_iterations_are_left_alone():
    rates = np.linspace(0.0, 0.1, 10)
    assert iterations(rates, True) == iterations(rates, False)
