# SPDX-License-Identifier: LGPL-3.0-or-later
"""Beam laws as UFL expressions.

The functions of a ``SectionLaw`` are called once with symbols for strain, strain rate and
parameters that are the same for all laws of a process. Laws that say the same thing are then equal,
whichever functions and values they come from, and share their forms and kernels.
"""

from dataclasses import dataclass
from functools import cache
from types import SimpleNamespace
from typing import Any

import basix.ufl
import ufl
from ufl.classes import (
    Coefficient,
    ConstantValue,
    Label,
    MultiIndex,
)
from ufl.corealg.traversal import unique_pre_traversal

from flexfem._checks import show
from flexfem.forms.lie import Expr
from flexfem.materials.section_law import SectionLaw

__all__ = [
    "LawExpressions",
    "LawForm",
    "constant_field",
    "interval_mesh",
    "law_expressions",
    "law_form",
    "symmetric",
    "written",
]


def interval_mesh() -> ufl.Mesh:
    """The abstract mesh of two-node lines in space."""
    return ufl.Mesh(basix.ufl.element("Lagrange", "interval", 1, shape=(3,)))


def constant_field(mesh: ufl.Mesh, *shape: int) -> ufl.Coefficient:
    """A coefficient that is constant on every cell."""
    return ufl.Coefficient(
        ufl.FunctionSpace(mesh, basix.ufl.element("DG", "interval", 0, shape=shape))
    )


def written(mesh: ufl.Mesh, entries: list[Expr]) -> ufl.Form:
    """Form whose vector holds the entries."""
    shape = (len(entries),)
    space = ufl.FunctionSpace(mesh, basix.ufl.element("DG", "interval", 0, shape=shape))
    value = ufl.dot(ufl.as_vector(entries), ufl.TestFunction(space))
    form: ufl.Form = value / ufl.CellVolume(mesh) * ufl.dx(mesh, degree=0)
    return form


def symmetric(values: Expr) -> Expr:
    """Symmetric 6x6 matrix from its 21 upper-triangle entries, row by row."""
    index: dict[tuple[int, int], int] = {}
    for i in range(6):
        for j in range(i, 6):
            index[i, j] = index[j, i] = len(set(index.values()))
    return ufl.as_matrix([[values[index[i, j]] for j in range(6)] for i in range(6)])


@dataclass(frozen=True)
class _Symbols:
    """Arguments with which the functions of laws are called."""

    mesh: ufl.Mesh
    strain: ufl.Coefficient
    strain_rate: ufl.Coefficient


@cache
def _symbols() -> _Symbols:
    mesh = interval_mesh()
    return _Symbols(mesh, constant_field(mesh, 6), constant_field(mesh, 6))


@cache
def _parameters(count: int) -> ufl.Coefficient:
    """Symbol of the parameters of laws that have ``count`` of them."""
    # UFL sorts sums by the age of coefficients: this one is always younger than the strains
    return constant_field(_symbols().mesh, count)


@dataclass(frozen=True)
class LawExpressions:
    """Expressions returned by the functions of a law; equal for laws with equal expressions.

    Attributes:
        energy: Strain energy per length, J/m.
        dissipation: Dissipation potential per length, W/m; None for none.
        count: Number of parameters.
    """

    energy: Expr
    dissipation: Expr | None
    count: int

    def stress(self, strain: Expr, strain_rate: Expr, parameters: Expr) -> Expr:
        """Stress resultants (6,) as a function of any strain, rate and parameters."""
        stress = self._gradient(self.energy, 0, strain, strain_rate, parameters)
        if self.dissipation is not None:
            stress += self._gradient(self.dissipation, 1, strain, strain_rate, parameters)
        return stress

    def _gradient(
        self, potential: Expr, which: int, strain: Expr, strain_rate: Expr, parameters: Expr
    ) -> Expr:
        """Derivative of a potential with respect to the strain (0) or its rate (1)."""
        symbols, values = _symbols(), [ufl.variable(strain), ufl.variable(strain_rate)]
        mapping = {symbols.strain: values[0], symbols.strain_rate: values[1]}
        if self.count:
            mapping[_parameters(self.count)] = parameters
        return ufl.diff(ufl.replace(potential, mapping), values[which])


