# SPDX-License-Identifier: LGPL-3.0-or-later
"""Director triangles: energy, internal forces, tangents and masses from frames of their nodes.

The energy is that of ``forms.director_shell``: quadratic positions, and one director in the middle
of each edge, which a frame there carries. Differentiated by hand, a tangent costs a fraction of
what the generated code of the form takes; the form is what the loops are compared with.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from flexfem._types import FloatArray, IndexArray, IntArray
from flexfem.elements.director_loops import add_forces, strain_rates_into, strains_into
from flexfem.elements.director_tables import MIDDLES, POINTS, REDUCTION, slopes
from flexfem.elements.director_tangent import add_action, tangents_into
from flexfem.forms.director_shell import RELAXATION
from flexfem.mesh.normals import projected

__all__ = ["DirectorTriangles"]


@dataclass(frozen=True)
class _Geometry:
    """Of the start, at three points of each triangle.

    Attributes:
        axes: orthonormal e1, e2, e3, rows, (m, 3, 3, 3).
        maps: components of e_1, e_2 in the covariant base vectors, (m, 3, 2, 2).
        areas: that the points stand for, m^2, (m, 3).
    """

    axes: FloatArray
    maps: FloatArray
    areas: FloatArray

    @classmethod
    def at(cls, points: FloatArray, places: FloatArray, directions: FloatArray | None) -> Self:
        """Geometry at points (3, 2) of triangles whose nodes are at places (m, 6, 3)."""
        base = np.einsum("pan,mnc->mpac", slopes(points), places)
        normals = np.cross(base[:, :, 0], base[:, :, 1])
        sizes = np.linalg.norm(normals, axis=2)
        normals /= sizes[..., None]
        along = places[:, 1] - places[:, 0] if directions is None else directions
        first = np.broadcast_to(along[:, None], normals.shape)
        e1 = projected(first, normals, places[:, 3:])
        axes = np.stack([e1, np.cross(normals, e1), normals], 2)
        maps = np.linalg.inv(np.einsum("mpac,mpbc->mpab", base, axes[:, :, :2]))
        return cls(axes, maps, sizes / 6.0)

    @property
    def strain_maps(self) -> FloatArray:
        """Maps (m, 3, 3, 3) from covariant strains to those along e1, e2."""
        (a, b), (c, d) = np.moveaxis(self.maps, (2, 3), (0, 1))
        rows = [[a * a, b * b, a * b], [c * c, d * d, c * d], [2 * a * c, 2 * b * d, a * d + b * c]]
        return np.stack([np.stack(row, -1) for row in rows], -2)


@dataclass(frozen=True)
class DirectorTriangles:
    """Triangles on this rank.

    Frames are those of all local nodes, (n, 12). Strains and resultants are in the axes of the
    start: membrane 11, 22, 12, curvatures or moments 11, 22, 12, shear 1, 2.

    Attributes:
        nodes: corners, then middles of the opposite edges, (m, 6).
        directors: d_0 in the axes of the frames in the middles, (m, 3, 3).
        starts: covariant strains at the start, (m, 24).
        sections: which stiffness a triangle has, (m,).
        stiffness: of membrane and bending, N/m, N and N m, (s, 6, 6).
        shear: across the thickness, N/m, (s, 2, 2).
        planes: stiffness of covariant strains times areas, (m, 3, 6, 6).
        shears: the same of the shear, relaxed, (m, 6, 6).
        areas: m^2, (m,).
        axes: e1, e2, e3 of the start, rows, amid the triangles, (m, 3, 3).
        damping: stiffness-proportional, s, (m,).
    """

    nodes: IndexArray
    directors: FloatArray
    starts: FloatArray
    sections: IntArray
    stiffness: FloatArray
    shear: FloatArray
    planes: FloatArray
    shears: FloatArray
    areas: FloatArray
    axes: FloatArray
    damping: FloatArray
    _places: FloatArray
    _points: _Geometry
    _middles: _Geometry

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
    ) -> Self:
        """Triangles free of stress at the given frames.

        Args:
            nodes: corners, then middles of the opposite edges, (m, 6).
            frames: of the nodes at the start, (n, 12).
            directors: unit vectors at the start, inertial axes, (m, 3, 3).
            stiffness: matrices (6, 6) or (s, 6, 6).
            shear: matrices (2, 2) or (s, 2, 2).
            sections: number of the stiffness of each triangle (m,); None for the first.
            directions: whose projection e1 is, (m, 3); None for the direction of edge 2.
            damping: stiffness-proportional damping, s, (m,); None for none.

        Raises:
            ValueError: A direction is normal to its triangle.
        """
        places, stiffness = frames[nodes, :3], stiffness.reshape(-1, 6, 6)
        turns = frames[nodes[:, 3:], 3:].reshape(-1, 3, 3, 3)
        own = np.einsum("mkba,mkb->mka", turns, directors)
        starts = np.empty((len(nodes), 24))
        strains_into(frames, nodes, own, starts)
        points, middles = (_Geometry.at(at, places, directions) for at in (POINTS, MIDDLES))
        numbers = np.zeros(len(nodes), np.int64) if sections is None else sections.astype(np.int64)
        D, across = stiffness[numbers], shear.reshape(-1, 2, 2)[numbers]
        times = np.zeros(len(nodes)) if damping is None else damping
        mean = _Geometry.at(np.full((3, 2), 1 / 3), places, directions).axes[:, 0]
        return cls(
            nodes, own, starts, numbers, stiffness, shear.reshape(-1, 2, 2),
            _plane_stiffness(points, D), _shear_stiffness(middles, D, across),
            points.areas.sum(1), mean, times, places, points, middles,
        )  # fmt: skip

    def strains(self, frames: FloatArray) -> FloatArray:
        """Mean strains (m, 8) of the triangles."""
        at_points, at_middles = self._strains(frames)
        return np.concatenate([at_points.mean(1), at_middles.mean(1)], 1)

    def stresses(self, strains: FloatArray) -> FloatArray:
        """Forces n_11, n_22, n_12 (N/m), moments m_11, m_22, m_12 (N), shear forces (N/m).

        Shape (m, 8), for strains (m, 8).
        """
        plane = np.einsum("mij,mj->mi", self.stiffness[self.sections], strains[:, :6])
        across = np.einsum("mij,mj->mi", self.shear[self.sections], strains[:, 6:])
        return np.concatenate([plane, across], 1)

    def energies(self, frames: FloatArray) -> FloatArray:
        """Strain energies of membrane, bending, shear and all together, J, (m, 4)."""
        changes = self.changes(frames)
        plane, shear = changes[:, :18].reshape(-1, 3, 6), changes[:, 18:]
        parts = [
            np.einsum(
                "mpi,mpij,mpj->m", plane[:, :, part], self.planes[:, :, part, part],
                plane[:, :, part],
            ) / 2
            for part in (slice(3), slice(3, 6))
        ]  # fmt: skip
        sheared = np.einsum("mi,mij,mj->m", shear, self.shears, shear) / 2
        return np.stack([*parts, sheared, self._energies(changes)], 1)

    def total_energies(self, frames: FloatArray) -> FloatArray:
        """Strain energies (m,) of membrane, bending and shear together, J."""
        return self._energies(self.changes(frames))

    def _energies(self, changes: FloatArray) -> FloatArray:
        """Strain energies (m,) for changes (m, 24) of the covariant strains, J."""
        energies: FloatArray = 0.5 * (changes * self.weighted(changes)).sum(axis=1)
        return energies

    def changes(self, frames: FloatArray) -> FloatArray:
        """Changes (m, 24) of the covariant strains since the start."""
        strains = np.empty_like(self.starts)
        strains_into(frames, self.nodes, self.directors, strains)
        strains -= self.starts
        return strains

    def rates(self, frames: FloatArray, steps: FloatArray) -> FloatArray:
        """Derivatives (m, 24) of the covariant strains along local twists (n, 6) of the nodes."""
        rates = np.empty_like(self.starts)
        strain_rates_into(frames, steps, self.nodes, self.directors, rates)
        return rates

    def weighted(self, strains: FloatArray) -> FloatArray:
        """Stresses (m, 24) of covariant strains (m, 24), times the areas that they stand for."""
        plane = np.einsum("mpij,mpj->mpi", self.planes, strains[:, :18].reshape(-1, 3, 6))
        shear = np.einsum("mij,mj->mi", self.shears, strains[:, 18:])
        return np.concatenate([plane.reshape(-1, 18), shear], 1)

    def add_forces(
        self,
        frames: FloatArray,
        residual: FloatArray,
        scale: float = 1.0,
        starts: FloatArray | None = None,
    ) -> None:
        """Add ``scale`` times the internal forces and moments, N and N m, to the residual (n, 6).

        They are in the axes of the nodes. Corners get no moments. ``starts`` (m, 24) are taken in
        place of :attr:`starts`, less what rates or assumptions add to the strains.
        """
        add_forces(frames, *self._data(starts), scale, residual)

    def tangents_into(
        self,
        frames: FloatArray,
        tangents: FloatArray,
        factors: tuple[float, float] = (1.0, 0.0),
        starts: FloatArray | None = None,
        first: int = 0,
    ) -> None:
        """Write derivatives of the internal forces, (r, 36, 36).

        They are those by local twists of the nodes times the first of the factors, plus those by
        local velocities times the second, but for how strain rates change as triangles turn, of the
        r triangles from ``first`` on. Rows and columns of turns of the corners are zero.
        """
        data = self._data(starts)
        tangents_into(frames, *data, np.array(factors), self.damping, first, tangents)

    def add_action(
        self,
        frames: FloatArray,
        steps: FloatArray,
        residual: FloatArray,
        factors: tuple[float, float] = (1.0, 0.0),
        starts: FloatArray | None = None,
    ) -> None:
        """Add the derivatives of :meth:`tangents_into` times steps to the residual, (n, 6) both."""
        add_action(frames, steps, *self._data(starts), np.array(factors), self.damping, residual)

    def masses(self, density: FloatArray) -> FloatArray:
        """Consistent masses (m, 6, 6), kg, constant with translations in inertial axes.

        Args:
            density: mass per area of each triangle, kg/m^2, (m,).
        """
        lengths = np.linalg.norm(_area_vectors(self._places), axis=2) * _WEIGHTS
        masses: FloatArray = np.einsum("m,mp,pi,pj->mij", density, lengths, _SHAPES, _SHAPES)
        return masses

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

        Linear functions that are one in the middle of an edge and zero in the others' are
        orthogonal: a third of each triangle turns with each of its directors, as a rigid rod.

        Args:
            inertia: of each triangle, density times thickness^3 / 12, kg, (m,).
        """
        across = np.eye(3) - np.einsum("mka,mkb->mkab", self.directors, self.directors)
        rods: FloatArray = (inertia * self.areas / 3.0)[:, None, None, None] * across
        return rods

    def _strains(self, frames: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Strains (m, 3, 6) at the points, (m, 3, 2) at the middles, along e1, e2."""
        changes = self.changes(frames)
        plane = changes[:, :18].reshape(-1, 3, 2, 3)
        turned = np.einsum("mpij,mpsj->mpsi", self._points.strain_maps, plane)
        sheared = np.einsum("mpij,mpj->mpi", self._middles.maps, changes[:, 18:].reshape(-1, 3, 2))
        return turned.reshape(-1, 3, 6), sheared

    def _data(
        self, starts: FloatArray | None
    ) -> tuple[IndexArray, FloatArray, FloatArray, FloatArray, FloatArray]:
        present = self.starts if starts is None else starts
        return self.nodes, self.directors, present, self.planes, self.shears


def _plane_stiffness(points: _Geometry, stiffness: FloatArray) -> FloatArray:
    """Stiffness (m, 3, 6, 6) of covariant membrane strains and curvatures times areas."""
    maps = np.zeros((*points.areas.shape, 6, 6))
    maps[..., :3, :3] = maps[..., 3:, 3:] = points.strain_maps
    result: FloatArray = np.einsum(
        "mp,mpki,mkl,mplj->mpij", points.areas, maps, stiffness, maps, optimize=True
    )
    return result


def _shear_stiffness(middles: _Geometry, stiffness: FloatArray, shear: FloatArray) -> FloatArray:
    """Stiffness (m, 6, 6) of covariant shear strains times areas.

    What is beyond the edge element counts less, see ``forms.director_shell``.
    """
    whole = np.zeros((len(shear), 6, 6))
    for k in range(3):
        at = slice(2 * k, 2 * k + 2)
        whole[:, at, at] = np.einsum(
            "m,mki,mkl,mlj->mij", middles.areas[:, k], middles.maps[:, k], shear,
            middles.maps[:, k],
        )  # fmt: skip
    slender = middles.areas.sum(1) * np.trace(shear, axis1=1, axis2=2)
    slender /= stiffness[:, 3, 3] + stiffness[:, 4, 4]
    rest = np.eye(6) - REDUCTION
    factor = 1.0 / (1.0 + RELAXATION * slender)
    reduced = REDUCTION.T @ whole @ REDUCTION
    result: FloatArray = reduced + factor[:, None, None] * (rest.T @ whole @ rest)
    return result


# Quadrature of masses, exact to degree 4 (Dunavant, Int. J. Numer. Meth. Eng. 21 (1985) 1129-1148)
_A, _B = 0.445948490915965, 0.091576213509771
_WEIGHTS = np.repeat([0.223381589678011 / 2, 0.109951743655322 / 2], 3)
_PLACES = np.array([[p, p] for p in (_A,)] + [[1 - 2 * _A, _A], [_A, 1 - 2 * _A]])
_PLACES = np.concatenate([_PLACES, [[_B, _B], [1 - 2 * _B, _B], [_B, 1 - 2 * _B]]])


def _shapes(points: FloatArray) -> FloatArray:
    """Quadratic shape functions (p, 6) at points (p, 2)."""
    x, y = points.T
    own = np.stack([1 - x - y, x, y], 1)
    return np.concatenate([own * (2 * own - 1), 4 * np.roll(own, -1, 1) * np.roll(own, -2, 1)], 1)


_SHAPES = _shapes(_PLACES)


def _area_vectors(places: FloatArray) -> FloatArray:
    """Vector areas (m, p, 3) at the quadrature points of masses, of the reference triangle."""
    base = np.einsum("pan,mnc->mpac", slopes(_PLACES), places)
    return np.cross(base[:, :, 0], base[:, :, 1])
