# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rotation-free triangles: energy, internal forces, tangents and masses from nodal positions.

The energy is that of ``forms.shell``, with the curvatures of ``mesh.patches``. Differentiated by
hand, a tangent costs a fraction of what the generated code of the form takes; the form is what the
loops are compared with.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from flexfem._types import FloatArray, IndexArray, IntArray
from flexfem.elements.rotation_free_loops import add_forces, strain_rates_into, strains_into
from flexfem.elements.rotation_free_tangent import add_action, tangents_into
from flexfem.mesh.patches import Patches

__all__ = ["RotationFreeTriangles"]

_NOTHING = np.zeros((0, 6))

# what the loops take first: nodes, gradients, curvatures, offsets, starts
type _Maps = tuple[IndexArray, FloatArray, FloatArray, FloatArray, FloatArray]


@dataclass(frozen=True)
class RotationFreeTriangles:
    """Triangles with patches of equally many nodes on this rank.

    Positions are those of all local nodes, (n, 3). ``offsets`` are ``Patches.offsets`` of the
    present tangents of clamped edges, (m, 3, 3); without them, those of the start. ``added`` is
    what damping and assumed stresses make of the strains, see :meth:`added`.

    Attributes:
        patches: maps of the triangles, p nodes each.
        starts: curvatures at the start kappa_0, 1/m, (m, 3).
        sections: which stiffness a triangle has, (m,).
        stiffness: matrices ``[D_m D_c; D_c^T D_b]`` in the axes of the triangles, of N/m, N and
            N m, (s, 6, 6).
        offsets: ``Patches.offsets`` at the start, 1/m, (m, 3, 3).
        damping: stiffness-proportional damping, s, (m,).
    """

    patches: Patches
    starts: FloatArray
    sections: IntArray
    stiffness: FloatArray
    offsets: FloatArray
    damping: FloatArray

    @classmethod
    def build(
        cls,
        patches: Patches,
        points: FloatArray,
        stiffness: FloatArray,
        sections: IndexArray | None = None,
        damping: FloatArray | None = None,
    ) -> Self:
        """Triangles free of stress at the given positions.

        Args:
            patches: maps made of the same positions.
            points: positions at the start (n, 3), m.
            stiffness: matrices (6, 6) or (s, 6, 6).
            sections: number of the stiffness of each triangle (m,); None for the first.
            damping: stiffness-proportional damping, s, (m,); None for none.
        """
        count = len(patches.areas)
        offsets, strains = patches.offsets(), np.empty((count, 6))
        maps = (patches.nodes, patches.gradients, patches.curvatures)
        strains_into(points, *maps, offsets, np.zeros((count, 3)), strains)
        numbers = np.zeros(count, np.int64) if sections is None else sections.astype(np.int64)
        times = np.zeros(count) if damping is None else damping
        starts = strains[:, 3:].copy()
        return cls(patches, starts, numbers, stiffness.reshape(-1, 6, 6), offsets, times)

    def strains(self, points: FloatArray, offsets: FloatArray | None = None) -> FloatArray:
        """Strains (m, 6): eps_11, eps_22, gamma_12, kappa_11, kappa_22, 2 kappa_12."""
        strains = np.empty((len(self.starts), 6))
        strains_into(points, *self._maps(offsets), strains)
        return strains

    def strain_rates(self, points: FloatArray, velocities: FloatArray) -> FloatArray:
        """Rates (m, 6) of the strains, 1/s and 1/(m s)."""
        rates = np.empty((len(self.starts), 6))
        strain_rates_into(points, velocities, *self._maps(None)[:4], rates)
        return rates

    def added(
        self,
        points: FloatArray,
        velocities: FloatArray | None = None,
        assumed: FloatArray | None = None,
    ) -> FloatArray:
        """What is added to the strains before stresses are taken of them, (m, 6) or nothing.

        Args:
            points: present positions (n, 3).
            velocities: of the nodes (n, 3); strain rates count with the time of the damping.
            assumed: strains (m, 6) that stand for the present ones.
        """
        added = _NOTHING
        if velocities is not None and self.damping.any():
            added = self.damping[:, None] * self.strain_rates(points, velocities)
        if assumed is not None:
            change = assumed - self.strains(points)
            added = added + change if len(added) else change
        return added

    def stresses(self, strains: FloatArray) -> FloatArray:
        """Forces n_11, n_22, n_12 (N/m) and moments m_11, m_22, m_12 (N) for strains (m, 6)."""
        stresses: FloatArray = np.einsum("mij,mj->mi", self.stiffness[self.sections], strains)
        return stresses

    def energies(self, points: FloatArray, offsets: FloatArray | None = None) -> FloatArray:
        """Strain energies of the membrane, of bending and of both together, J, (m, 3)."""
        strains = self.strains(points, offsets)
        D = self.stiffness[self.sections] * self.patches.areas[:, None, None]
        membrane = np.einsum("mi,mij,mj->m", strains[:, :3], D[:, :3, :3], strains[:, :3]) / 2
        bending = np.einsum("mi,mij,mj->m", strains[:, 3:], D[:, 3:, 3:], strains[:, 3:]) / 2
        total = np.einsum("mi,mij,mj->m", strains, D, strains) / 2
        return np.stack([membrane, bending, total], 1)

    def add_forces(
        self,
        points: FloatArray,
        residual: FloatArray,
        scale: float = 1.0,
        offsets: FloatArray | None = None,
        added: FloatArray = _NOTHING,
    ) -> None:
        """Add ``scale`` times the internal forces, N, to the residual (n, 3)."""
        add_forces(points, *self._maps(offsets), *self._material(), added, scale, residual)

    def tangents_into(
        self,
        points: FloatArray,
        tangents: FloatArray,
        factors: tuple[float, float] = (1.0, 0.0),
        offsets: FloatArray | None = None,
        added: FloatArray = _NOTHING,
        first: int = 0,
    ) -> None:
        """Write derivatives of the internal forces, N/m, (r, 3 p, 3 p).

        They are those by positions times the first of the factors plus those by velocities times
        the second, of the r triangles from ``first`` on: some hundreds at a time stay in the cache,
        which halves the time with twelve nodes.

        Rows and columns are the components of the positions of ``patches.nodes``, node by node;
        those of missing nodes are zero. A node may occur twice among twelve.
        """
        maps, numbers = self._maps(offsets), np.array(factors)
        tangents_into(
            points, *maps, *self._material(), added, numbers, self.damping, first, tangents
        )

    def add_action(
        self,
        points: FloatArray,
        steps: FloatArray,
        residual: FloatArray,
        factors: tuple[float, float] = (1.0, 0.0),
        added: FloatArray = _NOTHING,
    ) -> None:
        """Add the derivatives of :meth:`tangents_into` times steps to the residual, (n, 3) both."""
        maps, numbers = self._maps(None), np.array(factors)
        add_action(points, *maps, *self._material(), added, numbers, self.damping, steps, residual)

    def add_masses(self, density: FloatArray, masses: FloatArray) -> None:
        """Add the masses of nodes, a third of each triangle, kg, to (n,).

        Args:
            density: mass per area of each triangle, kg/m^2, (m,).
            masses: masses (n,).
        """
        thirds = np.repeat((density * self.patches.areas / 3)[:, None], 3, 1)
        np.add.at(masses, self.patches.nodes[:, :3], thirds)

    def _maps(self, offsets: FloatArray | None) -> _Maps:
        present = self.offsets if offsets is None else offsets
        patches = self.patches
        return patches.nodes, patches.gradients, patches.curvatures, present, self.starts

    def _material(self) -> tuple[FloatArray, IntArray, FloatArray]:
        """Areas, sections, stiffness."""
        return self.patches.areas, self.sections, self.stiffness
