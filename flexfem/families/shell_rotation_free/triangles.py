# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rotation-free triangles: energy, internal forces, tangents and masses from nodal positions.

The energy is that of ``forms.shell``, with the curvatures of ``mesh.shells.patches``.
Differentiated by hand, a residual costs 0.09 and a tangent 1.6 us a triangle; by the form
(``families.shells.ufl_triangles``) they cost 1.6 and 8.6 us
(``tests/benchmarks/shell_kernels.py``).
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from flexfem._types import FloatArray, IndexArray, IntArray
from flexfem.families.common.law_loops import linear_resultants
from flexfem.families.common.law_values import LawValues
from flexfem.families.shell_rotation_free.action import add_action
from flexfem.families.shell_rotation_free.forces import add_forces
from flexfem.families.shell_rotation_free.strains import strain_rates_into, strains_into
from flexfem.families.shell_rotation_free.tangent import tangents_into
from flexfem.families.shell_rotation_free.tangent_steps import TriangleData
from flexfem.kernels.records import Memory
from flexfem.mesh.shells.patches import Patches

__all__ = ["Response", "RotationFreeTriangles"]

_NOTHING = np.zeros((0, 6))


@dataclass(frozen=True)
class Response:
    """Stresses and stiffness of triangles, as the compiled loops take them.

    Attributes:
        sections: (m,) which stiffness a triangle has.
        stiffness: (s, 6, 6) derivatives of the stresses by the strains.
        stresses: (m, 6) stresses; none where they are the stiffness times the present strains.
    """

    sections: IntArray
    stiffness: FloatArray
    stresses: FloatArray


