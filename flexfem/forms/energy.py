# SPDX-License-Identifier: LGPL-3.0-or-later
"""UFL forms of a user-defined energy of nodal positions."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import basix.ufl
import ufl

__all__ = ["EnergyForms", "Parameters"]


class Parameters:
    """Parameters of an energy as attributes and by names; records those that are used."""

    def __init__(self, values: Mapping[str, Any]) -> None:
        """Take coefficients by name."""
        self._values, self.asked = values, set[str]()

    def __getitem__(self, name: str) -> Any:
        """Return a parameter.

        Raises:
            ValueError: there is none of this name.
        """
        if name not in self._values:
            known = ", ".join(self._values) or "none"
            raise ValueError(f'the energy needs a parameter "{name}"; given are {known}')
        self.asked.add(name)
        return self._values[name]

    def __getattr__(self, name: str) -> Any:
        """Return a parameter."""
        return self[name]


@dataclass(frozen=True)
class EnergyForms:
    """Energy of a cell, its derivatives by the positions of the nodes, and the mass.

    Attributes:
        energy: form of degree zero, J.
        position: coefficient of the positions, m.
        parameters: coefficients that are constant in a cell, in the order of the names.
        measure: integration over the cell at the start.
    """

    energy: ufl.Form
    position: ufl.Coefficient
    parameters: tuple[ufl.Coefficient, ...]
    measure: ufl.Measure

    @classmethod
    def of(
        cls, energy: Callable[[Any, Any, Any], Any], cell: str, degree: int, names: Sequence[str],
        quadrature: int | None,
    ) -> "EnergyForms":  # fmt: skip
        """Forms of an energy.

        Args:
            energy: function of positions, places at the start and parameters.
            cell: shape of the cell; degree: of its shape functions.
            degree: of the shape functions.
            names: of the parameters.
            quadrature: degree of polynomials that are integrated exactly; None for twice that of
                the shape functions.

        Raises:
            ValueError: the function fails, returns no scalar, or leaves a parameter out.
        """
        vectors = basix.ufl.element("Lagrange", cell, degree, shape=(3,))
        domain = ufl.Mesh(vectors)
        x = ufl.Coefficient(ufl.FunctionSpace(domain, vectors))
        constant = ufl.FunctionSpace(domain, basix.ufl.element("DG", cell, 0))
        values = {name: ufl.Coefficient(constant) for name in names}
        parameters = Parameters(values)
        try:
            density = energy(x, ufl.SpatialCoordinate(domain), parameters)
            scalar = ufl.as_ufl(density).ufl_shape == ()
        except Exception as error:
            text = str(error).partition("\n")[0] or type(error).__name__
            raise ValueError(f"energy fails: {text}") from None
        if not scalar:
            raise ValueError(f"energy must return a scalar, got shape {density.ufl_shape}")
        if idle := [name for name in names if name not in parameters.asked]:
            raise ValueError(f'the energy does not depend on the parameter "{idle[0]}"')
        # one rule for all: UFL would choose others for derivatives, which then would be none
        order = 2 * degree if quadrature is None else quadrature
        measure = ufl.dx(domain, metadata={"quadrature_degree": order})
        form = density * measure
        if not isinstance(form, ufl.Form) or x not in form.coefficients():
            raise ValueError("energy does not depend on the positions x")
        return cls(form, x, tuple(values.values()), measure)

    @cached_property
    def force(self) -> Any:
        """First derivatives, N."""
        return ufl.derivative(self.energy, self.position)

    @cached_property
    def stiffness(self) -> Any:
        """Second derivatives, N/m."""
        return ufl.derivative(self.force, self.position)

    @cached_property
    def mass(self) -> Any:
        """Products of scalar shape functions, m^d."""
        space = self.position.ufl_function_space()
        element = space.ufl_element()
        scalar = basix.ufl.element("Lagrange", element.cell_type.name, element.degree)
        own = ufl.FunctionSpace(space.ufl_domain(), scalar)
        return ufl.TestFunction(own) * ufl.TrialFunction(own) * ufl.dx(space.ufl_domain())
