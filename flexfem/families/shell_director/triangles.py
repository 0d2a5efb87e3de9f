# SPDX-License-Identifier: LGPL-3.0-or-later
"""Director triangles: energy, internal forces, tangents and masses from frames of their nodes.

The energy is that of ``forms.director_shell``: quadratic positions, and one director at the
midpoint of each edge, which rotates with a frame there. Differentiated by hand, a residual costs
0.4 and a tangent 4 us a triangle; by the form (``families.shells.ufl_triangles``) they cost 24 and
49 us (``tests/benchmarks/shell_kernels.py``).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Self

import numpy as np

from flexfem._types import FloatArray, IndexArray, IntArray
from flexfem.families.shell_director import kernels
from flexfem.families.shell_director.geometry import (
    Geometry,
    consistent_masses,
    plane_stiffness,
    shear_stiffness,
)
from flexfem.families.shell_director.law import (
    DirectorLaw,
    Response,
    law_energies,
    law_response,
    law_viscosity,
)
from flexfem.families.shell_director.steps import SIZES, WORK, constant_data
from flexfem.families.shell_director.tables import MIDDLES, POINTS, shapes, slopes
from flexfem.families.shell_director.tangent import TANGENT_WORK, tangent
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

__all__ = ["UNKNOWNS", "DirectorTriangles"]

_NO_STRESSES = np.zeros((0, 18))
#: Number of translations of the six nodes plus rotations of the three with directors.
UNKNOWNS = np.array([(i, 0 if i < 6 else 3) for i in range(9)])


class _Nodes(Record):
    """Frames (n, 12) and twists (n, 6) of nodes."""

    frames: Float2D
    steps: Float2D


@cache
def _cell_kernel(
    kernel: ByHand, size: int, *, given: bool = False, stepped: bool = False
) -> CellKernel:
    """A kernel.

    Args:
        kernel: one of ``kernels`` and ``tangent``.
        size: number of results.
        given: True if stresses are data of the cells.
        stepped: True if it takes the twists of nodes.
    """
    nodal = {
        "positions": (Nodal.POSITION, _Nodes.word("frames")),
        "rotations": (Nodal.ROTATION, _Nodes.word("frames")),
    }
    if stepped:
        nodal["steps"] = Nodal.TWIST, _Nodes.word("steps")
    own = {"starts": (0, 24)} | ({"given": (24, 18)} if given else {})
    made = kernel.kernel([*SIZES.values(), TANGENT_WORK if kernel is tangent else WORK])
    return cell_kernel(made, size, SIZES, nodal, own, unknowns=UNKNOWNS)


@dataclass(frozen=True)
class DirectorTriangles:
    """Triangles on this rank.

    Frames are those of all local nodes, (n, 12). Strains and resultants are in the axes of the
    start: membrane 11, 22, 12, curvatures or moments 11, 22, 12, shear 1, 2.

    Attributes:
        nodes: (m, 9) corners, midside nodes opposite to them, and the nodes that carry the
            directors: the midside nodes again, save where these are fixed along axes that must not
            rotate.
        directors: at the start in the axes of the frames that carry them, (m, 3, 3).
        shears: stiffness of covariant shear strains times areas, relaxed, N m, (m, 6, 6).
        damping: stiffness-proportional, s, (m,).
        starts: covariant strains at the start, (m, 24), or those of a rest state.
        sections: number of each triangle's stiffness, (m,).
        stiffness: of membrane and bending, N/m, N and N m, (s, 6, 6).
        shear: across the thickness, N/m, (s, 2, 2).
        planes: stiffness of covariant strains times areas, (m, 3, 6, 6).
        areas: m^2, (m,).
        axes: e1, e2, e3 of the start, rows, at the centroids of the triangles, (m, 3, 3).
        laws: user-defined laws of membrane and bending.
    """

    nodes: IntArray
    directors: FloatArray
    shears: FloatArray
    damping: FloatArray
    starts: FloatArray
    sections: IntArray
    stiffness: FloatArray
    shear: FloatArray
    planes: FloatArray
    areas: FloatArray
    axes: FloatArray
    _places: FloatArray
    _points: Geometry
    _middles: Geometry
    laws: tuple[DirectorLaw, ...] = ()
    _cells: Cells = field(init=False)
    _nodes: _Nodes = field(init=False)

    def __post_init__(self) -> None:
        """Collect the data in the format of the kernel driver."""
        nodes = np.ascontiguousarray(self.nodes, dtype=np.int32)
        cells = plain_cells(self.starts, nodes, self._rows(self.planes))
        object.__setattr__(self, "_cells", cells)
        state = _Nodes(frames=np.zeros((1, 12)), steps=np.zeros((1, 6)))
        object.__setattr__(self, "_nodes", state)

    def _rows(self, planes: FloatArray) -> FloatArray:
        """Data of calls of kernels with some stiffness of membrane and bending."""
        return constant_data(self.nodes, self.directors, self.damping, self.shears, planes)

    @classmethod
    def build(
        cls,
        nodes: IndexArray,
        frames: FloatArray,
        directors: FloatArray,
        stiffness: FloatArray,
        shear: FloatArray,
        sections: IndexArray | None = None,
        directions: FloatArray | None = None,
        damping: FloatArray | None = None,
        laws: Sequence[DirectorLaw] = (),
    ) -> Self:
        """Triangles free of stress at the given frames.

        Args:
            nodes: corners, then midside nodes of the opposite edges, (m, 6); or with the nodes that
                carry the directors, (m, 9).
            frames: of the nodes at the start, (n, 12).
            directors: unit vectors at the start, inertial axes, (m, 3, 3).
            stiffness: matrices (6, 6) or (s, 6, 6).
            shear: matrices (2, 2) or (s, 2, 2).
            sections: number of the stiffness of each triangle (m,); None for the first.
            directions: vectors whose projections are e1, (m, 3); None for the direction of edge 2.
            damping: stiffness-proportional damping, s, (m,); None for none.
            laws: user-defined laws.

        Raises:
            ValueError: A direction is normal to its triangle.
        """
        nodes = nodes if nodes.shape[1] == 9 else np.concatenate([nodes, nodes[:, 3:]], 1)
        places, stiffness = frames[nodes[:, :6], :3], stiffness.reshape(-1, 6, 6)
        turns = frames[nodes[:, 6:], 3:].reshape(-1, 3, 3, 3)
        own = np.einsum("mkba,mkb->mka", turns, directors)
        points, middles = (Geometry.at(at, places, directions) for at in (POINTS, MIDDLES))
        numbers = np.zeros(len(nodes), np.int64) if sections is None else sections.astype(np.int64)
        D, across = stiffness[numbers], shear.reshape(-1, 2, 2)[numbers]
        times = np.zeros(len(nodes)) if damping is None else damping
        mean = Geometry.at(np.full((3, 2), 1 / 3), places, directions).axes[:, 0]
        made = cls(
            nodes.astype(np.int64), own, shear_stiffness(middles, D, across), times,
            np.zeros((len(nodes), 24)), numbers, stiffness, shear.reshape(-1, 2, 2),
            plane_stiffness(points, D), points.areas.sum(1), mean, places, points, middles,
            tuple(laws),
        )  # fmt: skip
        return replace(made, starts=made.changes(frames))

    def renumbered(self, nodes: IndexArray) -> Self:
        """The same triangles with other numbers (m, 9) of their nodes."""
        return replace(self, nodes=nodes.astype(np.int64))

    def set_starts(self, starts: FloatArray) -> None:
        """Set the covariant strains (m, 24) that have no stress."""
        self.starts[:] = starts

    @property
    def rest_maps(self) -> FloatArray:
        """Maps (m, 3, 6, 6) from strains along e1 and e2 at the points to covariant ones."""
        maps: FloatArray = np.linalg.inv(self._points.plane_maps)
        return maps

    @property
    def places(self) -> FloatArray:
        """Points (m, 3, 3) at which membrane strains and curvatures count, at the start, m."""
        found: FloatArray = np.einsum("pn,mnc->mpc", shapes(POINTS), self._places)
        return found

    def strains(self, frames: FloatArray) -> FloatArray:
        """Mean strains (m, 8) of the triangles."""
        at_points, at_middles = self._strains(frames)
        return np.concatenate([at_points.mean(1), at_middles.mean(1)], 1)

    def facing(self, frames: FloatArray) -> FloatArray:
        """Areas (m, 3) projected along the directors of the edges, relative to the start."""
        base = np.einsum("pan,mnc->mpac", slopes(MIDDLES), frames[self.nodes[:, :6], :3])
        turns = frames[self.nodes[:, 6:], 3:].reshape(-1, 3, 3, 3)
        directors = np.einsum("mkab,mkb->mka", turns, self.directors)
        seen = np.einsum("mkc,mkc->mk", np.cross(base[:, :, 0], base[:, :, 1]), directors)
        found: FloatArray = seen / (6.0 * self._middles.areas)
        return found

    def stresses(self, strains: FloatArray) -> FloatArray:
        """Forces n_11, n_22, n_12 (N/m), moments m_11, m_22, m_12 (N), shear forces (N/m).

        Shape (m, 8), for strains (m, 8).
        """
        plane = np.einsum("mij,mj->mi", self.stiffness[self.sections], strains[:, :6])
        for law in self.laws:
            own = np.ascontiguousarray(strains[law.rows, :6])
            plane[law.rows] = law.values.at(own, np.zeros_like(own), law.sections)[:, 1:7]
        across = np.einsum("mij,mj->mi", self.shear[self.sections], strains[:, 6:])
        return np.concatenate([plane, across], 1)

    def energies(self, frames: FloatArray) -> FloatArray:
        """Strain energies of membrane, bending, shear and all together, J, (m, 4)."""
        changes = self.changes(frames)
        plane, shear = changes[:, :18].reshape(-1, 3, 6), changes[:, 18:]
        membrane, bending = plane.copy(), plane.copy()
        membrane[..., 3:], bending[..., :3] = 0.0, 0.0
        sheared = np.einsum("mi,mij,mj->m", shear, self.shears, shear) / 2
        both = self._plane_energies(plane)
        parts = [self._plane_energies(membrane), self._plane_energies(bending)]
        return np.stack([*parts, sheared, both + sheared], 1)

    def total_energies(self, frames: FloatArray) -> FloatArray:
        """Strain energies (m,) of membrane, bending and shear together, J."""
        changes = self.changes(frames)
        shear = changes[:, 18:]
        sheared: FloatArray = np.einsum("mi,mij,mj->m", shear, self.shears, shear) / 2
        return sheared + self._plane_energies(changes[:, :18].reshape(-1, 3, 6))

    def _plane_energies(self, strains: FloatArray) -> FloatArray:
        """Strain energies (m,) of membrane and bending for covariant strains (m, 3, 6), J."""
        energies: FloatArray = 0.5 * np.einsum(
            "mpi,mpij,mpj->m", strains, self.planes, strains, optimize=True
        )
        law_energies(self.laws, self._points, strains, energies)
        return energies

    def changes(self, frames: FloatArray) -> FloatArray:
        """Changes (m, 24) of the covariant strains since the start."""
        strains, made = np.empty_like(self.starts), _cell_kernel(kernels.strains, 24)
        cells, nodes = self._cells.memory, self._at(frames)
        evaluate(made.memory, cells, nodes, _constants(), strains)
        strains -= self.starts
        return strains

    def rates(self, frames: FloatArray, steps: FloatArray) -> FloatArray:
        """Derivatives (m, 24) of the covariant strains along local twists (n, 6) of the nodes."""
        rates = np.empty_like(self.starts)
        made = _cell_kernel(kernels.strain_rates, 24, stepped=True)
        cells, nodes = self._cells.memory, self._at(frames, steps)
        evaluate(made.memory, cells, nodes, _constants(), rates)
        return rates

    @property
    def viscous(self) -> bool:
        """True if stresses depend on strain rates."""
        return bool(self.damping.any()) or any(law.values.viscous for law in self.laws)

    def elastic_stresses(self, frames: FloatArray) -> FloatArray:
        """Stresses (m, 24) of the present strains, times areas, all covariant."""
        found = self.linear_stresses(self.changes(frames))
        if self.laws:
            found[:, :18] = self.response(frames).stresses.reshape(-1, 18)
        return found

    def linear_stresses(self, changes: FloatArray) -> FloatArray:
        """Stresses (m, 24) of changes of strain (m, 24) without laws, times areas."""
        plane = np.einsum("mpij,mpj->mpi", self.planes, changes[:, :18].reshape(-1, 3, 6))
        shear = np.einsum("mij,mj->mi", self.shears, changes[:, 18:])
        return np.concatenate([plane.reshape(-1, 18), shear], 1)

    def viscous_stresses(self, frames: FloatArray, rates: FloatArray) -> FloatArray:
        """Viscous stresses (m, 24) of strain rates (m, 24), times areas, all covariant."""
        damped = self.damping[:, None] * rates
        plane = np.einsum("mpij,mpj->mpi", self.planes, damped[:, :18].reshape(-1, 3, 6))
        strains = self.changes(frames)[:, :18].reshape(-1, 3, 6)
        law_viscosity(self.laws, self._points, strains, rates[:, :18].reshape(-1, 3, 6), plane)
        shear = np.einsum("mij,mj->mi", self.shears, damped[:, 18:])
        return np.concatenate([plane.reshape(-1, 18), shear], 1)

    def response(
        self,
        frames: FloatArray,
        starts: FloatArray | None = None,
        rates: FloatArray | None = None,
        rate: float = 0.0,
    ) -> Response:
        """Stresses and stiffness of the present strains.

        Args:
            frames: present frames (n, 12).
            starts: as of :meth:`add_forces`.
            rates: of the strains, (m, 24); None to neglect them.
            rate: change of strain rates with strains, 1/s, included in the stiffness of a
                user-defined law.
        """
        if not self.laws:
            return Response(self.planes, _NO_STRESSES)
        strains = self.changes(frames)
        if starts is not None:
            strains += self.starts - starts
        moving = None if rates is None else rates[:, :18].reshape(-1, 3, 6)
        plane = strains[:, :18].reshape(-1, 3, 6)
        return law_response(self.laws, self._points, self.planes, plane, moving, rate)

    def add_forces(
        self,
        frames: FloatArray,
        residual: FloatArray,
        scale: float = 1.0,
        starts: FloatArray | None = None,
        response: Response | None = None,
    ) -> None:
        """Add ``scale`` times the internal forces and moments, N and N m, to the residual (n, 6).

        They are in the axes of the nodes. Corners get no moments. ``starts`` (m, 24) are taken in
        place of :attr:`starts`, less the contributions of rates or given strains. ``response`` is a
        result of :meth:`response`; without it, that of the same ``starts`` without rates.
        """
        begin, planes, stresses = self._present(frames, starts, response)
        if len(stresses):
            planes = self.planes  # forces of given stresses need no stiffness
        present = begin, planes, stresses
        call = self._call(kernels.forces, 27, self._at(frames), (scale, 0.0), present)
        add_forces(*call, 1.0, residual)

    def tangents(
        self,
        frames: FloatArray,
        factors: tuple[float, float] = (1.0, 0.0),
        starts: FloatArray | None = None,
        response: Response | None = None,
    ) -> FloatArray:
        """Derivatives of the internal forces, (m, 27, 27).

        They are those by local twists of the nodes times the first of the factors, plus those by
        local velocities times the second, without the change of strain rates by the rotation of the
        triangles. Rows and columns are the translations of the six nodes, then the rotations of the
        three with directors.
        """
        present = self._present(frames, starts, response)
        found = np.empty((len(self.nodes), 27 * 27))
        evaluate(*self._call(tangent, 27 * 27, self._at(frames), factors, present), found)
        return found.reshape(-1, 27, 27)

    def add_tangents(
        self,
        frames: FloatArray,
        index: IndexArray,
        blocks: FloatArray,
        factors: tuple[float, float] = (1.0, 0.0),
        starts: FloatArray | None = None,
        response: Response | None = None,
    ) -> None:
        """Add the derivatives of :meth:`tangents` to matrices (b, 6, 6) of pairs of nodes.

        ``index`` (m, 9, 9) are the numbers of the pairs.
        """
        present = self._present(frames, starts, response)
        call = self._call(tangent, 27 * 27, self._at(frames), factors, present)
        add_blocks(*call, index, blocks)

    def add_action(
        self,
        frames: FloatArray,
        steps: FloatArray,
        residual: FloatArray,
        factors: tuple[float, float] = (1.0, 0.0),
        starts: FloatArray | None = None,
        response: Response | None = None,
    ) -> None:
        """Add the derivatives of :meth:`tangents` times steps to the residual, (n, 6) both."""
        present, nodes = self._present(frames, starts, response), self._at(frames, steps)
        call = self._call(kernels.action, 27, nodes, factors, present, stepped=True)
        add_forces(*call, 1.0, residual)

    def masses(self, density: FloatArray) -> FloatArray:
        """Consistent masses (m, 6, 6), kg, constant with translations in inertial axes.

        Args:
            density: mass per area of each triangle, kg/m^2, (m,).
        """
        return consistent_masses(self._places, density)

    def lumped_masses(self, density: FloatArray) -> FloatArray:
        """Diagonal masses (m, 6, 6), kg, in the proportions of the consistent diagonal.

        Hinton, Rock, Zienkiewicz, Earthq. Eng. Struct. Dyn. 4 (1976) 245-249.
        """
        consistent = self.masses(density)
        diagonal = np.einsum("mii->mi", consistent).copy()
        diagonal *= (consistent.sum((1, 2)) / diagonal.sum(1))[:, None]
        lumped: FloatArray = diagonal[:, :, None] * np.eye(6)
        return lumped

    def rods(self, inertia: FloatArray) -> FloatArray:
        """Inertia of the directors (m, 3, 3, 3), kg m^2, in the axes of their frames.

        Linear functions that are one at the midpoint of an edge and zero at the others are
        orthogonal: a third of each triangle rotates with each of its directors, as a rigid rod.

        Args:
            inertia: of each triangle, density times thickness^3 / 12, kg, (m,).
        """
        across = np.eye(3) - np.einsum("mka,mkb->mkab", self.directors, self.directors)
        rods: FloatArray = (inertia * self.areas / 3.0)[:, None, None, None] * across
        return rods

    def _strains(self, frames: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Strains (m, 3, 6) at the points, (m, 3, 2) at the midpoints of edges, along e1, e2."""
        changes = self.changes(frames)
        plane = changes[:, :18].reshape(-1, 3, 2, 3)
        turned = np.einsum("mpij,mpsj->mpsi", self._points.strain_maps, plane)
        sheared = np.einsum("mpij,mpj->mpi", self._middles.maps, changes[:, 18:].reshape(-1, 3, 2))
        return turned.reshape(-1, 3, 6), sheared

    def _present(
        self, frames: FloatArray, starts: FloatArray | None, response: Response | None
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Strains at the start, stiffness and stresses."""
        own = self.response(frames, starts) if response is None else response
        return self.starts if starts is None else starts, own.planes, own.stresses

    def _at(self, frames: FloatArray, steps: FloatArray | None = None) -> Memory:
        """Record of the nodes."""
        self._nodes.frames = frames
        if steps is not None:
            self._nodes.steps = steps
        return self._nodes.memory

    def _call(
        self, kernel: ByHand, size: int, nodes: Memory, factors: tuple[float, float],
        present: tuple[FloatArray, FloatArray, FloatArray], *, stepped: bool = False,
    ) -> tuple[Memory, Memory, Memory, FloatArray]:  # fmt: skip
        """Kernel, cells, nodes and constants for a result of :meth:`_present`."""
        starts, planes, stresses = present
        cells, given = self._cells, len(stresses) > 0
        if planes is not self.planes:
            cells = plain_cells(self.starts, cells.nodes, self._rows(planes))
        cells.own = np.concatenate([starts, stresses], axis=1) if given else starts
        made = _cell_kernel(kernel, size, given=given, stepped=stepped)
        return made.memory, cells.memory, nodes, _constants(factors, given)


def _constants(factors: tuple[float, float] = (1.0, 0.0), given: bool = False) -> FloatArray:
    """Constants of kernels, see ``steps``."""
    return np.array([*factors, given], dtype=np.float64)
