# SPDX-License-Identifier: LGPL-3.0-or-later
"""Triangles of shells with strains and derivatives from UFL forms.

They replace the hand-written kernels, with the same maps from nodes to points and the same section
laws, so that a shell is assembled from its UFL forms. They verify the kernels, and are the place to
start with another measure of strain.
"""

from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any, Self, override

import numpy as np

from flexfem._types import FloatArray, IndexArray
from flexfem.families.common.corotating_loops import add_blocks
from flexfem.families.shell_director.law import Response as DirectorResponse
from flexfem.families.shell_director.tables import BARYCENTRIC, MIDDLES, POINTS, slopes
from flexfem.families.shell_director.triangles import UNKNOWNS, DirectorTriangles
from flexfem.families.shell_rotation_free.triangles import Response, RotationFreeTriangles
from flexfem.families.shells.strain_kernels import StrainKernels
from flexfem.forms.director_shell import MEMBRANE_PLACES, membrane_weights
from flexfem.kernels.driver import ALL_COLUMNS, add_products
from flexfem.kernels.lanes import in_rows
from flexfem.lie import so3

__all__ = ["UFLDirectorTriangles", "UFLRotationFreeTriangles"]

_ALL = slice(None)
#: Triangles whose matrices are computed at a time: they stay in the cache.
_CHUNK = 128


def _fields(triangles: RotationFreeTriangles | DirectorTriangles) -> dict[str, Any]:
    """Values of the fields of triangles by name."""
    return {part.name: getattr(triangles, part.name) for part in fields(triangles) if part.init}


@dataclass(frozen=True)
class UFLRotationFreeTriangles(RotationFreeTriangles):
    """Rotation-free triangles with the strains of ``forms.shell``."""

    kernels: StrainKernels = field(kw_only=True)

    @classmethod
    def of(cls, triangles: RotationFreeTriangles, kernels: StrainKernels) -> Self:
        """The same triangles with kernels of ``forms.strain_forms.rotation_free_strains``."""
        return cls(**_fields(triangles), kernels=kernels)

    @cached_property
    def _to_points(self) -> FloatArray:
        """Maps (m, 5, p) from nodal positions to the vectors of a point."""
        patches = self.patches
        maps = np.zeros((len(patches.areas), 5, patches.nodes.shape[1]))
        maps[:, :2, : patches.membrane.shape[2]] = patches.membrane
        maps[:, 2:] = patches.curvatures
        found: FloatArray = np.where((patches.nodes >= 0)[:, None], maps, 0.0)
        return found

    def _vectors(self, values: FloatArray, rows: slice = _ALL) -> FloatArray:
        """The vectors (m, 5, 3) of nodal values; those relative to a node keep their digits."""
        own = values[self.patches.nodes[rows]]
        vectors: FloatArray = self._to_points[rows] @ (own - own[:, :1])
        return vectors

    def _unknowns(self, points: FloatArray, rows: slice = _ALL) -> FloatArray:
        """Unknowns (m, 15) of the forms."""
        vectors = self._vectors(points, rows)
        vectors[:, 2:] += self.offsets[rows]
        return vectors.reshape(-1, 15)

    def _strains_of(
        self, unknowns: FloatArray, rows: slice = _ALL
    ) -> tuple[FloatArray, FloatArray]:
        """Strains (m, 6) since the start, and their derivatives (m, 6, 15) by the unknowns."""
        strains, rates = self.kernels.strains(unknowns)
        return strains - self.starts[rows], rates

    @override
    def strains(self, points: FloatArray) -> FloatArray:
        return self._strains_of(self._unknowns(points))[0]

    @override
    def strain_rates(self, points: FloatArray, velocities: FloatArray) -> FloatArray:
        _, rates = self._strains_of(self._unknowns(points))
        moved = self._vectors(velocities).reshape(-1, 15)
        found: FloatArray = np.einsum("mij,mj->mi", rates, moved)
        return found

    def _stresses_of(
        self, strains: FloatArray, response: Response | None, rows: slice = _ALL
    ) -> tuple[FloatArray, FloatArray]:
        """Stresses (m, 6) and stiffness (m, 6, 6), both times the areas."""
        (sections, matrices, given), areas = self._material(response), self.patches.areas
        stiffness = areas[rows, None, None] * matrices[sections[rows]]
        if len(given):
            return areas[rows, None] * given[rows], stiffness
        return np.einsum("mij,mj->mi", stiffness, strains), stiffness

    @override
    def add_forces(
        self, points: FloatArray, residual: FloatArray, scale: float = 1.0,
        response: Response | None = None,
    ) -> None:  # fmt: skip
        strains, rates = self._strains_of(self._unknowns(points))
        stresses, _ = self._stresses_of(strains, response)
        forces = _transposed_times(rates, scale * stresses).reshape(-1, 5, 3)
        self._scatter(np.swapaxes(self._to_points, 1, 2) @ forces, residual)

    @override
    def add_damped_forces(
        self, points: FloatArray, velocities: FloatArray, residual: FloatArray
    ) -> None:
        self.add_forces(points, residual, response=self.response(points, velocities))

    def _scatter(self, forces: FloatArray, residual: FloatArray) -> None:
        """Add forces (m, p, 3) of the triangles to their nodes (n, 3)."""
        there = self.patches.nodes >= 0
        np.add.at(residual, self.patches.nodes[there], forces[there])

    @override
    def tangents(
        self, points: FloatArray, factors: tuple[float, float] = (1.0, 0.0),
        response: Response | None = None, rows: slice = _ALL,
    ) -> FloatArray:  # fmt: skip
        unknowns = self._unknowns(points, rows)
        strains, rates = self._strains_of(unknowns, rows)
        stresses, stiffness = self._stresses_of(strains, response, rows)
        inner = self.kernels.geometric(unknowns, factors[0] * stresses)
        weight = factors[0] + factors[1] * self.damping[rows]
        inner += np.swapaxes(rates, 1, 2) @ (weight[:, None, None] * stiffness) @ rates
        return _to_nodes(self._to_points[rows], inner).reshape(-1, self._width, self._width)

    @override
    def add_tangents(
        self, points: FloatArray, index: IndexArray, blocks: FloatArray,
        factors: tuple[float, float] = (1.0, 0.0), response: Response | None = None,
    ) -> None:  # fmt: skip
        for first in range(0, len(index), _CHUNK):
            rows = slice(first, first + _CHUNK)
            tangents = self.tangents(points, factors, response, rows)
            add_blocks(tangents, index, first, blocks)

    @override
    def add_action(
        self, points: FloatArray, steps: FloatArray, residual: FloatArray,
        factors: tuple[float, float] = (1.0, 0.0), response: Response | None = None,
    ) -> None:  # fmt: skip
        tangents = in_rows(self.tangents(points, factors, response))
        add_products(ALL_COLUMNS, self._cells.memory, tangents, steps, 1.0, False, residual)


