# SPDX-License-Identifier: LGPL-3.0-or-later
"""Series for ParaView of the bodies of the families: beams, shells, rigid and floating bodies.

Every class gets the parts of all families that name it in ``Family.series``, maybe none: then it
only removes files of an earlier run. All calls are collective.
"""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, Protocol

from mpi4py import MPI

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.families.beam_se3.elements import SE3Beams
from flexfem.families.common.beam_family import BeamFamily
from flexfem.families.floating.elements import FloatingBodies
from flexfem.families.shell_director.elements import DirectorShells
from flexfem.families.shell_rotation_free.elements import RotationFreeShells
from flexfem.io.paraview.curve_fields import CurveSampler
from flexfem.io.vtu.beam_fields import BeamFields
from flexfem.io.vtu.beam_writer import BeamWriter
from flexfem.io.vtu.body_fields import RigidBodyFields, RigidBodyWriter
from flexfem.io.vtu.field_choice import EVERYTHING, FieldChoice
from flexfem.io.vtu.floating_fields import FloatingState, FloatingWriter
from flexfem.io.vtu.shell_fields import ShellFields, ShellWriter
from flexfem.io.vtu.surfaces import body_surface
from flexfem.layout.numbered_model import NumberedModel
from flexfem.lie import se3
from flexfem.model.bodies.floating_body import FloatingBody
from flexfem.system.bounding_box import model_extent
from flexfem.system.system import BlockPart

__all__ = ["BeamSeries", "FloatingSeries", "RigidSeries", "Series", "ShellSeries", "node_motion"]

#: Largest size of the boxes that represent bodies without shape, relative to flexible models.
_BODY = 0.2


class Series(Protocol):
    """Pictures of some bodies over time; every call is collective.

    A class may have ``shown_as``, the names of its files, so that viewers know the names of bodies.
    """

    def __init__(
        self, folder: Path, comm: MPI.Intracomm, parts: Sequence[BlockPart], serial: NumberedModel,
        resume: float | None, fields: FieldChoice = EVERYTHING,
    ) -> None:  # fmt: skip
        """Declare the series.

        Args:
            folder: result folder.
            comm: communicator.
            parts: of the families whose series it is.
            serial: serial data of the model.
            resume: keep the instants of an earlier run up to this time (s).
            fields: names of those to write, and their precision. A class without this
                argument writes all.

        Raises:
            InputError: the series of an earlier run cannot be read.
        """

    def write(self, time: float, step: int) -> None:
        """Write the accepted state at a time, s."""

    def close(self) -> None:
        """End the series; one that was never written removes earlier files."""


class BeamSeries:
    """Beams as lines with sections; see :class:`Series`."""

    shown_as = ("beams", "beam_surfaces")

    def __init__(
        self, folder: Path, comm: MPI.Intracomm, parts: Sequence[BlockPart], serial: NumberedModel,
        resume: float | None, fields: FieldChoice = EVERYTHING,
    ) -> None:  # fmt: skip
        """See :class:`Series`."""
        self._samplers: list[_LineSampler | CurveSampler] = []
        outlines: list[Any] = []
        for part in parts:
            assert isinstance(part.family, BeamFamily)
            sampler = _LineSampler if isinstance(part.elements, SE3Beams) else CurveSampler
            self._samplers.append(sampler(part, len(outlines)))
            outlines += part.family.walls
        self._writer = BeamWriter(folder, comm, outlines, resume=resume, fields=fields)

    def write(self, time: float, step: int) -> None:
        """See :class:`Series`."""
        fields = [sampler.fields() for sampler in self._samplers]
        self._writer.write(time, step, BeamFields.joined(fields))

    def close(self) -> None:
        """See :class:`Series`."""
        self._writer.close()


class ShellSeries:
    """Shells as triangles; see :class:`Series`."""

    shown_as = ("shells",)

    def __init__(
        self, folder: Path, comm: MPI.Intracomm, parts: Sequence[BlockPart], serial: NumberedModel,
        resume: float | None, fields: FieldChoice = EVERYTHING,
    ) -> None:  # fmt: skip
        """See :class:`Series`."""
        self._parts = list(parts)
        self._thickness = np.array([shell.section.thickness for shell in serial.model.shells])
        self._writer = ShellWriter(folder, comm, resume=resume, fields=fields)

    def write(self, time: float, step: int) -> None:
        """See :class:`Series`."""
        fields = [_shell_fields(part, self._thickness) for part in self._parts]
        self._writer.write(time, step, fields[0] if fields else ShellFields.empty())

    def close(self) -> None:
        """See :class:`Series`."""
        self._writer.close()


