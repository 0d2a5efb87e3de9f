# SPDX-License-Identifier: LGPL-3.0-or-later
"""Geometry of director triangles at the start, and the stiffness and masses that follow from it."""

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from flexfem._types import FloatArray
from flexfem.families.shell_director.tables import DEGREE_4, REDUCTION, shapes, slopes
from flexfem.forms.director_shell import RELAXATION
from flexfem.mesh.geometry.normals import projected

__all__ = ["Geometry", "consistent_masses", "plane_stiffness", "shear_stiffness"]


@dataclass(frozen=True)
class Geometry:
    """Geometry at the start at three points of each triangle.

    Attributes:
        axes: orthonormal e1, e2, e3, rows, (m, 3, 3, 3).
        maps: components of e_1, e_2 in the covariant base vectors, (m, 3, 2, 2).
        areas: areas that the points represent, m^2, (m, 3).
    """

    axes: FloatArray
    maps: FloatArray
    areas: FloatArray

    @classmethod
    def at(cls, points: FloatArray, places: FloatArray, directions: FloatArray | None) -> Self:
        """Geometry at points (3, 2) of triangles with nodes at positions (m, 6, 3)."""
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

    @cached_property
    def plane_maps(self) -> FloatArray:
        """Maps (m, 3, 6, 6) from covariant membrane strains and curvatures to local ones."""
        maps = np.zeros((*self.areas.shape, 6, 6))
        maps[..., :3, :3] = maps[..., 3:, 3:] = self.strain_maps
        return maps


def plane_stiffness(points: Geometry, stiffness: FloatArray) -> FloatArray:
    """Stiffness (m, 3, 6, 6) of covariant membrane strains and curvatures times areas."""
    maps = points.plane_maps
    result: FloatArray = np.einsum(
        "mp,mpki,mkl,mplj->mpij", points.areas, maps, stiffness, maps, optimize=True
    )
    return result


def shear_stiffness(middles: Geometry, stiffness: FloatArray, shear: FloatArray) -> FloatArray:
    """Stiffness (m, 6, 6) of covariant shear strains times areas.

    The part outside the lowest edge element is weighted less, see ``forms.director_shell``.
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


def consistent_masses(places: FloatArray, density: FloatArray) -> FloatArray:
    """Integrals (m, 6, 6) of a density (m,) per area times two shape functions.

    Args:
        places: positions of the nodes at the start, (m, 6, 3).
        density: of each triangle, kg/m^2.
    """
    points, weights = DEGREE_4
    base, values = np.einsum("pan,mnc->mpac", slopes(points), places), shapes(points)
    sizes = np.linalg.norm(np.cross(base[:, :, 0], base[:, :, 1]), axis=2) * weights
    masses: FloatArray = np.einsum("m,mp,pi,pj->mij", density, sizes, values, values)
    return masses
