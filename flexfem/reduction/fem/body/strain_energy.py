# SPDX-License-Identifier: LGPL-3.0-or-later
"""Strain energies of homogeneous solids about their natural state, to fourth order.

The energy per volume at the start is a UFL function of the deformation gradient ``F = I + H``; UFL
differentiates it along four matrices at ``F = I``. Energies that are polynomials of fourth order,
as Saint Venant and Kirchhoff's, are so represented exactly.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement, permutations
from typing import Any

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem, mesh
from ufl.corealg.traversal import unique_pre_traversal

from flexfem import _checks
from flexfem._types import FloatArray
from flexfem.forms.energy import Parameters
from flexfem.kernels.ffcx_options import compile_options, quick_compiler, without_variables

__all__ = ["StrainEnergy", "law_energy"]

#: What has no derivatives everywhere.
_KINKS = (
    ufl.classes.Conditional, ufl.classes.Abs, ufl.classes.MinValue, ufl.classes.MaxValue,
)  # fmt: skip
#: Stress at rest, and energy of a rotation, over the stiffness, that are round-off.
_ROUND_OFF = 1e-8


class _Numbers(Parameters):
    """Parameters of a law, and J of a deformation gradient."""

    def volume_ratio(self, F: Any) -> Any:
        """J = det F."""
        return ufl.det(F)


@dataclass(frozen=True, eq=False)
class StrainEnergy:
    """Energy of a law and its derivatives at rest.

    Attributes:
        owner: for messages.
        density: energy per volume at the start, J/m^3, in UFL: a function of F (3, 3) and of the
            parameters.
        parameters: numbers and vectors (1, 3) of the law by name.
        quadrature: degree of polynomials that are integrated exactly over a cell.
    """

    owner: str
    density: Callable[[Any, Any], Any]
    parameters: Mapping[str, Any]
    quadrature: int

    @cached_property
    def derivatives(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Second (9, 9) to fourth (9, 9, 9, 9) derivatives at ``F = I`` by the rows of H.

        Raises:
            ValueError: the law is not smooth, or the body is not free of stress or resists
                rotation.
        """
        cell = mesh.create_unit_cube(MPI.COMM_SELF, 1, 1, 1)
        steps = [ufl.variable(fem.Constant(cell, np.zeros(()))) for _ in range(4)]
        ways = [fem.Constant(cell, np.zeros((3, 3))) for _ in range(4)]
        H = sum((s * way for s, way in zip(steps, ways, strict=True)), 0.0 * ways[0])
        change = self.density(ufl.Identity(3) + H, self._values(cell))
        for kink in unique_pre_traversal(change):
            if isinstance(kink, _KINKS):
                raise ValueError(f"{self.owner}: its law has a kink, and no derivatives at rest")
        found = []
        for step in steps:
            change = ufl.diff(change, step)
            found.append(change)
        with quick_compiler():
            expression = fem.Expression(
                without_variables(ufl.as_vector(found)), np.full((1, 3), 0.25), comm=MPI.COMM_SELF,
                **compile_options(MPI.COMM_SELF),
            )  # fmt: skip
        tensors = [np.zeros((9,) * order) for order in range(1, 5)]
        for chosen in combinations_with_replacement(range(9), 4):
            for way, component in zip(ways, chosen, strict=True):
                way.value.flat = np.eye(9)[component]
            values = expression.eval(cell, np.zeros(1, dtype=np.int32)).ravel()
            for order, tensor in enumerate(tensors, 1):
                for place in set(permutations(chosen[:order])):
                    tensor[place] = values[order - 1]
        stress, second, third, fourth = tensors
        self._check(stress, second, fourth)
        return second, third, fourth

    def _values(self, cell: mesh.Mesh) -> Parameters:
        """The parameters as constants."""
        return _Numbers({
            name: fem.Constant(cell, np.squeeze(np.asarray(value, dtype=np.float64)))
            for name, value in self.parameters.items()
        })  # fmt: skip

    def _check(self, stress: FloatArray, second: FloatArray, fourth: FloatArray) -> None:
        size = np.abs(second).max()
        if not np.isfinite(fourth).all():
            raise ValueError(f"{self.owner}: the derivatives of its law at rest are not finite")
        if not np.abs(stress).max() <= _ROUND_OFF * size:
            raise ValueError(
                f"{self.owner}: its law has a stress of {np.abs(stress).max():.3g} Pa at rest; a "
                "reduced body must be free of it"
            )
        turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 0]]).ravel()
        twist = np.array([[0.0, 0, 0], [0, 0, -1], [0, 1, 0]]).ravel()
        if max(np.abs(second @ turn).max(), np.abs(second @ twist).max()) > _ROUND_OFF * size:
            raise ValueError(f"{self.owner}: the energy of its law changes as the body rotates")


def law_energy(owner: str, law: Any, quadrature: int) -> StrainEnergy:
    """Energy of a law of solids, see ``flexfem.laws.SolidLaw``.

    Raises:
        ValueError: a law with internal variables, viscosity, or numbers that differ in place or
            time.
    """
    kind = type(law).__name__
    if len(law.initial):
        raise ValueError(
            f"{owner}: {kind} has internal variables, which a reduced body cannot have; take a "
            "Solid"
        )
    for name, value in law.parameters.items():
        if callable(value):
            raise ValueError(f'{owner}: {kind}: "{name}" must not change with time')
        given = np.asarray(value)
        if (given.ndim and given.shape not in ((1, 3), (1,))) or given.dtype == object:
            raise ValueError(
                f'{owner}: {kind}: "{name}" must be one number for the whole body, got '
                f"{_checks.show(value)}"
            )
    numbers = {name: ufl.as_ufl(1.0) for name in law.parameters}
    if law.dissipation(ufl.Identity(3), ufl.Identity(3), _Numbers(numbers)) is not None:
        raise ValueError(
            f"{owner}: {kind} has viscosity, which is not reduced; take reduce_body's damping"
        )
    return StrainEnergy(owner, law.energy, law.parameters, quadrature)
