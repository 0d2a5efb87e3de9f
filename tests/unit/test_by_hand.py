# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cell kernels written by hand."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from flexfem.kernels.by_hand import by_hand
from flexfem.kernels.driver import NO_NODES, cell_kernel, evaluate, plain_cells

# kernels of one process; those of shells and beams are tested on all ranks
pytestmark = pytest.mark.serial


@by_hand
def spring(tensor, coefficients, constants, coordinates):
    """Force and energy of a spring, by a row of work space."""
    coefficients[1] = constants[0] - coordinates[0]
    tensor[0] += coefficients[0] * coefficients[1]
    tensor[1] += 0.5 * coefficients[0] * coefficients[1] ** 2


@by_hand
def broken(tensor, coefficients, constants, coordinates):
    """Cannot raise an error that anyone would hear of."""
    tensor[0] = 1.0
    if constants[0] > 0.0:
        raise ValueError("too much")


def values(kernel, size, constants):
    own = {"stiffness": (0, 1)}
    call = cell_kernel(kernel, size, ["stiffness", "work"], {}, own)
    cells = plain_cells(np.array([[2.0], [3.0]]), corners=np.array([[0.5], [1.0]]))
    found = np.empty((2, size))
    evaluate(call.memory, cells.memory, NO_NODES, constants, found)
    return found


def test_driver_calls_a_kernel_written_by_hand():
    kernel = spring.kernel([1, 1])
    assert kernel.offsets.tolist() == [0, 1, 2]
    assert kernel.lanes == 1
    np.testing.assert_array_equal(values(kernel, 2, np.array([2.0])), [[3.0, 2.25], [3.0, 1.5]])


def test_an_error_in_a_kernel_shows_in_its_results():
    assert values(broken.kernel([1]), 1, np.array([0.0])).tolist() == [[1.0], [1.0]]
    assert np.isnan(values(broken.kernel([1]), 1, np.array([1.0]))).all()


def test_kernels_are_out_of_date_with_their_own_file():
    assert Path(spring.address._cache._impl.locator._py_file) == Path(__file__)


def test_kernels_of_one_name_are_told_apart():
    """A factory would give all its kernels one file on disk."""

    def spring(tensor, coefficients, constants, coordinates):
        tensor[0] += coefficients[0]

    with pytest.raises(TypeError, match="not a function of a module"):
        by_hand(spring)


@pytest.mark.slow
def test_kernels_are_kept_on_disk(tmp_path):
    """The second process compiles nothing."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    script = (
        "from tests.unit.test_by_hand import spring\n"
        "spring.kernel([1, 1])\n"
        "print(sum(spring.address.stats.cache_misses.values()))"
    )
    command = [sys.executable, "-c", script]
    found = [
        int(
            subprocess.run(
                command, env=environment, capture_output=True, text=True, check=True
            ).stdout
        )
        for _ in range(2)
    ]
    assert found == [1, 0]
