# SPDX-License-Identifier: LGPL-3.0-or-later
"""Histories of runs on all ranks: the first one alone has them."""

from collections.abc import Mapping
from typing import Any

from mpi4py import MPI

import numpy as np


def columns(outcome: Any) -> Mapping[str, np.ndarray]:
    """History of a run that ended well, on every rank (collective)."""
    assert outcome.status == "ok"
    found: Mapping[str, np.ndarray] = MPI.COMM_WORLD.bcast(outcome.history)
    return found
