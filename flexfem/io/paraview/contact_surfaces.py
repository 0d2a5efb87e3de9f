# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid surfaces of contacts for ParaView: obstacles on the ground and those that bodies carry."""

from pathlib import Path

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.io.vtu.body_fields import RigidBodyFields, RigidBodyWriter
from flexfem.io.vtu.field_choice import EVERYTHING, FieldChoice
from flexfem.io.vtu.isosurface import isosurface
from flexfem.io.vtu.surfaces import Surface, cylinder, joined, sphere
from flexfem.layout.node_key import NodeKey
from flexfem.layout.numbered_model import NumberedModel
from flexfem.lie import se3
from flexfem.lie.vectors import cross
from flexfem.model.rigid_surface import (
    RigidCylinder,
    RigidMesh,
    RigidObstacle,
    RigidPlane,
    RigidSphere,
    RigidSurface,
)
from flexfem.system.bounding_box import model_box
from flexfem.system.system import System

__all__ = ["ContactSurfaceWriter", "surface_of"]

#: Sides of planes and lengths of cylinders without end, relative to the model.
_BEYOND = 1.4
#: Cells along the box of an obstacle, of which its triangles are made.
_CELLS = 40


class ContactSurfaceWriter:
    """Series ``contact_surfaces``: the rigid surfaces of all contacts.

    Triangles show the side that nodes are kept on: with hidden back faces one looks into hollow
    surfaces, and through planes from below. Surfaces that act on both sides occur twice.
    """

    def __init__(
        self, folder: Path, system: System, serial: NumberedModel, resume: float | None = None,
        fields: FieldChoice = EVERYTHING,
    ) -> None:  # fmt: skip
        """Declare the series; without surfaces it only removes earlier files.

        Args:
            folder: result folder.
            system: system whose state is written.
            serial: serial data of its model.
            resume: keep the instants of an earlier run up to this time (s).
            fields: to write, and their precision.
        """
        # a surface may be of several contacts
        every = {id(s): s for contact in serial.model.contacts for s in contact.surfaces}
        offsets = [serial.marker_frame(surface.place) for surface in every.values()]
        self._carriers = [serial.key(surface.place) for surface in every.values()]
        self._offsets = np.array(offsets).reshape(-1, 12)
        starts = [
            offset if key is None else se3.compose(serial.node_frames(key[0])[key[1]], offset)
            for key, offset in zip(self._carriers, offsets, strict=True)
        ]
        self._starts = np.array(starts).reshape(-1, 12)
        box = model_box(serial)
        templates = [
            surface_of(surface, box, start)
            for surface, start in zip(every.values(), starts, strict=True)
        ]
        blocks = {part.kind: part.block for part in system.parts}
        self._places = [
            place for number, key in enumerate(self._carriers)
            if (place := _placed(number, key, blocks, system.comm.rank)) is not None
        ]  # fmt: skip
        self._writer = RigidBodyWriter(
            folder, system.comm, templates, name="contact_surfaces", resume=resume, fields=fields
        )

    def write(self, time: float, step: int) -> None:
        """Write one instant (collective)."""
        own = [number for number, _, _ in self._places]
        frames, starts = self._starts[own], self._starts[own]
        velocity, spin = np.zeros((len(own), 3)), np.zeros((len(own), 3))
        for k, (number, block, node) in enumerate(self._places):
            if block is None:
                continue
            base = block.frames[node]
            frames[k] = se3.compose(base, self._offsets[number])
            turn = se3.rotation(base)
            spin[k] = turn @ block.velocity[node, 3:]
            arm = frames[k, :3] - base[:3]
            velocity[k] = turn @ block.velocity[node, :3] + cross(spin[k], arm)
        position = se3.position(frames)
        self._writer.write(
            time, step,
            RigidBodyFields(
                position, se3.rotation(frames), velocity, spin, np.array(own, dtype=np.int64),
                position - se3.position(starts), se3.rotation(starts),
            ),
        )  # fmt: skip

    def close(self) -> None:
        """End the series (collective)."""
        self._writer.close()


def _placed(
    number: int, carrier: NodeKey | None, blocks: dict[int, FrameBlock], rank: int
) -> tuple[int, FrameBlock | None, int] | None:
    """Number of a surface, block and local node that carry it; None on other ranks."""
    if carrier is None:
        return (number, None, 0) if rank == 0 else None
    kind, node = carrier
    local = int(blocks[kind].owned_index(np.array([node]))[0])
    return (number, blocks[kind], local) if local >= 0 else None


def surface_of(surface: RigidSurface, box: FloatArray, start: FloatArray) -> Surface:
    """Triangles of a surface in its axes; infinite ones as far as the model reaches."""
    reach = _BEYOND * (float(np.linalg.norm(box[1] - box[0])) or 1.0)
    near = se3.rotation(start).T @ (box.mean(axis=0) - se3.position(start))
    match surface:
        case RigidPlane():
            corners = 0.5 * reach * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
            return Surface(corners + near * [1, 1, 0], np.array([[0, 1, 2], [0, 2, 3]]))
        case RigidSphere(radius=radius, inside=inside):
            made = sphere(radius, refinements=4)
            return _reversed(made) if inside else made
        case RigidCylinder(radius=radius, length=length, inside=inside):
            middle = near * [0, 0, 1] if length == np.inf else np.zeros(3)
            long = reach if length == np.inf else length
            made = cylinder(radius, long, (0.0, 0.0, 1.0), sides=64, caps=not inside)
            made = made.moved(np.eye(3), middle)
            return _reversed(made) if inside else made
        case RigidObstacle(surface=written, box=corners):
            made = isosurface(written.values, corners, _CELLS)
            _, feet = written.closest(made.points)
            return Surface(np.where(np.isfinite(feet), feet, made.points), made.triangles)
        case RigidMesh(mesh=mesh, two_sided=two_sided):
            made = Surface(mesh.points, mesh.triangles)
            return joined(made, _reversed(made)) if two_sided else made
    raise TypeError(f"unknown rigid surface {surface!r}")


def _reversed(surface: Surface) -> Surface:
    """The other side."""
    return Surface(surface.points, surface.triangles[:, ::-1])
