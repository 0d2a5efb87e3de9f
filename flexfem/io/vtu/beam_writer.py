# SPDX-License-Identifier: LGPL-3.0-or-later
"""Beams as lines and as solid-looking surfaces for ParaView."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexfem.io.vtu.beam_fields import BeamFields
from flexfem.io.vtu.beam_skin import BeamSkin, SkinSection
from flexfem.io.vtu.field_choice import EVERYTHING, FieldChoice
from flexfem.io.vtu.polygons import anticlockwise
from flexfem.io.vtu.series import VtuSeries
from flexfem.materials.section_wall import SectionWall

if TYPE_CHECKING:
    from mpi4py import MPI

__all__ = ["BeamWriter", "drawn_walls"]

#: Walls at the first and at the second end of cells.
Walls = tuple[tuple[SectionWall, ...], ...]

STRAINS = ("gamma1", "gamma2", "gamma3", "kappa1", "kappa2", "kappa3")
RESULTANTS = ("N", "Q2", "Q3", "T", "M2", "M3")
#: Of points of surfaces.
_STRESSES = ("axial_stress", "shear_stress", "von_mises")
COMPONENTS = {"strain": STRAINS, "resultant": RESULTANTS}


class BeamWriter:
    """Series ``beams`` (lines) and ``beam_surfaces`` (sections swept along the deformed beams).

    Where the stresses in sections are known, points of surfaces have ``axial_stress``,
    ``shear_stress`` (of torsion, along the boundary of the section) and ``von_mises``, Pa. Cells of
    lines have the number of their ``section``; where its axes are not those of the nodes for all
    cells, also ``section_axes``: e2 and e3 at both ends in the axes of the node there.
    """

    def __init__(
        self,
        folder: Path,
        comm: MPI.Comm,
        outlines: Sequence[ArrayLike | Sequence[SectionWall] | Walls | None],
        *,
        caps: bool = True,
        resume: float | None = None,
        fields: FieldChoice = EVERYTHING,
    ) -> None:
        """Declare the two series; nothing is written yet.

        Args:
            folder: Result folder.
            comm: Communicator; `write` and `close` are collective.
            outlines: Closed polygon (k, 2) of each section in the (e2, e3) plane in m, or its
                walls, or those at both ends of the cells; None, or no walls, for a section that is
                shown as a line only.
            caps: True if the ends of the swept surfaces are closed.
            resume: Keep the instants of an earlier run up to this time (s).
            fields: To write, and their precision. Surfaces, which are large, are written for all,
                for ``beam_surfaces`` among these names, and for a stress on them.
        """
        walls = [drawn_walls(outline, i) for i, outline in enumerate(outlines)]
        self._sections, self._caps = [SkinSection(*ends) for ends in walls], caps
        self._stressed = any(np.isfinite(one.stress).any() for one in self._sections)
        lines, skins = "beams", "beam_surfaces"
        self._fields, self._swept = fields, any(name in fields for name in (skins, *_STRESSES))
        self._lines = VtuSeries(
            folder, lines, comm, components=COMPONENTS, resume=resume, fields=fields
        )
        self._skins = VtuSeries(
            folder, skins, comm, components=COMPONENTS, resume=resume if self._swept else None,
            fields=fields, single=True,
        )  # fmt: skip
        self._skin: BeamSkin | None = None
        self._comm = comm
        self._axes: bool | None = None  # section axes differ from those of nodes, on any rank

    def write(self, time: float, step: int, beams: BeamFields) -> None:
        """Write both series at one instant; collective.

        Args:
            time: Time in s.
            step: Step number.
            beams: This rank's part.
        """
        # Rounded now: the surfaces repeat these values for every corner of an outline.
        rounded = self._fields.rounded
        cell_data = {
            "body": beams.body.astype(np.int32),
            "strain": rounded(beams.strain),
            "resultant": rounded(beams.resultant),
            "bending_moment": rounded(np.hypot(*beams.resultant[:, 4:].T)),
        }
        point_data: dict[str, NDArray[Any]] = {
            "displacement": rounded(beams.displacement),
            "velocity": rounded(beams.velocity),
            "angular_velocity": rounded(beams.angular_velocity),
        }
        frames: dict[str, NDArray[Any]] = {f"e{i + 1}": beams.rotation[:, :, i] for i in range(3)}
        sections = {"section": beams.section.astype(np.int32)} | self._section_axes(beams)
        self._lines.write(
            time, step, beams.position, beams.cells, "line", point_data | frames,
            cell_data | sections,
        )  # fmt: skip
        if not self._swept:
            self._skins.close()  # files of an earlier run go
            return
        if self._skin is None or not self._skin.fits(beams):
            self._skin = BeamSkin(beams, self._sections, caps=self._caps)
        skin = self._skin
        on_skin = {k: point_data[k].take(skin.node, axis=0) for k in ("displacement", "velocity")}
        if self._stressed:
            axial, shear = skin.stresses(beams).T
            on_skin |= {"axial_stress": axial, "shear_stress": shear}
            on_skin["von_mises"] = np.sqrt(axial**2 + 3.0 * shear**2)
        self._skins.write(
            time,
            step,
            skin.points(beams),
            skin.quads,
            "quad",
            on_skin,
            {k: v.take(skin.owner, axis=0) for k, v in cell_data.items() if k != "strain"},
        )

    def _section_axes(self, beams: BeamFields) -> dict[str, NDArray[Any]]:
        """Axes of sections (m, 2, 6) where they are not those of the nodes; collective at first."""
        if self._axes is None:
            own = bool(np.any(beams.turn != np.eye(3)))
            self._axes = any(self._comm.allgather(own)) if self._comm.size > 1 else own
        if not self._axes:
            return {}
        axes = np.swapaxes(beams.turn[..., 1:], -1, -2)
        return {"section_axes": axes.reshape(len(axes), 2, 6)}

    def close(self) -> None:
        """End both series; collective."""
        self._lines.close()
        self._skins.close()


def drawn_walls(
    outline: ArrayLike | Sequence[SectionWall] | Walls | None, number: int
) -> tuple[tuple[SectionWall, ...], ...]:
    """Walls of a section, of which there may be none; of both ends where they are given."""
    if outline is None:
        return ((),)
    if isinstance(outline, tuple) and all(isinstance(end, tuple) for end in outline):
        return tuple(_end(end, number) for end in outline) or ((),)
    if isinstance(outline, Sequence) and all(isinstance(wall, SectionWall) for wall in outline):
        return (_end([wall for wall in outline if isinstance(wall, SectionWall)], number),)
    return (_end([SectionWall(np.asarray(outline, dtype=np.float64))], number),)


def _end(walls: Sequence[SectionWall], number: int) -> tuple[SectionWall, ...]:
    """Walls of one end, in anticlockwise order."""
    who = f"BeamWriter: outline {number}"
    turned = [anticlockwise(wall.points, who) for wall in walls]
    # stresses belong to the vertices as they are: such walls are anticlockwise already
    return tuple(
        wall if wall.stress is not None else SectionWall(points)
        for wall, points in zip(walls, turned, strict=True)
    )
