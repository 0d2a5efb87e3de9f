# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rotation-free triangles: energy, internal forces, tangents and masses from nodal positions.

The energy is that of ``forms.shell``, with the curvatures of ``mesh.shells.patches``.
Differentiated by hand, a residual costs 0.07 and a tangent 0.6 us a triangle; by the form
(``families.shells.ufl_triangles``) they cost 0.9 and 3.5 us
(``tests/benchmarks/shell_kernels.py``).
"""

from dataclasses import dataclass, field, replace
from functools import cache
from typing import Self

import numpy as np

from flexfem._types import FloatArray, IndexArray, IntArray
from flexfem.families.common.law_loops import linear_resultants
from flexfem.families.common.law_values import LawValues
from flexfem.families.shell_rotation_free import kernels
from flexfem.families.shell_rotation_free.steps import constant_data, write_starts
from flexfem.families.shell_rotation_free.tangent import tangent, work_space
from flexfem.kernels.by_hand import ByHand
from flexfem.kernels.driver import (
    CellKernel,
    Cells,
    Nodal,
    add_blocks,
    add_forces,
    cell_kernel,
    evaluate,
    plain_cells,
)
from flexfem.kernels.records import Float2D, Memory, Record
from flexfem.mesh.shells.patches import Patches

__all__ = ["Response", "RotationFreeTriangles"]

_NOTHING = np.zeros((0, 6))


class _Nodes(Record):
    """Positions and steps (n, 3) of nodes."""

    points: Float2D
    steps: Float2D


@cache
def _cell_kernel(
    kernel: ByHand, count: int, size: int, *, given: bool = False, stepped: bool = False
) -> CellKernel:
    """A kernel for patches of some nodes.

    Args:
        kernel: one of ``kernels`` and ``tangent``.
        count: number of nodes of a patch.
        size: number of results.
        given: True if stresses are data of the cells.
        stepped: True if it takes the steps of nodes, and no work space.
    """
    nodal = {"points": (Nodal.POSITION, _Nodes.word("points"))}
    if stepped:
        nodal["steps"] = Nodal.POSITION, _Nodes.word("steps")
    behind = 3 * count if stepped else work_space(count)
    sizes = {"stiffness": 36, "given": 6, "points": 3 * count, "steps": behind}
    return cell_kernel(
        kernel.kernel(list(sizes.values())), size, sizes, nodal,
        {"given": (0, 6)} if given else {}, {"stiffness": (0, 36)},
    )  # fmt: skip


@dataclass(frozen=True)
class Response:
    """Stresses and stiffness of triangles, in the format of the compiled loops.

    Attributes:
        sections: (m,) number of each triangle's stiffness.
        stiffness: (s, 6, 6) derivatives of the stresses by the strains.
        stresses: (m, 6) stresses; (0, 6) where they are the stiffness times the present strains.
    """

    sections: IntArray
    stiffness: FloatArray
    stresses: FloatArray


@dataclass(frozen=True)
class RotationFreeTriangles:
    """Triangles with patches of equally many nodes on this rank.

    Positions are those of all local nodes, (n, 3). ``response`` is a result of :meth:`response`;
    without it, that of the linear law without damping.

    Attributes:
        patches: maps of the triangles, p nodes each.
        offsets: ``Patches.offsets`` of the tangents of clamped edges, (m, 3, 3), 1/m.
        starts: reference values (m, 6) of zero strain: lengths and products of ``f_1`` and ``f_2``
            at the start, 1, 1 and 0 unless they are smoothed, and curvatures kappa_0, 1/m; or those
            of a rest state, see :meth:`set_starts`.
        damping: stiffness-proportional damping (m,), s.
        sections: number of each triangle's stiffness, (m,).
        stiffness: matrices ``[D_m D_c; D_c^T D_b]`` in the axes of the triangles, of N/m, N and
            N m, (s, 6, 6).
        law: a user-defined law in place of the stiffness; None for the linear one.
    """

    patches: Patches
    offsets: FloatArray
    starts: FloatArray
    damping: FloatArray
    sections: IntArray
    stiffness: FloatArray
    law: LawValues | None = None
    _cells: Cells = field(init=False)
    _nodes: _Nodes = field(init=False)

    def __post_init__(self) -> None:
        """Collect the data in the format of the kernel driver."""
        rows = constant_data(self.patches, self.offsets, self.starts, self.damping)
        nodes = np.ascontiguousarray(self.patches.nodes, dtype=np.int32)
        cells = plain_cells(_NOTHING, nodes, rows, self.sections, self._matrices(self.stiffness))
        object.__setattr__(self, "_cells", cells)
        none = np.zeros((1, 3))
        object.__setattr__(self, "_nodes", _Nodes(points=none, steps=none))

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

        Curvatures are counted against the normal, so that strains at a height z along it are those
        of the membrane plus z times the curvatures, as sections and their laws define them.

        Args:
            patches: maps made of the same positions.
            points: positions at the start (n, 3), m.
            stiffness: matrices (6, 6) or (s, 6, 6).
            sections: number of the stiffness of each triangle (m,); None for the first.
            damping: stiffness-proportional damping, s, (m,); None for none.
            law: a user-defined law instead of the stiffness; ``sections`` then numbers its
                sections.
        """
        count = len(patches.areas)
        patches = replace(patches, curvatures=-patches.curvatures, slopes=-patches.slopes)
        numbers = np.zeros(count, np.int64) if sections is None else sections.astype(np.int64)
        times = np.zeros(count) if damping is None else damping
        made = cls(
            patches, patches.offsets(), np.zeros((count, 6)), times, numbers,
            stiffness.reshape(-1, 6, 6), law,
        )  # fmt: skip
        return replace(made, starts=made.strains(points))

    def renumbered(self, nodes: IndexArray) -> Self:
        """The same triangles with other numbers (m, p) of their nodes."""
        return replace(self, patches=replace(self.patches, nodes=nodes))

    def set_starts(self, starts: FloatArray) -> None:
        """Set the reference values (m, 6) of zero strain."""
        self.starts[:] = starts
        write_starts(self._cells.corners, starts)

    @property
    def rest_maps(self) -> FloatArray:
        """Maps (m, 1, 6, 6) from strains along e1 and e2 to those that are measured.

        At free edges patches have curvatures without a moment across the edge. Beside clamps
        compliances are the areas over the squares of the weights, also those by which initial
        curvatures count: uniform moments stay in equilibrium, and rotations are right in total.
        """
        maps = np.zeros((len(self.starts), 1, 6, 6))
        maps[:, 0, :3, :3] = np.eye(3)
        maps[:, 0, 3:, 3:] = self.patches.uniform / self.patches.weights[:, None, None]
        return maps

    def strains(self, points: FloatArray) -> FloatArray:
        """Strains (m, 6): eps_11, eps_22, gamma_12, kappa_11, kappa_22, 2 kappa_12."""
        strains, kernel = np.empty((len(self.starts), 6)), self._kernel(kernels.strains, 6)
        evaluate(kernel, self._cells.memory, self._at(points), self._constants(), strains)
        return strains

    def strain_rates(self, points: FloatArray, velocities: FloatArray) -> FloatArray:
        """Rates (m, 6) of the strains, 1/s and 1/(m s)."""
        rates = np.empty((len(self.starts), 6))
        kernel = self._kernel(kernels.strain_rates, 6, stepped=True)
        nodes = self._at(points, velocities)
        evaluate(kernel, self._cells.memory, nodes, self._constants(), rates)
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
            velocities: of the nodes (n, 3); None to neglect strain rates.
            assumed: strains (m, 6) in place of the present ones.
            rate: change of strain rates with strains, 1/s, included in the stiffness of a
                user-defined law.
            drop_compression: True to set compressive principal membrane forces to zero.
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
        """Viscous stresses (m, 6) of strain rates (m, 6)."""
        if self.law is None:
            return self.stresses(self.damping[:, None] * rates)
        if not self.law.viscous:
            return np.zeros_like(rates)
        return self.law.at(strains, rates, self.sections)[:, 43:49]

    @property
    def viscous(self) -> bool:
        """True if stresses depend on strain rates."""
        return bool(self.damping.any()) or (self.law is not None and self.law.viscous)

    def energies(self, points: FloatArray) -> FloatArray:
        """Strain energies of the membrane alone, of bending alone and of both, J, (m, 3)."""
        strains = self.strains(points)
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

    def add_present_forces(
        self, points: FloatArray, velocities: FloatArray | None, assumed: FloatArray | None,
        residual: FloatArray,
    ) -> None:  # fmt: skip
        """Add the internal forces of :meth:`response` to the residual (n, 3)."""
        linear = self.law is None and assumed is None
        if linear and velocities is not None and self.damping.any():
            self.add_damped_forces(points, velocities, residual)
        else:
            self.add_forces(points, residual, response=self.response(points, velocities, assumed))

    def add_damped_forces(
        self, points: FloatArray, velocities: FloatArray, residual: FloatArray
    ) -> None:
        """Add the internal forces of the linear law with damping to the residual (n, 3).

        Strains and rates are not written down: 0.11 us a triangle instead of 0.28.
        """
        nodes = self._at(points, velocities)
        call = self._call(
            kernels.damped_forces, self._width, nodes, (1.0, 0.0), None, stepped=True
        )  # fmt: skip
        add_forces(*call, 1.0, residual)

    def add_forces(
        self, points: FloatArray, residual: FloatArray, scale: float = 1.0,
        response: Response | None = None,
    ) -> None:  # fmt: skip
        """Add ``scale`` times the internal forces, N, to the residual (n, 3)."""
        call = self._call(kernels.forces, self._width, self._at(points), (scale, 0.0), response)
        add_forces(*call, 1.0, residual)

    def tangents(
        self, points: FloatArray, factors: tuple[float, float] = (1.0, 0.0),
        response: Response | None = None,
    ) -> FloatArray:  # fmt: skip
        """Derivatives of the internal forces, N/m, (m, 3 p, 3 p).

        They are those by positions times the first of the factors plus those by velocities times
        the second. Rows and columns are the components of the positions of ``patches.nodes``, node
        by node; those of missing nodes are zero. A node may occur twice among twelve.
        """
        width = self._width
        found = np.empty((len(self.starts), width * width))
        evaluate(*self._call(tangent, width**2, self._at(points), factors, response), found)
        return found.reshape(-1, width, width)

    def add_tangents(
        self, points: FloatArray, index: IndexArray, blocks: FloatArray,
        factors: tuple[float, float] = (1.0, 0.0), response: Response | None = None,
    ) -> None:  # fmt: skip
        """Add the derivatives of :meth:`tangents` to matrices (b, 3, 3) of pairs of nodes.

        ``index`` (m, p, p) are the numbers of the pairs, -1 for missing nodes.
        """
        call = self._call(tangent, self._width**2, self._at(points), factors, response)
        add_blocks(*call, index, blocks)

    def add_action(
        self, points: FloatArray, steps: FloatArray, residual: FloatArray,
        factors: tuple[float, float] = (1.0, 0.0), response: Response | None = None,
    ) -> None:  # fmt: skip
        """Add the derivatives of :meth:`tangents` times steps to the residual, (n, 3) both."""
        nodes = self._at(points, steps)
        call = self._call(
            kernels.action, self._width, nodes, factors, response, stepped=True
        )  # fmt: skip
        add_forces(*call, 1.0, residual)

    def add_masses(self, density: FloatArray, masses: FloatArray) -> None:
        """Add the masses of nodes, a third of each triangle, kg, to (n,).

        Args:
            density: mass per area of each triangle, kg/m^2, (m,).
            masses: masses (n,).
        """
        thirds = np.repeat((density * self.patches.areas / 3)[:, None], 3, 1)
        np.add.at(masses, self.patches.nodes[:, :3], thirds)

    @property
    def _width(self) -> int:
        """Number of components of the positions of a patch."""
        return 3 * int(self.patches.nodes.shape[1])

    def _at(self, points: FloatArray, steps: FloatArray | None = None) -> Memory:
        """Record of the nodes."""
        self._nodes.points = points
        if steps is not None:
            self._nodes.steps = steps
        return self._nodes.memory

    def _kernel(
        self, kernel: ByHand, size: int, *, given: bool = False, stepped: bool = False
    ) -> Memory:
        """Record of a kernel, see :func:`_cell_kernel`."""
        count = self.patches.nodes.shape[1]
        return _cell_kernel(kernel, count, size, given=given, stepped=stepped).memory

    def _constants(
        self, factors: tuple[float, float] = (1.0, 0.0), given: bool = False
    ) -> FloatArray:
        """Constants of kernels, see ``steps``."""
        patches = self.patches
        sizes = patches.nodes.shape[1], patches.membrane.shape[2]
        return np.array([*sizes, *factors, given], dtype=np.float64)

    def _call(
        self, kernel: ByHand, size: int, nodes: Memory, factors: tuple[float, float],
        response: Response | None, *, stepped: bool = False,
    ) -> tuple[Memory, Memory, Memory, FloatArray]:  # fmt: skip
        """Kernel, cells, nodes and constants for stresses and stiffness of a response."""
        sections, stiffness, stresses = self._material(response)
        cells, given = self._cells, len(stresses) > 0
        cells.own, cells.section, cells.sections = stresses, sections, self._matrices(stiffness)
        made = self._kernel(kernel, size, given=given, stepped=stepped)
        return made, cells.memory, nodes, self._constants(factors, given)

    @staticmethod
    def _matrices(stiffness: FloatArray) -> FloatArray:
        """Stiffness as the data of sections."""
        return np.ascontiguousarray(stiffness.reshape(-1, 36))

    def _material(self, response: Response | None) -> tuple[IntArray, FloatArray, FloatArray]:
        """Sections, stiffness, given stresses."""
        own = Response(self.sections, self.stiffness, _NOTHING) if response is None else response
        return own.sections, own.stiffness, own.stresses


def _pull(stresses: FloatArray) -> None:
    """Set compressive principal membrane forces to zero, in stresses (m, 6)."""
    n11, n22, n12 = stresses[:, :3].T
    mean, half = 0.5 * (n11 + n22), 0.5 * (n11 - n22)
    radius = np.hypot(half, n12)
    first, second = np.maximum(mean + radius, 0.0), np.maximum(mean - radius, 0.0)
    kept = 0.5 * (first - second) / np.maximum(radius, np.finfo(np.float64).tiny)
    mean = 0.5 * (first + second)
    stresses[:, :3] = np.column_stack([mean + kept * half, mean - kept * half, kept * n12])
