# SPDX-License-Identifier: LGPL-3.0-or-later
"""Stresses of director triangles whose sections have user-defined laws."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.families.common.law_values import LawValues
from flexfem.families.shell_director.geometry import Geometry

__all__ = ["DirectorLaw", "Response", "law_energies", "law_response", "law_viscosity"]


@dataclass(frozen=True)
class Response:
    """Stresses and stiffness of triangles, in the format of the compiled loops.

    Attributes:
        planes: derivatives of the covariant stresses of membrane and bending by the strains, times
            areas, (m, 3, 6, 6).
        stresses: these stresses, (m, 18); (0, 18) where they are the stiffness times the strains.
    """

    planes: FloatArray
    stresses: FloatArray


@dataclass(frozen=True)
class DirectorLaw:
    """A user-defined law for some triangles, in place of their stiffness.

    Attributes:
        rows: the triangles, (r,).
        sections: number of each triangle's section among those of the law, (r,).
        values: the law.
    """

    rows: IntArray
    sections: IntArray
    values: LawValues


def law_response(
    laws: Sequence[DirectorLaw],
    points: Geometry,
    planes: FloatArray,
    strains: FloatArray,
    rates: FloatArray | None,
    rate: float,
) -> Response:
    """Stresses and stiffness where some triangles have user-defined laws.

    Args:
        laws: the laws and their triangles.
        points: geometry of all triangles.
        planes: stiffness of those without a law, as ``Response.planes``.
        strains: covariant strains of membrane and bending, (m, 3, 6).
        rates: of the strains, same shape; None to neglect them.
        rate: change of strain rates with strains, 1/s, included in the stiffness.
    """
    planes = planes.copy()
    stresses = np.einsum("mpij,mpj->mpi", planes, strains)
    for law in laws:
        maps, areas = points.plane_maps[law.rows], points.areas[law.rows]
        values = _values(law, maps, strains, rates)
        stress, stiffness = values[..., 1:7], values[..., 7:43]
        if law.values.viscous:
            stress = stress + values[..., 43:49]
            stiffness = stiffness + rate * values[..., 49:85]
        matrices = stiffness.reshape(*areas.shape, 6, 6)
        stresses[law.rows] = np.einsum("mp,mpki,mpk->mpi", areas, maps, stress)
        planes[law.rows] = np.einsum(
            "mp,mpki,mpkl,mplj->mpij", areas, maps, matrices, maps, optimize=True
        )
    return Response(planes, np.ascontiguousarray(stresses.reshape(-1, 18)))


def law_energies(
    laws: Sequence[DirectorLaw], points: Geometry, strains: FloatArray, energies: FloatArray
) -> None:
    """Write strain energies of membrane and bending of triangles with laws to (m,), J.

    The covariant strains (m, 3, 6) are those of all triangles.
    """
    for law in laws:
        values = _values(law, points.plane_maps[law.rows], strains, None)
        energies[law.rows] = (points.areas[law.rows] * values[..., 0]).sum(1)


def law_viscosity(
    laws: Sequence[DirectorLaw],
    points: Geometry,
    strains: FloatArray,
    rates: FloatArray,
    stresses: FloatArray,
) -> None:
    """Write the viscous stresses of triangles with laws to (m, 3, 6), covariant, times areas.

    The covariant strains and rates (m, 3, 6) are those of all triangles.
    """
    for law in laws:
        maps, areas = points.plane_maps[law.rows], points.areas[law.rows]
        stresses[law.rows] = 0.0
        if law.values.viscous:
            values = _values(law, maps, strains, rates)[..., 43:49]
            stresses[law.rows] = np.einsum("mp,mpki,mpk->mpi", areas, maps, values)


def _values(
    law: DirectorLaw, maps: FloatArray, strains: FloatArray, rates: FloatArray | None
) -> FloatArray:
    """Values (r, 3, k) of the law at covariant strains and rates (m, 3, 6) of all triangles."""
    local = np.einsum("mpij,mpj->mpi", maps, strains[law.rows]).reshape(-1, 6)
    moving = np.zeros_like(local)
    if rates is not None:
        moving = np.einsum("mpij,mpj->mpi", maps, rates[law.rows]).reshape(-1, 6)
    values = law.values.at(local, moving, np.repeat(law.sections, 3))
    return values.reshape(len(law.rows), 3, -1)