def _director_places() -> tuple[FloatArray, FloatArray]:
    """Maps (12, 5, 8) from nodes to the vectors of points, and (24, 12, 8) from there to strains.

    The points are those of the membrane (9), whose last three are the midpoints of the edges, and
    those of the curvatures (3). Nodes are five relative positions and three directors.
    """
    places = np.concatenate([MEMBRANE_PLACES, POINTS])
    x, y = places.T
    vectors = np.zeros((len(places), 5, 8))
    vectors[:, :2, :5] = slopes(places)[:, :, 1:]
    # functions of directors: one at the midpoint of their edge, zero at the others
    vectors[:, 2, 5:] = 1.0 - 2.0 * np.stack([1.0 - x - y, x, y], 1)
    vectors[:, 3:, 5:] = -2.0 * BARYCENTRIC.T
    strains = np.zeros((24, len(places), 8))
    for p, place in enumerate(POINTS.tolist()):
        strains[6 * p : 6 * p + 3, :9, :3] = np.array(membrane_weights(tuple(place)), dtype=float)
        strains[6 * p + 3 : 6 * p + 6, 9 + p, 3:6] = np.eye(3)
    for k in range(len(MIDDLES)):
        strains[18 + 2 * k : 20 + 2 * k, 6 + k, 6:] = np.eye(2)
    return vectors, strains


_TO_POINTS, _TO_STRAINS = _director_places()


