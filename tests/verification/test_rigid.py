# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid mechanisms against closed forms and independent computations, with long steps."""

import pytest

from tests.verification.benchmarks import (
    rigid_bricard,
    rigid_four_bars,
    rigid_governor,
    rigid_heavy_top,
    rigid_pendulum,
    rigid_slider_crank,
    rigid_squeezer,
)

pytestmark = pytest.mark.serial

BENCHMARKS = [
    rigid_bricard,
    rigid_four_bars,
    rigid_governor,
    rigid_heavy_top,
    rigid_pendulum,
    rigid_slider_crank,
    rigid_squeezer,
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
    """The steps and spans of the table."""
    for result in benchmark_of.results():
        assert result.error <= result.tolerance, result
