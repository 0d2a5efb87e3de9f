# SPDX-License-Identifier: LGPL-3.0-or-later
"""Loads on shells as forces at the nodes and on the triangles of this rank."""

from collections.abc import Iterator

import numpy as np

from flexfem._types import FloatArray, IndexArray, IntArray
from flexfem.bodies.pressure import add_pressures, pressure_states, pressure_tangent
from flexfem.core.frame_block import FrameBlock
from flexfem.core.load import NOTHING
from flexfem.lie import se3
from flexfem.loads.pressure import Pressure
from flexfem.loads.shell_load import ShellLoad
from flexfem.system.assembly import Assembly
from flexfem.system.node_loads import Force

__all__ = ["Pressures", "pressures", "shell_forces"]


class Pressures:
    """Pressures on triangles, with the loads whose amplitudes scale them.

    Attributes:
        nodes: (m, 3) local corners; body: (m,) number of the shell.
    """

    def __init__(
        self, nodes: IntArray, body: IntArray, pressure: FloatArray, load: IntArray
    ) -> None:
        """Store pressures (m,) in Pa and the numbers (m,) of their loads."""
        self.nodes, self.body = nodes, body
        self._data = np.ascontiguousarray(nodes), pressure, load

    def add_residual(self, block: FrameBlock, factors: FloatArray, scale: float) -> None:
        """See :class:`flexfem.system.inner_forces.InnerForces`."""
        add_pressures(*self._data, factors, block.frames, scale, block.residual)

    def tangent(self, block: FrameBlock, factors: FloatArray, scale: float) -> FloatArray:
        """See :class:`flexfem.system.inner_forces.InnerForces`."""
        out = np.empty((len(self.nodes), 9, 9))
        pressure_tangent(*self._data, factors, block.frames, scale, out)
        return out

    def add_action(self, block: FrameBlock, factors: FloatArray, scale: float) -> None:
        """See :class:`flexfem.system.inner_forces.InnerForces`."""
        steps = block.step[self.nodes, :3].reshape(len(self.nodes), 9, 1)
        action = self.tangent(block, factors, scale) @ steps
        np.add.at(block.residual[:, :3], self.nodes, action.reshape(-1, 3, 3))

    def states(self, block: FrameBlock, factors: FloatArray) -> FloatArray:
        """See :class:`flexfem.system.inner_forces.InnerForces`."""
        out = np.empty((len(self.nodes), 12))
        pressure_states(*self._data, factors, block.frames, out)
        return out


def pressures(serial: Assembly, corners: IndexArray, body: IntArray) -> list[Pressures]:
    """All pressures on the triangles that this rank owns, as one group.

    Args:
        serial: serial data of the model.
        corners: (m, 3) local nodes of these triangles; body: (m,) numbers of their shells.
        body: see ``corners``.
    """
    names = [shell.name for shell in serial.model.shells]
    loads = [
        (number, load)
        for number, load in enumerate(serial.model.loads)
        if isinstance(load, Pressure)
    ]
    if not loads:
        return []
    chosen = [np.flatnonzero(body == names.index(load.shell)) for _, load in loads]
    rows = np.concatenate(chosen)
    counts = [len(c) for c in chosen]
    return [
        Pressures(
            corners[rows].astype(np.int64),
            body[rows],
            np.repeat([load.pressure for _, load in loads], counts),
            np.repeat([number for number, _ in loads], counts),
        )
    ]


def shell_forces(serial: Assembly, block: FrameBlock) -> Iterator[Force]:
    """Dead loads on shells as forces at the nodes that this rank owns."""
    still = se3.frame(np.zeros(3), np.eye(3))
    for number, load in enumerate(serial.model.loads):
        if isinstance(load, ShellLoad):
            assert serial.surface is not None
            body = serial.model[load.shell].body
            nodes, sizes = load.shares(serial.surface.mesh, body)
            local = block.owned_index(nodes)
            for k in np.flatnonzero(local >= 0):
                yield Force(
                    int(local[k]), still, float(sizes[k]) * load.force, NOTHING, False, number
                )
