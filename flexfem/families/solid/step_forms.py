# SPDX-License-Identifier: LGPL-3.0-or-later
"""UFL forms of the mean forces of a solid cell over a step, which do the work of energy changes.

With the deformation gradients F_0 and F_1 at both ends, their mean F_m and ``C = F^T F``,
``sym(F_m^T (F_1 - F_0)) = (C_1 - C_0)/2`` holds exactly. So the force ``int F_m S : grad v`` of a
stress S with ``S : (C_1 - C_0)/2 = W_1 - W_0`` at every point of the quadrature does the work of
the energy's change; S being symmetric, it has no moment about the mean positions, and no resultant.
Such an S is the mean of the stresses at both ends and what Gonzalez (Comput. Methods Appl. Mech.
Eng. 190 (2000) 1763-1783) adds along the change of C, a term of second order in the step. With a
dilatation theta W changes by C and theta, theta by the projection of J, and J by C, each in this
way. Viscous forces are those of F_m and ``(F_1 - F_0)/h``, whose rate of C is that of the step.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import ufl

from flexfem.families.solid.forms import CellKind, LawFunctions, LawParameters, SolidForms

__all__ = ["SolidStepForms"]

#: Change of C below which what is added is computed from stresses: the difference of two energies,
#: over a small change of C, is rounding, and Simpson's rule is exact to the fifth power of it.
_SMALL = 1e-3
#: Square of a change of C far above rounding, of which derivatives of what is added would consist
#: if it were less. There that is less than 1e-24 of the stress.
_TINY = 1e-24


def _values(function: Any, F: Any, theta: Any) -> tuple[Any, Any, Any]:
    """A function of F and theta, its stress ``F^-1 dW/dF`` and its derivative by theta."""
    value = function(F, theta)
    slope = ufl.as_ufl(0.0) if theta is None else ufl.diff(value, theta)
    return value, ufl.inv(F) * ufl.diff(value, F), slope


class SolidStepForms(SolidForms):
    """Forms of a law in cells of a kind over a step.

    The coefficients are those of :class:`SolidForms` and, with names that no parameter has,
    ``_start``, the positions at the start of the step, ``_start_dilatation`` and ``_per_step``,
    1/h; ``position`` and ``dilatation`` are at the end. With numerical dissipation there are
    ``_before`` and ``_last``, at the start and the end of the last step, ``_before_dilatation`` and
    ``_last_dilatation``, ``_half``, half the dissipation, ``_share`` of the last change, and moduli
    of the law at rest, ``_shear`` and ``_bulk``, Pa. :attr:`force` and :attr:`duals` are means over
    the step, :attr:`moments` those of the end.
    """

    def __init__(
        self, law: LawFunctions, kind: CellKind, sizes: Mapping[str, int], dissipates: bool
    ) -> None:
        """Evaluate the law; see :class:`SolidForms`."""
        super().__init__(law, kind, sizes)
        self._dissipates = dissipates
        names = ["_per_step", *(("_half", "_share", "_shear", "_bulk") if dissipates else ())]
        for name in names:
            self.coefficients[name] = ufl.Coefficient(self._space("DG", 0))
        for name in ("_start", *(("_before", "_last") if dissipates else ())):
            self.coefficients[name] = ufl.Coefficient(self._vectors)
            if kind.dilatation >= 0:
                space = self.coefficients["dilatation"].ufl_function_space()
                self.coefficients[f"{name}_dilatation"] = ufl.Coefficient(space)
        self._values = {name: self.coefficients[name] for name in sizes}

    @cached_property
    def _ends(self) -> list[tuple[Any, Any]]:
        """F and theta (None without) at the start and the end, as variables."""
        names = ("_start", "_start_dilatation"), ("position", "dilatation")
        return [
            (
                ufl.variable(self.gradient(self.coefficients[place])),
                ufl.variable(self.coefficients[theta]) if self.kind.dilatation >= 0 else None,
            )
            for place, theta in names
        ]

    def _energy_at(self, F: Any, theta: Any) -> Any:
        """Energy per volume."""
        if theta is None or self.law.split:
            return self.law.energy(F, LawParameters(self._values, theta))
        seen = (theta / ufl.det(F)) ** (1.0 / 3.0) * F
        return self.law.energy(seen, LawParameters(self._values))

    @cached_property
    def _strain(self) -> Any:
        """Change of C over the step."""
        (F0, _), (F1, _) = self._ends
        return F1.T * F1 - F0.T * F0

    def _means(self, function: Any, swelling: Any) -> tuple[Any, Any]:
        """Mean stress, and derivative by theta, whose products with the changes are a function's.

        Args:
            function: of F and theta, the same for all rotations.
            swelling: change of theta, zero for functions of F alone.
        """
        change, middle = self._strain, self._middle
        (W0, S0, p0), (W1, S1, p1) = (_values(function, *end) for end in self._ends)
        _, Sm, pm = _values(function, *middle)

        def along(stress: Any, slope: Any) -> Any:
            return ufl.inner(stress, change) / 2.0 + slope * swelling

        stress, slope = (S0 + S1) / 2.0, (p0 + p1) / 2.0
        square = ufl.inner(change, change) + swelling * swelling
        exact = W1 - W0 - along(stress, slope)
        # Simpson's rule for the integral of the stress along the change, less the mean
        smooth = 2.0 / 3.0 * along(Sm - stress, pm - slope)
        share = square * square / (square * square + _SMALL**4)
        part = (share * exact + (1.0 - share) * smooth) / (square + _TINY)
        return stress + 2.0 * part * change, slope + part * swelling

    @cached_property
    def _middle(self) -> tuple[Any, Any]:
        """Deformation gradient without rotation whose C is the mean one, and the mean theta."""
        (F0, before), (F1, after) = self._ends
        C = (F0.T * F0 + F1.T * F1) / 2.0
        a = ufl.sqrt(C[0, 0])
        b, c = C[0, 1] / a, C[0, 2] / a
        d = ufl.sqrt(C[1, 1] - b * b)
        e = (C[1, 2] - b * c) / d
        f = ufl.sqrt(C[2, 2] - c * c - e * e)
        U = ufl.as_matrix([[a, b, c], [0.0, d, e], [0.0, 0.0, f]])
        theta = None if before is None else ufl.variable((before + after) / 2.0)
        return ufl.variable(U), theta

    @cached_property
    def _mean(self) -> tuple[Any, Any]:
        """Those of the energy."""
        (_, before), (_, after) = self._ends
        swelling = ufl.as_ufl(0.0) if before is None else after - before
        stress, slope = self._means(self._energy_at, swelling)
        if self._dissipates:
            more, further = self._dissipation(swelling)
            stress, slope = stress + more, slope + further
        return stress, slope

    def _dissipation(self, swelling: Any) -> tuple[Any, Any]:
        """Stress, and derivative by theta, of second differences: ``chi/2 S (De - De_last)``.

        The strains e are Green's and theta, their moduli S constant: with any others the sum that
        never grows would not be one (``integrators.energy_momentum.scheme``).
        """
        given = self.coefficients
        before, after = (self.gradient(given[name]) for name in ("_before", "_last"))
        last = given["_share"] * (after.T * after - before.T * before)
        second = (self._strain - last) / 2.0
        stress = 2.0 * given["_shear"] * ufl.dev(second)
        if self.kind.dilatation < 0:
            return given["_half"] * (stress + given["_bulk"] * ufl.tr(second) * ufl.Identity(3)), 0
        swelled = given["_last_dilatation"] - given["_before_dilatation"]
        swelled = swelling - given["_share"] * swelled
        return given["_half"] * stress, given["_half"] * given["_bulk"] * swelled

    @cached_property
    def duals(self) -> Any:
        """Mean derivatives of the energy by the dilatation, J."""
        return self._integral(self._mean[1] * self._dilated)

    @cached_property
    def force(self) -> Any:
        """Mean elastic and viscous forces on the nodes over the step, N."""
        (F0, _), (F1, _) = self._ends
        middle, stress = (F0 + F1) / 2.0, self._mean[0]
        if self.kind.dilatation >= 0:
            by_volume, _ = self._means(lambda F, theta: ufl.det(F), ufl.as_ufl(0.0))
            stress = stress + self.coefficients["multiplier"] * by_volume
        mean = middle * stress
        if self.damped:
            mean = mean + self._viscous(middle)
        test = self.gradient(ufl.TestFunction(self._vectors), rate=True)
        return self._integral(ufl.inner(mean, test))

    def _viscous(self, middle: Any) -> Any:
        """Viscous part of the mean first Piola stress."""
        change = self.coefficients["position"] - self.coefficients["_start"]
        rate = ufl.variable(self.coefficients["_per_step"] * self.gradient(change, rate=True))
        return ufl.diff(self.law.dissipation(middle, rate, LawParameters(self._values)), rate)

    @cached_property
    def last_action(self) -> Any:
        """Change of the forces along a step of the positions at the end of the last step."""
        return self._change(self.force, ("_last", "step"))

    @cached_property
    def loss(self) -> Any:
        """Energy that the viscous forces take in the step, J."""
        (F0, _), (F1, _) = self._ends
        return self._integral(ufl.inner(self._viscous((F0 + F1) / 2.0), F1 - F0))

    @cached_property
    def action(self) -> Any:
        """Change of the forces along steps of the positions at the end, and what follows them."""
        steps = [("position", "step")]
        if self.kind.dilatation >= 0:
            steps += [("dilatation", "dilatation_step"), ("multiplier", "multiplier_step")]
        return self._change(self.force, *steps)
