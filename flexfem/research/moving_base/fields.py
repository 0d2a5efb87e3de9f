# SPDX-License-Identifier: LGPL-3.0-or-later
"""Fields of a beam (s, u2, u3, theta1, theta2, theta3) in finite elements: stiffness and mass."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse

from flexfem._types import FloatArray
from flexfem.research.moving_base.effects import Effects
from flexfem.research.moving_base.properties import BeamProperties
from flexfem.research.moving_base.space import GAUSS, LineSpace, Quadrature

__all__ = ["FiniteElements", "Sections", "section_values", "stiffness_of"]

#: SciPy sparse matrix, which has no types.
Matrix = Any


@dataclass(frozen=True, eq=False)
class Sections:
    """Stiffness and inertia at quadrature points, without the effects that are switched off.

    Attributes:
        stiffness: (6, p): of s', u2' - theta3, u3' + theta2, theta1', theta2', theta3'.
        warping: (p,), of theta1''.
        mass: (p,), kg/m.
        rotary: (3, p), moments of inertia per length about the mass centre, kg m.
        eccentricity: (3, p), mass centre relative to the axis, m.
    """

    stiffness: FloatArray
    warping: FloatArray
    mass: FloatArray
    rotary: FloatArray
    eccentricity: FloatArray


def section_values(properties: BeamProperties, effects: Effects, x: FloatArray) -> Sections:
    """Stiffness and inertia at the points x.

    Raises:
        ValueError: a property is out of range there.
    """
    at = properties.at(x)
    e, g, area = at["youngs_modulus"], at["shear_modulus"], at["area"]
    i2, i3 = at["second_moment_2"], at["second_moment_3"]
    stiffness = np.array(
        [
            e * area, g * area / at["shear_ratio_2"], g * area / at["shear_ratio_3"],
            g * at["torsion_constant"], e * i2, e * i3,
        ]
    )  # fmt: skip
    density = at["mass_per_length"] / area
    zero = np.zeros_like(x)
    offset = np.array([zero, at["eccentricity_2"], at["eccentricity_3"]])
    kept = np.array([True, effects.eccentricity_2, effects.eccentricity_3])
    turning = np.array(
        [effects.torsional_inertia, effects.rotary_inertia_2, effects.rotary_inertia_3]
    )
    return Sections(
        stiffness,
        e * at["warping_constant"] * effects.warping,
        at["mass_per_length"],
        density * (turning[:, None] * [i2 + i3, i2, i3]),
        offset * kept[:, None],
    )


def stiffness_of(
    sections: Sections,
    weights: FloatArray,
    fields: Sequence[Any],
    slopes: Sequence[Any],
    twist: Any,
) -> Any:
    """Stiffness matrix from operators, or arrays (p, n), of fields, slopes and theta1''."""
    strains = [
        slopes[0], slopes[1] - fields[5], slopes[2] + fields[4], slopes[3], slopes[4], slopes[5],
        twist,
    ]  # fmt: skip
    moduli = [*sections.stiffness, sections.warping]
    return sum(
        strain.T @ (scipy.sparse.diags_array(weights * k) @ strain)
        for strain, k in zip(strains, moduli, strict=True)
    )


class FiniteElements:
    """Cubic elements for all fields; the root is clamped, also against warping where there is any.

    Attributes:
        quadrature: points of all integrals.
        size: number of unknowns.
    """

    def __init__(
        self, properties: BeamProperties, effects: Effects, sections: Sections,
        quadrature: Quadrature,
    ) -> None:  # fmt: skip
        """Number the unknowns."""
        self.quadrature, self._sections = quadrature, sections
        edges = quadrature.edges
        self._spaces: dict[int, LineSpace] = {}
        kept, first = [], 0
        self._first: dict[int, int] = {}
        used = {
            0: effects.extension, 1: effects.in_plane, 2: effects.out_of_plane,
            3: effects.torsion, 4: effects.out_of_plane and effects.shear_3,
            5: effects.in_plane and effects.shear_2,
        }  # fmt: skip
        bent = [f for f, turn in ((1, 5), (2, 4)) if not used[turn]]
        for field in (f for f, there in used.items() if there):
            hermite = field == 3 or field in bent
            space = LineSpace(edges, hermite)
            self._spaces[field], self._first[field] = space, first
            clamped = [0]
            if hermite and (field != 3 or sections.warping[0] > 0.0):
                clamped.append(1)
            kept += [first + i for i in range(space.size) if i not in clamped]
            first += space.size
        self._total, self.size = first, len(kept)
        self._keep = scipy.sparse.identity(first, format="csr")[:, kept]

    def operators(self, xi: FloatArray) -> tuple[list[Matrix], list[Matrix], Matrix]:
        """Fields and slopes (6 matrices each) and theta1'' at places xi of every element."""
        count = (len(self.quadrature.edges) - 1) * len(xi)
        empty = [scipy.sparse.csr_matrix((count, self.size)) for _ in range(3)]
        at = {
            field: [self._placed(o, field) for o in space.operators(xi)]
            for field, space in self._spaces.items()
        }
        if 1 in at and 5 not in at:
            at[5] = [at[1][1], at[1][2], empty[0]]
        if 2 in at and 4 not in at:
            at[4] = [-at[2][1], -at[2][2], empty[0]]
        every = [at.get(field, empty) for field in range(6)]
        return [o[0] for o in every], [o[1] for o in every], every[3][2]

    def _placed(self, operator: Matrix, field: int) -> Matrix:
        """An operator on the unknowns of one field as one on all that are not clamped."""
        first, last = self._first[field], self._total - self._first[field] - operator.shape[1]
        rows = operator.shape[0]
        wide = scipy.sparse.hstack(
            [scipy.sparse.csr_matrix((rows, first)), operator,
             scipy.sparse.csr_matrix((rows, last))]
        )  # fmt: skip
        return (wide @ self._keep).tocsr()

    def matrices(self) -> tuple[Matrix, Matrix, FloatArray]:
        """Stiffness and mass matrix, and loads (size, 2) rho and rho x along the axis."""
        points = np.polynomial.legendre.leggauss(GAUSS)[0]
        fields, slopes, twist = self.operators(0.5 * (points + 1.0))
        s, w = self._sections, self.quadrature.weights
        stiffness = stiffness_of(s, w, fields, slopes, twist)
        centres = centre_displacements(fields, s.eccentricity)
        masses = [s.mass] * 3 + list(s.rotary)
        mass = sum(
            o.T @ (scipy.sparse.diags_array(w * m) @ o)
            for o, m in zip([*centres, *fields[3:]], masses, strict=True)
        )
        along = (w * s.mass)[:, None] * np.stack([np.ones_like(w), self.quadrature.x], axis=1)
        return stiffness.tocsr(), mass.tocsr(), centres[0].T @ along


def centre_displacements(fields: Sequence[Any], e: FloatArray) -> list[Any]:
    """First-order displacements of the mass centres, u + theta x e, as operators or arrays."""

    def times(values: FloatArray, operator: Any) -> Any:
        return scipy.sparse.diags_array(values) @ operator

    u, theta = fields[:3], fields[3:]
    return [
        u[0] + times(e[2], theta[1]) - times(e[1], theta[2]),
        u[1] - times(e[2], theta[0]),
        u[2] + times(e[1], theta[0]),
    ]
