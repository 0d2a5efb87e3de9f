# SPDX-License-Identifier: LGPL-3.0-or-later
"""Materials of beam cells: the linear one of a stiffness matrix, and user-defined laws."""

from collections.abc import Mapping, Sequence
from typing import Protocol

from mpi4py import MPI

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.families.common.law_loops import linear_resultants
from flexfem.families.common.law_values import LawValues
from flexfem.forms.beam_law import LawExpressions, law_expressions
from flexfem.materials.section import Section
from flexfem.materials.shell_section import ShellSection

__all__ = [
    "LawMaterial", "LinearMaterial", "Material", "about_centres", "grouped", "materials",
    "symmetric", "upper_triangles", "viscous_factors",
]  # fmt: skip

_UPPER = np.triu_indices(6)


class Material(Protocol):
    """Constitutive model of the cells of one group.

    Attributes:
        law, damped: parameters of an element's forms: the law, None for the linear one, and how
            many numbers its stiffness-proportional damping has: none, 1, or 6 for each strain.
        data: (s, k) data of each section for the kernels: 21 entries of the inertia, then stiffness
            or parameters.
        viscous: True if the stress depends on the strain rate.
    """

    law: LawExpressions | None
    damped: int
    data: FloatArray
    viscous: bool

    def response(self, strain: FloatArray, sections: IntArray) -> tuple[FloatArray, FloatArray]:
        """Stress resultants (m, 6) and strain energies per length (m,) at rest."""
        ...

    def viscous_stress(
        self, strain: FloatArray, rate: FloatArray, sections: IntArray, damping: FloatArray
    ) -> FloatArray:
        """Stress resultants (m, 6) that the strain rate adds; ``damping`` (m, 1 or 6) of cells."""
        ...


def grouped(
    sections: Sequence[Section | ShellSection],
) -> Mapping[LawExpressions | None, list[int]]:
    """Numbers of the sections that share kernels, by their law; None stands for the linear one.

    Raises:
        ValueError: a law's function fails or returns something unusable.
    """
    groups: dict[LawExpressions | None, list[int]] = {}
    for number, section in enumerate(sections):
        law = None if section.law is None else law_expressions(section.law)
        groups.setdefault(law, []).append(number)
    return groups


def materials(
    comm: MPI.Intracomm, sections: Sequence[Section], owners: Sequence[str], damped: int
) -> list[tuple[list[int], "Material"]]:
    """Materials of a model's sections, each with the numbers of its sections (collective).

    Args:
        comm: communicator.
        sections: the sections.
        owners: their names in messages.
        damped: how many numbers their stiffness-proportional damping has, see :class:`Material`.

    Raises:
        ValueError: a section's law is not usable; on all ranks.
    """
    found: list[tuple[list[int], Material]] = []
    for law, numbers in grouped(sections).items():
        own = [sections[i] for i in numbers]
        if law is None:
            stiffness = np.array([s.stiffness for s in own])
            found.append((numbers, LinearMaterial(stiffness, _inertias(own), damped)))
        else:
            found.append((numbers, LawMaterial(comm, law, own, [owners[i] for i in numbers])))
    return found


def symmetric(upper: FloatArray) -> FloatArray:
    """Matrices (s, 6, 6) from their upper triangles (s, 21)."""
    matrices = np.zeros((len(upper), 6, 6))
    matrices[:, *_UPPER] = upper
    return matrices + np.swapaxes(np.triu(matrices, 1), -1, -2)


def about_centres(inertias: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mass centres (s, 3), m, and rotary inertia about them (s, 3, 3) of section inertias.

    A section without mass has its centre on the axis.
    """
    mass = inertias[:, 0, 0]
    first = np.stack([inertias[:, 5, 1], inertias[:, 3, 2], inertias[:, 4, 0]], axis=1)
    centres = first / np.where(mass > 0.0, mass, np.inf)[:, np.newaxis]
    squares = np.sum(centres**2, axis=1)[:, np.newaxis, np.newaxis] * np.eye(3)
    steiner = squares - centres[:, :, np.newaxis] * centres[:, np.newaxis]
    return centres, inertias[:, 3:, 3:] - mass[:, np.newaxis, np.newaxis] * steiner


def viscous_factors(damping: FloatArray) -> FloatArray:
    """Factors of kernels for damping (m, 1), which are this, or (m, 6): their roots.

    With the diagonal matrix R of the roots the viscosity is ``R D R``, positive for every D.
    """
    return damping if damping.shape[1] == 1 else np.sqrt(damping)


def upper_triangles(matrices: FloatArray) -> FloatArray:
    """Upper triangles (..., 21) of symmetric matrices (..., 6, 6)."""
    return matrices[..., *_UPPER]


def _inertias(sections: Sequence[Section]) -> FloatArray:
    return np.array([s.inertia for s in sections])


def _data(inertias: FloatArray, material: FloatArray) -> FloatArray:
    both = np.concatenate([upper_triangles(inertias), material], axis=1)
    return np.ascontiguousarray(both)


class LinearMaterial:
    """Stiffness matrices, with stiffness-proportional damping or without."""

    law: LawExpressions | None

    def __init__(self, stiffness: FloatArray, inertias: FloatArray, damped: int) -> None:
        """Take the matrices (s, 6, 6)."""
        self._matrices = stiffness
        self.law, self.damped, self.viscous = None, damped, damped > 0
        self.data = _data(inertias, upper_triangles(stiffness))

    def response(self, strain: FloatArray, sections: IntArray) -> tuple[FloatArray, FloatArray]:
        """See :class:`Material`."""
        resultant = np.empty_like(strain)
        linear_resultants(strain, sections, self._matrices, resultant)
        return resultant, 0.5 * np.einsum("mi,mi->m", strain, resultant)

    def viscous_stress(
        self, strain: FloatArray, rate: FloatArray, sections: IntArray, damping: FloatArray
    ) -> FloatArray:
        """See :class:`Material`."""
        factors = viscous_factors(damping)
        if factors.shape[1] == 1:
            return factors * self.response(rate, sections)[0]
        return factors * self.response(np.ascontiguousarray(factors * rate), sections)[0]


class LawMaterial:
    """User-defined laws that differ in the values of parameters only."""

    law: LawExpressions | None

    def __init__(
        self, comm: MPI.Intracomm, law: LawExpressions, sections: Sequence[Section],
        owners: Sequence[str],
    ) -> None:  # fmt: skip
        """Compile the law and check it at zero strain (collective).

        Raises:
            ValueError: the law cannot be compiled, or is not usable at zero strain; on all ranks.
        """
        laws = [s.law for s in sections if s.law is not None]
        self._law = LawValues(comm, law, laws, owners)
        self.law, self.damped, self.viscous = law, 0, law.dissipation is not None
        self.data = _data(_inertias(sections), self._law.parameters)

    def response(self, strain: FloatArray, sections: IntArray) -> tuple[FloatArray, FloatArray]:
        """See :class:`Material`."""
        values = self._law.at(strain, np.zeros_like(strain), sections)
        return np.ascontiguousarray(values[:, 1:7]), values[:, 0]

    def viscous_stress(
        self, strain: FloatArray, rate: FloatArray, sections: IntArray, damping: FloatArray
    ) -> FloatArray:
        """See :class:`Material`; laws have a dissipation potential instead of ``damping``."""
        if not self.viscous:
            return np.zeros_like(strain)
        return np.ascontiguousarray(self._law.at(strain, rate, sections)[:, 43:49])
