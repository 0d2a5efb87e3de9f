# SPDX-License-Identifier: LGPL-3.0-or-later
"""The masses of a group of NURBS elements: their data and the calls of the compiled loops.

The loops of ``nurbs_inertia`` treat masses at nodes. Where the sections' mass centres lie off the
axis, they get the twists of the centres, and the forces that they add act there.
"""

import numpy as np

from flexfem._types import FloatArray, IndexArray, IntArray
from flexfem.core.frame_block import FrameBlock
from flexfem.elements.beam_material import about_centres
from flexfem.elements.nurbs_inertia import add_inertia, add_inertia_action, add_inertia_tangent
from flexfem.elements.nurbs_tables import Masses

__all__ = ["NurbsMasses"]

_ALL = slice(None)


class NurbsMasses:
    """Masses that move with the interpolated velocities of the control points' mass centres.

    The rotary inertia about the centres is lumped at the control points.

    Attributes:
        nodes: (u,) control points of the elements.
    """

    def __init__(
        self, cells: IndexArray, masses: Masses, inertias: FloatArray, section: IntArray, count: int
    ) -> None:
        """Prepare the elements (m, k).

        Args:
            cells: (m, k) control points.
            masses: integrals of products of shape functions.
            inertias: (s, 6, 6) of the sections per length.
            section: (m,) number of the section.
            count: of the nodes of the block.
        """
        self._cells = cells
        self._products = inertias[section, 0, 0][:, np.newaxis, np.newaxis] * masses.products
        nodes, first, back = np.unique(cells.ravel(), return_index=True, return_inverse=True)
        self.nodes: IntArray = nodes.astype(np.int64)
        self._homes = np.stack(np.unravel_index(first, cells.shape), axis=1).astype(np.int64)
        centres, rotary = about_centres(inertias)
        self._lumps, lumps = np.zeros((len(nodes), 6, 6)), np.zeros((*cells.shape, 6, 6))
        lumps[..., 3:, 3:] = (
            masses.weights[..., np.newaxis, np.newaxis] * rotary[section][:, np.newaxis]
        )
        np.add.at(self._lumps, back.ravel(), lumps.reshape(-1, 6, 6))
        self._centres = None
        if centres[section].any():  # beams share no nodes: a node's elements have one section
            self._centres = np.zeros((count, 3))
            self._centres[cells] = centres[section][:, np.newaxis]

    def _at_centres(self, *twists: FloatArray) -> tuple[FloatArray, ...]:
        """Local twists (n, 6) or their rates, or maps (n, 6, j) to them, of the mass centres."""
        if self._centres is None:
            return twists
        moved = tuple(x.copy() for x in twists)
        for x in moved:
            c = self._centres if x.ndim == 2 else self._centres[:, :, np.newaxis]
            x[:, :3] += np.cross(x[:, 3:], c, axis=1)
        return moved

    def _no_forces(self, out: FloatArray) -> FloatArray:
        """Where to add forces on the mass centres; ``out`` itself if these are the nodes."""
        return out if self._centres is None else np.zeros_like(out)

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
        v, w = self._at_centres(block.velocity, block.acceleration)
        forces = self._no_forces(block.residual)
        add_inertia(
            self.nodes, self._cells, self._products, self._lumps, gravity, block.frames, v, w,
            scale, forces,
        )  # fmt: skip
        self._add_at_nodes(forces, block.residual)

    def add_tangent(
        self, block: FrameBlock, gravity: FloatArray, by_v: FloatArray, by_w: FloatArray,
        stiffness: float, scale: float, values: FloatArray,
    ) -> None:  # fmt: skip
        """Add the derivatives along local twists to the elements' matrices (m, 36 k k).

        ``by_v`` and ``by_w`` (n, 6, 6) are the changes of local velocities and accelerations.
        """
        v, w, by_v, by_w = self._at_centres(block.velocity, block.acceleration, by_v, by_w)
        changes = self._no_forces(values)
        add_inertia_tangent(
            self.nodes, self._cells, self._products, self._lumps, gravity, self._homes,
            block.frames, v, w, by_v, by_w, stiffness, scale, changes,
        )  # fmt: skip
        self._add_at_nodes(changes, values, self._cells)

    def add_action(
        self, block: FrameBlock, gravity: FloatArray, steps: FloatArray, dv: FloatArray,
        dw: FloatArray, scale: float,
    ) -> None:  # fmt: skip
        """Add the change along local twists ``steps`` (n, 6) to the block's residual.

        ``dv`` and ``dw`` (n, 6) are the changes of local velocities and accelerations.
        """
        v, w, dv, dw = self._at_centres(block.velocity, block.acceleration, dv, dw)
        forces = self._no_forces(block.residual)
        add_inertia_action(
            self.nodes, self._cells, self._products, self._lumps, gravity, block.frames, v, w,
            steps, dv, dw, scale, forces,
        )  # fmt: skip
        self._add_at_nodes(forces, block.residual)
