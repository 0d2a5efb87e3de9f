# SPDX-License-Identifier: LGPL-3.0-or-later
"""A linear elastic body as UFL forms on any DOLFINx mesh."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import ufl
from dolfinx import fem

from flexfem import _checks
from flexfem._types import FloatArray
from flexfem.forms.elasticity import in_space, small_rotation
from flexfem.reduction.fem.body.strain_energy import StrainEnergy

__all__ = ["LinearBody", "MassField"]

Expr = Any


@dataclass(frozen=True, eq=False)
class MassField:
    """Masses that are spread over the cells of a mesh, not necessarily where these are.

    The masses of a solid are where its points are. A beam or shell carries several, at points of
    its section that move with it: four equal ones have any second moments a section may have.

    Attributes:
        density: UFL scalar or number, mass per measure of the cells (volume, area, length).
        position: UFL vector of three, where the masses are at rest, body axes, m.
        displacement: from a function of the body's space to their displacement, a UFL vector of
            three, linear.
    """

    density: Expr
    position: Expr
    displacement: Callable[[Expr], Expr]


@dataclass(frozen=True, eq=False)
class LinearBody:
    """A linear elastic body: a function space with energy, mass and loads.

    Attributes:
        space: DOLFINx function space of the displacements (and rotations) of the body.
        elastic: from trial u and test v to the bilinear form of the strain energy.
        masses: everything that has mass.
        rigid: from a displacement (3,) and a rotation vector (3,) about the origin to the function
            of a small rigid motion; zero for motions that the space does not have. None for
            spaces of plain displacement vectors.
        displacement: from a function of the space to the displacement of the points of the mesh,
            a UFL vector of three; None for spaces of plain displacement vectors.
        rotation: from a function of the space to the small rotation vector of the points of the
            mesh, a UFL vector of three; None: half the curl of plain displacement vectors, and no
            lines for sliders on other spaces.
        prestress: from a function u0 (the state that causes the stress), trial u and test v to the
            bilinear form of the work of that stress on the strain of second order. None: no
            geometric stiffness.
        stress: from a function of the space to the (3, 3) stress of pictures. None: no stress.
        energy: of the body's law, of spaces of displacement vectors of three; None: linear alone.
        name: of the body, for messages.
    """

    space: fem.FunctionSpace
    elastic: Callable[[Expr, Expr], ufl.Form]
    masses: Sequence[MassField]
    rigid: Callable[[FloatArray, FloatArray], fem.Function] | None = None
    displacement: Callable[[Expr], Expr] | None = None
    rotation: Callable[[Expr], Expr] | None = None
    prestress: Callable[[Expr, Expr, Expr], ufl.Form] | None = None
    stress: Callable[[Expr], Expr] | None = None
    energy: StrainEnergy | None = None
    name: str = "body"

    def __post_init__(self) -> None:
        """Check the arguments that need no computation.

        Raises:
            TypeError: a field has the wrong type.
            ValueError: there are no masses, a form is not bilinear, a vector has not three
                components, or rigid motions are missing for a space that is not of plain
                displacements.
        """
        _checks.text("LinearBody", "name", self.name)
        _checks.instance(self.owner, "space", self.space, fem.FunctionSpace)
        masses = tuple(self.masses)
        if not masses:
            raise ValueError(f"{self.owner}: masses must hold at least one MassField")
        dimension = self.space.mesh.geometry.dim
        components = self.space.value_shape
        plain = components == (self.space.dofmap.index_map_bs,) and components[0] <= dimension
        if not plain:
            for what in ("rigid", "displacement"):
                if getattr(self, what) is None:
                    raise ValueError(
                        f"{self.owner}: {what} must be given for the space {self.space}"
                    )
        _checks.assign(
            self,
            masses=masses,
            rigid=self.rigid or self._rigid_displacement,
            displacement=self.displacement or in_space,
            rotation=self.rotation or (small_rotation if plain and dimension > 1 else None),
        )
        u, v = ufl.TrialFunction(self.space), ufl.TestFunction(self.space)
        self._check_form("elastic", self.elastic(u, v))
        if self.prestress is not None:
            self._check_form("prestress", self.prestress(fem.Function(self.space), u, v))
        for mass in masses:
            _checks.instance(self.owner, "mass", mass, MassField)
            for what, vector in {
                "position": mass.position,
                "displacement": mass.displacement(u),
            }.items():
                if getattr(vector, "ufl_shape", None) != (3,):
                    raise ValueError(
                        f"{self.owner}: {what} of masses must be a UFL vector of three, got "
                        f"{_checks.show(vector)}"
                    )

    @property
    def owner(self) -> str:
        """Class and name, for messages."""
        return f'LinearBody "{self.name}"'

    def _check_form(self, what: str, form: object) -> None:
        if not isinstance(form, ufl.Form) or len(form.arguments()) != 2:
            raise TypeError(
                f"{self.owner}: {what} must give a bilinear UFL form, got {_checks.show(form)}"
            )

    def _rigid_displacement(self, shift: FloatArray, turn: FloatArray) -> fem.Function:
        """Small rigid motion of a space of plain displacement vectors."""
        return rigid_displacement(fem.Function(self.space), shift, turn)


def rigid_displacement(function: fem.Function, shift: FloatArray, turn: FloatArray) -> fem.Function:
    """Fill a vector function with a small rigid motion.

    Components that it does not have are left out; a motion that would need them, as rotations out
    of a plane do, is left out whole, so that only rigid motions of the body itself remain.
    """
    components = function.function_space.value_shape[0]
    shift, turn = np.array(shift, dtype=np.float64), np.array(turn, dtype=np.float64)
    shift[components:] = 0.0
    if components == 2:
        turn[:2] = 0.0
    elif components == 1:
        turn[:] = 0.0
    function.interpolate(
        lambda x: (shift[:, np.newaxis] + np.cross(turn, x, axisb=0, axisc=0))[:components]
    )
    return function
