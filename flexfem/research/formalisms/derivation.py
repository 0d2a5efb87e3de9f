# SPDX-License-Identifier: LGPL-3.0-or-later
"""Energies of a body in a floating frame, and the equations of the four formalisms.

All coordinates of a cell, elastic ones and those of the frame, are one coefficient q of a mixed
element; the frame's part is constant over the cell and shared by all cells. So one operator,
``ufl.derivative``, serves both: velocities are ``dr/dq [q']``, accelerations one more total time
derivative, and an equation of motion is the derivative of an energy in the direction of a test
function of the mixed space, whose components are the rows of both nodes and frame.

Kinetic energy and energy of accelerations are the same quadratic form, of velocities and of
accelerations: Ec = T(v) and Ea = T(a), T(w) = 1/2 int rho w.w.

Vlase, Marin, Negrean, "Finite Element Method-Based Elastic Analysis of Multibody Systems: A
Review", Mathematics 10 (2022) 257: the formalisms and their comparison.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import basix.ufl
import ufl

from flexfem.research.formalisms.description.frames import Frame
from flexfem.research.formalisms.description.matter import Matter

__all__ = ["BodyEnergies", "kernel_parts"]

Expr = Any
Form = Any
_D = ufl.derivative


def kernel_parts(form: Form) -> list[Form]:
    """Parts of a form that may be compiled each as one kernel; those that vanish are left out.

    FFCx takes an integrand with a rule of one point for constant over the cell, and then finds that
    value also where another rule of the same kernel asks for its own. So one-point rules go apart.
    """
    rules: dict[bool, list[Any]] = {}
    for integral in form.integrals():
        rules.setdefault(integral.metadata()["quadrature_degree"] <= 1, []).append(integral)
    parts = [ufl.Form(integrals) for integrals in rules.values()]
    if len(parts) == 1:
        return parts
    return [part for part in parts if not ufl.algorithms.expand_derivatives(part).empty()]


@dataclass(frozen=True)
class BodyEnergies:
    """Symbolic energies of bodies of one kind of matter in one kind of frame.

    Args:
        matter: materials of the bodies; the numbers do not enter the forms.
        frame: coordinates of their frames.
    """

    matter: Matter
    frame: Frame

    @cached_property
    def mesh(self) -> ufl.Mesh:
        """Abstract mesh of straight cells."""
        cell = self.matter.cell
        dimension = {"interval": 1, "triangle": 2, "tetrahedron": 3}[cell]
        return ufl.Mesh(basix.ufl.element("Lagrange", cell, 1, shape=(dimension,)))

    @cached_property
    def elastic_element(self) -> Any:
        """Element of the elastic displacement."""
        m = self.matter
        return basix.ufl.element("Lagrange", m.cell, m.degree, shape=(m.components,))

    @cached_property
    def space(self) -> ufl.FunctionSpace:
        """Space of all coordinates of a cell: elastic ones first, then those of the frame."""
        rigid = basix.ufl.element("DG", self.matter.cell, 0, shape=(self.frame.count,))
        return ufl.FunctionSpace(self.mesh, basix.ufl.mixed_element([self.elastic_element, rigid]))

    @cached_property
    def fields(self) -> tuple[ufl.Coefficient, ufl.Coefficient, ufl.Coefficient]:
        """Coordinates q, their rates q' and second rates q''."""
        return tuple(ufl.Coefficient(self.space) for _ in range(3))  # type: ignore[return-value]

    @cached_property
    def constants(self) -> dict[str, ufl.Constant]:
        """Numbers of the matter, "damping" (s), "gravity" (m/s^2), "weights" of sums of forms."""
        x, u = ufl.SpatialCoordinate(self.mesh), ufl.split(self.fields[0])[0]
        axes = max(self.frame.dimension, self.matter.place(x, u).ufl_shape[0])
        names = [*self.matter.parameters, "damping"]
        shapes: dict[str, tuple[int, ...]] = dict.fromkeys(names, ())
        shapes |= {"gravity": (axes,), "weights": (4,)}
        return {name: ufl.Constant(self.mesh, shape=shape) for name, shape in shapes.items()}

    @cached_property
    def positions(self) -> list[tuple[Expr, Expr, bool]]:
        """Terms of the inertia: density, vector in inertial axes, whether it is a position."""
        u, g = ufl.split(self.fields[0])
        x = ufl.SpatialCoordinate(self.mesh)
        return [
            (density, self.frame.place(g, a) if bound else self.frame.turn(g, a), bound)
            for density, a, bound in self.matter.inertia(x, u, self.constants)
        ]

    def rate(self, e: Expr) -> Expr:
        """Total time derivative of an expression or form of q and q'."""
        q, qd, qdd = self.fields
        return _D(e, q, qd) + _D(e, qd, qdd)

    def _inertia(self, vectors: list[Expr]) -> Expr:
        """T(w): the quadratic form of kinetic energy and of the energy of accelerations."""
        dx = ufl.dx(metadata={"quadrature_degree": 2 * self.matter.degree})
        densities = [density for density, _, _ in self.positions]
        pairs = zip(densities, vectors, strict=True)
        return sum(0.5 * density * ufl.dot(w, w) for density, w in pairs) * dx

    @cached_property
    def velocities(self) -> list[Expr]:
        """Velocities of the points and rates of the directions."""
        q, qd, _ = self.fields
        return [_D(r, q, qd) for _, r, _ in self.positions]

    @cached_property
    def kinetic(self) -> Form:
        """Ec."""
        return self._inertia(self.velocities)

    @cached_property
    def of_accelerations(self) -> Form:
        """Ea, the energy of accelerations (Gibbs' function)."""
        return self._inertia([self.rate(v) for v in self.velocities])

    def _strain(self, field: ufl.Coefficient) -> Form:
        u = ufl.split(field)[0]
        dx = ufl.dx(metadata={"quadrature_degree": self.matter.strain_degree})
        return self.matter.strain_energy(u, self.constants) * dx

    @cached_property
    def potential(self) -> Form:
        """Strain energy and potential of gravity."""
        dx = ufl.dx(metadata={"quadrature_degree": 2 * self.matter.degree})
        g = self.constants["gravity"]
        weight = sum(density * ufl.dot(g, r) for density, r, bound in self.positions if bound)
        return self._strain(self.fields[0]) - weight * dx

    @cached_property
    def dissipation(self) -> Form:
        """Rayleigh's function: the strain energy of the rates times the damping."""
        return self.constants["damping"] * self._strain(self.fields[1])

    @cached_property
    def lagrangian(self) -> Form:
        """L = Ec - V."""
        return self.kinetic - self.potential

    @cached_property
    def _test(self) -> Expr:
        return ufl.TestFunction(self.space)

    @cached_property
    def _trial(self) -> Expr:
        return ufl.TrialFunction(self.space)

    @cached_property
    def momentum(self) -> Form:
        """dL/dq': the momenta p."""
        return _D(self.lagrangian, self.fields[1], self._test)

    @cached_property
    def _damping(self) -> Form:
        return _D(self.dissipation, self.fields[1], self._test)

    @cached_property
    def force(self) -> Form:
        """dL/dq - dD/dq': the rates of the momenta without applied forces, -dH/dq + Q."""
        return _D(self.lagrangian, self.fields[0], self._test) - self._damping

    @cached_property
    def lagrange(self) -> Form:
        """d/dt dL/dq' - dL/dq + dD/dq': three derivatives."""
        slope = _D(self.lagrangian, self.fields[0], self._test)
        return self.rate(self.momentum) - slope + self._damping

    @cached_property
    def gibbs_appell(self) -> Form:
        """dEa/dq'' + dV/dq + dD/dq': one derivative of the inertia."""
        q, _, qdd = self.fields
        slope = _D(self.potential, q, self._test)
        return _D(self.of_accelerations, qdd, self._test) + slope + self._damping

    @cached_property
    def tangent(self) -> Form:
        """weights[0] dF/dq + weights[1] dF/dq' + weights[2] dF/dq'' of the equations F.

        The equations of Lagrange and of Gibbs and Appell are the same functions, so that their
        derivatives are too; they are taken of the shorter form.
        """
        F, w = self.gibbs_appell, self.constants["weights"]
        terms = (w[i] * _D(F, field, self._trial) for i, field in enumerate(self.fields))
        return sum(terms, start=ufl.Form([]))

    @cached_property
    def hamilton(self) -> Form:
        """Momenta p and forces f: weights . (dp/dq', dp/dq, df/dq, df/dq')."""
        q, qd, _ = self.fields
        p, f, w = self.momentum, self.force, self.constants["weights"]
        pairs = [(p, qd), (p, q), (f, q), (f, qd)]
        terms = (w[i] * _D(e, field, self._trial) for i, (e, field) in enumerate(pairs))
        return sum(terms, start=ufl.Form([]))

    @cached_property
    def energy(self) -> Form:
        """weights[0] Ec + weights[1] V."""
        w = self.constants["weights"]
        return w[0] * self.kinetic + w[1] * self.potential
