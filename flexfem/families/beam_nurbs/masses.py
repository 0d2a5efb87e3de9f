# SPDX-License-Identifier: LGPL-3.0-or-later
"""The masses of a group of NURBS elements: their data and the calls of the compiled loops.

The loops of ``inertia`` treat masses at nodes. Where the sections' mass centres are eccentric, they
get the twists of the centres, and the forces that they add act at the centres.

Where sections vary, the centres ``c_I`` of the control points are those whose interpolation
``c_h`` is nearest to the sections', weighted with their masses: the first moment of mass is exact,
and with the inertia ``rho A S(c - c_h)``, ``S(c) = |c|^2 - c c^T``, added to the rotary inertia the
second one, too. For centres that the shape functions represent nothing is added.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from flexfem._types import BoolArray, FloatArray, IndexArray, IntArray
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.core.nodes.frame_kernels import Nodes
from flexfem.families.beam_nurbs.inertia import (
    MassiveElements,
    NodalMasses,
    add_element_motion,
    add_inertia,
    add_inertia_action,
    add_inertia_tangent,
)
from flexfem.families.beam_nurbs.tables import Masses
from flexfem.families.common.section_groups import about_centres

__all__ = ["ElementMasses", "NurbsMasses"]

_ALL = slice(None)
#: Twists of the nodes and their changes.
_TWISTS = ("velocity", "acceleration", "velocity_change", "acceleration_change")


@dataclass(frozen=True)
class ElementMasses:
    """Masses of m elements with k nodes each.

    Attributes:
        masses: (m, k, k) integrals of the mass times products of two shape functions, kg.
        lumps: (m, k, 3, 3) rotary inertia about the mass centres lumped at the nodes, kg m^2.
        centres: (m, k, 3) mass centres of the nodes, the same in all elements of a node, m.
    """

    masses: FloatArray
    lumps: FloatArray
    centres: FloatArray

    @classmethod
    def uniform(cls, integrals: Masses, inertias: FloatArray, section: IntArray) -> Self:
        """Those of sections that are the same along a beam.

        Args:
            integrals: of products of shape functions.
            inertias: (s, 6, 6) of the sections per length.
            section: (m,) number of the section.
        """
        centres, rotary = about_centres(inertias)
        k = integrals.weights.shape[1]
        lumps = integrals.weights[..., np.newaxis, np.newaxis] * rotary[section][:, np.newaxis]
        masses = inertias[section, 0, 0][:, np.newaxis, np.newaxis] * integrals.products
        return cls(masses, lumps, np.repeat(centres[section][:, np.newaxis], k, axis=1))

    @classmethod
    def varying(
        cls, nodes: IntArray, cell: IntArray, functions: FloatArray, inertias: FloatArray,
        lengths: FloatArray,
    ) -> Self:  # fmt: skip
        """Those of one beam along which the section varies, from points along it.

        Args:
            nodes: (m, k) control points of the elements, counted along the beam.
            cell: (n,) element of each point.
            functions: (n, k) shape functions there.
            inertias: (n, 6, 6) of the sections per length.
            lengths: (n,) that each point stands for, m.
        """
        (m, k), mass = nodes.shape, lengths * inertias[:, 0, 0]
        centres, rotary = about_centres(inertias)
        own = _projected(nodes[cell], functions, mass, centres)
        away = centres - np.einsum("ni,nid->nd", functions, own[nodes[cell]])
        added = np.einsum("nd,nd->n", away, away)[:, np.newaxis, np.newaxis] * np.eye(3)
        added -= away[:, :, np.newaxis] * away[:, np.newaxis]
        spread = lengths[:, np.newaxis, np.newaxis] * rotary
        spread += mass[:, np.newaxis, np.newaxis] * added
        masses, lumps = np.zeros((m, k, k)), np.zeros((m, k, 3, 3))
        np.add.at(masses, cell, np.einsum("n,ni,nj->nij", mass, functions, functions))
        np.add.at(lumps, cell, np.einsum("ni,ncd->nicd", functions, spread))
        return cls(masses, lumps, own[nodes])

    def take(self, rows: IntArray) -> Self:
        """Those of some of the elements."""
        return type(self)(self.masses[rows], self.lumps[rows], self.centres[rows])

    @classmethod
    def joined(cls, parts: "list[ElementMasses]") -> Self:
        """Those of elements of several beams, one after the other."""
        names = "masses", "lumps", "centres"
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))

    @property
    def inertias(self) -> FloatArray:
        """Inertia (m, k, 6, 6) of each node if all masses were lumped, in local axes."""
        mass, c = self.masses.sum(axis=2), self.centres
        found = np.zeros((*mass.shape, 6, 6))
        found[..., :3, :3] = mass[..., np.newaxis, np.newaxis] * np.eye(3)
        first = mass[..., np.newaxis, np.newaxis] * np.cross(c[..., np.newaxis, :], np.eye(3))
        found[..., :3, 3:], found[..., 3:, :3] = first, np.swapaxes(first, -1, -2)
        squares = np.sum(c**2, axis=-1)[..., np.newaxis, np.newaxis] * np.eye(3)
        squares -= c[..., :, np.newaxis] * c[..., np.newaxis, :]
        found[..., 3:, 3:] = self.lumps + mass[..., np.newaxis, np.newaxis] * squares
        return found


def _projected(
    nodes: IntArray, functions: FloatArray, mass: FloatArray, values: FloatArray
) -> FloatArray:
    """Values (c, 3) at control points whose interpolation is nearest to those at points.

    Args:
        nodes: (n, k) control points of each point.
        functions: (n, k) shape functions there.
        mass: (n,) weights.
        values: (n, 3) wanted.
    """
    from scipy import sparse
    from scipy.sparse.linalg import spsolve

    count = int(nodes.max()) + 1
    if not values.any():
        return np.zeros((count, 3))
    # parts without mass have any centre: that of a little mass
    weights = mass + 1e-12 * mass.max()
    rows = np.repeat(np.arange(len(nodes)), nodes.shape[1])
    N = sparse.csr_array((functions.ravel(), (rows, nodes.ravel())), shape=(len(nodes), count))
    weighted = N.T * weights
    found: FloatArray = spsolve((weighted @ N).tocsc(), weighted @ values)
    return found


class NurbsMasses:
    """Masses that move with the interpolated velocities of the control points' mass centres.

    The rotary inertia about the centres is lumped at the control points.
    """

    def __init__(self, cells: IntArray, masses: ElementMasses, count: int) -> None:
        """Prepare the elements (m, k) at ``count`` nodes of the block."""
        nodes, first, back = np.unique(cells.ravel(), return_index=True, return_inverse=True)
        self._homes = np.stack(np.unravel_index(first, cells.shape), axis=1).astype(np.int64)
        all_lumps, lumps = np.zeros((len(nodes), 6, 6)), np.zeros((*cells.shape, 6, 6))
        lumps[..., 3:, 3:] = masses.lumps
        np.add.at(all_lumps, back.ravel(), lumps.reshape(-1, 6, 6))
        self._masses = NodalMasses(
            nodes=nodes.astype(np.int64), lumps=all_lumps, cells=cells, masses=masses.masses
        )
        self._massive = MassiveElements(nodes=cells, masses=masses.masses, inertias=masses.inertias)
        self._centres: FloatArray | None = None
        self._moving: Nodes | None = None
        if masses.centres.any():  # beams share no nodes
            self._centres = np.zeros((count, 3))
            self._centres[cells] = masses.centres

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
            own = self.nodes  # the rates of others are not set
            for x in rates:
                x[own, :3] += np.cross(x[own, 3:], self._centres[own, :, np.newaxis], axis=1)
        add_inertia_tangent(
            self._masses.memory, self._homes, state.memory, gravity, rates, factors, changes
        )
        self._add_at_nodes(changes, values, self._masses.cells)

    def add_action(self, block: FrameBlock, gravity: FloatArray, scale: float) -> None:
        """Add the change along the block's step to its residual, see ``step_changes``."""
        state = self._at_centres(block)
        add_inertia_action(self._masses.memory, state.memory, gravity, scale)
        self._add_at_nodes(state.residual, block.residual)

    def add_motion(self, block: FrameBlock, chosen: BoolArray, motion: FloatArray) -> None:
        """Add energy and momenta of the chosen (m,) elements, see ``flexfem.core.nodes.motion``."""
        add_element_motion(self._massive.memory, chosen, block.nodes.memory, motion)
