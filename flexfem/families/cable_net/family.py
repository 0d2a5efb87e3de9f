# SPDX-License-Identifier: LGPL-3.0-or-later
"""Family of nets of cables."""

from collections.abc import Mapping
from typing import Any, override

from mpi4py import MPI

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.families.cable_net.cables import Cables
from flexfem.families.cable_net.elements import CableElements
from flexfem.families.common.block_nodes import MeshFamily
from flexfem.layout.elements import ElementFamily
from flexfem.model.bodies.cable_net import CableNet

__all__ = ["CableNetFamily"]

#: Cost of a cable relative to a beam element.
_COST = 1


class CableNetFamily(MeshFamily[CableNet]):
    """See :class:`flexfem.layout.family.Family`."""

    name = "cable_nets"
    series = "flexfem.io.paraview.net_series:NetSeries"

    @override
    def check_energy_momentum(self, dissipates: bool) -> None:
        pass

    @override
    def costs(self) -> dict[str, tuple[int, int]]:
        return {body.name: (len(body.mesh.cells), _COST) for body in self._bodies}

    @override
    def block(self, comm: MPI.Intracomm, ranks: IntArray) -> tuple[FrameBlock, ElementFamily]:
        block, mine = self.own_nodes(comm, ranks)
        own = np.flatnonzero(np.concatenate(mine))
        nodes = np.concatenate(
            [self.first[k] + body.mesh.cells for k, body in enumerate(self._bodies)]
        )
        numbers = np.concatenate([_numbers(body) for body in self._bodies])
        mass = np.concatenate([body.mass_per_length * body.unstretched for body in self._bodies])
        counts = [len(body.mesh.cells) for body in self._bodies]
        cables = Cables(
            nodes=np.ascontiguousarray(block.local_index(nodes[own]), dtype=np.int32),
            numbers=np.ascontiguousarray(numbers[own]),
            mass=mass[own],
            fittings=np.concatenate([_fittings(body) for body in self._bodies])[own],
            body=np.repeat(np.arange(len(counts)), counts)[own],
        )
        return block, CableElements(cables, block)

    @override
    def fingerprint(self) -> Mapping[str, Any]:
        return {
            "nets": [[b.mesh.points, b.mesh.cells, b.held, b.unstretched] for b in self._bodies]
        }


def _numbers(body: CableNet) -> FloatArray:
    """Numbers (m, 6) of the cables of a body for the loops."""
    values = body.damping, body.tension_only, body.slack_damping, body.dissipating_catch
    own = [np.full(len(body.mesh.cells), float(value)) for value in values]
    return np.column_stack([body.unstretched, body.axial_stiffness, *own])


def _fittings(body: CableNet) -> FloatArray:
    """Masses (m, 2) of nodes, each with the first cable there, kg."""
    cells = body.mesh.cells
    _, first = np.unique(cells.ravel(), return_index=True)
    found = np.zeros(cells.size)
    found[first] = body.node_mass[cells.ravel()[first]]
    return found.reshape(cells.shape)
