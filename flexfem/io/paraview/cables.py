# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cables for ParaView: lines over their guides, with the tension in each part."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.constraints.rows.placed_joint import PlacedJoint
from flexfem.core.pose import Pose
from flexfem.io.vtu.field_choice import EVERYTHING, FieldChoice
from flexfem.io.vtu.series import VtuSeries
from flexfem.joints.cable import Cable
from flexfem.joints.cable_guides import rubs
from flexfem.joints.cable_path import Course, course
from flexfem.lie import se3
from flexfem.system.system import System

__all__ = ["CableWriter"]


@dataclass(frozen=True)
class _Drawn:
    """A cable that this rank draws.

    Attributes:
        number: of the joint in the table of rows.
        placed: the joint.
        cable: its declaration.
        start: its points at the start, m.
    """

    number: int
    placed: PlacedJoint
    cable: Cable
    start: FloatArray


class CableWriter:
    """Series ``cables``: lines with tension, and displacement of points at the same place on it."""

    def __init__(
        self, folder: Path, system: System, resume: float | None = None,
        fields: FieldChoice = EVERYTHING, *, shown: bool = True,
    ) -> None:  # fmt: skip
        """Declare the series; without cables it only removes earlier files.

        Args:
            folder: result folder.
            system: system whose state is written.
            resume: keep the instants of an earlier run up to this time (s).
            fields: to write, and their precision.
            shown: True if the model has cables.
        """
        self._system, self._shown = system, shown
        self._series = VtuSeries(folder, "cables", system.comm, resume=resume, fields=fields)
        self._drawn = []
        for i, placed in enumerate(system.constraints.joints):
            cable = placed.joint
            if placed.owned and isinstance(cable, Cable):
                angles = {wrap.guide: wrap.angle for wrap in cable.shape(placed.poses).wraps}
                start = _course(cable, placed, placed.poses, angles).points
                self._drawn.append(_Drawn(i, placed, cable, start))

    def write(self, time: float, step: int) -> None:
        """Write one instant (collective)."""
        rows = self._system.constraints
        forces = self._system.reported_forces() if self._shown else rows.forces
        points, lines, tensions, numbers, moved = [np.empty((0, 3))], [], [], [], []
        count = 0
        for drawn in self._drawn:
            own = self._course(drawn)
            size = len(own.points)
            points.append(own.points)
            moved.append(own.points - drawn.start)
            lines.append(count + np.arange(size - 1)[:, np.newaxis] + [0, 1])
            every = self._tensions(drawn, forces)
            tensions.append(every[own.spans % len(every)])
            numbers.append(np.full(size - 1, drawn.placed.index))
            count += size
        self._series.write(
            time, step, np.concatenate(points),
            np.concatenate([np.empty((0, 2), dtype=np.int64), *lines]), "line",
            {"displacement": np.concatenate([np.empty((0, 3)), *moved])},
            {
                "joint": np.concatenate([np.empty(0, dtype=np.int64), *numbers]),
                "tension": np.concatenate([np.empty(0), *tensions]),
            },
        )  # fmt: skip

    def close(self) -> None:
        """End the series (collective)."""
        self._series.close()

    def _course(self, drawn: _Drawn) -> Course:
        """Points of a cable at the accepted state."""
        rows, i = self._system.constraints, drawn.number
        frames = rows.poses[rows.marker_start[i] : rows.marker_start[i + 1]]
        poses = tuple(Pose(se3.position(H), se3.rotation(H)) for H in frames)
        angles, first = rows.angles_of(i), self._first_terms(drawn)
        around = {
            wrap.guide: wrap.angle
            + sum(float(angles[first[part] + term]) for part, term in wrap.touches)
            for wrap in drawn.cable.shape(drawn.placed.poses).wraps
        }
        return _course(drawn.cable, drawn.placed, poses, around)

    def _first_terms(self, drawn: _Drawn) -> IntArray:
        """Numbers of the first terms of the rows of its parts among those of the joint."""
        rows = self._system.constraints
        own = rows.start[drawn.number] + np.array(drawn.cable.part_rows)
        first: IntArray = rows.term_start[own] - rows.term_start[rows.start[drawn.number]]
        return first

    def _tensions(self, drawn: _Drawn, forces: FloatArray) -> FloatArray:
        """Tensions (N) of the straight parts of a cable, in the order of its path."""
        cable, rows = drawn.cable, self._system.constraints
        found: dict[int, float] = {}
        shape = cable.shape(drawn.placed.poses)
        for part, number in zip(shape.parts, cable.part_rows, strict=True):
            row = int(rows.start[drawn.number]) + number
            inner = part.guides[1:-1]
            tension, guide_row = float(forces[row]), row + sum(rubs(cable.path[k]) for k in inner)
            for k in reversed(inner):
                found[k] = tension
                if rubs(cable.path[k]):
                    tension += float(forces[guide_row])
                    guide_row -= 1
            found[part.guides[0]] = tension
        return np.array([found[k] for k in sorted(found)])


def _course(
    cable: Cable, placed: PlacedJoint, poses: tuple[Pose, ...], angles: dict[int, float]
) -> Course:
    return course(cable.owner, cable.path, cable.closed, placed.poses, poses, angles)
