# SPDX-License-Identifier: LGPL-3.0-or-later
"""ParaView output of a whole system: the bodies of all families, obstacles and joints."""

from importlib import import_module
from pathlib import Path

import numpy as np

from flexfem._types import BoolArray
from flexfem.io.paraview.contact_surfaces import ContactSurfaceWriter
from flexfem.io.paraview.family_series import Series
from flexfem.io.paraview.paraview_state import write_paraview_state
from flexfem.io.vtu.body_fields import JointFields, JointWriter
from flexfem.joints.elastic_lock import ElasticLock
from flexfem.layout.family import registry
from flexfem.layout.numbered_model import NumberedModel
from flexfem.lie import se3
from flexfem.system.bounding_box import model_extent
from flexfem.system.system import System

__all__ = ["FieldOutput"]

#: Size of joints, relative to the model.
_GLYPH = 0.02


class FieldOutput:
    """The series of one run; every call is collective."""

    def __init__(
        self, folder: Path, system: System, serial: NumberedModel, resume: float | None = None
    ) -> None:
        """Declare all series; those without anything to show only remove earlier files.

        Args:
            folder: result folder.
            system: system whose state is written.
            serial: serial data of its model.
            resume: keep the instants of an earlier run up to this time (s).

        Raises:
            InputError: the series of an earlier run cannot be read.
        """
        self._system, self._folder, self._opened = system, folder, False
        comm = system.comm
        self._bodies: list[Series] = []
        named = dict.fromkeys(family.series for family in registry(serial.model))
        for name in filter(None, named):
            parts = [part for part in system.parts if part.family.series == name]
            self._bodies.append(_series(name)(folder, comm, parts, serial, resume))
        self._obstacles = ContactSurfaceWriter(folder, system, serial, resume)
        # locks of elastic coordinates are inside a body and not shown
        self._shown = np.array([not isinstance(j, ElasticLock) for j in serial.joints], dtype=bool)
        kinds = [j.owner.partition(" ")[0] for j in serial.joints]
        size = _GLYPH * model_extent(serial)
        self._joints = JointWriter(folder, comm, kinds, size, resume=resume)

    def write(self, time: float, step: int) -> None:
        """Write the accepted state."""
        for series in (*self._bodies, self._obstacles):
            series.write(time, step)
        self._joints.write(time, step, _joint_fields(self._system, self._shown))
        if not self._opened:
            write_paraview_state(self._folder, self._system.comm)
            self._opened = True

    def close(self) -> None:
        """End all series."""
        for series in (*self._bodies, self._obstacles):
            series.close()
        self._joints.close()


def _series(name: str | type[Series]) -> type[Series]:
    """Class of a series that is given as "module:class" or as itself."""
    if not isinstance(name, str):
        return name
    module, _, known = name.partition(":")
    found: type[Series] = getattr(import_module(module), known)
    return found


def _joint_fields(system: System, shown: BoolArray) -> JointFields:
    """Markers and axes of the joints that this rank owns, and their wrenches on the first body.

    ``shown`` are those of all joints that have a picture.
    """
    rows = system.constraints
    forces = system.reported_forces() if shown.any() else rows.forces
    owned = np.array([placed.owned and shown[placed.index] for placed in rows.joints], dtype=bool)
    first = rows.marker_start[:-1][owned]
    frames, wrench = rows.poses, rows.reactions(forces)[first]
    axis = np.zeros((len(first), 3))
    joints = [placed for placed in rows.joints if placed.owned and shown[placed.index]]
    start = np.array([placed.poses[0].position for placed in joints])
    for i, placed in enumerate(joints):
        if placed.joint.direction is not None:
            turn = se3.rotation(frames[first[i]]) @ placed.poses[0].rotation.T
            axis[i] = turn @ placed.joint.direction
    return JointFields(
        a=frames[first, :3],
        b=frames[first + 1, :3],
        axis=axis,
        force=wrench[:, :3],
        moment=wrench[:, 3:],
        joint=np.array([placed.index for placed in joints], dtype=np.int64),
        displacement=frames[first, :3] - start.reshape(-1, 3),
    )
