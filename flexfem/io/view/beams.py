# SPDX-License-Identifier: LGPL-3.0-or-later
"""Beams on a page: sections swept along their elements, in the frames of the nodes.

A file of the lines at each instant is enough: outlines of sections and what resultants mean for
stresses at their points come from ``scene.json``, once.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexfem._checks import InputError
from flexfem.io.scene_file import SceneFile
from flexfem.io.view.layers import Description, Layer
from flexfem.io.view.normals import shade, triangulated
from flexfem.io.view.packing import Pack
from flexfem.io.view.shapes import Framed
from flexfem.io.vtu.beam_fields import BeamFields
from flexfem.io.vtu.beam_skin import BeamSkin, SkinSection
from flexfem.io.vtu.beam_writer import drawn_walls
from flexfem.io.vtu.reader import Grid

__all__ = ["ARRAYS", "RESULTANTS", "STRESSES", "BeamLayer"]

type FloatArray = NDArray[np.floating[Any]]

#: Arrays without which sections cannot be swept.
ARRAYS = ("e1", "e2", "e3", "body", "section")
#: Components of the resultants, ...
RESULTANTS = ("N", "Q2", "Q3", "T", "M2", "M3")
#: ... from which a page computes these fields.
STRESSES = ("von_mises", "axial_stress", "shear_stress")


class BeamLayer(Layer):
    """Beams as lines and as surfaces; see :class:`Layer`."""

    def __init__(self, series: str, scene: SceneFile, wanted: Sequence[str], first: Grid) -> None:
        """Sweep the sections."""
        super().__init__(series, scene, wanted, first)
        self._beams = _beam_fields(first)
        if not np.isin(self._beams.section, np.arange(len(scene.sections))).all():
            raise InputError(f"series '{series}': a section is missing in scene.json")
        walls = [drawn_walls(ends, i) for i, ends in enumerate(scene.sections)]
        self._skin = BeamSkin(self._beams, [SkinSection(*ends) for ends in walls])
        self._places: list[FloatArray] = []
        self._turns: list[FloatArray] = []

    def _add(self, grid: Grid) -> None:
        self._places.append(grid.points)
        self._turns.append(_rotations(grid))

    def store(self, pack: Pack) -> list[Description]:
        """See :class:`Layer`."""
        surface = self.framed()
        fields = self._stored_fields(pack)
        return [{
            "series": self.series, **surface.store(pack), "fields": fields,
            "lines": pack.store(self._shape.cells.astype(np.uint32)),
            "stress": self._stored_stress(pack, {one["name"] for one in fields}),
        }]  # fmt: skip

    def framed(self) -> Framed:
        """The swept surface and its motion."""
        skin = self._skin
        triangles, _ = triangulated(skin.quads)
        shaded = shade(skin.points(self._beams), triangles)
        self._vertex = shaded.point
        node = skin.node[shaded.point]
        normal = np.einsum("nji,nj->ni", self._beams.rotation[node], shaded.normal)
        return Framed(
            skin.arm[shaded.point], normal, node, skin.cell[shaded.point], shaded.triangles,
            self._places, self._turns, *self._names(self._shape.cell_data["body"]),
        )  # fmt: skip

    def _stored_stress(self, pack: Pack, fields: set[str]) -> Description | None:
        """What resultants mean for stresses at vertices, where they are known and kept."""
        factors = self._skin.stress_factors()[self._vertex].reshape(-1, 12)
        known = np.isfinite(factors).all(axis=1)
        if not known.any() or not {*RESULTANTS} <= fields:
            return None
        table, row = np.unique(factors[known], axis=0, return_inverse=True)
        rows = np.full(len(factors), len(table))
        rows[known] = row.reshape(-1)
        table = np.vstack([table, np.full((1, 12), np.nan)])
        return {
            "factors": pack.store(table.astype(np.float32)),
            "row": pack.store(rows.astype(np.uint32)),
        }


def _rotations(grid: Grid) -> NDArray[np.float64]:
    return np.stack([grid.point_data[name] for name in ("e1", "e2", "e3")], axis=-1).astype(float)


def _beam_fields(grid: Grid) -> BeamFields:
    """The lines as they were written."""
    n, m = len(grid.points), len(grid.cells)
    zero = np.zeros((n, 3))
    turn = np.broadcast_to(np.eye(3), (m, 2, 3, 3))
    axes = grid.cell_data.get("section_axes")
    if axes is not None:
        columns = np.swapaxes(axes.astype(float).reshape(m, 2, 2, 3), -1, -2)
        first = np.cross(columns[..., 0], columns[..., 1])
        turn = np.concatenate([first[..., None], columns], axis=-1)
    return BeamFields(
        position=grid.points, displacement=zero, rotation=_rotations(grid), velocity=zero,
        angular_velocity=zero, cells=grid.cells, body=grid.cell_data["body"],
        strain=np.zeros((m, 6)), resultant=np.zeros((m, 6)),
        section=grid.cell_data["section"], turn=turn,
    )  # fmt: skip
