# SPDX-License-Identifier: LGPL-3.0-or-later
"""State matrices of a linear model as one compressed NumPy file."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from flexfem.io.atomic import raise_together, replace_file

if TYPE_CHECKING:
    from mpi4py import MPI

__all__ = ["write_arrays"]


def write_arrays(path: Path, arrays: Mapping[str, ArrayLike], comm: MPI.Comm) -> None:
    """Write named arrays of numbers or text to an ``npz`` file; rank 0 writes (collective).

    Args:
        path: the file; its folder is created if missing.
        arrays: arrays to write, by name.
        comm: communicator.

    Raises:
        OSError: the file cannot be written (on all ranks).
    """
    error: OSError | None = None
    if comm.rank == 0:
        buffer = io.BytesIO()
        named: dict[str, Any] = {name: np.asarray(a) for name, a in arrays.items()}
        np.savez_compressed(buffer, **named)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            replace_file(path, [buffer.getvalue()])
        except OSError as exc:
            error = exc
    raise_together(comm, error)
