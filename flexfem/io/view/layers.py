# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a page draws of each series, and what it keeps of every instant.

A layer is made of the grids of the first instant, gets those of all others by ``add``, and is
stored by ``store``, which describes it for ``web/layers.js``. Two kinds of surfaces are drawn:
those of vertices that are fixed in moving frames (sections of beams in the frames of nodes, rigid
bodies, obstacles, joints), and those whose points all move for themselves. Besides there are lines
between such points and arrows at them.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexfem._checks import InputError
from flexfem.io.scene_file import SceneFile
from flexfem.io.view.fields import column, columns, store_field, unit
from flexfem.io.view.motion import Anchors, store_points
from flexfem.io.view.normals import shade, triangulated
from flexfem.io.view.packing import Pack
from flexfem.io.view.shapes import Deforming, Framed
from flexfem.io.vtu.reader import Grid

__all__ = [
    "CableLayer",
    "ChangedShapeError",
    "Layer",
    "MeshLayer",
    "ReactionLayer",
    "RigidLayer",
    "joined",
]

type FloatArray = NDArray[np.floating[Any]]
type IntArray = NDArray[np.integer[Any]]
type Description = dict[str, Any]

_LINE = 3  # type of the cells of lines


class ChangedShapeError(Exception):
    """A surface that should move rigidly does not; its points must be kept one by one."""


def joined(grids: Sequence[Grid]) -> Grid:
    """The cells of all ranks as one grid."""
    if len(grids) == 1:
        return grids[0]
    start = np.cumsum([0, *(len(grid.points) for grid in grids)])
    first = grids[0]
    same = {grid.kind for grid in grids} == {first.kind}
    if not same or any(grid.components != first.components for grid in grids):
        raise InputError("pieces of ranks have different arrays")
    try:
        points = _together([grid.point_data for grid in grids])
        values = _together([grid.cell_data for grid in grids])
    except (KeyError, ValueError):
        raise InputError("pieces of ranks have different arrays") from None
    cells = np.concatenate([grid.cells + at for grid, at in zip(grids, start, strict=False)])
    x = np.concatenate([grid.points for grid in grids])
    return Grid(x, cells, first.kind, points, values, first.components)


def _together(parts: Sequence[Mapping[str, NDArray[Any]]]) -> dict[str, NDArray[Any]]:
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


class Layer(ABC):
    """What a page draws of one series.

    Attributes:
        series: its name.
        scene: names of bodies, joints and sections.
        wanted: names of the fields to keep.
    """

    def __init__(self, series: str, scene: SceneFile, wanted: Sequence[str], first: Grid) -> None:
        """Keep what does not change; ``add`` gets the first instant as well."""
        self.series, self.scene, self._shape = series, scene, first
        self._fields = [one for one in columns(first) if one[0] in wanted]
        self._values: list[list[NDArray[Any]]] = [[] for _ in self._fields]

    def add(self, grid: Grid) -> None:
        """Keep an instant.

        Raises:
            InputError: its cells are not those of the first one.
            ChangedShapeError: See there.
        """
        if not np.array_equal(grid.cells, self._shape.cells) or len(grid.points) != len(
            self._shape.points
        ):
            raise InputError(
                f"series '{self.series}': its cells change with time, which no page shows"
            )
        self._add(grid)
        for (_, where, array, component), kept in zip(self._fields, self._values, strict=True):
            data = grid.cell_data if where == "cell" else grid.point_data
            kept.append(column(data, array, component).astype(np.float32))

    @abstractmethod
    def _add(self, grid: Grid) -> None:
        """Keep the motion."""

    @abstractmethod
    def store(self, pack: Pack) -> list[Description]:
        """Keep everything, and describe what is drawn."""

    def _stored_fields(self, pack: Pack) -> list[Description]:
        return [
            {"name": name, "of": where, "unit": unit(self.series, name), **store_field(pack, kept)}
            for (name, where, _, _), kept in zip(self._fields, self._values, strict=True)
        ]

    def _names(self, numbers: IntArray) -> tuple[IntArray, list[str]]:
        """Numbers (n,) into a list of names, and this list."""
        found, index = np.unique(numbers, return_inverse=True)
        return index.astype(np.uint32), [self.scene.body(self.series, int(k)) for k in found]


