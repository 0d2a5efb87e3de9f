# SPDX-License-Identifier: LGPL-3.0-or-later
"""Columns of a history for the plots of a page."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexfem.io.tables.history import history_columns, read_history
from flexfem.io.tables.history_files import history_file
from flexfem.io.view.packing import Pack

__all__ = ["store_history"]

type FloatArray = NDArray[np.float64]

#: Rows of a plot: more than any screen has pixels.
_ROWS = 4000
#: Columns beyond which the first ones are kept.
_COLUMNS = 500


def store_history(pack: Pack, folder: Path) -> tuple[dict[str, Any] | None, list[str]]:
    """Keep the columns of a folder's table; None without one, and notes about what is left out.

    Raises:
        ValueError: the table is damaged.
    """
    path = history_file(folder)
    if path is None:
        return None, []
    every = history_columns(path)
    names, notes = [name for name in every if name != "t"], []
    if len(names) > _COLUMNS:
        notes.append(f"the first {_COLUMNS} of {len(names)} columns of {path.name} are shown")
        names = names[:_COLUMNS]
    if "t" not in every or not names:
        return None, []
    table = read_history(path, ["t", *names])
    if not len(table["t"]):
        return None, []
    t, values = table["t"], np.column_stack([table[name] for name in names])
    if len(t) > _ROWS:
        size = -(-len(t) // (_ROWS // 2))
        notes.append(f"plots show the least and greatest value of every {size} rows of {path.name}")
        t, values = _envelope(t, values, size)
    with np.errstate(over="ignore"):
        single = values.T.astype(np.float32)
    return {"names": names, "t": pack.store(t), "values": pack.store(single)}, notes


def _envelope(t: FloatArray, values: FloatArray, size: int) -> tuple[FloatArray, FloatArray]:
    """Least and greatest value of every column in groups of rows, as they rise or fall."""
    starts = np.arange(0, len(t), size)
    low = np.minimum.reduceat(values, starts)
    high = np.maximum.reduceat(values, starts)
    times = np.stack([t[starts], t[np.minimum(starts + size // 2, len(t) - 1)]], 1).reshape(-1)
    first, last = values[starts], values[np.minimum(starts + size, len(t)) - 1]
    pair = np.where((last >= first)[:, None], np.stack([low, high], 1), np.stack([high, low], 1))
    return times, pair.reshape(-1, values.shape[1])