def law_expressions(law: SectionLaw) -> LawExpressions:
    """Call the functions of a law and check the returned values.

    Raises:
        ValueError: A function fails, or returns anything but a UFL scalar of its arguments.
    """
    symbols, p = _symbols(), SimpleNamespace()
    if law.parameters:
        values = _parameters(len(law.parameters))
        p = SimpleNamespace(**{name: values[i] for i, name in enumerate(law.parameters)})
    arguments: tuple[Any, ...] = (symbols.strain, p)
    energy = _called(law, "energy", law.energy, arguments)
    if symbols.strain not in set(unique_pre_traversal(energy)):
        raise ValueError(f"{law.owner}: energy does not depend on the strain, got {show(energy)}")
    dissipation = None
    if law.dissipation is not None:
        arguments = (symbols.strain, symbols.strain_rate, p)
        dissipation = _called(law, "dissipation", law.dissipation, arguments)
        if symbols.strain_rate not in set(unique_pre_traversal(dissipation)):
            raise ValueError(
                f"{law.owner}: dissipation does not depend on the strain rate, got "
                f"{show(dissipation)}"
            )
    return LawExpressions(energy, dissipation, len(law.parameters))


def _called(law: SectionLaw, what: str, function: Any, arguments: tuple[Any, ...]) -> Expr:
    """Value of a law's function, checked to be a scalar of its arguments alone."""
    try:
        value = function(*arguments)
    except Exception as error:  # a user's function: any error in it is wrong input
        if isinstance(error, AttributeError) and error.obj is arguments[-1]:
            given = ", ".join(law.parameters) or "none"
            reason = f'uses the parameter "{error.name}", given are {given}'
        else:
            reason = f"fails with {type(error).__name__}: {' '.join(str(error).split())}"
        raise ValueError(f"{law.owner}: {what} {reason}") from None
    try:
        value = ufl.as_ufl(value)
        scalar = value.ufl_shape == () and not value.ufl_free_indices
    except (AttributeError, ValueError):
        scalar = False
    if not scalar:
        raise ValueError(f"{law.owner}: {what} must return a UFL scalar, got {show(value)}")
    _check_terminals(law, what, value, arguments)
    return value


def _check_terminals(law: SectionLaw, what: str, value: Expr, arguments: tuple[Any, ...]) -> None:
    """Check that an expression consists of the symbols of a law and numbers."""
    symbols = {a for a in arguments if isinstance(a, Coefficient)}
    if law.parameters:
        symbols.add(_parameters(len(law.parameters)))
    for node in unique_pre_traversal(value):
        foreign = node._ufl_is_terminal_ and not isinstance(
            node, ConstantValue | MultiIndex | Label
        )
        if foreign and node not in symbols:
            raise ValueError(
                f"{law.owner}: {what} may depend on its arguments and numbers only, but has "
                f"{show(node)}"
            )


@dataclass(frozen=True)
class LawForm:
    """All quantities of a law in one cell, as one form.

    Attributes:
        form: rank 1; its vector holds the energy, the stress (6), its derivative by the strain
            (6, 6), and of a law with dissipation the viscous stress (6) and its derivative by the
            strain rate (6, 6).
        coefficients: strain, strain rate and, if there are any, parameters.
        size: length of the vector.
    """

    form: ufl.Form
    coefficients: tuple[ufl.Coefficient, ...]
    size: int


@cache
def law_form(law: LawExpressions) -> LawForm:
    """Build the form of a law."""
    symbols = _symbols()
    strain, rate = ufl.variable(symbols.strain), ufl.variable(symbols.strain_rate)
    mapping = {symbols.strain: strain, symbols.strain_rate: rate}
    energy = ufl.replace(law.energy, mapping)
    entries = [energy, *_derivatives(energy, strain)]
    if law.dissipation is not None:
        entries += _derivatives(ufl.replace(law.dissipation, mapping), rate)
    space = ufl.FunctionSpace(
        symbols.mesh, basix.ufl.element("DG", "interval", 0, shape=(len(entries),))
    )
    value = ufl.dot(ufl.as_vector(entries), ufl.TestFunction(space))
    form = value / ufl.CellVolume(symbols.mesh) * ufl.dx(symbols.mesh, degree=0)
    coefficients: tuple[ufl.Coefficient, ...] = (symbols.strain, symbols.strain_rate)
    if law.count:
        coefficients += (_parameters(law.count),)
    return LawForm(form, coefficients, len(entries))


def _derivatives(potential: Expr, by: Expr) -> list[Expr]:
    """Entries of the gradient of a potential, then those of its second derivative row by row."""
    gradient = ufl.diff(potential, by)
    second = ufl.diff(gradient, by)
    return [*(gradient[i] for i in range(6)), *(second[i, j] for i in range(6) for j in range(6))]