class RigidLayer(Layer):
    """Surfaces that move rigidly, each with the frame that three of its points give.

    Rigid bodies, obstacles (``contact_surfaces``), and joints with the rods between their markers.
    """

    def __init__(self, series: str, scene: SceneFile, first: Grid) -> None:
        """Divide the surface into its parts."""
        super().__init__(series, scene, (), first)
        number = first.cell_data.get("joint" if series == "joints" else "body")
        if number is None or first.cells.shape[1] != 3:
            raise ChangedShapeError
        cells, points = self._without_rods(first, number)
        self._cells, self._used = first.cells[:cells], slice(points)
        if not len(self._cells) or self._cells.max() >= points:
            raise ChangedShapeError
        self._numbers, self._of_cell = np.unique(number[:cells], return_inverse=True)
        part = np.full(points, -1)
        part[self._cells] = self._of_cell[:, None]
        if np.any(part < 0):
            raise ChangedShapeError
        self._part = part
        self._anchors = Anchors(first.points[:points], part, len(self._numbers))
        if self._anchors.flat:
            raise ChangedShapeError
        self._start = first.points[:points]
        self._places: list[FloatArray] = []
        self._turns: list[FloatArray] = []
        self._ends: list[FloatArray] = []

    def _without_rods(self, first: Grid, number: IntArray) -> tuple[int, int]:
        """Counts of cells and points without those of rods, boxes at the end in order of joints."""
        self._rods = 0
        if self.series == "joints":
            rods = len(np.unique(number))
            body = len(number) - 12 * rods
            if body > 0 and len(first.points) > 8 * rods and np.array_equal(
                np.unique(number[body:]), np.unique(number[:body])
            ):  # fmt: skip
                self._rods = rods
        return len(number) - 12 * self._rods, len(first.points) - 8 * self._rods

    def _add(self, grid: Grid) -> None:
        points = grid.points[self._used]
        place, turn = self._anchors.frames(points)
        if not self._anchors.fit(points, place, turn):
            raise ChangedShapeError
        self._places.append(place)
        self._turns.append(turn)
        if self._rods:
            rods = grid.points[-8 * self._rods :].reshape(self._rods, 4, 2, 3)
            self._ends.append(rods.mean(axis=1).reshape(-1, 3))

    def store(self, pack: Pack) -> list[Description]:
        """See :class:`Layer`."""
        named = [self.scene.joint(int(k)) for k in self._numbers]
        kinds = [kind for kind, _ in named] if self.series == "joints" else []
        own = {"series": self.series, **self.framed().store(pack), "kinds": kinds, "fields": []}
        return [own, *self._stored_rods(pack)]

    def framed(self) -> Framed:
        """The surface and its motion."""
        shaded = shade(self._start, self._cells)
        part, local = self._part[shaded.point], self._anchors.local[shaded.point]
        numbers = [int(k) for k in self._numbers]
        joints = self.series == "joints"
        names = [
            self.scene.joint(k)[1] if joints else self.scene.body(self.series, k) for k in numbers
        ]
        return Framed(
            local, shaded.normal, part, part, shaded.triangles, self._places, self._turns,
            np.arange(len(numbers)), names,
        )  # fmt: skip

    def _stored_rods(self, pack: Pack) -> list[Description]:
        """Lines between the markers of joints, unless they are always at one place."""
        if not self._rods:
            return []
        ends = np.array(self._ends).reshape(len(self._ends), self._rods, 2, 3)
        length = np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2).max(axis=0)
        shown = length > 1e-6 * float(np.ptp(ends.reshape(-1, 3), axis=0).max(initial=0.0))
        if not shown.any():
            return []
        numbers = self._shape.cell_data["joint"][-12 * self._rods :: 12][shown]
        named = [self.scene.joint(int(k)) for k in numbers]
        count = len(named)
        return [{
            "series": "joint_rods", "kind": "lines", "fields": [],
            "names": [name for _, name in named], "kinds": [kind for kind, _ in named],
            "bodies": pack.store(np.arange(count, dtype=np.uint32)),
            "cells": pack.store(np.arange(2 * count, dtype=np.uint32).reshape(-1, 2)),
            "motion": store_points(pack, list(ends[:, shown].reshape(len(ends), -1, 3))),
        }]  # fmt: skip


