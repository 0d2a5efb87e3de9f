# SPDX-License-Identifier: LGPL-3.0-or-later
"""Iterations of the flexible slider-crank on NURBS beams."""

import pytest

from tests.verification.benchmarks.flexible_slider_crank import PUBLISHED, run

pytestmark = pytest.mark.serial
#: the long ones with the table
SLOW = [pytest.mark.slow, pytest.mark.benchmark]


@pytest.mark.parametrize(
    ("h", "matrix"),
    [pytest.param(h, matrix, marks=SLOW if h < 5e-4 else []) for h, matrix in PUBLISHED],
)
def test_not_above_the_published_number(h, matrix):
    """And what is frozen is factorised once."""
    summary, _ = run(h, matrix)
    assert summary["newton_iterations"] <= PUBLISHED[h, matrix]
    if matrix == "frozen":
        assert summary["factorizations"] == 1