@dataclass(frozen=True)
class RotationFreeTriangles:
    """Triangles with patches of equally many nodes on this rank.

    Positions are those of all local nodes, (n, 3). ``offsets`` are ``Patches.offsets`` of the
    present tangents of clamped edges, (m, 3, 3); without them, those of the start. ``response`` is
    what :meth:`response` returns; without it, that of the linear law without damping.

    Attributes:
        patches: maps of the triangles, p nodes each.
        data: these maps and the state at the start, as compiled loops take them.
        sections: which stiffness a triangle has, (m,).
        stiffness: matrices ``[D_m D_c; D_c^T D_b]`` in the axes of the triangles, of N/m, N and
            N m, (s, 6, 6).
        law: a law of the user, which takes the place of the stiffness; None for the linear one.
    """

    patches: Patches
    data: TriangleData
    sections: IntArray
    stiffness: FloatArray
    law: LawValues | None = None

    @classmethod
    def build(
        cls,
        patches: Patches,
        points: FloatArray,
        stiffness: FloatArray,
        sections: IndexArray | None = None,
        damping: FloatArray | None = None,
        law: LawValues | None = None,
    ) -> Self:
        """Triangles free of stress at the given positions.

        Curvatures count against the normal, so that strains at a height z along it are those of the
        membrane plus z times the curvatures, as sections and their laws take them.

        Args:
            patches: maps made of the same positions.
            points: positions at the start (n, 3), m.
            stiffness: matrices (6, 6) or (s, 6, 6).
            sections: number of the stiffness of each triangle (m,); None for the first.
            damping: stiffness-proportional damping, s, (m,); None for none.
            law: a law of the user instead of the stiffness; sections are its own then.
        """
        count = len(patches.areas)
        patches = replace(patches, curvatures=-patches.curvatures, slopes=-patches.slopes)
        data = TriangleData(
            nodes=_numbers(patches.nodes), gradients=patches.membrane,
            curvatures=patches.curvatures, offsets=patches.offsets(), starts=np.zeros((count, 6)),
            areas=patches.areas, damping=np.zeros(count) if damping is None else damping,
        )  # fmt: skip
        strains = np.empty((count, 6))
        strains_into(points, data.memory, strains)
        data.starts = strains
        numbers = np.zeros(count, np.int64) if sections is None else sections.astype(np.int64)
        return cls(patches, data, numbers, stiffness.reshape(-1, 6, 6), law)

    def renumbered(self, nodes: IndexArray) -> Self:
        """The same triangles with other numbers (m, p) of their nodes."""
        data = self._with(nodes=_numbers(nodes))
        return replace(self, patches=replace(self.patches, nodes=nodes), data=data)

    @property
    def starts(self) -> FloatArray:
        """Numbers (m, 6) that count as no strain.

        Lengths and products of ``f_1`` and ``f_2`` at the start, 1, 1 and 0 unless they are
        smoothed, and curvatures kappa_0, 1/m.
        """
        return self.data.starts

    @property
    def offsets(self) -> FloatArray:
        """``Patches.offsets`` (m, 3, 3) at the start, 1/m."""
        return self.data.offsets

    @property
    def damping(self) -> FloatArray:
        """Stiffness-proportional damping (m,), s."""
        return self.data.damping

    def strains(self, points: FloatArray, offsets: FloatArray | None = None) -> FloatArray:
        """Strains (m, 6): eps_11, eps_22, gamma_12, kappa_11, kappa_22, 2 kappa_12."""
        strains = np.empty((len(self.starts), 6))
        strains_into(points, self._data(offsets), strains)
        return strains

    def strain_rates(self, points: FloatArray, velocities: FloatArray) -> FloatArray:
        """Rates (m, 6) of the strains, 1/s and 1/(m s)."""
        rates = np.empty((len(self.starts), 6))
        strain_rates_into(points, velocities, self.data.memory, rates)
        return rates

    def response(
        self,
        points: FloatArray,
        velocities: FloatArray | None = None,
        assumed: FloatArray | None = None,
        rate: float = 0.0,
        *,
        drop_compression: bool = False,
    ) -> Response:
        """Stresses and stiffness at given positions (n, 3).

        Args:
            points: present positions (n, 3).
            velocities: of the nodes (n, 3); None where strain rates do not count.
            assumed: strains (m, 6) that stand for the present ones.
            rate: change of strain rates with strains, 1/s, that the stiffness of a law of the user
                takes in.
            drop_compression: leave out principal forces of the membrane that compress it.
        """
        damped = velocities is not None and bool(self.damping.any())
        if self.law is None and assumed is None and not (damped or drop_compression):
            return Response(self.sections, self.stiffness, _NOTHING)
        strains = self.strains(points) if assumed is None else assumed
        rates = _NOTHING if velocities is None else self.strain_rates(points, velocities)
        if self.law is None:
            if damped:
                strains = strains + self.damping[:, None] * rates
            stresses = self.stresses(strains)
            if drop_compression:
                _pull(stresses)
            return Response(self.sections, self.stiffness, stresses)
        moving = rates if len(rates) else np.zeros_like(strains)
        values = self.law.at(strains, moving, self.sections)
        stresses, stiffness = values[:, 1:7], values[:, 7:43]
        if self.law.viscous:
            stresses = stresses + values[:, 43:49]
            stiffness = stiffness + rate * values[:, 49:85]
        matrices = np.ascontiguousarray(stiffness).reshape(-1, 6, 6)
        stresses = stresses.copy()
        if drop_compression:
            _pull(stresses)
        return Response(np.arange(len(strains)), matrices, stresses)

    def stresses(self, strains: FloatArray) -> FloatArray:
        """Forces n_11, n_22, n_12 (N/m) and moments m_11, m_22, m_12 (N) for strains (m, 6)."""
        if self.law is not None:
            return self.law.at(strains, np.zeros_like(strains), self.sections)[:, 1:7]
        stresses = np.empty_like(strains)
        linear_resultants(strains, self.sections, self.stiffness, stresses)
        return stresses

    def viscous_stresses(self, strains: FloatArray, rates: FloatArray) -> FloatArray:
        """Part of the stresses (m, 6) that strain rates (m, 6) make."""
        if self.law is None:
            return self.stresses(self.damping[:, None] * rates)
        if not self.law.viscous:
            return np.zeros_like(rates)
        return self.law.at(strains, rates, self.sections)[:, 43:49]

    @property
    def viscous(self) -> bool:
        """True if strain rates count."""
        return bool(self.damping.any()) or (self.law is not None and self.law.viscous)

    def energies(self, points: FloatArray, offsets: FloatArray | None = None) -> FloatArray:
        """Strain energies of the membrane alone, of bending alone and of both, J, (m, 3)."""
        strains = self.strains(points, offsets)
        membrane, bending = strains.copy(), strains.copy()
        membrane[:, 3:], bending[:, :3] = 0.0, 0.0
        densities = [self._densities(part) for part in (membrane, bending, strains)]
        return np.stack(densities, 1) * self.patches.areas[:, None]

    def total_energies(self, points: FloatArray) -> FloatArray:
        """Strain energies (m,) of membrane and bending together, J."""
        return self._densities(self.strains(points)) * self.patches.areas

    def _densities(self, strains: FloatArray) -> FloatArray:
        """Energies per area (m,), J/m^2."""
        if self.law is not None:
            return self.law.at(strains, np.zeros_like(strains), self.sections)[:, 0]
        densities: FloatArray = 0.5 * (strains * self.stresses(strains)).sum(axis=1)
        return densities

    def add_forces(
        self,
        points: FloatArray,
        residual: FloatArray,
        scale: float = 1.0,
        offsets: FloatArray | None = None,
        response: Response | None = None,
    ) -> None:
        """Add ``scale`` times the internal forces, N, to the residual (n, 3)."""
        material = self._material(response)
        add_forces(points, self._data(offsets), *material, scale, residual)

    def tangents_into(
        self,
        points: FloatArray,
        tangents: FloatArray,
        factors: tuple[float, float] = (1.0, 0.0),
        offsets: FloatArray | None = None,
        response: Response | None = None,
        first: int = 0,
    ) -> None:
        """Write derivatives of the internal forces, N/m, (r, 3 p, 3 p).

        They are those by positions times the first of the factors plus those by velocities times
        the second, of the r triangles from ``first`` on: some hundreds at a time stay in the cache,
        which halves the time with twelve nodes.

        Rows and columns are the components of the positions of ``patches.nodes``, node by node;
        those of missing nodes are zero. A node may occur twice among twelve.
        """
        data, material = self._data(offsets), self._material(response)
        tangents_into(points, data, *material, np.array(factors), first, tangents)

    def add_action(
        self,
        points: FloatArray,
        steps: FloatArray,
        residual: FloatArray,
        factors: tuple[float, float] = (1.0, 0.0),
        response: Response | None = None,
    ) -> None:
        """Add the derivatives of :meth:`tangents_into` times steps to the residual, (n, 3) both."""
        data, material = self.data.memory, self._material(response)
        add_action(points, data, *material, np.array(factors), steps, residual)

    def add_masses(self, density: FloatArray, masses: FloatArray) -> None:
        """Add the masses of nodes, a third of each triangle, kg, to (n,).

        Args:
            density: mass per area of each triangle, kg/m^2, (m,).
            masses: masses (n,).
        """
        thirds = np.repeat((density * self.patches.areas / 3)[:, None], 3, 1)
        np.add.at(masses, self.patches.nodes[:, :3], thirds)

    def _data(self, offsets: FloatArray | None) -> Memory:
        """Data for compiled loops, with other offsets if there are any."""
        return self.data.memory if offsets is None else self._with(offsets=offsets).memory

    def _with(self, **changed: FloatArray | IndexArray) -> TriangleData:
        """The data with other arrays for some."""
        return TriangleData(
            **{name: getattr(self.data, name) for name in TriangleData.fields} | changed
        )

    def _material(self, response: Response | None) -> tuple[IntArray, FloatArray, FloatArray]:
        """Sections, stiffness, given stresses."""
        own = Response(self.sections, self.stiffness, _NOTHING) if response is None else response
        return own.sections, own.stiffness, own.stresses


def _numbers(nodes: IndexArray) -> IndexArray:
    """Numbers of nodes as compiled loops take them."""
    return np.ascontiguousarray(nodes, dtype=np.int32)


def _pull(stresses: FloatArray) -> None:
    """Set principal forces of the membrane that compress it to zero, in stresses (m, 6)."""
    n11, n22, n12 = stresses[:, :3].T
    mean, half = 0.5 * (n11 + n22), 0.5 * (n11 - n22)
    radius = np.hypot(half, n12)
    first, second = np.maximum(mean + radius, 0.0), np.maximum(mean - radius, 0.0)
    kept = 0.5 * (first - second) / np.maximum(radius, np.finfo(np.float64).tiny)
    mean = 0.5 * (first + second)
    stresses[:, :3] = np.column_stack([mean + kept * half, mean - kept * half, kept * n12])
