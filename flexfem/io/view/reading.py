# SPDX-License-Identifier: LGPL-3.0-or-later
"""Reading a result folder: what is shown of it, and the layers that show it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flexfem._checks import InputError, show
from flexfem.io.scene_file import SceneFile
from flexfem.io.view.beams import ARRAYS, RESULTANTS, STRESSES, BeamLayer
from flexfem.io.view.fields import SMALL, USUAL, columns
from flexfem.io.view.instants import Series, evenly, find_series
from flexfem.io.view.layers import (
    CableLayer,
    ChangedShapeError,
    Layer,
    MeshLayer,
    ReactionLayer,
    RigidLayer,
    joined,
)
from flexfem.io.vtu.reader import Grid

__all__ = ["Choice", "Motion", "read_motion"]

#: Bytes of motions and fields before they are deflated: what a page takes by default, and at most.
_ROOM, _MOST_ROOM = 150e6, 2e9
#: Places beyond which nothing is drawn, m.
_FAR = 1e30
#: Instants by default; there are frames between them, too.
_FRAMES = 600
#: Instants below which fields are left out rather than instants.
_FEW = 150
#: Series without colours.
_PLAIN = ("rigid_bodies", "contact_surfaces", "joints", "reactions")
#: Fields that are kept on request only.
_ON_REQUEST = ("gamma", "kappa", "2kappa", "eps", "angular_velocity", "thickness")


@dataclass(frozen=True)
class Choice:
    """What a page shall show.

    Attributes:
        frames: number of instants at most; None for what keeps the file small.
        fields: names of fields, or "all" or "none"; None for the usual ones.
    """

    frames: int | None = None
    fields: Sequence[str] | None = None

    def __post_init__(self) -> None:
        """Check the number."""
        if self.frames is not None and not 1 <= self.frames <= 100_000:
            raise InputError(f"frames must be from 1 to 100000, got {self.frames}")


@dataclass(frozen=True)
class Motion:
    """What is shown of a result folder.

    Attributes:
        layers: of all series, with all instants.
        times: (n,) of the instants, s.
        instants: number of those in the files.
        notes: what is left out, and how to choose.
    """

    layers: Sequence[Layer]
    times: np.ndarray
    instants: int
    notes: Sequence[str]


def read_motion(folder: Path, choice: Choice) -> Motion:
    """Read the series of a result folder.

    Raises:
        InputError: it has nothing to show, or a file is damaged.
    """
    # what is not finite, or not in single precision, is shown as missing
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        series, times = find_series(folder)
        reading = _Reading(folder, series, choice)
        chosen, notes = reading.choose(times)
        layers, kept = reading.read(chosen)
    if len(kept) < len(chosen):
        lost = min(set(chosen.tolist()) - set(kept))
        count = len(chosen) - len(kept)
        notes.append(f"{count} instants without finite positions are left out, from {lost:g} on")
    return Motion(layers, np.array(kept), len(times), notes)


class _Reading:
    """How the series of a folder become layers."""

    def __init__(self, folder: Path, series: Sequence[Series], choice: Choice) -> None:
        """Look at the first instants."""
        self._folder, self._choice, self._scene = folder, choice, SceneFile.of(folder)
        self._series = {one.name: one for one in series}
        self._first = {one.name: joined(one.grids(one.instants[0].time)) for one in series}
        self._swept = {"section", "e1"} <= self._arrays("beams") and bool(self._scene.sections)
        if self._swept:
            self._series.pop("beam_surfaces", None)
        self._notes = []
        for name in [name for name in self._series if name != "reactions"]:
            if self._first[name].cells.shape[1] == 1:
                del self._series[name]
                self._notes.append(f"points without cells are not drawn: {name}")
        for name, grid in self._first.items():
            if not _drawable(grid):
                raise InputError(
                    f"{folder}: positions in {name} are not finite at the first instant"
                )
        self._loose: set[str] = set()  # series that should move rigidly and do not

    def _arrays(self, name: str) -> set[str]:
        grid = self._first.get(name)
        return set() if grid is None else {*grid.point_data, *grid.cell_data}

    def choose(self, times: np.ndarray) -> tuple[np.ndarray, list[str]]:
        """Times of the instants, and notes about what is left out; sets the fields."""
        notes = self._notes
        most = _MOST_ROOM if self._choice.frames else _ROOM
        count = self._choice.frames or min(len(times), _FRAMES)
        self._fields = self._with_resultants(self._wanted())
        if self._choice.fields is None and self._size() * min(count, _FEW) > most:
            usual = [name for name in USUAL if name in self._fields]
            while len(usual) > 1 and self._size(self._with_resultants(usual)) * _FEW > most:
                usual.pop()
            small = [name for name in SMALL if name in self._fields]
            kept = self._with_resultants([*usual, *small])
            left = [name for name in self._fields if name not in kept]
            self._fields = kept
            notes.append(
                f"left out to keep the file small: {', '.join(left)} (--fields A,B chooses)"
            )
        room = max(2, int(most / max(self._size(), 1)))
        if self._choice.frames and room < min(self._choice.frames, len(times)):
            raise InputError(
                f"{self._folder}: {self._choice.frames} instants are more than a browser holds; "
                f"ask for at most {room}, or for fewer fields"
            )
        chosen = evenly(times, min(count, room))
        if len(chosen) < len(times):
            notes.append(f"{len(chosen)} of {len(times)} instants are shown (--frames N chooses)")
        return chosen, notes

    def _wanted(self) -> list[str]:
        walls = [wall for ends in self._scene.sections for end in ends for wall in end]
        stressed = any(wall.stress is not None for wall in walls)
        shown = [self._first[name] for name in self._series if name not in _PLAIN]
        written = {name for grid in shown for name, *_ in columns(grid)}
        computed = STRESSES if self._swept and stressed and {*RESULTANTS} <= written else ()
        known = sorted(written | {*computed})
        asked = self._choice.fields
        if asked is None:
            return [name for name in known if not name.startswith(_ON_REQUEST)]
        if list(asked) in (["all"], ["none"]):
            return known if asked[0] == "all" else []
        for name in asked:
            if name not in known:
                raise InputError(
                    f"{self._folder}: no field {show(name)}; there are {', '.join(known)}"
                )
        return list(asked)

    def _with_resultants(self, fields: Sequence[str]) -> list[str]:
        """Fields with those from which a page computes stresses of beams."""
        there = "resultant" in self._arrays("beams")
        needed = RESULTANTS if self._swept and there and {*STRESSES} & {*fields} else ()
        return [*fields, *(name for name in needed if name not in fields)]

    def _size(self, fields: Sequence[str] | None = None) -> float:
        """Bytes of an instant, about."""
        total, kept = 0.0, self._fields if fields is None else fields
        for name in self._series:
            grid = self._first[name]
            rigid = name in _PLAIN and name not in self._loose
            total += 200.0 if rigid else len(grid.points) * (14.0 if name == "beams" else 6.0)
            for field, where, *_ in columns(grid):
                if field in kept and not rigid:
                    total += 2.0 * (len(grid.cells) if where == "cell" else len(grid.points))
        return total

    def read(self, times: np.ndarray) -> tuple[list[Layer], list[float]]:
        """Layers with their instants, and the times of these; those not finite are left out."""
        while True:
            layers = {name: self._layer(name) for name in self._series}
            kept = []
            try:
                for time in times.tolist():
                    if self._read_instant(layers, time):
                        kept.append(time)
                return list(layers.values()), kept
            except _LooseError as error:
                self._loose.add(error.series)

    def _read_instant(self, layers: Mapping[str, Layer], time: float) -> bool:
        grids = {name: joined(one.grids(time)) for name, one in self._series.items()}
        if not all(map(_drawable, grids.values())):
            return False
        for name, layer in layers.items():
            try:
                layer.add(grids[name])
            except ChangedShapeError:
                raise _LooseError(name) from None
            except KeyError as error:
                raise InputError(f"{self._folder}: {name} has no {error} at t = {time:g}") from None
        return True

    def _layer(self, name: str) -> Layer:
        first = self._first[name]
        if name == "beams" and self._swept:
            missing = set(ARRAYS) - self._arrays(name)
            if missing:
                raise InputError(f"{self._folder}: {name} has no {', '.join(sorted(missing))}")
            return BeamLayer(name, self._scene, self._fields, first)
        if name == "reactions":
            return ReactionLayer(name, self._scene, first)
        if name == "cables" and "joint" in first.cell_data:
            return CableLayer(name, self._scene, self._fields, first)
        if name in _PLAIN and name not in self._loose:
            try:
                return RigidLayer(name, self._scene, first)
            except ChangedShapeError:
                self._loose.add(name)
        return MeshLayer(name, self._scene, self._fields, first)


def _drawable(grid: Grid) -> bool:
    """True if all positions are numbers that single precision holds."""
    return bool(np.all(np.abs(grid.points) < _FAR))


class _LooseError(Exception):
    """A series that should move rigidly does not."""

    def __init__(self, series: str) -> None:
        super().__init__(series)
        self.series = series
