# SPDX-License-Identifier: LGPL-3.0-or-later
"""Stiffness, inertia, centres and stresses of arbitrary beam sections."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import atan2
from typing import Any

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._types import FloatArray
from flexfem.materials.material import Material
from flexfem.materials.orthotropic import OrthotropicMaterial
from flexfem.materials.section import Section
from flexfem.sections.section_material import OrientedMaterial, SectionMaterial, elastic_matrices
from flexfem.sections.section_mesh import SectionMesh

__all__ = ["SectionProperties", "section_properties"]

_DEGREES = (1, 2, 3)


@dataclass(frozen=True, eq=False)
class SectionProperties:
    """Results of `section_properties`.

    Stiffness and inertia are about the reference point, in the orders of `Section`.

    Attributes:
        stiffness: Maps strains (gamma, kappa) to forces and moments, shape (6, 6); N, N m, N m^2.
        inertia: Maps velocities (V, Omega) to momentum per length, shape (6, 6); kg/m, kg, kg m.
        mesh: Cells of the section.
        reference: Point (y, z) of the mesh on the beam's axis, shape (2,), metres.
    """

    stiffness: FloatArray
    inertia: FloatArray
    mesh: SectionMesh
    reference: FloatArray
    _warping: Any = field(repr=False)  # a Warping, whose module loads DOLFINx
    _units: _Units = field(repr=False)

    @property
    def section(self) -> Section:
        """The section of a beam, without outline."""
        return Section.general(self.stiffness, self.inertia)

    @property
    def shear_centre(self) -> FloatArray:
        """Point (y, z) through which shear forces do not twist the beam, shape (2,), metres.

        It is measured from the reference point, and is that at the end where the forces act: where
        bending and twist are coupled, the beam also twists along its length.
        """
        f = np.linalg.inv(self.stiffness)
        return np.array([-f[3, 2] / f[3, 3], f[3, 1] / f[3, 3]])

    @property
    def tension_centre(self) -> FloatArray:
        """Point (y, z), from the reference point, where tension does not bend; (2,), metres."""
        f = np.linalg.inv(self.stiffness)
        bend, pull = f[4:, 4:], f[4:, 0]
        moments = -np.linalg.solve(bend, pull)  # of a unit tension at (y, z): z, -y
        return np.array([-moments[1], moments[0]])

    @property
    def mass_centre(self) -> FloatArray:
        """Centre of mass (y, z), from the reference point, shape (2,), metres."""
        return self.section.mass_centre

    @property
    def principal_bending(self) -> tuple[FloatArray, float]:
        """Two bending stiffnesses, greater first, N m^2, and the angle of the first's axis to e2.

        They relate moments to curvatures where no other resultant acts. The angle is in radians,
        in (-pi/2, pi/2].
        """
        values, axes = np.linalg.eigh(np.linalg.inv(self.stiffness)[4:, 4:])
        y, z = axes[:, 0]
        angle = atan2(z, y)
        turned = angle - np.pi * round(angle / np.pi)
        return 1.0 / values, turned if turned > -0.5 * np.pi else turned + np.pi

    @property
    def nodes(self) -> FloatArray:
        """Points (y, z) of the warping, in the axes of the mesh, shape (k, 2), metres."""
        result: FloatArray = self._warping.nodes * self._units.length + self._units.centre
        return result

    def warping(self, resultants: npt.ArrayLike) -> FloatArray:
        """Return the warping displacements of given forces and moments.

        Args:
            resultants: (n, m) about the reference point, shape (6,), N and N m.

        Returns:
            Displacements along e1, e2, e3 at `nodes`, without mean rigid motion, shape (k, 3),
            metres.

        Raises:
            TypeError: The argument does not consist of numbers.
            ValueError: It has another shape, or is not finite.
        """
        result: FloatArray = self._warping.displacement(self._scaled(resultants))
        return self._units.length * result

    def stress(self, resultants: npt.ArrayLike) -> FloatArray:
        """Return the stresses of given forces and moments in the middle of the cells.

        Args:
            resultants: (n, m) about the reference point, shape (6,), N and N m.

        Returns:
            Stresses (11, 22, 33, 23, 13, 12) in section axes, shape (m, 6), pascals.

        Raises:
            TypeError: The argument does not consist of numbers.
            ValueError: It has another shape, or is not finite.
        """
        result: FloatArray = self._warping.stress(self._scaled(resultants))
        return self._units.modulus * result

    def _scaled(self, resultants: npt.ArrayLike) -> FloatArray:
        """Return resultants about the centroid, without units."""
        given = _checks.array("SectionProperties", "resultants", resultants, (6,))
        # power: resultants . strains is the same about both points
        moved = np.linalg.solve(_motion(self._units.centre - self.reference).T, given)
        scale = self._units.scale
        result: FloatArray = moved / (self._units.modulus * self._units.length**2 * scale)
        return result


@dataclass(frozen=True)
class _Units:
    """Units in which the section is solved, so that its numbers are near one.

    Attributes:
        length: Metres.
        modulus: Pascals.
        centre: Centroid (y, z), metres.
    """

    length: float
    modulus: float
    centre: FloatArray

    @property
    def scale(self) -> FloatArray:
        """Lengths of moments, shape (6,)."""
        return np.array([1.0] * 3 + [self.length] * 3)


def section_properties(
    mesh: SectionMesh,
    materials: SectionMaterial | Mapping[str, SectionMaterial],
    *,
    reference: npt.ArrayLike = (0.0, 0.0),
    degree: int = 2,
) -> SectionProperties:
    """Find the constants of a section of any shape and materials.

    The stiffness is that of Saint-Venant's solutions of the solid beam: cross-sections warp freely,
    in and out of their plane, under the six resultants (`flexfem.sections.warping`). Every rank
    solves for itself. The first solution of a process loads DOLFINx, about two seconds.

    Args:
        mesh: Cells of the section.
        materials: One for all parts, or one by the name of each part.
        reference: Point (y, z) of the mesh through which the beam's axis passes, metres.
        degree: Of the displacements, 1 to 3; the error of the constants falls with twice this power
            of the cells' size where the section has no reentrant corners.

    Raises:
        TypeError: An argument has the wrong type.
        ValueError: A part without material, a material of no part, an incompressible one, a section
            without mass, or a degree that is not 1 to 3.
    """
    owner = "section_properties"
    _checks.instance(owner, "mesh", mesh, SectionMesh)
    if degree not in _DEGREES:
        raise ValueError(
            f"section_properties: degree must be 1, 2 or 3, got {_checks.show(degree)}"
        )
    axis = _checks.array(owner, "reference", reference, (2,))
    given = _by_part(owner, mesh, materials)
    elastic, density = np.empty((len(mesh.cells), 6, 6)), np.empty(len(mesh.cells))
    for name, cells in mesh.parts.items():
        elastic[cells] = elastic_matrices(given[name], mesh.centres[cells])
        density[cells] = given[name].density
    if not density.max() > 0.0:
        raise ValueError(
            "section_properties: at least one material must have a density, all have 0"
        )
    areas = mesh.areas
    centre = areas @ mesh.centres / areas.sum()
    units = _Units(float(np.sqrt(areas.sum())), float(elastic.max()), centre)
    heavy = float(density.max())

    from flexfem.installation import load_dolfinx

    load_dolfinx()
    from flexfem.sections.warping import Warping

    warping = Warping(
        (mesh.points - centre) / units.length, mesh.cells, elastic / units.modulus,
        density / heavy, degree,
    )  # fmt: skip
    motion = units.scale[:, None] * _motion(centre - axis)
    square = units.length**2
    stiffness = units.modulus * square * motion.T @ np.linalg.inv(warping.flexibility) @ motion
    inertia = heavy * square * motion.T @ warping.inertia @ motion
    return SectionProperties(
        _checks.freeze(0.5 * (stiffness + stiffness.T)),
        _checks.freeze(0.5 * (inertia + inertia.T)),
        mesh,
        axis,
        warping,
        units,
    )


def _by_part(
    owner: str, mesh: SectionMesh, materials: SectionMaterial | Mapping[str, SectionMaterial]
) -> dict[str, SectionMaterial]:
    """Return the material of each part."""
    kinds = (Material, OrthotropicMaterial, OrientedMaterial)
    if isinstance(materials, Mapping):
        given = dict(materials)
    else:
        given = dict.fromkeys(mesh.parts, materials)
    for name in mesh.parts:
        if name not in given:
            raise ValueError(f'section_properties: part "{name}" has no material')
    for name, material in given.items():
        if name not in mesh.parts:
            raise ValueError(
                f"section_properties: no part {_checks.show(name)}; there are "
                f"{', '.join(sorted(mesh.parts))}"
            )
        _checks.instance(owner, f'material of part "{name}"', material, kinds)
        if isinstance(material, Material) and material.poisson_ratio == 0.5:
            raise ValueError(
                f'section_properties: poisson_ratio of part "{name}" must be less than 0.5'
            )
    return given


def _motion(offset: FloatArray) -> FloatArray:
    """Return the map of motions at the reference point to those at a point (y, z) from it."""
    y, z = offset
    result = np.eye(6)
    result[:3, 3:] = [[0.0, z, -y], [-z, 0.0, 0.0], [y, 0.0, 0.0]]
    return result
