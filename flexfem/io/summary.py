# SPDX-License-Identifier: LGPL-3.0-or-later
"""Summary of a run as JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flexfem._files import read_text
from flexfem.io.atomic import replace_file

if TYPE_CHECKING:
    from mpi4py import MPI


#: Bytes of a file beyond which it must be something else.
_LARGEST = 64_000_000


def write_summary(path: Path, data: Mapping[str, Any], comm: MPI.Comm | None = None) -> None:
    """Write a summary, replacing an earlier one as a whole.

    Keys are sorted; NaN and infinity become null; NumPy scalars and arrays become numbers and
    lists; paths become strings.

    Args:
        path: The file; its folder is created if missing.
        data: Nested mappings, sequences, numbers, strings, None.
        comm: Communicator of which only rank 0 writes; None means that the caller sees to that.

    Raises:
        TypeError: If a value cannot be written.
        OSError: If the file cannot be written.
    """
    if comm is not None and comm.rank != 0:
        return
    text = json.dumps(_plain(data, "summary"), indent=2, sort_keys=True, allow_nan=False)
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    replace_file(path, [text.encode(), b"\n"])


def read_summary(path: Path) -> dict[str, Any]:
    """Read a summary.

    Raises:
        ValueError: If the file cannot be read, or is none.
    """
    owner = f"summary '{path}'"
    text = read_text(owner, path, _LARGEST)
    try:
        found = json.loads(text)
    except ValueError as error:  # no JSON, or a number of thousands of digits
        raise ValueError(f"{owner}: {error}") from None
    except RecursionError:
        found = None
    if not isinstance(found, dict):
        raise ValueError(f"{owner}: it is no object of JSON")
    return found


def remove_summary(path: Path, comm: MPI.Comm) -> None:
    """Remove the summary of an earlier run, which a killed run would leave in place; rank 0."""
    if comm.rank == 0:
        Path(path).unlink(missing_ok=True)


def _plain(value: Any, where: str) -> Any:
    if isinstance(value, Mapping):
        return {str(k): _plain(v, f"{where}.{k}") for k, v in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist(), where)
    if isinstance(value, list | tuple):
        return [_plain(v, where) for v in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"{where}: a {type(value).__name__} cannot be written to a summary")
