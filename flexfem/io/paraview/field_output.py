# SPDX-License-Identifier: LGPL-3.0-or-later
"""ParaView output of a whole system: the bodies of all families, obstacles and joints."""

from importlib import import_module
from inspect import signature
from pathlib import Path

import numpy as np

from flexfem.families.common.beam_family import BeamFamily
from flexfem.io.atomic import raise_together
from flexfem.io.paraview.cables import CableWriter
from flexfem.io.paraview.contact_surfaces import ContactSurfaceWriter
from flexfem.io.paraview.family_series import Series
from flexfem.io.paraview.paraview_state import write_paraview_state
from flexfem.io.scene_file import SceneFile, Walls
from flexfem.io.vtu.body_fields import JointFields, JointWriter
from flexfem.io.vtu.field_choice import EVERYTHING, FieldChoice
from flexfem.io.vtu.series import remove_series
from flexfem.joints.cable import Cable
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
        self, folder: Path, system: System, serial: NumberedModel, resume: float | None = None,
        fields: FieldChoice = EVERYTHING,
    ) -> None:  # fmt: skip
        """Declare all series; those without anything to show only remove earlier files.

        Args:
            folder: result folder.
            system: system whose state is written.
            serial: serial data of its model.
            resume: keep the instants of an earlier run up to this time (s).
            fields: names of those to write, and their precision.

        Raises:
            InputError: the series of an earlier run cannot be read.
        """
        self._system, self._folder, self._opened = system, folder, False
        self._continues = resume is not None
        comm = system.comm
        self._filled: list[Series] = []
        self._empty: list[Series] = []
        named = dict.fromkeys(family.series for family in registry(serial.model))
        for name in filter(None, named):
            parts = [part for part in system.parts if part.family.series == name]
            made = _series(name)
            # a class of a script may know nothing of fields
            chosen = {"fields": fields} if "fields" in signature(made).parameters else {}
            series = made(folder, comm, parts, serial, resume, **chosen)
            (self._filled if parts else self._empty).append(series)
        obstacles = any(contact.surfaces for contact in serial.model.contacts)
        (self._filled if obstacles else self._empty).append(
            ContactSurfaceWriter(folder, system, serial, resume, fields)
        )
        cables = any(isinstance(joint, Cable) for joint in serial.joints)
        (self._filled if cables else self._empty).append(
            CableWriter(folder, system, resume, fields, shown=cables)
        )
        self._sampler = _JointSampler(system, serial)
        self._scene = _scene(system, serial)
        kinds = [kind for kind, _ in self._scene.joints]
        size = _GLYPH * model_extent(serial)
        self._joints = JointWriter(folder, comm, kinds, size, resume=resume, fields=fields)

    def write(self, time: float, step: int) -> None:
        """Write the accepted state."""
        if not (self._opened or self._continues):  # also of bodies that this model lacks
            remove_series(self._folder, self._system.comm)
        for series in self._filled:
            series.write(time, step)
        if not self._opened:
            for series in self._empty:  # files of an earlier run go
                series.write(time, step)
        if self._sampler.shown or not self._opened:
            self._joints.write(time, step, self._sampler.fields())
        if not self._opened:
            write_paraview_state(self._folder, self._system.comm)
            self._write_scene()
            self._opened = True

    def _write_scene(self) -> None:
        error: Exception | None = None
        if self._system.comm.rank == 0:
            try:
                self._scene.write(self._folder)
            except OSError as exc:
                error = exc
        raise_together(self._system.comm, error)

    def close(self) -> None:
        """End all series."""
        for series in (*self._filled, *self._empty):
            series.close()
        self._joints.close()


def _series(name: str | type[Series]) -> type[Series]:
    """Class of a series that is given as "module:class" or as itself."""
    if not isinstance(name, str):
        return name
    module, _, known = name.partition(":")
    found: type[Series] = getattr(import_module(module), known)
    return found


def _scene(system: System, serial: NumberedModel) -> SceneFile:
    """Names of bodies and joints, and sections of beams in the order of their numbers."""
    bodies: dict[str, list[str]] = {}
    sections: list[Walls] = []
    for part in system.parts:
        shown = part.family.series and _series(part.family.series)
        for name in getattr(shown, "shown_as", ()):
            bodies[name] = [body.name for body in part.family.bodies]
        if isinstance(part.family, BeamFamily):
            sections += part.family.walls
    every = {id(s): s for contact in serial.model.contacts for s in contact.surfaces}
    bodies["contact_surfaces"] = [type(surface).__name__ for surface in every.values()]
    joints = [(joint.owner.partition(" ")[0], joint.name) for joint in serial.joints]
    return SceneFile(bodies, joints, sections)


class _JointSampler:
    """Markers and axes of the joints that this rank owns, and their wrenches on the first body.

    Attributes:
        shown: True if any joint of the model has a picture.
    """

    def __init__(self, system: System, serial: NumberedModel) -> None:
        """Find the joints, and compute what does not change with time."""
        self._system = system
        # locks of elastic coordinates are inside a body, and cables are lines
        pictured = [not isinstance(joint, (ElasticLock, Cable)) for joint in serial.joints]
        self.shown = any(pictured)
        rows = system.constraints
        chosen = [k for k, j in enumerate(rows.joints) if j.owned and pictured[j.index]]
        joints = [rows.joints[k] for k in chosen]
        ends = [(j.joint.pairs or ((0, j.joint.second),))[0] for j in joints]
        pair = rows.marker_start[chosen][:, np.newaxis] + np.array(ends).reshape(-1, 2)
        self._first, self._second = pair.T.astype(np.int64)
        self._numbers = np.array([joint.index for joint in joints], dtype=np.int64)
        start = np.array([j.poses[a].position for j, (a, _) in zip(joints, ends, strict=True)])
        self._start = start.reshape(-1, 3)
        along = [(k, j) for k, j in enumerate(joints) if j.joint.direction is not None]
        self._along = np.array([k for k, _ in along], dtype=np.int64)
        back = [j.poses[ends[k][0]].rotation.T for k, j in along]
        self._back = np.array(back).reshape(-1, 3, 3)
        self._directions = np.array([j.joint.direction for _, j in along]).reshape(-1, 3, 1)

    def fields(self) -> JointFields:
        """State of the joints."""
        rows, first = self._system.constraints, self._first
        forces = self._system.reported_forces() if self.shown else rows.forces
        wrench, a = rows.reactions(forces)[first], rows.poses[first, :3]
        axis = np.zeros((len(first), 3))
        turn = se3.rotation(rows.poses[first[self._along]]) @ self._back
        axis[self._along] = (turn @ self._directions)[:, :, 0]
        return JointFields(
            a=a,
            b=rows.poses[self._second, :3],
            axis=axis,
            force=wrench[:, :3],
            moment=wrench[:, 3:],
            joint=self._numbers,
            displacement=a - self._start,
        )