class MeshLayer(Layer):
    """Surfaces and lines whose points move for themselves."""

    def __init__(self, series: str, scene: SceneFile, wanted: Sequence[str], first: Grid) -> None:
        """Choose cells and points: of solids, those on the outside."""
        super().__init__(series, scene, wanted, first)
        self._about = first.points.mean(axis=0)
        self._places: list[FloatArray] = []
        self._cells, self._owner = _drawn(first)
        self._points, inverse = np.unique(self._cells, return_inverse=True)
        self._cells = inverse.reshape(self._cells.shape)
        self._source: IntArray = np.arange(len(self._points))
        if first.kind != _LINE:  # corners on sharp edges have several normals
            shaded = shade(first.points[self._points], self._cells)
            self._cells, self._source = shaded.triangles, shaded.point

    def _add(self, grid: Grid) -> None:
        self._places.append((grid.points[self._points] - self._about).astype(np.float32))

    def store(self, pack: Pack) -> list[Description]:
        """See :class:`Layer`."""
        cells, position = np.unique(self._owner, return_inverse=True)
        for (_, where, _, _), kept in zip(self._fields, self._values, strict=True):
            chosen = cells if where == "cell" else self._points
            kept[:] = [values[chosen] for values in kept]
        return [{
            "series": self.series, "kind": "lines" if self._cells.shape[1] == 2 else "points",
            "cells": pack.store(self._cells.astype(np.uint32)),
            "cell": pack.store(position.astype(np.uint32)), **self._owners(pack, cells),
            "source": pack.store(self._source.astype(np.uint32)),
            "motion": store_points(pack, self._places, self._about),
            "fields": self._stored_fields(pack),
        }]  # fmt: skip

    def deforming(self) -> Deforming:
        """What is drawn, and its motion."""
        cells, position = np.unique(self._owner, return_inverse=True)
        bodies, names, _ = self._named(cells)
        return Deforming(
            self._about, self._places, self._source, self._cells, position, bodies, names
        )

    def _owners(self, pack: Pack, cells: IntArray) -> Description:
        """Names of the joints or bodies that cells belong to, for a page."""
        bodies, names, kinds = self._named(cells)
        return {"bodies": pack.store(bodies), "names": names, "kinds": kinds}

    def _named(self, cells: IntArray) -> tuple[IntArray, list[str], list[str]]:
        """Numbers (n,) of cells' joints or bodies, and names and kinds of these."""
        data = self._shape.cell_data
        number = data.get("joint", data.get("body", np.zeros(len(self._shape.cells), np.int32)))
        bodies, names = self._names(number[cells])
        kinds: list[str] = []
        if "joint" in data:
            named = [self.scene.joint(int(k)) for k in np.unique(number[cells])]
            kinds, names = [kind for kind, _ in named], [name for _, name in named]
        return bodies, names, kinds


class CableLayer(MeshLayer):
    """Cables in the order of their numbers: a restart on other ranks writes them in another."""

    def __init__(self, series: str, scene: SceneFile, wanted: Sequence[str], first: Grid) -> None:
        """Order the first instant."""
        super().__init__(series, scene, wanted, _by_joint(first))

    def add(self, grid: Grid) -> None:
        """See :class:`Layer`."""
        super().add(_by_joint(grid))


class ReactionLayer(Layer):
    """Arrows of forces and moments at joints."""

    def __init__(self, series: str, scene: SceneFile, first: Grid) -> None:
        """Keep the numbers of the joints."""
        super().__init__(series, scene, (), first)
        self._joint = first.point_data.get("joint", np.arange(len(first.points)))
        self._places: list[FloatArray] = []
        self._vectors: dict[str, list[FloatArray]] = {
            name: [] for name in ("force", "moment") if name in first.point_data
        }

    def _add(self, grid: Grid) -> None:
        self._places.append(grid.points)
        for name, kept in self._vectors.items():
            kept.append(grid.point_data[name].astype(np.float32))

    def store(self, pack: Pack) -> list[Description]:
        """See :class:`Layer`."""
        named = [self.scene.joint(int(k)) for k in self._joint]
        shown = {name: store_points(pack, kept) for name, kept in self._vectors.items()}
        return [{
            "series": self.series, "kind": "arrows", "names": [name for _, name in named],
            "kinds": [kind for kind, _ in named], "motion": store_points(pack, self._places),
            "vectors": shown, "fields": [],
        }]  # fmt: skip


def _by_joint(grid: Grid) -> Grid:
    """A grid with its cells and points in the order of the joints that they belong to."""
    joint = grid.cell_data["joint"]
    of_point = np.zeros(len(grid.points), dtype=joint.dtype)
    of_point[grid.cells] = joint[:, None]
    points, cells = np.argsort(of_point, kind="stable"), np.argsort(joint, kind="stable")
    return replace(
        grid, points=grid.points[points], cells=np.argsort(points)[grid.cells[cells]],
        point_data={name: values[points] for name, values in grid.point_data.items()},
        cell_data={name: values[cells] for name, values in grid.cell_data.items()},
    )  # fmt: skip


def _drawn(grid: Grid) -> tuple[IntArray, IntArray]:
    """Lines or triangles (m, k) that show the cells of a grid, and the cell of each."""
    if grid.kind == _LINE:
        return grid.cells, np.arange(len(grid.cells))
    if grid.cells.shape[1] == 4 and grid.kind == 10:
        return _outside(grid.cells)
    return triangulated(grid.cells)


def _outside(cells: IntArray) -> tuple[IntArray, IntArray]:
    """Faces of tetrahedra that belong to one of them only, seen from outside."""
    faces = np.concatenate(
        [cells[:, [0, 2, 1]], cells[:, [0, 1, 3]], cells[:, [1, 2, 3]], cells[:, [0, 3, 2]]]
    )
    owner = np.tile(np.arange(len(cells)), 4)
    _, index, count = np.unique(
        np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True
    )
    chosen = index[count == 1]
    return faces[chosen], owner[chosen]
