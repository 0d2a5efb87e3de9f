# SPDX-License-Identifier: LGPL-3.0-or-later
"""Series of a result folder, and the instants of them that a page shows."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flexfem._checks import InputError
from flexfem.io.tables.history_files import history_file
from flexfem.io.vtu.reader import Grid, Instant, read_index, read_pieces

__all__ = ["SERIES", "Series", "evenly", "find_series"]

#: Series of the package, what lies in front last.
SERIES = (
    "contact_surfaces", "rigid_bodies", "solids", "shells", "floating_bodies", "floating_lines",
    "energy_solids", "energy_triangles", "energy_lines", "cable_nets", "beam_surfaces",
    "beams", "cables", "joints", "reactions",
)  # fmt: skip
#: Begin of the names of series of curved cells, whose surfaces are in ``solids``.
CURVED = "solid_cells_"
#: Series of other names, as scripts write them, that are shown at most.
_OTHERS = 50
#: Instants of a run beyond which an index must be something else.
_MOST = 10_000_000


@dataclass(frozen=True)
class Series:
    """One series of a folder.

    Attributes:
        name: of the series.
        instants: those in its index, in order of time.
    """

    name: str
    instants: Sequence[Instant]

    def at(self, time: float) -> Path:
        """File of an instant, of the one before where the series has none at this time."""
        number = bisect_right(self.instants, time, key=lambda instant: instant.time)
        return self.instants[max(number - 1, 0)].file

    def grids(self, time: float, wanted: Sequence[str] | None = None) -> list[Grid]:
        """Cells of all ranks at a time."""
        return read_pieces(self.at(time), wanted)


def find_series(folder: Path) -> tuple[list[Series], np.ndarray]:
    """Series of a folder, and the times (s) at which any of them has an instant.

    Raises:
        InputError: it is no folder of results, or an index is damaged.
    """
    if not folder.is_dir():
        raise InputError(f"{folder}: there is no such folder")
    names = {path.stem for path in folder.glob("*.pvd")} - {*SERIES}
    others = sorted(name for name in names if not name.startswith(CURVED))[:_OTHERS]
    there = {name: folder / f"{name}.pvd" for name in (*others, *SERIES)}
    indices = {name: read_index(path, name) for name, path in there.items() if path.exists()}
    series = [Series(name, instants) for name, instants in indices.items() if instants]
    if not series:
        reason = _reason(folder)
        raise InputError(
            f"{folder}: nothing to show, {reason} (no {SERIES[1]}.pvd, {SERIES[10]}.pvd, ...)"
        )
    times = np.unique([one.time for each in series for one in each.instants])
    if len(times) > _MOST:
        raise InputError(
            f"{folder}: its series have {len(times)} instants, at most {_MOST} are read"
        )
    return series, times


def _reason(folder: Path) -> str:
    """Why a folder has no series."""
    if (folder / "mode_01").is_dir():
        return "its modes are in folders of their own, mode_01, ..."
    known = history_file(folder) is not None or (folder / "summary.json").exists()
    return "the run wrote no fields" if known else "it is not a folder of results"


def evenly(times: np.ndarray, count: int) -> np.ndarray:
    """At most so many of some times, the first and the last among them."""
    if len(times) <= count:
        return times
    chosen = np.unique(np.linspace(0, len(times) - 1, max(count, 2)).round().astype(int))
    kept: np.ndarray = times[chosen]
    return kept
