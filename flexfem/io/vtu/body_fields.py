# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid bodies and joints as surfaces for ParaView."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from flexfem.io.vtu.field_choice import EVERYTHING, FieldChoice
from flexfem.io.vtu.glyphs import glyph
from flexfem.io.vtu.series import VtuSeries
from flexfem.io.vtu.surfaces import InstanceCache, Instances, Surface, box, frames_along
from flexfem.lie.vectors import cross

if TYPE_CHECKING:
    from mpi4py import MPI

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class RigidBodyFields:
    """This rank's rigid bodies at one instant; arrays may have no rows.

    Attributes:
        position: Reference points (n, 3), inertial, m.
        rotation: Body axes (n, 3, 3), as columns in inertial axes.
        velocity: Velocities of the reference points (n, 3), inertial, m/s.
        angular_velocity: Angular velocities (n, 3), inertial, rad/s.
        body: Number of each body (n,): index of its surface.
        displacement: Of the reference points since the start (n, 3), inertial, m.
        start_rotation: Body axes at the start (n, 3, 3).
    """

    position: FloatArray
    rotation: FloatArray
    velocity: FloatArray
    angular_velocity: FloatArray
    body: IntArray
    displacement: FloatArray
    start_rotation: FloatArray

    @classmethod
    def empty(cls) -> RigidBodyFields:
        """Fields of a rank without rigid bodies."""
        v, axes = np.zeros((0, 3)), np.zeros((0, 3, 3))
        return cls(v, axes, v, v, np.zeros(0, dtype=np.int64), v, axes)


class RigidBodyWriter:
    """Series ``rigid_bodies``, or of another name: surfaces with displacement and velocity."""

    def __init__(
        self,
        folder: Path,
        comm: MPI.Comm,
        surfaces: Sequence[Surface],
        *,
        name: str = "rigid_bodies",
        resume: float | None = None,
        fields: FieldChoice = EVERYTHING,
    ) -> None:
        """Declare the series; nothing is written yet.

        Args:
            folder: Result folder.
            comm: Communicator; `write` and `close` are collective.
            surfaces: Surface of every body of the model in body axes (see `body_surface`).
            name: Of the series.
            resume: Keep the instants of an earlier run up to this time (s).
            fields: To write, and their precision.
        """
        self._series = VtuSeries(folder, name, comm, resume=resume, fields=fields)
        self._templates = InstanceCache(surfaces)
        self._mesh: Instances | None = None
        self._before = np.zeros((0, 3))  # its arms at the start

    def write(self, time: float, step: int, bodies: RigidBodyFields) -> None:
        """Write one instant; collective.

        Args:
            time: Time in s.
            step: Step number.
            bodies: This rank's part.
        """
        mesh = self._templates.select(bodies.body)
        if mesh is not self._mesh:
            self._mesh, self._before = mesh, mesh.arms(bodies.start_rotation)
        owner = mesh.owner
        arms = mesh.arms(bodies.rotation)
        self._series.write(
            time,
            step,
            bodies.position.take(owner, axis=0) + arms,
            mesh.triangles,
            "triangle",
            {
                "displacement": bodies.displacement.take(owner, axis=0) + (arms - self._before),
                "velocity": bodies.velocity.take(owner, axis=0)
                + cross(bodies.angular_velocity.take(owner, axis=0), arms),
            },
            {"body": bodies.body.take(mesh.cell_owner)},
        )

    def close(self) -> None:
        """End the series; collective."""
        self._series.close()


@dataclass(frozen=True)
class JointFields:
    """This rank's joints at one instant; arrays may have no rows.

    Attributes:
        a: Positions of the first markers (n, 3), inertial, m.
        b: Positions of the second markers (n, 3), inertial, m.
        axis: Joint axes (n, 3), inertial; zero for joints without one.
        force: Forces (n, 3) on the first body, inertial, N.
        moment: Moments (n, 3) on the first body about the first marker, inertial, N m.
        joint: Number of each joint (n,): index of its kind.
        displacement: Of the first markers since the start (n, 3), inertial, m.
    """

    a: FloatArray
    b: FloatArray
    axis: FloatArray
    force: FloatArray
    moment: FloatArray
    joint: IntArray
    displacement: FloatArray

    @classmethod
    def empty(cls) -> JointFields:
        """Fields of a rank without joints."""
        v = np.zeros((0, 3))
        return cls(v, v, v, v, v, np.zeros(0, dtype=np.int64), v)


class JointWriter:
    """Series ``joints`` and ``reactions``.

    Joints are shown as a glyph at the first marker and a thin rod from there to the second.
    Reactions are points at the first markers with the vectors ``force`` and ``moment`` on the first
    body, for arrows.
    """

    def __init__(
        self,
        folder: Path,
        comm: MPI.Comm,
        kinds: Sequence[str],
        size: float | Sequence[float],
        *,
        resume: float | None = None,
        fields: FieldChoice = EVERYTHING,
    ) -> None:
        """Declare both series; nothing is written yet.

        Args:
            folder: Result folder.
            comm: Communicator; `write` and `close` are collective.
            kinds: Kind of every joint of the model, such as "Revolute"; unknown ones become cubes.
            size: Size of the glyphs in m, common or per joint.
            resume: Keep the instants of an earlier run up to this time (s).
            fields: To write, and their precision.
        """
        sizes = np.broadcast_to(np.asarray(size, dtype=np.float64), (len(kinds),)).tolist()
        self._series = VtuSeries(folder, "joints", comm, resume=resume, fields=fields)
        self._reactions = VtuSeries(folder, "reactions", comm, resume=resume, fields=fields)
        glyphs = [glyph(kind).scaled(size) for kind, size in zip(kinds, sizes, strict=True)]
        # Thickness by size, length one: it is stretched to the distance of the markers.
        rods = [box((0.12 * s, 0.12 * s, 1.0)) for s in sizes]
        self._pictures = InstanceCache([*glyphs, *rods])
        self._kinds = len(kinds)

    def write(self, time: float, step: int, joints: JointFields) -> None:
        """Write one instant; collective.

        Args:
            time: Time in s.
            step: Step number.
            joints: This rank's part.
        """
        n, link = len(joints.joint), joints.b - joints.a
        mesh = self._pictures.select(np.concatenate([joints.joint, joints.joint + self._kinds]))
        origin = np.concatenate([joints.a, joints.a + 0.5 * link])
        frames = frames_along(np.concatenate([joints.axis, link]))
        frames[n:, :, 2] = link
        points = origin.take(mesh.owner, axis=0) + mesh.arms(frames)
        owner, cell = (at % max(n, 1) for at in (mesh.owner, mesh.cell_owner))
        values: dict[str, NDArray[Any]] = {
            "joint": joints.joint,
            "force": joints.force,
            "force_magnitude": np.linalg.norm(joints.force, axis=1),
            "moment": joints.moment,
            "moment_magnitude": np.linalg.norm(joints.moment, axis=1),
        }
        self._series.write(
            time,
            step,
            points,
            mesh.triangles,
            "triangle",
            {"displacement": joints.displacement.take(owner, axis=0)},
            {name: value.take(cell, axis=0) for name, value in values.items()},
        )
        self._reactions.write(
            time,
            step,
            joints.a,
            np.arange(len(joints.a))[:, np.newaxis],
            "vertex",
            {**values, "displacement": joints.displacement},
        )

    def close(self) -> None:
        """End both series; collective."""
        self._series.close()
        self._reactions.close()
