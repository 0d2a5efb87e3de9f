# SPDX-License-Identifier: LGPL-3.0-or-later
"""ParaView output of a whole system: beams, shells, bodies, obstacles and joints."""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

from mpi4py import MPI

import numpy as np

from flexfem._types import BoolArray, FloatArray
from flexfem.core.frame_block import FrameBlock
from flexfem.elements.director_shells import DirectorShells
from flexfem.elements.floating_bodies import FloatingBodies
from flexfem.elements.rotation_free_shells import RotationFreeShells
from flexfem.elements.se3_beam import SE3Beams
from flexfem.io.beam_fields import BeamFields
from flexfem.io.beam_writer import BeamWriter
from flexfem.io.body_fields import JointFields, JointWriter, RigidBodyFields, RigidBodyWriter
from flexfem.io.contact_surfaces import ContactSurfaceWriter
from flexfem.io.curve_fields import CurveSampler
from flexfem.io.floating_fields import FloatingState, FloatingWriter
from flexfem.io.paraview_state import write_paraview_state
from flexfem.io.shell_fields import ShellFields, ShellWriter
from flexfem.io.surfaces import body_surface
from flexfem.joints.elastic_lock import ElasticLock
from flexfem.lie import se3
from flexfem.model.floating_body import FloatingBody
from flexfem.system.assembly import Assembly
from flexfem.system.extent import model_extent
from flexfem.system.placement import BEAMS, FLOATING, NURBS, RIGID, SHELLS
from flexfem.system.system import BlockPart, System

__all__ = ["FieldOutput"]

#: Size of joints, relative to the model.
_GLYPH = 0.02
#: Largest size of the boxes that stand for bodies without shape, relative to flexible models.
_BODY = 0.2


class FieldOutput:
    """The series of one run; every call is collective."""

    def __init__(
        self, folder: Path, system: System, serial: Assembly, resume: float | None = None
    ) -> None:
        """Declare all series; those without anything to show only remove what is there.

        Args:
            folder: result folder.
            system: whose state is written.
            serial: serial data of its model.
            resume: keep the instants of an earlier run up to this time (s).

        Raises:
            InputError: the series of an earlier run cannot be read.
        """
        self._system, self._folder, self._opened = system, folder, False
        model, comm = serial.model, system.comm
        self._parts = {part.kind: part for part in system.parts}
        self._curves = CurveSampler(self._parts[NURBS], serial) if NURBS in self._parts else None
        size = _GLYPH * model_extent(serial)
        curves = [] if serial.curves is None else serial.curves.sections
        outlines = [section.walls for section in (*serial.sections, *curves)]
        self._beams = BeamWriter(folder, comm, outlines, resume=resume)
        self._shells = ShellWriter(folder, comm, resume=resume)
        self._thickness = np.array([shell.section.thickness for shell in model.shells])
        self._model_bodies = model.floating_bodies
        self._floating = FloatingWriter(folder, comm, self._model_bodies, resume=resume)
        # an inertia that drives or brakes must not hide what is flexible
        largest = _BODY * model_extent(serial) if len(serial.nodes) else np.inf
        surfaces = [
            body_surface(b.shape, b.mass, b.inertia, b.centre, largest) for b in model.rigid_bodies
        ]
        self._bodies = RigidBodyWriter(folder, comm, surfaces, resume=resume)
        self._obstacles = ContactSurfaceWriter(folder, system, serial, resume)
        # what locks elastic coordinates is inside a body and not shown
        self._shown = np.array([not isinstance(j, ElasticLock) for j in serial.joints], dtype=bool)
        kinds = [j.owner.partition(" ")[0] for j in serial.joints]
        self._joints = JointWriter(folder, comm, kinds, size, resume=resume)

    def write(self, time: float, step: int) -> None:
        """Write the accepted state."""
        beams, bodies = self._parts.get(BEAMS), self._parts.get(RIGID)
        shells = self._parts.get(SHELLS)
        fields = [_beam_fields(beams)] if beams else []
        if self._curves is not None:
            fields.append(self._curves.fields())
        self._beams.write(time, step, BeamFields.joined(fields))
        self._shells.write(
            time, step, self._shell_fields(shells) if shells else ShellFields.empty()
        )
        self._bodies.write(time, step, _body_fields(bodies) if bodies else RigidBodyFields.empty())
        self._obstacles.write(time, step)
        if FLOATING in self._parts:
            states = _floating_states(self._parts[FLOATING], self._model_bodies)
            self._floating.write(time, step, states)
        self._joints.write(time, step, _joint_fields(self._system, self._shown))
        if not self._opened:
            write_paraview_state(self._folder, self._system.comm)
            self._opened = True

    def _shell_fields(self, part: BlockPart) -> ShellFields:
        elements = part.elements
        assert isinstance(elements, (RotationFreeShells, DirectorShells))
        if isinstance(elements, DirectorShells):
            cells, of = elements.facets
        else:
            cells, of = elements.corners.astype(np.int64), np.arange(len(elements.body))
        position, _, velocity, _ = _motion(part.block)
        strain, resultant = elements.resultants(part.block.frames)
        energy = elements.energy_parts(part.block.frames) / elements.areas[:, np.newaxis]
        body = elements.body[of]
        return ShellFields(
            position=position,
            displacement=position - se3.position(part.block.start_frames),
            velocity=velocity,
            cells=cells,
            body=body,
            strain=strain[of],
            resultant=resultant[of],
            thickness=self._thickness[body],
            energy=energy[of],
        )

    def close(self) -> None:
        """End all series."""
        for writer in (
            self._beams, self._shells, self._bodies, self._obstacles, self._floating, self._joints,
        ):  # fmt: skip
            writer.close()


