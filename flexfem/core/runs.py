# SPDX-License-Identifier: LGPL-3.0-or-later
"""Runs of entries that lie one after the other in one array."""

from collections.abc import Sequence

import numpy as np

from flexfem._types import IntArray

__all__ = ["starts"]


def starts(counts: Sequence[int] | IntArray) -> IntArray:
    """Return the first entry of each of several consecutive runs, and the end of the last.

    Args:
        counts: (n,) lengths of the runs.

    Returns:
        (n + 1,) first entries.
    """
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
