# SPDX-License-Identifier: LGPL-3.0-or-later
"""Motions of flexible bodies against independent computations, on coarse meshes."""

import pytest

from tests.verification.benchmarks import (
    flexible_elbow,
    flexible_four_bars,
    flexible_lateral_buckling,
    flexible_shaft,
    flexible_spaghetti,
    flexible_spin_up,
)

pytestmark = pytest.mark.serial

BENCHMARKS = [
    flexible_elbow,
    flexible_four_bars,
    flexible_lateral_buckling,
    flexible_shaft,
    flexible_spaghetti,
    flexible_spin_up,
]
NAMES = [module.__name__.rsplit(".", 1)[-1] for module in BENCHMARKS]


@pytest.mark.parametrize("benchmark_of", BENCHMARKS, ids=NAMES)
def test_within_tolerance(benchmark_of):
    # what each tolerance tells apart is said where it is set
    for result in benchmark_of.results(full=False):
        assert result.error <= result.tolerance, result


@pytest.mark.slow
@pytest.mark.benchmark
@pytest.mark.parametrize("benchmark_of", BENCHMARKS, ids=NAMES)
def test_table(benchmark_of):
    """The meshes, steps and spans of the table."""
    for result in benchmark_of.results():
        assert result.error <= result.tolerance, result
