# SPDX-License-Identifier: LGPL-3.0-or-later
"""Beams as lines and as solid-looking surfaces for ParaView."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexfem.io.vtu_series import VtuSeries

if TYPE_CHECKING:
    from mpi4py import MPI

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

STRAINS = ("gamma1", "gamma2", "gamma3", "kappa1", "kappa2", "kappa3")
RESULTANTS = ("N", "Q2", "Q3", "T", "M2", "M3")
COMPONENTS = {"strain": STRAINS, "resultant": RESULTANTS}


@dataclass(frozen=True)
class BeamFields:
    """This rank's beam cells and their nodes at one instant; arrays may have no rows.

    Attributes:
        position: Node positions (n, 3), inertial, m.
        displacement: Node displacements (n, 3), inertial, m.
        rotation: Section frames (n, 3, 3), columns e1, e2, e3 in inertial axes.
        velocity: Node velocities (n, 3), inertial, m/s.
        angular_velocity: Angular velocities (n, 3), inertial, rad/s.
        cells: Node numbers (m, 2), in the direction of e1.
        body: Body number of each cell (m,).
        strain: Extension, two shears, twist, two curvatures (m, 6), 1 and 1/m.
        resultant: N, Q2, Q3 in N, T, M2, M3 in N m (m, 6).
        section: Number of each cell's outline (m,).
    """

    position: FloatArray
    displacement: FloatArray
    rotation: FloatArray
    velocity: FloatArray
    angular_velocity: FloatArray
    cells: IntArray
    body: IntArray
    strain: FloatArray
    resultant: FloatArray
    section: IntArray

    def __post_init__(self) -> None:
        """Check the shapes."""
        n, m = len(self.position), len(self.cells)
        shapes: dict[str, tuple[int, ...]] = {f.name: (n, 3) for f in fields(self)}
        shapes |= {"rotation": (n, 3, 3), "cells": (m, 2), "body": (m,), "section": (m,)}
        shapes |= {"strain": (m, 6), "resultant": (m, 6)}
        for name, shape in shapes.items():
            found = np.shape(getattr(self, name))
            if found != shape:
                raise ValueError(f"BeamFields '{name}': shape {found}, expected {shape}")

    @classmethod
    def joined(cls, several: Sequence[BeamFields]) -> BeamFields:
        """Fields of several groups of beams, none of which may be given."""
        if len(several) < 2:
            return several[0] if several else cls.empty()
        first = np.cumsum([0, *(len(one.position) for one in several)])
        values = {
            f.name: np.concatenate([getattr(one, f.name) for one in several]) for f in fields(cls)
        }
        cells = [one.cells + at for one, at in zip(several, first, strict=False)]
        return cls(**{**values, "cells": np.concatenate(cells)})

    @classmethod
    def empty(cls) -> BeamFields:
        """Fields of a rank without beams."""
        v, s, i = np.zeros((0, 3)), np.zeros((0, 6)), np.zeros(0, dtype=np.int64)
        cells = np.zeros((0, 2), dtype=np.int64)
        return cls(v, v, np.zeros((0, 3, 3)), v, v, cells, i, s, s, i)


class BeamWriter:
    """Series ``beams`` (lines) and ``beam_surfaces`` (outlines swept along the deformed beams)."""

    def __init__(
        self,
        folder: Path,
        comm: MPI.Comm,
        outlines: Sequence[ArrayLike | None],
        *,
        caps: bool = True,
        resume: float | None = None,
    ) -> None:
        """Declare the two series; nothing is written yet.

        Args:
            folder: Result folder.
            comm: Communicator; `write` and `close` are collective.
            outlines: Closed polygon (k, 2) of each section in the (e2, e3) plane in m; None for a
                section that is shown as a line only.
            caps: Whether the ends of the swept surfaces are closed (convex outlines).
            resume: Keep the instants of an earlier run up to this time (s).
        """
        self._outlines = [None if o is None else _polygon(o, i) for i, o in enumerate(outlines)]
        self._caps = caps
        self._lines = VtuSeries(folder, "beams", comm, components=COMPONENTS, resume=resume)
        self._skins = VtuSeries(folder, "beam_surfaces", comm, components=COMPONENTS, resume=resume)
        self._skin: _Skin | None = None

    def write(self, time: float, step: int, beams: BeamFields) -> None:
        """Write both series at one instant; collective.

        Args:
            time: Time in s.
            step: Step number.
            beams: This rank's part.
        """
        # Single precision now: the surfaces repeat these values for every corner of an outline.
        single = np.float32
        cell_data = {
            "body": beams.body.astype(np.int32),
            "strain": beams.strain.astype(single),
            "resultant": beams.resultant.astype(single),
            "bending_moment": np.hypot(*beams.resultant[:, 4:].T).astype(single),
        }
        point_data: dict[str, NDArray[Any]] = {
            "displacement": beams.displacement.astype(single),
            "velocity": beams.velocity.astype(single),
            "angular_velocity": beams.angular_velocity.astype(single),
        }
        frames: dict[str, NDArray[Any]] = {f"e{i + 1}": beams.rotation[:, :, i] for i in range(3)}
        self._lines.write(
            time, step, beams.position, beams.cells, "line", point_data | frames, cell_data
        )
        if self._skin is None or not self._skin.fits(beams):
            self._skin = _Skin(beams, self._outlines, self._caps)
        skin = self._skin
        self._skins.write(
            time,
            step,
            skin.points(beams),
            skin.quads,
            "quad",
            {k: point_data[k].take(skin.node, axis=0) for k in ("displacement", "velocity")},
            {k: v.take(skin.cell, axis=0) for k, v in cell_data.items() if k != "strain"},
        )

    def close(self) -> None:
        """End both series; collective."""
        self._lines.close()
        self._skins.close()


class _Skin:
    """Topology of the swept outlines: cells of one section share the ring of a common node."""

    def __init__(
        self, beams: BeamFields, outlines: Sequence[FloatArray | None], caps: bool
    ) -> None:
        self._key = (beams.cells.copy(), beams.section.copy())
        # Sections with outlines of as many corners are treated together: models may have as many
        # sections as beams.
        corners = np.array([0 if o is None else len(o) for o in outlines], dtype=np.int64)
        nodes, offsets = [np.zeros(0, np.int64)], [np.zeros((0, 2))]
        quads, owners = [np.zeros((0, 4), np.int64)], [np.zeros(0, np.int64)]
        start = 0
        per_cell = corners[beams.section] if len(beams.section) else np.zeros(0, np.int64)
        for k in sorted(set(per_cell.tolist()) - {0}):
            cells = np.flatnonzero(per_cell == k)
            section = beams.section[cells]
            key = beams.cells[cells] * len(outlines) + section[:, None]
            rings, inverse = np.unique(key, return_inverse=True)
            ends = inverse.reshape(-1, 2)
            same = [
                o if len_k == k and o is not None else np.zeros((k, 2))
                for o, len_k in zip(outlines, corners, strict=True)
            ]
            table = np.stack(same)
            nodes.append(np.repeat(rings // len(outlines), k))
            offsets.append(table[rings % len(outlines)].reshape(-1, 2))
            faces, owner = _sweep(ends, k, caps)
            quads.append(faces + start)
            owners.append(cells[owner])
            start += len(rings) * k
        self.node, self.cell = np.concatenate(nodes), np.concatenate(owners)
        self.quads, self._offset = np.concatenate(quads), np.concatenate(offsets)

    def fits(self, beams: BeamFields) -> bool:
        """Whether the topology belongs to these cells."""
        cells, section = self._key
        return np.array_equal(cells, beams.cells) and np.array_equal(section, beams.section)

    def points(self, beams: BeamFields) -> FloatArray:
        """Corners of all rings (p, 3) in the deformed state."""
        x: FloatArray = beams.position.take(self.node, axis=0)
        for i in (1, 2):
            axis = beams.rotation[:, :, i].take(self.node, axis=0)
            axis *= self._offset[:, i - 1 : i]
            x += axis
        return x


def _sweep(ends: IntArray, k: int, caps: bool) -> tuple[IntArray, IntArray]:
    """Quads between the rings (m, 2) of each cell, and the cell of each quad."""
    m = len(ends)
    first, last = ends[:, :1] * k, ends[:, 1:] * k
    j = np.arange(k)
    nxt = (j + 1) % k
    sides = np.stack([first + j, first + nxt, last + nxt, last + j], axis=2).reshape(-1, 4)
    owner = np.repeat(np.arange(m), k)
    if not caps:
        return sides, owner
    # A convex polygon is cut into a ladder of quads (the last one is a triangle when k is odd).
    i = np.arange((k - 1) // 2)
    ladder = np.stack([i, i + 1, np.maximum(k - 2 - i, i + 1), k - 1 - i], axis=1)
    single = np.bincount(ends.reshape(-1), minlength=1)[ends] == 1
    start, end = np.flatnonzero(single[:, 0]), np.flatnonzero(single[:, 1])
    back = (first[start][:, :, None] + ladder[None, :, ::-1]).reshape(-1, 4)
    front = (last[end][:, :, None] + ladder[None]).reshape(-1, 4)
    owners = [owner, np.repeat(start, len(i)), np.repeat(end, len(i))]
    return np.concatenate([sides, back, front]), np.concatenate(owners)


def _polygon(outline: ArrayLike, number: int) -> FloatArray:
    """Outline without a repeated first corner, counterclockwise about e1."""
    p = np.array(outline, dtype=np.float64)
    if p.ndim == 2 and len(p) > 1 and np.array_equal(p[0], p[-1]):
        p = p[:-1]
    if p.ndim != 2 or p.shape[1] != 2 or len(p) < 3 or not np.isfinite(p).all():
        raise ValueError(
            f"BeamWriter: outline {number} has shape {p.shape}, expected (k, 2), k >= 3"
        )
    following = np.roll(p, -1, axis=0)
    area = np.sum(p[:, 0] * following[:, 1] - p[:, 1] * following[:, 0])
    return p if area >= 0.0 else p[::-1].copy()
