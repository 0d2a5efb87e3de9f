# SPDX-License-Identifier: LGPL-3.0-or-later
"""The masses of a group of NURBS elements: their data and the calls of the compiled loops.

The loops of ``inertia`` treat masses at nodes. Where the sections' mass centres are eccentric, they
get the twists of the centres, and the forces that they add act at the centres.
"""

import numpy as np

from flexfem._types import FloatArray, IndexArray, IntArray
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.core.nodes.frame_kernels import Nodes
from flexfem.families.beam_nurbs.inertia import (
    NodalMasses,
    add_inertia,
    add_inertia_action,
    add_inertia_tangent,
)
from flexfem.families.beam_nurbs.tables import Masses
from flexfem.families.common.section_groups import about_centres

__all__ = ["NurbsMasses"]

_ALL = slice(None)
#: Twists of the nodes and their changes.
_TWISTS = ("velocity", "acceleration", "velocity_change", "acceleration_change")


class NurbsMasses:
    """Masses that move with the interpolated velocities of the control points' mass centres.

    The rotary inertia about the centres is lumped at the control points.
    """

    def __init__(
        self, cells: IntArray, masses: Masses, inertias: FloatArray, section: IntArray, count: int
    ) -> None:
        """Prepare the elements (m, k).

        Args:
            cells: (m, k) control points.
            masses: integrals of products of shape functions.
            inertias: (s, 6, 6) of the sections per length.
            section: (m,) number of the section.
            count: of the nodes of the block.
        """
        nodes, first, back = np.unique(cells.ravel(), return_index=True, return_inverse=True)
        self._homes = np.stack(np.unravel_index(first, cells.shape), axis=1).astype(np.int64)
        centres, rotary = about_centres(inertias)
        all_lumps, lumps = np.zeros((len(nodes), 6, 6)), np.zeros((*cells.shape, 6, 6))
        lumps[..., 3:, 3:] = (
            masses.weights[..., np.newaxis, np.newaxis] * rotary[section][:, np.newaxis]
        )
        np.add.at(all_lumps, back.ravel(), lumps.reshape(-1, 6, 6))
        self._masses = NodalMasses(
            nodes=nodes.astype(np.int64), lumps=all_lumps, cells=cells,
            masses=inertias[section, 0, 0][:, np.newaxis, np.newaxis] * masses.products,
        )  # fmt: skip
        self._centres: FloatArray | None = None
        self._moving: Nodes | None = None
        if centres[section].any():  # beams share no nodes: a node's elements have one section
            self._centres = np.zeros((count, 3))
            self._centres[cells] = centres[section][:, np.newaxis]

    @property
    def nodes(self) -> IntArray:
        """(u,) control points of the elements."""
        return self._masses.nodes

    def _at_centres(self, block: FrameBlock) -> Nodes:
        """The nodes; if masses are eccentric, their centres' twists and changes, with no forces."""
        if self._centres is None:
            return block.nodes
        if self._moving is None or self._moving.frames is not block.nodes.frames:
            own = {
                name: np.empty_like(getattr(block.nodes, name)) for name in (*_TWISTS, "residual")
            }
            same = {name: getattr(block.nodes, name) for name in Nodes.fields}
            self._moving = Nodes(**(same | own))
        for name in _TWISTS:
            twists, moved = getattr(block.nodes, name), getattr(self._moving, name)
            moved[:] = twists
            moved[:, :3] += np.cross(twists[:, 3:], self._centres, axis=1)
        self._moving.residual[:] = 0.0
        return self._moving

    def _add_at_nodes(
        self, forces: FloatArray, out: FloatArray, nodes: IndexArray | slice = _ALL
    ) -> None:
        """Add forces on the mass centres and their moments about the nodes to ``out``.

        They are those of the nodes (n, 6), or rows (m, 36 k k) of matrices of the nodes (m, k).
        """
        if self._centres is None:
            return
        c = self._centres[nodes]
        rows = forces.reshape(*c.shape[:-1], 6, -1)
        rows[..., 3:, :] += np.cross(c[..., np.newaxis], rows[..., :3, :], axis=-2)
        out += forces

    def add_residual(self, block: FrameBlock, gravity: FloatArray, scale: float) -> None:
        """Add ``scale`` times inertia forces less weights to the block's residual."""
        state = self._at_centres(block)
        add_inertia(self._masses.memory, state.memory, gravity, scale)
        self._add_at_nodes(state.residual, block.residual)

    def add_tangent(
        self, block: FrameBlock, gravity: FloatArray, rates: FloatArray, factors: FloatArray,
        values: FloatArray,
    ) -> None:  # fmt: skip
        """Add the derivatives along local twists to the elements' matrices (m, 36 k k).

        Args:
            block: of the nodes.
            gravity: (3,) m/s^2.
            rates: (2, n, 6, 6) changes of local velocities and accelerations.
            factors: (2,) that of the stiffness, and that of all.
            values: the matrices.
        """
        state, changes = self._at_centres(block), values
        if self._centres is not None:
            rates, changes = rates.copy(), np.zeros_like(values)
            for x in rates:
                x[:, :3] += np.cross(x[:, 3:], self._centres[:, :, np.newaxis], axis=1)
        add_inertia_tangent(
            self._masses.memory, self._homes, state.memory, gravity, rates, factors, changes
        )
        self._add_at_nodes(changes, values, self._masses.cells)

    def add_action(self, block: FrameBlock, gravity: FloatArray, scale: float) -> None:
        """Add the change along the block's step to its residual, see ``step_changes``."""
        state = self._at_centres(block)
        add_inertia_action(self._masses.memory, state.memory, gravity, scale)
        self._add_at_nodes(state.residual, block.residual)
