# SPDX-License-Identifier: LGPL-3.0-or-later
"""Loads on shells as forces at the nodes and on the triangles of this rank."""

from collections.abc import Iterator
from types import ModuleType

import numpy as np

from flexfem._types import FloatArray, IndexArray, IntArray
from flexfem.bodies import pressure as flat
from flexfem.core.load import NOTHING
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.families.common.shell_surface import ShellSurface
from flexfem.families.shell_director import loads as curved
from flexfem.layout.node_loads import Force
from flexfem.layout.numbered_model import NumberedModel
from flexfem.lie import se3
from flexfem.loads.pressure import Pressure
from flexfem.loads.shell_load import ShellLoad
from flexfem.mesh.geometry.topology import edge_keys

__all__ = ["Pressures", "pressures", "shell_forces"]


class Pressures:
    """Pressures on triangles of one kind, with the loads whose amplitudes scale them.

    Attributes:
        nodes: (m, 3) local corners of flat triangles, or (m, 6) nodes of quadratic ones, corners
            first.
        body: number of the shell: (m,) of flat triangles, (6 m,) of quadratic ones, node by node.
    """

    def __init__(
        self, nodes: IntArray, body: IntArray, pressure: FloatArray, load: IntArray
    ) -> None:
        """Store pressures (m,) in Pa and the numbers (m,) of their loads and shells."""
        count = nodes.shape[1]
        straight = count == 3
        self.nodes, self.body = nodes, body if straight else np.repeat(body, count)
        self._data = np.ascontiguousarray(nodes), pressure, load
        self._kernels: ModuleType = flat if straight else curved
        self._width = 3 if straight else 6

    def add_residual(self, block: FrameBlock, factors: FloatArray, scale: float) -> None:
        """See :class:`flexfem.layout.inner_forces.InnerForces`."""
        self._kernels.add_pressures(*self._data, factors, block.frames, scale, block.residual)

    def tangent(self, block: FrameBlock, factors: FloatArray, scale: float) -> FloatArray:
        """See :class:`flexfem.layout.inner_forces.InnerForces`."""
        size = self.nodes.shape[1] * self._width
        out = np.empty((len(self.nodes), size, size))
        self._kernels.pressure_tangent(*self._data, factors, block.frames, scale, out)
        return out

    def add_action(self, block: FrameBlock, factors: FloatArray, scale: float) -> None:
        """See :class:`flexfem.layout.inner_forces.InnerForces`."""
        steps = block.step[self.nodes, : self._width]
        tangent = self.tangent(block, factors, scale)
        action = tangent @ steps.reshape(len(steps), tangent.shape[1], 1)
        np.add.at(block.residual[:, : self._width], self.nodes, action.reshape(steps.shape))

    def states(self, block: FrameBlock, factors: FloatArray) -> FloatArray:
        """See :class:`flexfem.layout.inner_forces.InnerForces`."""
        out = np.empty((len(self.body), 12))
        self._kernels.pressure_states(*self._data, factors, block.frames, out)
        return out


def pressures(serial: NumberedModel, nodes: IndexArray, body: IntArray) -> list[Pressures]:
    """All pressures on the triangles that this rank owns, as one group.

    Args:
        serial: serial data of the model.
        nodes: (m, 3) corners of these triangles, or (m, 6) with the midside nodes.
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
    return [
        Pressures(
            nodes[rows].astype(np.int64),
            body[rows],
            np.repeat([load.pressure for _, load in loads], counts),
            np.repeat([number for number, _ in loads], counts),
        )
    ]


def shell_forces(
    serial: NumberedModel, surface: ShellSurface, block: FrameBlock
) -> Iterator[Force]:
    """Dead loads on shells as forces at the nodes that this rank owns."""
    still = se3.frame(np.zeros(3), np.eye(3))
    for number, load in enumerate(serial.model.loads):
        if isinstance(load, ShellLoad):
            nodes, sizes = _shares(surface, load, serial.model[load.shell].body)
            local = block.owned_index(nodes)
            for k in np.flatnonzero(local >= 0):
                yield Force(
                    int(local[k]), still, float(sizes[k]) * load.force, NOTHING, False, number
                )


def _shares(surface: ShellSurface, load: ShellLoad, body: str) -> tuple[IntArray, FloatArray]:
    """Nodes, ascending, and the length or area at the start that each carries.

    They are the integrals of the nodes' shape functions: consistent loads.
    """
    own = load.elements(surface.mesh, body)
    places = surface.frames[:, :3]
    count = own.shape[1]
    if surface.directors is not None:
        own = np.concatenate([own, _midside_nodes(surface, own)], 1)
        sizes = (curved.edge_shares if count == 2 else curved.area_shares)(places[own])
    else:
        first, last = (places[own[:, k]] - places[own[:, 0]] for k in (1, count - 1))
        whole = first if count == 2 else np.cross(first, last) / 2.0
        measure = np.linalg.norm(whole, axis=1, keepdims=True)
        sizes = np.broadcast_to(measure / count, own.shape)
    nodes, inverse = np.unique(own, return_inverse=True)
    return nodes, np.bincount(inverse.ravel(), sizes.ravel())


def _midside_nodes(surface: ShellSurface, elements: IntArray) -> IntArray:
    """Midside nodes of edges (m, 2), or of triangles (m, 3) opposite to their corners."""
    assert surface.directors is not None
    count, width = len(surface.mesh.points), elements.shape[1]
    known = edge_keys(surface.directors.edges, count)
    pairs = [(0, 1)] if width == 2 else [(1, 2), (2, 0), (0, 1)]
    keys = [edge_keys(elements[:, pair], count) for pair in pairs]
    return count + np.searchsorted(known, np.stack(keys, 1))
