# SPDX-License-Identifier: LGPL-3.0-or-later
"""Loads on shells as forces at the nodes and on the triangles of this rank."""

from collections.abc import Iterator

import numpy as np

from flexfem._types import FloatArray, IndexArray, IntArray
from flexfem.bodies import pressure as flat
from flexfem.core.frame_block import FrameBlock
from flexfem.core.load import NOTHING
from flexfem.elements import director_loads as curved
from flexfem.lie import se3
from flexfem.loads.pressure import Pressure
from flexfem.loads.shell_load import ShellLoad
from flexfem.mesh.topology import edge_keys
from flexfem.system.assembly import Assembly
from flexfem.system.node_loads import Force
from flexfem.system.shell_surface import ShellSurface

__all__ = ["CurvedPressures", "Pressures", "pressures", "shell_forces"]


class Pressures:
    """Pressures on flat triangles, with the loads whose amplitudes scale them.

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
        flat.add_pressures(*self._data, factors, block.frames, scale, block.residual)

    def tangent(self, block: FrameBlock, factors: FloatArray, scale: float) -> FloatArray:
        """See :class:`flexfem.system.inner_forces.InnerForces`."""
        out = np.empty((len(self.nodes), 9, 9))
        flat.pressure_tangent(*self._data, factors, block.frames, scale, out)
        return out

    def add_action(self, block: FrameBlock, factors: FloatArray, scale: float) -> None:
        """See :class:`flexfem.system.inner_forces.InnerForces`."""
        steps = block.step[self.nodes, :3].reshape(len(self.nodes), 9, 1)
        action = self.tangent(block, factors, scale) @ steps
        np.add.at(block.residual[:, :3], self.nodes, action.reshape(-1, 3, 3))

    def states(self, block: FrameBlock, factors: FloatArray) -> FloatArray:
        """See :class:`flexfem.system.inner_forces.InnerForces`."""
        out = np.empty((len(self.nodes), 12))
        flat.pressure_states(*self._data, factors, block.frames, out)
        return out


class CurvedPressures:
    """Pressures on quadratic triangles, with the loads whose amplitudes scale them.

    Attributes:
        nodes: (m, 6) local nodes, corners first; body: (6 m,) number of the shell, node by node.
    """

    def __init__(
        self, nodes: IntArray, body: IntArray, pressure: FloatArray, load: IntArray
    ) -> None:
        """Store pressures (m,) in Pa and the numbers (m,) of their loads and shells."""
        self.nodes, self.body = nodes, np.repeat(body, nodes.shape[1])
        self._data = np.ascontiguousarray(nodes), pressure, load

    def add_residual(self, block: FrameBlock, factors: FloatArray, scale: float) -> None:
        """See :class:`flexfem.system.inner_forces.InnerForces`."""
        curved.add_pressures(*self._data, factors, block.frames, scale, block.residual)

    def tangent(self, block: FrameBlock, factors: FloatArray, scale: float) -> FloatArray:
        """See :class:`flexfem.system.inner_forces.InnerForces`."""
        out = np.empty((len(self.nodes), 36, 36))
        curved.pressure_tangent(*self._data, factors, block.frames, scale, out)
        return out

    def add_action(self, block: FrameBlock, factors: FloatArray, scale: float) -> None:
        """See :class:`flexfem.system.inner_forces.InnerForces`."""
        steps = block.step[self.nodes].reshape(len(self.nodes), 36, 1)
        action = self.tangent(block, factors, scale) @ steps
        np.add.at(block.residual, self.nodes, action.reshape(-1, 6, 6))

    def states(self, block: FrameBlock, factors: FloatArray) -> FloatArray:
        """See :class:`flexfem.system.inner_forces.InnerForces`: those at the nodes."""
        out = np.empty((len(self.body), 12))
        curved.pressure_states(*self._data, factors, block.frames, out)
        return out


def pressures(
    serial: Assembly, nodes: IndexArray, body: IntArray
) -> list[Pressures | CurvedPressures]:
    """All pressures on the triangles that this rank owns, as one group.

    Args:
        serial: serial data of the model.
        nodes: (m, 3) corners of these triangles, or (m, 6) with the middles of the edges.
        body: (m,) numbers of their shells.
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
    made = Pressures if nodes.shape[1] == 3 else CurvedPressures
    return [
        made(
            nodes[rows].astype(np.int64),
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
            nodes, sizes = _shares(serial.surface, load, serial.model[load.shell].body)
            local = block.owned_index(nodes)
            for k in np.flatnonzero(local >= 0):
                yield Force(
                    int(local[k]), still, float(sizes[k]) * load.force, NOTHING, False, number
                )


def _shares(surface: ShellSurface, load: ShellLoad, body: str) -> tuple[IntArray, FloatArray]:
    """Nodes, ascending, and the length or area at the start that each carries.

    They are the integrals of the nodes' shape functions, which makes the work of the forces exact.
    """
    own = load.elements(surface.mesh, body)
    places = surface.frames[:, :3]
    count = own.shape[1]
    if surface.directors is not None:
        own = np.concatenate([own, _middles(surface, own)], 1)
        sizes = (curved.edge_shares if count == 2 else curved.area_shares)(places[own])
    else:
        first, last = (places[own[:, k]] - places[own[:, 0]] for k in (1, count - 1))
        whole = first if count == 2 else np.cross(first, last) / 2.0
        measure = np.linalg.norm(whole, axis=1, keepdims=True)
        sizes = np.broadcast_to(measure / count, own.shape)
    nodes, inverse = np.unique(own, return_inverse=True)
    return nodes, np.bincount(inverse.ravel(), sizes.ravel())


def _middles(surface: ShellSurface, elements: IntArray) -> IntArray:
    """Nodes amid edges (m, 2), or amid the edges of triangles (m, 3) opposite to their corners."""
    assert surface.directors is not None
    count, width = len(surface.mesh.points), elements.shape[1]
    known = edge_keys(surface.directors.edges, count)
    pairs = [(0, 1)] if width == 2 else [(1, 2), (2, 0), (0, 1)]
    keys = [edge_keys(elements[:, pair], count) for pair in pairs]
    return count + np.searchsorted(known, np.stack(keys, 1))
