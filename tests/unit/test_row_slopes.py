# SPDX-License-Identifier: LGPL-3.0-or-later
"""Derivatives of functions of rows: those of each row as precise as that row allows."""

import numpy as np
import pytest

from flexfem.core.differences import ENOUGH, SUITS, slopes_of_rows

pytestmark = pytest.mark.serial


def test_rows_at_and_near_a_kink() -> None:
    """Rows far from a kink have exact derivatives, and one at it says that it has none."""
    x = np.array([[3.0, 1.0], [2e-5, 1.0], [5e-9, 1.0]])
    slopes, missed, changes = slopes_of_rows(
        lambda rows: np.abs(rows[:, 0]) + rows[:, 1] ** 3, x, np.array([1.0, 1.0])
    )
    # one step for all rows, as long as the first one allows, crosses the kink of the second one
    np.testing.assert_allclose(slopes[:2], [[1.0, 3.0]] * 2, rtol=1e-6)
    assert (missed[:2] <= SUITS * changes[:2]).all()
    assert missed[2] > ENOUGH * changes[2]


def test_sizes_of_numbers() -> None:
    """Numbers of very different sizes change by parts of their own."""
    x = np.array([[1e-8, 1e6]])
    slopes, _, _ = slopes_of_rows(
        lambda rows: np.abs(rows[:, 0]) * rows[:, 1] ** 2, x, np.array([1e-8, 1e6])
    )
    # steps of the larger number, or its thousandth, would cross the kink of the other one
    np.testing.assert_allclose(slopes, [[1e12, 2e-2]], rtol=1e-6)