@dataclass(frozen=True)
class UFLDirectorTriangles(DirectorTriangles):
    """Director triangles with the strains of ``forms.director_shell``."""

    kernels: StrainKernels = field(kw_only=True)

    @classmethod
    def of(cls, triangles: DirectorTriangles, kernels: StrainKernels) -> Self:
        """The same triangles with kernels of ``forms.strain_forms.director_strains``."""
        return cls(**_fields(triangles), kernels=kernels)

    def _turns(self, frames: FloatArray, rows: slice) -> FloatArray:
        """Rotations (m, 3, 3, 3) of the frames that carry the directors."""
        turns: FloatArray = frames[self.nodes[rows, 6:], 3:].reshape(-1, 3, 3, 3)
        return turns

    def _unknowns(self, frames: FloatArray, rows: slice = _ALL) -> FloatArray:
        """Unknowns (12 m, 15) of the forms at the points."""
        places = frames[self.nodes[rows, :6], :3]
        directors = np.einsum("mkab,mkb->mka", self._turns(frames, rows), self.directors[rows])
        own = np.concatenate([places[:, 1:] - places[:, :1], directors], 1)
        unknowns: FloatArray = _TO_POINTS.reshape(-1, 8) @ own
        return unknowns.reshape(-1, 15)

    def _covariant(self, unknowns: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Covariant strains (m, 24), not since the start, and derivatives (m, 24, 24) by vectors.

        These are the five relative positions and three directors.
        """
        products, rates = self.kernels.strains(unknowns)
        to_strains, count = _TO_STRAINS.reshape(24, -1), len(_TO_POINTS)
        strains = products.reshape(-1, 8 * count) @ to_strains.T
        by_points = np.swapaxes(rates.reshape(-1, count, 8, 5, 3), 3, 4)
        by_nodes = np.swapaxes(by_points @ _TO_POINTS[:, None, :, :], 3, 4)
        return strains, to_strains @ by_nodes.reshape(len(strains), 8 * count, 24)

    def _levers(self, frames: FloatArray, rows: slice = _ALL) -> FloatArray:
        """Derivatives (m, 24, 27) of relative positions and directors by the unknowns."""
        nodes = self.nodes[rows]
        levers = np.zeros((len(nodes), 8, 3, 27))
        turns = frames[nodes[:, :6], 3:].reshape(-1, 6, 3, 3)
        for i in range(1, 6):
            levers[:, i - 1, :, 3 * i : 3 * i + 3] = turns[:, i]
            levers[:, i - 1, :, :3] = -turns[:, 0]
        turned = -self._turns(frames, rows) @ so3.skew(self.directors[rows])
        for k in range(3):
            levers[:, 5 + k, :, 18 + 3 * k : 21 + 3 * k] = turned[:, k]
        return levers.reshape(-1, 24, 27)

    @override
    def changes(self, frames: FloatArray) -> FloatArray:
        return self._covariant(self._unknowns(frames))[0] - self.starts

    @override
    def rates(self, frames: FloatArray, steps: FloatArray) -> FloatArray:
        _, by_vectors = self._covariant(self._unknowns(frames))
        moved = self._levers(frames) @ self._own_steps(steps)[:, :, None]
        found: FloatArray = (by_vectors @ moved)[:, :, 0]
        return found

    def _own_steps(self, steps: FloatArray) -> FloatArray:
        """Steps (m, 27) of the unknowns: translations of the nodes, rotations of the directors."""
        moved, turned = steps[self.nodes[:, :6], :3], steps[self.nodes[:, 6:], 3:]
        return np.concatenate([moved, turned], 1).reshape(-1, 27)

    def _stresses_of(
        self, strains: FloatArray, starts: FloatArray, response: DirectorResponse, rows: slice
    ) -> tuple[FloatArray, FloatArray]:
        """Covariant stresses (m, 24) and stiffness (m, 24, 24), times areas."""
        stiffness = np.zeros((len(strains), 24, 24))
        for p in range(3):
            part = slice(6 * p, 6 * p + 6)
            stiffness[:, part, part] = response.planes[rows, p]
        stiffness[:, 18:, 18:] = self.shears[rows]
        stresses = np.einsum("mij,mj->mi", stiffness, strains - starts[rows])
        if len(response.stresses):
            stresses[:, :18] = response.stresses[rows]
        return stresses, stiffness

    @override
    def add_forces(
        self,
        frames: FloatArray,
        residual: FloatArray,
        scale: float = 1.0,
        starts: FloatArray | None = None,
        response: DirectorResponse | None = None,
    ) -> None:
        begin, planes, given = self._present(frames, starts, response)
        strains, by_vectors = self._covariant(self._unknowns(frames))
        stresses, _ = self._stresses_of(strains, begin, DirectorResponse(planes, given), _ALL)
        forces = _transposed_times(by_vectors, scale * stresses)
        self._scatter(_transposed_times(self._levers(frames), forces), residual)

    def _scatter(self, forces: FloatArray, residual: FloatArray) -> None:
        """Add forces (m, 27) of the unknowns to the nodes (n, 6)."""
        split = forces.reshape(-1, 9, 3)
        np.add.at(residual[:, :3], self.nodes[:, :6], split[:, :6])
        np.add.at(residual[:, 3:], self.nodes[:, 6:], split[:, 6:])

    @override
    def tangents(
        self,
        frames: FloatArray,
        factors: tuple[float, float] = (1.0, 0.0),
        starts: FloatArray | None = None,
        response: DirectorResponse | None = None,
        rows: slice = _ALL,
    ) -> FloatArray:
        begin, planes, given = self._present(frames, starts, response)
        unknowns = self._unknowns(frames, rows)
        strains, by_vectors = self._covariant(unknowns)
        own = DirectorResponse(planes, given)
        stresses, stiffness = self._stresses_of(strains, begin, own, rows)
        stresses = factors[0] * stresses
        at_points = stresses @ _TO_STRAINS.reshape(24, -1)
        inner = self.kernels.geometric(unknowns, at_points.reshape(-1, 8))
        split = inner.reshape(-1, len(_TO_POINTS), 15, 15)
        second = _to_nodes(_TO_POINTS, split).sum(1).reshape(-1, 24, 24)
        weight = factors[0] + factors[1] * self.damping[rows]
        material = weight[:, None, None] * stiffness
        second += np.swapaxes(by_vectors, 1, 2) @ material @ by_vectors
        levers = self._levers(frames, rows)
        tangents: FloatArray = np.swapaxes(levers, 1, 2) @ second @ levers
        forces = _transposed_times(by_vectors, stresses).reshape(-1, 8, 3)
        self._add_turns(frames, forces, rows, tangents)
        return tangents

    def _add_turns(
        self, frames: FloatArray, forces: FloatArray, rows: slice, tangents: FloatArray
    ) -> None:
        """Add changes of forces (m, 8, 3) in nodal axes by rotations of director nodes."""
        nodes, turns, directors = self.nodes[rows], self._turns(frames, rows), self.directors[rows]
        pulled = np.einsum("mkba,mkb->mka", turns, forces[:, 2:5])
        levered = np.einsum("mkba,mkb->mka", turns, forces[:, 5:])
        inner = np.einsum("mka,mka->mk", levered, directors)
        spins = np.einsum("mka,mkb->mkab", levered, directors)
        spins -= inner[:, :, None, None] * np.eye(3)
        # a midside node whose axes rotate with its director
        shifts = np.where((nodes[:, 3:6] == nodes[:, 6:])[:, :, None, None], so3.skew(pulled), 0.0)
        for k in range(3):
            turned = slice(18 + 3 * k, 21 + 3 * k)
            tangents[:, turned, turned] += spins[:, k]
            tangents[:, 9 + 3 * k : 12 + 3 * k, turned] += shifts[:, k]

    @override
    def add_tangents(
        self,
        frames: FloatArray,
        index: IndexArray,
        blocks: FloatArray,
        factors: tuple[float, float] = (1.0, 0.0),
        starts: FloatArray | None = None,
        response: DirectorResponse | None = None,
    ) -> None:
        columns = np.repeat([0, 3], [6, 3])[:, None] + np.arange(3)
        for first in range(0, len(index), _CHUNK):
            rows = slice(first, first + _CHUNK)
            tangents = self.tangents(frames, factors, starts, response, rows)
            split = tangents.reshape(-1, 9, 3, 9, 3).transpose(0, 1, 3, 2, 4)
            to = index[rows][..., None, None]
            np.add.at(blocks, (to, columns[:, None, :, None], columns[None, :, None, :]), split)

    @override
    def add_action(
        self,
        frames: FloatArray,
        steps: FloatArray,
        residual: FloatArray,
        factors: tuple[float, float] = (1.0, 0.0),
        starts: FloatArray | None = None,
        response: DirectorResponse | None = None,
    ) -> None:
        tangents = in_rows(self.tangents(frames, factors, starts, response))
        add_products(UNKNOWNS, self._cells.memory, tangents, steps, 1.0, False, residual)


def _transposed_times(matrices: FloatArray, values: FloatArray) -> FloatArray:
    """Transposes of matrices (m, i, j) times values (m, i), (m, j)."""
    found: FloatArray = (values[:, None, :] @ matrices)[:, 0]
    return found


def _to_nodes(maps: FloatArray, inner: FloatArray) -> FloatArray:
    """Matrices (..., 3 s, 3 s) of vectors of points as those (..., p, 3, p, 3) of nodes.

    Args:
        maps: from p nodes to s vectors, (..., s, p).
        inner: the matrices.
    """
    s, p = maps.shape[-2:]
    shape = inner.shape[:-2]
    rows = np.swapaxes(maps, -1, -2) @ inner.reshape(*shape, s, 9 * s)
    split = np.swapaxes(rows.reshape(*shape, p, 3, s, 3), -1, -2)
    return np.swapaxes(split @ maps[..., None, None, :, :], -1, -2)