class RigidSeries:
    """Rigid bodies as surfaces; see :class:`Series`."""

    shown_as = ("rigid_bodies",)

    def __init__(
        self, folder: Path, comm: MPI.Intracomm, parts: Sequence[BlockPart], serial: NumberedModel,
        resume: float | None, fields: FieldChoice = EVERYTHING,
    ) -> None:  # fmt: skip
        """See :class:`Series`."""
        self._bodies = [_BodySampler(part) for part in parts]
        # the box of a large inertia must not hide flexible bodies
        largest = _BODY * model_extent(serial) if len(serial.nodes) else np.inf
        surfaces = [
            body_surface(b.shape, b.mass, b.inertia, b.centre, largest)
            for b in serial.model.rigid_bodies
        ]
        self._writer = RigidBodyWriter(folder, comm, surfaces, resume=resume, fields=fields)

    def write(self, time: float, step: int) -> None:
        """See :class:`Series`."""
        fields = [sampler.fields() for sampler in self._bodies]
        self._writer.write(time, step, fields[0] if fields else RigidBodyFields.empty())

    def close(self) -> None:
        """See :class:`Series`."""
        self._writer.close()


class FloatingSeries:
    """Bodies in floating frames as their meshes; see :class:`Series`."""

    shown_as = ("floating_bodies", "floating_lines")

    def __init__(
        self, folder: Path, comm: MPI.Intracomm, parts: Sequence[BlockPart], serial: NumberedModel,
        resume: float | None, fields: FieldChoice = EVERYTHING,
    ) -> None:  # fmt: skip
        """See :class:`Series`."""
        self._parts, self._bodies = list(parts), serial.model.floating_bodies
        self._writer = FloatingWriter(folder, comm, self._bodies, resume=resume, fields=fields)

    def write(self, time: float, step: int) -> None:
        """See :class:`Series`."""
        for part in self._parts:
            self._writer.write(time, step, _floating_states(part, self._bodies))

    def close(self) -> None:
        """See :class:`Series`."""
        self._writer.close()


def node_motion(block: FrameBlock) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Positions, rotations, velocities and angular velocities in inertial axes."""
    rotation = se3.rotation(block.frames)
    velocity = np.einsum("nij,nj->ni", rotation, block.velocity[:, :3])
    spin = np.einsum("nij,nj->ni", rotation, block.velocity[:, 3:])
    return se3.position(block.frames), rotation, velocity, spin


class _LineSampler:
    """Nodes and cells of beams of two nodes."""

    def __init__(self, part: BlockPart, first_section: int) -> None:
        """Compute what does not change with time; ``first_section`` is the number of the first."""
        assert isinstance(part.elements, SE3Beams)
        self._block, self._beams = part.block, part.elements
        data = part.elements.data
        start = se3.rotation(part.block.start_frames)[data.cells]
        self._turn = np.swapaxes(start, -1, -2) @ se3.rotation(data.frames)
        self._start, self._cells = part.block.start_frames[:, :3], data.cells.astype(np.int64)
        self._section = first_section + data.section

    def fields(self) -> BeamFields:
        """State of the nodes and cells."""
        position, rotation, velocity, spin = node_motion(self._block)
        strain, resultant = self._beams.resultants(self._block.frames)
        return BeamFields(
            position=position,
            displacement=position - self._start,
            rotation=rotation,
            velocity=velocity,
            angular_velocity=spin,
            cells=self._cells,
            body=self._beams.data.body,
            strain=strain,
            resultant=resultant,
            section=self._section,
            turn=self._turn,
        )


class _BodySampler:
    """Rigid bodies of a part."""

    def __init__(self, part: BlockPart) -> None:
        """Compute what does not change with time."""
        self._block, frames = part.block, part.block.start_frames
        self._start, self._turn = se3.position(frames), se3.rotation(frames)

    def fields(self) -> RigidBodyFields:
        """State of the bodies."""
        position, rotation, velocity, spin = node_motion(self._block)
        return RigidBodyFields(
            position, rotation, velocity, spin, self._block.node_ids, position - self._start,
            self._turn,
        )  # fmt: skip


def _shell_fields(part: BlockPart, thickness: FloatArray) -> ShellFields:
    elements = part.elements
    assert isinstance(elements, (RotationFreeShells, DirectorShells))
    if isinstance(elements, DirectorShells):
        cells, of = elements.facets
    else:
        cells, of = elements.corners.astype(np.int64), np.arange(len(elements.body))
    position, _, velocity, _ = node_motion(part.block)
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
        thickness=thickness[body],
        energy=energy[of],
    )


def _floating_states(part: BlockPart, bodies: Sequence[FloatingBody]) -> list[FloatingState]:
    """Frames and coordinates of all bodies on every rank (collective)."""
    elements, block = part.elements, part.block
    assert isinstance(elements, FloatingBodies)
    starts = np.cumsum([0, *(18 + 3 * body.reduced.functions for body in bodies)])
    table = np.zeros(starts[-1])
    for group in elements.groups:
        base, eta = group.coordinates(block.frames, block.velocity, block.acceleration)
        strains = group.strains(eta[:, :, 0])
        for k, number in enumerate(group.body.tolist()):
            own = table[starts[number] : starts[number + 1]]
            own[:18] = base[k, :18]
            values = np.vstack([eta[k, :, :2].T, strains[k]])
            own[18:].reshape(3, -1)[:, bodies[number].functions] = values
    block.comm.Allreduce(MPI.IN_PLACE, table)
    every = (table[a:b] for a, b in pairwise(starts))
    return [FloatingState(one[:12], one[12:18], *one[18:].reshape(3, -1)) for one in every]
