# SPDX-License-Identifier: LGPL-3.0-or-later
"""Material laws with internal variables: viscoelastic and plastic solids.

Internal variables belong to the points of the quadrature. Over a step of a motion they advance from
their accepted values in closed form, with the time of the step; in statics the load factor takes
the place of time. The last one is the energy per volume that has been dissipated, J/m^3.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any

import numpy as np

from flexfem import _checks
from flexfem._fields import array, declared, instance
from flexfem._types import FloatArray
from flexfem.families.solid.laws.energies import (
    Parameter,
    SolidLaw,
    isochoric,
    joined,
    modulus,
    volumetric,
)

__all__ = ["HistoryLaw", "J2Plasticity", "Viscoelastic"]


class HistoryLaw(SolidLaw):
    """Law of a solid with internal variables z at its points."""

    @property
    @abstractmethod
    def initial(self) -> FloatArray:
        """(k,) internal variables at the start; the last one is the dissipated energy, zero."""

    @abstractmethod
    def advance(self, F: Any, z: Any, h: Any, p: Any) -> list[Any]:
        """Internal variables at the end of a step, in UFL.

        Args:
            F: Deformation gradient at the end, (3, 3).
            z: Internal variables at the beginning, (k,).
            h: Time of the step, s; 0 of an accepted state.
            p: The parameters.
        """

    @abstractmethod
    def stored(self, F: Any, z: Any, p: Any) -> Any:
        """Stored energy per volume, J/m^3, whose derivative by F is the stress."""

    def energy(self, F: Any, p: Any) -> Any:
        """See :meth:`SolidLaw.energy`: stored energy with the initial internal variables."""
        return self.stored(F, self.initial.tolist(), p)


def _tensor(z: Any, first: int) -> Any:
    """Symmetric tensor of six internal variables (xx, yy, zz, yz, xz, xy)."""
    import ufl

    a, b, c, d, e, f = (z[first + k] for k in range(6))
    return ufl.as_matrix([[a, f, e], [f, b, d], [e, d, c]])


def _numbers(T: Any) -> list[Any]:
    """Six internal variables of a symmetric tensor."""
    return [T[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))]


_UNIT = [1.0, 1.0, 1.0, 0.0, 0.0, 0.0]


@declared
class Viscoelastic(HistoryLaw):
    """Generalised Maxwell solid: a law beside branches that relax (Linder, Tkachuk, Miehe 2011).

    A branch stores ``mu/2 (A : C - 3 - ln det A)`` of the shape, with an internal tensor that
    follows ``dA/dt = (C^-1 - A)/tau``. It is a spring of the shear modulus mu in series with a
    dashpot mu tau at small strains; volume changes do not relax. Steps are exact where C^-1 is
    linear in time.

    Attributes:
        elastic: Law of the solid at rest.
        shear_moduli: mu of the branches, Pa.
        times: Relaxation times tau, s.

    Raises:
        TypeError: An argument has the wrong type.
        ValueError: Not as many times as moduli, none, or one that is not positive.
    """

    rate_dependent = True

    elastic: SolidLaw = instance(SolidLaw)
    shear_moduli: Any = array(-1)
    times: Any = array(-1)

    def __post_init__(self) -> None:
        """Check moduli and times."""
        owner = "Viscoelastic"
        if isinstance(self.elastic, HistoryLaw):
            raise ValueError(
                f"{owner}: elastic must have no internal variables, got "
                f"{_checks.show(self.elastic)}"
            )
        if len(self.shear_moduli) != len(self.times) or not len(self.times):
            raise ValueError(
                f"{owner}: needs as many times as shear_moduli, got "
                f"{_checks.show(self.shear_moduli.tolist())} and "
                f"{_checks.show(self.times.tolist())}"
            )
        for what, values in (("shear_moduli", self.shear_moduli), ("times", self.times)):
            if not (values > 0.0).all():
                raise ValueError(f"{owner}: {what} must be positive, got {values.tolist()}")

    @property
    def split(self) -> bool:  # type: ignore[override]
        """See :attr:`SolidLaw.split`."""
        return self.elastic.split

    @property
    def form(self) -> Any:
        """See :attr:`SolidLaw.form`."""
        return type(self), self.elastic.form, len(self.times)

    @property
    def parameters(self) -> Mapping[str, Parameter]:
        """See :attr:`SolidLaw.parameters`."""
        branches: dict[str, Parameter] = {}
        for k, (mu, tau) in enumerate(zip(self.shear_moduli, self.times, strict=True)):
            branches |= {f"branch{k}": float(mu), f"time{k}": float(tau)}
        return joined("Viscoelastic", self.elastic.parameters, branches)

    @property
    def initial(self) -> FloatArray:
        """See :attr:`HistoryLaw.initial`: A of each branch, C^-1, and the dissipated energy."""
        return np.array((len(self.times) + 1) * _UNIT + [0.0])

    def advance(self, F: Any, z: Any, h: Any, p: Any) -> list[Any]:
        """See :meth:`HistoryLaw.advance`."""
        import ufl

        count = len(self.times)
        C = isochoric(F)
        inverse, before = ufl.inv(C), _tensor(z, 6 * count)
        found, lost = [], z[6 * count + 6]
        for k in range(count):
            x = h / p[f"time{k}"]
            kept, small = ufl.exp(-x), ufl.lt(x, _SMALL)
            divisor = ufl.conditional(small, 1.0, x)
            mean = ufl.conditional(small, 1.0 - x / 2.0 + x * x / 6.0, (1.0 - kept) / divisor)
            A = _tensor(z, 6 * k)
            new = kept * A + (mean - kept) * before + (1.0 - mean) * inverse
            found += _numbers(new)
            # what A takes from the energy, the mean of that at both ends of the motion
            taken = ufl.inner(A - new, ufl.inv(before) + C) / 2.0
            taken = taken - ufl.ln(ufl.det(A)) + ufl.ln(ufl.det(new))
            lost = lost + p[f"branch{k}"] / 2.0 * taken
        return [*found, *_numbers(inverse), lost]

    def stored(self, F: Any, z: Any, p: Any) -> Any:
        """See :meth:`HistoryLaw.stored`."""
        import ufl

        C, total = isochoric(F), self.elastic.energy(F, p)
        for k in range(len(self.times)):
            A = _tensor(z, 6 * k)
            total = total + p[f"branch{k}"] / 2.0 * (ufl.inner(A, C) - 3.0 - ufl.ln(ufl.det(A)))
        return total

    def dissipation(self, F: Any, rate: Any, p: Any) -> Any:
        """See :meth:`SolidLaw.dissipation`."""
        return self.elastic.dissipation(F, rate, p)


#: Step over relaxation time below which the mean of the exponential is a series.
_SMALL = 1e-4


@declared
class J2Plasticity(HistoryLaw):
    """Metal with von Mises' yield stress and linear isotropic hardening, large strains (Simo 1988).

    The elastic part is neo-Hookean, ``mu/2 (tr b - 3)`` of the shape with the elastic left
    Cauchy-Green tensor b, and the volumetric part; the plastic flow is associated and keeps the
    volume, and each step ends on the yield surface ``|dev tau| = sqrt(2/3) (s + H a)`` in closed
    form (Simo, Hughes 1998, box 9.1, with the trace of b for which its determinant is one). What
    hardening takes counts as dissipated. Steps are of first order in the plastic strain of a step.

    Attributes:
        shear_modulus: mu, Pa.
        bulk_modulus: K, Pa.
        yield_stress: s in tension, Pa.
        hardening: H, rise of the yield stress per plastic strain, Pa.

    Raises:
        TypeError: A value is not a number.
        ValueError: A value is not positive, or the hardening is negative.
    """

    split = True

    shear_modulus: Any = modulus(positive=True)
    bulk_modulus: Any = modulus(positive=True)
    yield_stress: Any = modulus(positive=True)
    hardening: Any = modulus(default=0.0, nonnegative=True)

    @property
    def form(self) -> Any:
        """See :attr:`SolidLaw.form`."""
        return type(self)

    @property
    def parameters(self) -> Mapping[str, Parameter]:
        """See :attr:`SolidLaw.parameters`."""
        return {
            "mu": self.shear_modulus, "bulk": self.bulk_modulus, "limit": self.yield_stress,
            "hardening": self.hardening,
        }  # fmt: skip

    @property
    def initial(self) -> FloatArray:
        """See :attr:`HistoryLaw.initial`: inverse plastic C, plastic strain, dissipated energy."""
        return np.array([*_UNIT, 0.0, 0.0])

    def advance(self, F: Any, z: Any, h: Any, p: Any) -> list[Any]:
        """See :meth:`HistoryLaw.advance`."""
        import ufl

        size = ufl.det(F) ** (2.0 / 3.0)
        b = F * _tensor(z, 0) * F.T / size
        stress = p.mu * ufl.dev(b)
        norm = ufl.sqrt(ufl.inner(stress, stress) + (_ROUND * p.mu) ** 2)
        mean, factor = p.mu * ufl.tr(b) / 3.0, np.sqrt(2.0 / 3.0)
        excess = norm - factor * (p.limit + p.hardening * z[6])
        flow = excess / (2.0 * mean + 2.0 / 3.0 * p.hardening)
        flow = ufl.conditional(ufl.gt(excess, 0.0), flow, 0.0)
        deviator = ufl.dev(b) * (1.0 - 2.0 * mean * flow / norm)
        elastic = deviator + _third_of_trace(deviator) * ufl.Identity(3)
        G = ufl.inv(F)
        strain = z[6] + factor * flow
        limit = p.limit + p.hardening * (z[6] + strain) / 2.0
        lost = z[7] + limit * factor * flow
        return [*_numbers(size * G * elastic * G.T), strain, lost]

    def stored(self, F: Any, z: Any, p: Any) -> Any:
        """See :meth:`HistoryLaw.stored`."""
        import ufl

        b = F * _tensor(z, 0) * F.T * ufl.det(F) ** (-2.0 / 3.0)
        return p.mu / 2.0 * (ufl.tr(b) - 3.0) + volumetric(p.volume_ratio(F), p.bulk)


def _third_of_trace(deviator: Any) -> Any:
    """Third of the trace of the tensor of determinant one with a deviator, by Newton's method."""
    import ufl

    square, cube = ufl.inner(deviator, deviator) / 2.0, ufl.det(deviator)
    third: Any = 1.0 + square / 3.0
    for _ in range(_ITERATIONS):
        third = third - (third**3 - square * third + cube - 1.0) / (3.0 * third**2 - square)
    return third


#: Iterations for the trace, which double its digits: enough for elastic strains up to a half.
_ITERATIONS = 4
#: Deviator relative to the shear modulus that is zero.
_ROUND = 1e-14
