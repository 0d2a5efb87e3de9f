# SPDX-License-Identifier: LGPL-3.0-or-later
"""UFL forms of a solid cell: its energy, forces, their change along a step, and fields.

Cells are integrated over the reference cell, with the inverse of the geometry's Jacobian and its
determinant (of straight simplices), or the places of the geometry's nodes, as data of the cell: so
several cells are evaluated at once. Data that are equal in a group of bodies are in the form.

With a dilatation theta, J is replaced by a polynomial in each cell: theta is the projection of J,
and the energy ``W((theta/J)^(1/3) F)`` depends on F through its shape alone (Simo, Taylor, Pister
1985; Brink, Stein 1996). The forces are ``dE/dx + int pi dJ/dx`` with the projection pi of
dE/dtheta, so that they are the derivative of the energy, and nothing is left to be solved.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import basix.ufl
import ufl

from flexfem._types import FloatArray
from flexfem.families.solid.meshes.lagrange import CELLS
from flexfem.forms.energy import Parameters

__all__ = ["FIELDS", "PAIRS", "CellKind", "LawFunctions", "LawParameters", "SolidForms"]

#: Fields of a solid in the order of :attr:`SolidForms.fields`, with their numbers of components:
#: Cauchy stress and Green's strain (xx, yy, zz, yz, xz, xy), and J.
FIELDS = {"stress": 6, "strain": 6, "J": 1}

#: Rows and columns of the components of symmetric tensors.
PAIRS = [(0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)]


class LawFunctions(Protocol):
    """What forms need of a law; see ``laws.energies.SolidLaw`` and ``laws.history.HistoryLaw``."""

    @property
    def initial(self) -> FloatArray:
        """Internal variables at the start."""

    @property
    def rate_dependent(self) -> bool:
        """True if these change with time alone."""

    @property
    def split(self) -> bool:
        """True if the energy depends on the shape of F and on ``p.volume_ratio(F)`` alone."""

    def energy(self, F: Any, p: Any) -> Any:
        """Strain energy, J/m^3."""

    def dissipation(self, F: Any, rate: Any, p: Any) -> Any:
        """Dissipation potential, W/m^3, or None."""


@dataclass(frozen=True)
class CellKind:
    """What the cells of a group have in common.

    Attributes:
        cell: shape; degree: of the positions.
        degree: of the positions.
        geometry: degree of the geometry, 0 for straight simplices with a constant Jacobian.
        plane: "strain", "stress" or "axisymmetric" of plane figures, None of solids.
        dilatation: degree of theta, -1 for displacements alone.
        quadrature: degree of polynomials that are integrated exactly.
    """

    cell: str
    degree: int
    geometry: int
    plane: str | None
    dilatation: int
    quadrature: int

    @property
    def dimension(self) -> int:
        """2 of plane figures, 3 of solids."""
        return CELLS[self.cell]


class LawParameters(Parameters):
    """Parameters of a law, and J of a deformation gradient."""

    def __init__(self, values: Mapping[str, Any], theta: Any = None) -> None:
        """Take coefficients by name, and the dilatation in the place of J; None for J."""
        super().__init__(values)
        self._theta = theta

    def volume_ratio(self, F: Any) -> Any:
        """J = det F, or the dilatation."""
        return ufl.det(F) if self._theta is None else self._theta


class SolidForms:
    """Forms of a law in cells of a kind.

    Attributes:
        law: the law.
        kind: of the cells.
        sizes: number of components of each parameter, 1 or 3.
        coefficients: all coefficients by name: position, velocity, step and rate of the nodes,
            those of the cells, and the parameters of the law.
        damped: True if the law has a dissipation potential.
        volume: weight of the integrals over the reference cell, m^d.
    """

    def __init__(self, law: LawFunctions, kind: CellKind, sizes: Mapping[str, int]) -> None:
        """Evaluate the law.

        Args:
            law: the law.
            kind: of the cells.
            sizes: number of components of each parameter, 1 or 3.

        Raises:
            ValueError: a function of the law fails, returns no scalar, or leaves out a parameter.
        """
        self.kind, self.sizes, d = kind, sizes, kind.dimension
        self._domain = ufl.Mesh(basix.ufl.element("Lagrange", kind.cell, 1, shape=(d,)))
        self._vectors = self._space("Lagrange", kind.degree, (3,))
        names = "position", "velocity", "step", "rate"
        self.coefficients = {name: ufl.Coefficient(self._vectors) for name in names}
        self._geometry()
        scalars = basix.ufl.quadrature_element(kind.cell, degree=kind.quadrature)
        self._scalars = ufl.FunctionSpace(self._domain, scalars)
        if kind.plane == "stress":
            for name in ("stretch", "stretch_step"):
                self.coefficients[name] = ufl.Coefficient(self._scalars)
        if kind.dilatation >= 0:
            space = self._space("DG", kind.dilatation)
            for name in ("dilatation", "multiplier", "dilatation_step", "multiplier_step"):
                self.coefficients[name] = ufl.Coefficient(space)
        values = {
            name: ufl.Coefficient(self._space("DG", 0, () if size == 1 else (3,)))
            for name, size in sizes.items()
        }
        self.coefficients |= values
        theta = self.coefficients.get("dilatation") if law.split else None
        self.law, self._parameters = law, LawParameters(values, theta)
        self._internal = len(law.initial)
        if self._internal:
            points = basix.ufl.quadrature_element(
                kind.cell, value_shape=(self._internal,), degree=kind.quadrature
            )
            self._points = ufl.FunctionSpace(self._domain, points)
            for name in ("history", "history_step"):
                self.coefficients[name] = ufl.Coefficient(self._points)
            self.coefficients["span"] = ufl.Coefficient(self._space("DG", 0))
            self._constant = ufl.Coefficient(self._points)
        stresses = basix.ufl.quadrature_element(
            kind.cell, value_shape=(len(PAIRS),), degree=kind.quadrature
        )
        self._stresses = ufl.FunctionSpace(self._domain, stresses)
        self.coefficients["excess"] = ufl.Coefficient(self._stresses)
        self._measure = ufl.dx(self._domain, metadata={"quadrature_degree": kind.quadrature})
        self._evaluate(list(values))

    def _space(self, family: str, degree: int, shape: tuple[int, ...] = ()) -> Any:
        """Space on the reference cell."""
        variant: dict[str, Any] = {}
        if degree > 0:
            variant["lagrange_variant"] = basix.LagrangeVariant.equispaced
        if family == "DG":
            variant["discontinuous"] = True
        element = basix.ufl.element("Lagrange", self.kind.cell, degree, shape=shape, **variant)
        return ufl.FunctionSpace(self._domain, element)

    def _geometry(self) -> None:
        """Inverse Jacobian, weight, and, where it is needed, the place."""
        kind, d = self.kind, self.kind.dimension
        if kind.geometry == 0:
            inverse = ufl.Coefficient(self._space("DG", 0, (d, d)))
            size = ufl.Coefficient(self._space("DG", 0))
            self.coefficients |= {"inverse": inverse, "size": size}
            self._inverse, self.volume = inverse, size
            return
        place = ufl.Coefficient(self._space("Lagrange", kind.geometry, (3,)))
        size = ufl.Coefficient(self._space("DG", 0))  # thickness of plane figures
        self.coefficients |= {"place": place, "size": size}
        jacobian = ufl.as_matrix([[ufl.grad(place)[i, j] for j in range(d)] for i in range(d)])
        self._inverse, self.volume = ufl.inv(jacobian), size * ufl.det(jacobian)
        if kind.plane == "axisymmetric":
            self.volume = 2.0 * ufl.pi * place[0] * self.volume

    def gradient(self, vector: Any, rate: bool = False) -> Any:
        """Gradient (3, 3) of positions, or of velocities, by the places at the start."""
        own = ufl.grad(vector) * self._inverse
        if self.kind.dimension == 3:
            return own
        across = 0.0 if rate else self.coefficients.get("stretch", 1.0)
        if self.kind.plane == "axisymmetric":
            across = vector[0] / self.coefficients["place"][0]
        return ufl.as_matrix(
            [[own[0, 0], own[0, 1], 0.0], [own[1, 0], own[1, 1], 0.0], [0.0, 0.0, across]]
        )

    def _evaluate(self, names: list[str]) -> None:
        """Energy and dissipation per volume."""
        self._F = ufl.variable(self.gradient(self.coefficients["position"]))
        seen = self._seen(self._F)
        rate = self.gradient(self.coefficients["velocity"], rate=True)
        self._W = self._scalar("energy", self._stored, seen, self._parameters)
        self._D = self._scalar(
            "dissipation", self.law.dissipation, self._F, rate, self._parameters, optional=True
        )
        self.damped = self._D is not None
        if self.damped and self.kind.plane == "stress":
            raise ValueError("a dissipation needs the rate of the thickness, not in plane stress")
        if self._internal:
            self._advanced = self._end_of_step()
        if idle := [name for name in names if name not in self._parameters.asked]:
            raise ValueError(f'the energy does not depend on the parameter "{idle[0]}"')
        if self.coefficients["position"] not in ufl.algorithms.extract_coefficients(self._W):
            raise ValueError("the energy does not depend on F")

    def _stored(self, F: Any, p: Any) -> Any:
        """Stored energy at constant internal variables, for which :meth:`_closed` puts advanced."""
        if not self._internal:
            return self.law.energy(F, p)
        law: Any = self.law
        return law.stored(F, self._constant, p)

    def _closed(self, form: Any) -> Any:
        """A form, differentiated at constant internal variables, at the end of the step."""
        return ufl.replace(form, {self._constant: self._advanced}) if self._internal else form

    def _end_of_step(self) -> Any:
        """Internal variables at the end of the step."""
        law: Any = self.law
        F = self._seen(self.gradient(self.coefficients["position"]))
        z, h = self.coefficients["history"], self.coefficients["span"]
        return ufl.as_vector(law.advance(F, z, h, self._parameters))

    def _seen(self, F: Any) -> Any:
        """Deformation gradient in the law: with the dilatation, if there is one beside F."""
        if self.kind.dilatation < 0 or self.law.split:
            return F
        return (self.coefficients["dilatation"] / ufl.det(F)) ** (1.0 / 3.0) * F

    @cached_property
    def advanced(self) -> Any:
        """Internal variables at the end of the step, times the weights of the points."""
        test = ufl.TestFunction(self._points)
        return ufl.inner(self._advanced, test) * self._measure

    @cached_property
    def advanced_action(self) -> Any:
        """Change of these along steps of positions and of internal variables at the beginning."""
        return self._change(self.advanced, ("position", "step"), ("history", "history_step"))

    @cached_property
    def advanced_by_positions(self) -> Any:
        """Derivatives of their sum, with steps of internal variables as factors, by positions."""
        total = ufl.action(self.advanced, self.coefficients["history_step"])
        return ufl.derivative(total, self.coefficients["position"], ufl.TestFunction(self._vectors))

    @cached_property
    def advanced_by_history(self) -> Any:
        """Derivatives of this sum by the internal variables at the beginning."""
        total = ufl.action(self.advanced, self.coefficients["history_step"])
        return ufl.derivative(total, self.coefficients["history"], ufl.TestFunction(self._points))

    @cached_property
    def force_action_of_history(self) -> Any:
        """Change of the forces along steps of the internal variables at the beginning."""
        return self._change(self.force, ("history", "history_step"))

    @cached_property
    def power_by_history(self) -> Any:
        """Derivatives of the work of the forces on steps of the nodes by these variables."""
        work = ufl.action(self.force, self.coefficients["step"])
        return ufl.derivative(work, self.coefficients["history"], ufl.TestFunction(self._points))

    @cached_property
    def volumes(self) -> Any:
        """Volumes at the points of the quadrature, m^3."""
        return self._integral(ufl.TestFunction(self._scalars))

    @cached_property
    def pulls(self) -> Any:
        """Stresses across a plane figure, zero in plane stress, times the points' weights."""
        across = ufl.diff(self._W, self._F)[2, 2]
        return self._closed(across * ufl.TestFunction(self._scalars) * self._measure)

    @cached_property
    def pulls_action(self) -> Any:
        """Change of these stresses along steps of positions and of the stretch across."""
        return self._change(self.pulls, ("position", "step"), ("stretch", "stretch_step"))

    def _scalar(self, what: str, function: Any, *arguments: Any, optional: bool = False) -> Any:
        """Value of a function of the law."""
        try:
            value = function(*arguments)
            if optional and value is None:
                return None
            found = ufl.as_ufl(value)
        except Exception as error:  # whatever a user's function raises
            text = str(error).partition("\n")[0] or type(error).__name__
            raise ValueError(f"{what} fails: {text}") from None
        if found.ufl_shape != ():
            raise ValueError(f"{what} must return a scalar, got shape {found.ufl_shape}")
        return found

    def _integral(self, density: Any) -> Any:
        return density * self.volume * self._measure

    @cached_property
    def energy(self) -> Any:
        """Strain energy, J."""
        return self._closed(self._integral(self._W))

    @cached_property
    def _dilated(self) -> Any:
        """The dilatation's functions as test functions."""
        return ufl.TestFunction(self.coefficients["dilatation"].ufl_function_space())

    @cached_property
    def moments(self) -> Any:
        """Integrals of J times the dilatation's functions, m^3."""
        return self._integral(ufl.det(self._F) * self._dilated)

    @cached_property
    def duals(self) -> Any:
        """Derivatives of the energy by the dilatation, J."""
        stored = self._integral(self._W)
        return self._closed(ufl.derivative(stored, self.coefficients["dilatation"], self._dilated))

    @cached_property
    def force(self) -> Any:
        """Elastic and viscous forces on the nodes, N."""
        stored = self._integral(self._W)
        if self.kind.dilatation >= 0:
            stored = stored + self._integral(self.coefficients["multiplier"] * ufl.det(self._F))
        test = ufl.TestFunction(self._vectors)
        total = ufl.derivative(stored, self.coefficients["position"], test)
        if self._D is not None:
            lost = self._integral(self._D)
            total = total + ufl.derivative(lost, self.coefficients["velocity"], test)
        return self._closed(total)

    def _change(self, form: Any, *names: tuple[str, str]) -> Any:
        """Change of a form along steps of some coefficients."""
        parts = [
            ufl.derivative(form, self.coefficients[of], self.coefficients[by]) for of, by in names
        ]
        return sum(parts[1:], start=parts[0])

    @cached_property
    def action(self) -> Any:
        """Change of the forces along steps of positions and velocities."""
        steps = [("position", "step")]
        if self.kind.dilatation >= 0:
            steps += [("dilatation", "dilatation_step"), ("multiplier", "multiplier_step")]
        if self.kind.plane == "stress":
            steps.append(("stretch", "stretch_step"))
        if self.damped:
            steps.append(("velocity", "rate"))
        return self._change(self.force, *steps)

    @cached_property
    def moments_action(self) -> Any:
        """Change of the moments along a step of the positions."""
        return self._change(self.moments, ("position", "step"))

    @cached_property
    def duals_action(self) -> Any:
        """Change of the duals along steps of positions and dilatation."""
        return self._change(self.duals, ("position", "step"), ("dilatation", "dilatation_step"))

    @cached_property
    def stresses(self) -> Any:
        """Second Piola-Kirchhoff stresses without the multiplier, times the points' weights."""
        S = ufl.inv(self._F) * ufl.diff(self._W, self._F)
        found = ufl.as_vector([S[pair] for pair in PAIRS])
        return self._closed(ufl.inner(found, ufl.TestFunction(self._stresses)) * self._measure)

    @cached_property
    def stresses_action(self) -> Any:
        """Change of these stresses along steps of positions and dilatation."""
        steps = [("position", "step")]
        if self.kind.dilatation >= 0 and not self.law.split:
            steps.append(("dilatation", "dilatation_step"))
        if self.kind.plane == "stress":
            steps.append(("stretch", "stretch_step"))
        return self._change(self.stresses, *steps)

    @cached_property
    def stiffening(self) -> Any:
        """Change of the forces of excess stresses, which stay as they are, along a step."""
        excess = self.coefficients["excess"]
        S = [[excess[PAIRS.index((min(i, j), max(i, j)))] for j in range(3)] for i in range(3)]
        moved = self.gradient(self.coefficients["step"], rate=True) * ufl.as_matrix(S)
        test = self.gradient(ufl.TestFunction(self._vectors), rate=True)
        return self._integral(ufl.inner(moved, test))

    @cached_property
    def resistance(self) -> Any:
        """Viscous forces on the nodes, N."""
        test = ufl.TestFunction(self._vectors)
        return ufl.derivative(self._integral(self._D), self.coefficients["velocity"], test)

    @cached_property
    def fields(self) -> Any:
        """Integrals of :data:`FIELDS` times the functions of degree p - 1, field by field."""
        F, J = self._F, ufl.det(self._F)
        P = ufl.diff(self._W, self._F)
        if self.kind.dilatation >= 0:
            P = P + self.coefficients["multiplier"] * J * ufl.inv(F).T
        stress, strain = P * F.T / J, (F.T * F - ufl.Identity(3)) / 2.0
        values = [tensor[pair] for tensor in (stress, strain) for pair in PAIRS]
        space = self._space("DG", self.kind.degree - 1, (len(values) + 1,))
        found = ufl.inner(ufl.as_vector([*values, J]), ufl.TestFunction(space))
        return self._closed(self._integral(found))

    def products(self, family: str, degree: int) -> Any:
        """Products of the shape functions of a degree, integrated, m^3."""
        space = self._space(family, degree)
        more = {0: 0, 1: 1 if self.kind.cell in ("triangle", "tetrahedron") else 2}
        order = 2 * degree + more.get(self.kind.geometry, 3 * self.kind.geometry)
        order += self.kind.plane == "axisymmetric"
        measure = ufl.dx(self._domain, metadata={"quadrature_degree": order})
        return ufl.TestFunction(space) * ufl.TrialFunction(space) * self.volume * measure