def _motion(block: FrameBlock) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Positions, rotations, velocities and angular velocities in inertial axes."""
    rotation = se3.rotation(block.frames)
    velocity = np.einsum("nij,nj->ni", rotation, block.velocity[:, :3])
    spin = np.einsum("nij,nj->ni", rotation, block.velocity[:, 3:])
    return se3.position(block.frames), rotation, velocity, spin


def _beam_fields(part: BlockPart) -> BeamFields:
    assert isinstance(part.elements, SE3Beams)
    position, rotation, velocity, spin = _motion(part.block)
    strain, resultant = part.elements.resultants(part.block.frames)
    data = part.elements.data
    start = se3.rotation(part.block.start_frames)[data.cells]
    return BeamFields(
        position=position,
        displacement=position - se3.position(part.block.start_frames),
        rotation=rotation,
        velocity=velocity,
        angular_velocity=spin,
        cells=data.cells.astype(np.int64),
        body=data.body,
        strain=strain,
        resultant=resultant,
        section=data.section,
        turn=np.swapaxes(start, -1, -2) @ se3.rotation(data.frames),
    )


def _body_fields(part: BlockPart) -> RigidBodyFields:
    position, rotation, velocity, spin = _motion(part.block)
    start, turn = (of(part.block.start_frames) for of in (se3.position, se3.rotation))
    ids = part.block.node_ids
    return RigidBodyFields(position, rotation, velocity, spin, ids, position - start, turn)


def _floating_states(part: BlockPart, bodies: Sequence[FloatingBody]) -> list[FloatingState]:
    """Frames and coordinates of all bodies on every rank (collective)."""
    elements, block = part.elements, part.block
    assert isinstance(elements, FloatingBodies)
    starts = np.cumsum([0, *(18 + 3 * body.reduced.size for body in bodies)])
    table = np.zeros(starts[-1])
    for group in elements.groups:
        base, eta = group.coordinates(block.frames, block.velocity, block.acceleration)
        strains = group.strains(eta[:, :, 0])
        for k, number in enumerate(group.body.tolist()):
            own = table[starts[number] : starts[number + 1]]
            own[:18] = base[k, :18]
            values = np.vstack([eta[k, :, :2].T, strains[k]])
            own[18:].reshape(3, -1)[:, bodies[number].coordinates] = values
    block.comm.Allreduce(MPI.IN_PLACE, table)
    every = (table[a:b] for a, b in pairwise(starts))
    return [FloatingState(one[:12], one[12:18], *one[18:].reshape(3, -1)) for one in every]


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
