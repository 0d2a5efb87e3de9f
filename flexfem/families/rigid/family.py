# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid bodies: one node each, no elements."""

from typing import override

from mpi4py import MPI

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.core.inertia import inertia_about
from flexfem.core.marker import Carrier, Marker
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.families.common.body_lines import rigid_line
from flexfem.layout.family import Family
from flexfem.layout.lines import Line
from flexfem.layout.numbered_model import NumberedModel
from flexfem.lie import se3
from flexfem.model.bodies.basic import RigidBody, inertia_matrices
from flexfem.model.model import Model
from flexfem.model.structure.place import Place

__all__ = ["RigidBodyFamily"]


class RigidBodyFamily(Family):
    """See :class:`flexfem.layout.family.Family`."""

    follows = True
    noun = "rigid body"
    series = "flexfem.io.paraview.family_series:RigidSeries"

    serial: NumberedModel

    @override
    def check_energy_momentum(self, dissipates: bool) -> None:
        """All are supported."""

    @classmethod
    def members(cls, model: Model) -> list[RigidBody]:
        """Bodies of a model that belong to the family."""
        return model.rigid_bodies

    def __init__(self, serial: NumberedModel, kind: int) -> None:
        """Lay out the bodies."""
        super().__init__(serial, kind)
        self._index = {body.name: i for i, body in enumerate(self.bodies)}
        positions = np.array([body.position for body in self.bodies]).reshape(-1, 3)
        turns = np.array([body.rotation for body in self.bodies]).reshape(-1, 3, 3)
        self._frames = se3.frame(positions, turns)
        rates = [(body.velocity, body.angular_velocity) for body in self.bodies]
        local = np.array(rates).reshape(-1, 2, 3) @ turns
        self._velocities: FloatArray = local.reshape(-1, 6)

    @property
    @override
    def bodies(self) -> list[RigidBody]:
        return self.serial.model.rigid_bodies

    @property
    @override
    def frames(self) -> FloatArray:
        return self._frames

    @property
    @override
    def velocities(self) -> FloatArray:
        return self._velocities

    @property
    @override
    def body_of_node(self) -> IntArray:
        return np.arange(len(self.bodies))

    @override
    def elements(self, body: RigidBody) -> int:
        return 0

    @override
    def outline(self, body: RigidBody) -> FloatArray:
        points = body.centre[np.newaxis] if body.shape is None else body.shape.corners
        return body.position + points @ body.rotation.T

    @override
    def inertia(self, body: RigidBody, origin: FloatArray) -> FloatArray:
        frame = se3.frame(body.position, body.rotation)
        return inertia_about(origin, frame[np.newaxis], body.inertia_matrix)

    @override
    def node(self, marker: Marker, place: Place | None) -> int:
        return self._index[marker.body]

    @override
    def line(self, carrier: Carrier) -> Line:
        return rigid_line(self.kind, self._index[carrier.body], carrier)

    @override
    def costs(self) -> dict[str, tuple[int, int]]:
        return {body.name: (1, 1) for body in self.bodies}

    @override
    def block(self, comm: MPI.Intracomm, ranks: IntArray) -> tuple[FrameBlock, None]:
        from dolfinx.common import IndexMap

        mine = np.flatnonzero(ranks == comm.rank)
        block = FrameBlock(
            "rigid_bodies", comm, self.frames[mine], self.velocities[mine], mine,
            IndexMap(comm, len(mine)), inertial=False,
        )  # fmt: skip
        return block, None

    @override
    def masses(self, block: FrameBlock) -> tuple[list[int], list[FloatArray]]:
        own = [self.bodies[i] for i in block.node_ids[: block.owned].tolist()]
        return list(range(block.owned)), list(inertia_matrices(own))
