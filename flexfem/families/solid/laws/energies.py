# SPDX-License-Identifier: LGPL-3.0-or-later
"""Material laws of solids: strain energies per volume at the start, as functions of F in UFL.

F = dx/dX is the deformation gradient (3, 3), J = det F, C = F^T F. Laws whose energy is split
have the part of the shape in ``F / J^(1/3)`` and the volumetric part ``K/4 (J^2 - 1 - 2 ln J)``
(Simo, Taylor 1991). Numbers of a law may be one for each cell; those that change with time are
functions of it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from functools import cache
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._fields import array, checked, declared, flag, function, instance, number, settled
from flexfem._types import FloatArray

__all__ = [
    "ActiveStress",
    "Growth",
    "HolzapfelGasserOgden",
    "Hyperelastic",
    "MooneyRivlin",
    "NeoHookean",
    "Ogden",
    "Parameter",
    "SaintVenantKirchhoff",
    "SolidLaw",
]  # fmt: skip

#: A number of a law: the same everywhere, one of each cell, or a function of time (s); or vectors.
Parameter = npt.ArrayLike | Callable[[float], float]

#: Ratio of the squares of stretches within which powers are approximated, and samples there.
_RATIO, _SAMPLES = 1e4, 400
#: Strain of second differences of an energy.
_SMALL = 1e-3


class SolidLaw(ABC):
    """Strain energy of a solid.

    A law of a user's own derives a class from this one, or is a :class:`Hyperelastic`.
    """

    @property
    @abstractmethod
    def parameters(self) -> Mapping[str, Parameter]:
        """Numbers of the law by name, each one, one of each cell (m,), or a function of time.

        Vectors are (1, 3) or (m, 3). Laws that differ in these alone are compiled once.
        """

    @abstractmethod
    def energy(self, F: Any, p: Any) -> Any:
        """Strain energy per volume at the start, J/m^3, in UFL.

        Args:
            F: Deformation gradient, (3, 3).
            p: The parameters as attributes and by name; ``p.volume_ratio(F)`` is J.
        """

    #: Whether internal variables change with time alone.
    rate_dependent: ClassVar[bool] = False
    #: Whether the energy depends on the shape of F and on ``p.volume_ratio(F)`` alone, its J: then
    #: the formulation "dilatation", which replaces J, is five times as fast.
    split: bool = False

    @property
    def form(self) -> Any:
        """What distinguishes the law from others with the same parameters, hashable: itself.

        A class whose objects differ in their parameters alone returns ``type(self)``, so that the
        cells of all of them are one group.
        """
        return self

    @property
    def initial(self) -> FloatArray:
        """Internal variables at the start, of a ``HistoryLaw``; none."""
        return np.empty(0)

    def dissipation(self, F: Any, rate: Any, p: Any) -> Any:
        """Dissipation potential, W/m^3, in UFL; None without damping.

        Its derivative by the rate of F is the viscous part of the first Piola stress.
        """
        return None

    def small_strain_moduli(self) -> tuple[float, float]:
        """Shear and bulk modulus at the start, Pa, of a mean cell; NaN if they are not found."""
        try:
            return _second_differences(self)
        except Exception:  # whatever a user's function raises; the start of a run says so
            return float("nan"), float("nan")


def _second_differences(law: SolidLaw) -> tuple[float, float]:
    """Shear and bulk modulus, Pa, by the energies of small strains."""
    import ufl
    from ufl.algorithms.apply_algebra_lowering import apply_algebra_lowering

    values: dict[str, Any] = {}
    for name, value in law.parameters.items():
        given = np.asarray(value(0.0) if callable(value) else value, dtype=np.float64)
        if given.ndim == 2:
            values[name] = ufl.as_vector(np.mean(given, axis=0).tolist())
        else:
            values[name] = float(given.mean())

    def energy(size: float, way: FloatArray) -> float:
        F = ufl.as_matrix((np.eye(3) + size * way).tolist())
        return float(apply_algebra_lowering(ufl.as_ufl(law.energy(F, Numbers(values)))))

    rest, found = energy(0.0, np.eye(3)), []
    shear = np.array([[0.0, 0.5, 0.0], [0.5, 0.0, 0.0], [0.0, 0.0, 0.0]])
    for way in (shear, np.eye(3) / 3.0):
        change = energy(_SMALL, way) + energy(-_SMALL, way) - 2.0 * rest
        found.append(change / _SMALL**2)
    return found[0], found[1]


class Numbers(dict[str, Any]):
    """Numbers by name and as attributes."""

    def __getattr__(self, name: str) -> Any:
        """Return a number."""
        return self[name]

    @staticmethod
    def volume_ratio(F: Any) -> Any:
        """J = det F."""
        import ufl

        return ufl.det(F)


def isochoric(F: Any) -> Any:
    """Right Cauchy-Green tensor without the change of volume, in UFL."""
    import ufl

    return ufl.det(F) ** (-2.0 / 3.0) * F.T * F


def volumetric(J: Any, bulk: Any) -> Any:
    """Energy of a change of volume J, J/m^3, in UFL."""
    import ufl

    return bulk / 4.0 * (J * J - 1.0 - 2.0 * ufl.ln(J))


def _values(owner: str, what: str, value: Any, **bounds: bool) -> Any:
    """A checked number, or numbers of the cells (m,)."""
    if np.ndim(value) == 0:
        return _checks.number(owner, what, value, **bounds)
    found = _checks.array(owner, what, value, (-1,))
    for one in found:
        _checks.number(owner, what, float(one), **bounds)
    return found


def modulus(*, default: Any = None, **bounds: bool) -> Any:
    """Declare a number that may be one for each cell."""

    def check(owner: str, what: str, value: Any) -> Any:
        return _values(owner, what, value, **bounds)

    return checked(check) if default is None else checked(check, default=default)


def moduli(owner: str, youngs_modulus: Any, poisson_ratio: Any) -> tuple[Any, Any]:
    """Shear and bulk modulus, Pa, of small strains.

    Raises:
        TypeError: They are no numbers.
        ValueError: A modulus that is not positive, or a ratio outside (-1, 0.5).
    """
    E = _values(owner, "youngs_modulus", youngs_modulus, positive=True)
    nu = _values(owner, "poisson_ratio", poisson_ratio)
    if not (np.all(np.asarray(nu) > -1.0) and np.all(np.asarray(nu) < 0.5)):
        raise ValueError(
            f"{owner}: poisson_ratio must lie in (-1, 0.5), got {_checks.show(poisson_ratio)}"
        )
    if np.ndim(E) and np.ndim(nu) and len(E) != len(nu):
        raise ValueError(
            f"{owner}: youngs_modulus has {len(E)} values, poisson_ratio {len(nu)}: one of each "
            "cell"
        )
    return E / (2.0 * (1.0 + nu)), E / (3.0 * (1.0 - 2.0 * nu))


def joined(
    owner: str, inner: Mapping[str, Parameter], own: Mapping[str, Parameter]
) -> Mapping[str, Parameter]:
    """Parameters of a law and of the one that it contains.

    Raises:
        ValueError: both have one of a name.
    """
    if both := sorted({*inner} & {*own}):
        raise ValueError(f'{owner}: its law has a parameter "{both[0]}", too: give it another name')
    return {**inner, **own}


@declared
class NeoHookean(SolidLaw):
    """Neo-Hookean rubber, ``mu/2 (tr C / J^(2/3) - 3)`` and the volumetric part.

    Attributes:
        shear_modulus: mu of small strains, Pa.
        bulk_modulus: K, Pa.

    Raises:
        TypeError: A value is not a number.
        ValueError: A modulus is not positive.
    """

    split = True

    shear_modulus: Any = modulus(positive=True)
    bulk_modulus: Any = modulus(positive=True)

    @classmethod
    def from_young(cls, youngs_modulus: Any, poisson_ratio: Any) -> NeoHookean:
        """Return the law with a Young's modulus (Pa) and a Poisson's ratio at small strains.

        Raises:
            TypeError: A value is not a number.
            ValueError: A modulus that is not positive, or a ratio outside (-1, 0.5).
        """
        return cls(*moduli(cls.__name__, youngs_modulus, poisson_ratio))

    @property
    def form(self) -> Any:
        """See :attr:`SolidLaw.form`."""
        return type(self)

    @property
    def parameters(self) -> Mapping[str, Parameter]:
        """See :attr:`SolidLaw.parameters`."""
        return {"mu": self.shear_modulus, "bulk": self.bulk_modulus}

    def energy(self, F: Any, p: Any) -> Any:
        """See :meth:`SolidLaw.energy`."""
        import ufl

        return p.mu / 2.0 * (ufl.tr(isochoric(F)) - 3.0) + volumetric(p.volume_ratio(F), p.bulk)


@declared
class MooneyRivlin(SolidLaw):
    """Mooney-Rivlin rubber, ``c10 (I1 - 3) + c01 (I2 - 3)`` of the shape, and the volumetric part.

    Attributes:
        c10, c01: Pa; their sum is half of the shear modulus of small strains.
        bulk_modulus: K, Pa.

    Raises:
        TypeError: A value is not a number.
        ValueError: c10 or K is not positive, or c01 negative.
    """

    split = True

    c10: Any = modulus(positive=True)
    c01: Any = modulus(nonnegative=True)
    bulk_modulus: Any = modulus(positive=True)

    @property
    def form(self) -> Any:
        """See :attr:`SolidLaw.form`."""
        return type(self)

    @property
    def parameters(self) -> Mapping[str, Parameter]:
        """See :attr:`SolidLaw.parameters`."""
        return {"c10": self.c10, "c01": self.c01, "bulk": self.bulk_modulus}

    def energy(self, F: Any, p: Any) -> Any:
        """See :meth:`SolidLaw.energy`."""
        import ufl

        C = isochoric(F)
        first, second = ufl.tr(C), (ufl.tr(C) ** 2 - ufl.inner(C, C)) / 2.0
        return (
            p.c10 * (first - 3.0) + p.c01 * (second - 3.0) + volumetric(p.volume_ratio(F), p.bulk)
        )


@declared
class SaintVenantKirchhoff(SolidLaw):
    """Hooke's law of Green's strain ``E = (C - I)/2``: ``lambda/2 (tr E)^2 + mu E:E``.

    For large rotations and small strains: in compression it softens, and collapses at J = 0.6.

    Attributes:
        youngs_modulus: Pa.
        poisson_ratio: In (-1, 0.5).

    Raises:
        TypeError: A value is not a number.
        ValueError: The modulus is not positive, or the ratio outside (-1, 0.5).
    """

    youngs_modulus: Any = modulus(positive=True)
    poisson_ratio: Any = modulus()

    def __post_init__(self) -> None:
        """Check the ratio."""
        moduli("SaintVenantKirchhoff", self.youngs_modulus, self.poisson_ratio)

    @property
    def form(self) -> Any:
        """See :attr:`SolidLaw.form`."""
        return type(self)

    @property
    def parameters(self) -> Mapping[str, Parameter]:
        """See :attr:`SolidLaw.parameters`."""
        owner = "SaintVenantKirchhoff"
        mu, bulk = moduli(owner, self.youngs_modulus, self.poisson_ratio)
        return {"mu": mu, "lame": bulk - 2.0 / 3.0 * mu}

    def energy(self, F: Any, p: Any) -> Any:
        """See :meth:`SolidLaw.energy`."""
        import ufl

        E = (F.T * F - ufl.Identity(3)) / 2.0
        return p.lame / 2.0 * ufl.tr(E) ** 2 + p.mu * ufl.inner(E, E)


@declared
class Ogden(SolidLaw):
    """Ogden's rubber, ``sum mu_k/alpha_k (l1^alpha_k + l2^alpha_k + l3^alpha_k - 3)``.

    The stretches l are those of the shape, ``J^(-1/3)`` times the principal ones; the volumetric
    part is added. The sums of powers are rational functions of the invariants of C that are within
    1e-9 of them while the squares of stretches differ by less than 1e4: they are smooth where
    stretches are equal, unlike formulas with the stretches.

    Attributes:
        moduli: mu_k, Pa; half of the sum of mu_k alpha_k is the shear modulus of small strains.
        exponents: alpha_k, of any sign, not zero, at most 12.
        bulk_modulus: K, Pa.

    Raises:
        TypeError: A value is not a number.
        ValueError: Not as many exponents as moduli, an exponent that is zero or larger, or no
            positive shear modulus.
    """

    split = True

    moduli: Any = array(-1)
    exponents: Any = array(-1)
    bulk_modulus: Any = modulus(positive=True)

    def __post_init__(self) -> None:
        """Check moduli and exponents."""
        owner = "Ogden"
        mu, alpha = np.asarray(self.moduli), np.asarray(self.exponents)
        if len(mu) != len(alpha) or not len(mu):
            raise ValueError(
                f"{owner}: needs as many exponents as moduli, got {_checks.show(mu.tolist())} and "
                f"{_checks.show(alpha.tolist())}"
            )
        if not ((alpha != 0.0) & (np.abs(alpha) <= _LARGEST)).all():
            raise ValueError(
                f"{owner}: exponents must not be zero and at most {_LARGEST}, got "
                f"{_checks.show(alpha.tolist())}"
            )
        if not mu @ alpha > 0.0:
            raise ValueError(
                f"{owner}: the shear modulus, half of the sum of moduli times exponents, must be "
                f"positive, got {0.5 * float(mu @ alpha):g}"
            )
        _checks.assign(self, moduli=tuple(mu.tolist()), exponents=tuple(alpha.tolist()))

    @property
    def form(self) -> Any:
        """See :attr:`SolidLaw.form`."""
        return type(self), self.exponents

    def small_strain_moduli(self) -> tuple[float, float]:
        """See :meth:`SolidLaw.small_strain_moduli`."""
        return 0.5 * float(np.dot(self.moduli, self.exponents)), float(np.mean(self.bulk_modulus))

    @property
    def parameters(self) -> Mapping[str, Parameter]:
        """See :attr:`SolidLaw.parameters`."""
        return {f"mu{k}": mu for k, mu in enumerate(self.moduli)} | {"bulk": self.bulk_modulus}

    def energy(self, F: Any, p: Any) -> Any:
        """See :meth:`SolidLaw.energy`."""
        C = isochoric(F)
        total = volumetric(p.volume_ratio(F), p.bulk)
        for k, alpha in enumerate(self.exponents):
            total = total + p[f"mu{k}"] / alpha * (trace_of_power(C, alpha / 2.0) - 3.0)
        return total


#: Largest exponent of a stretch in Ogden's law.
_LARGEST = 12.0


def trace_of_power(C: Any, exponent: float) -> Any:
    """Trace of a power of a symmetric positive definite tensor of determinant one, in UFL.

    A power of the eigenvalues is a whole one times one between -1 and 0, which is a sum of
    fractions ``r/(z + s)`` with positive r and s; the trace of ``(C + s I)^-1`` is a rational
    function of the invariants. The trace of the inverse's power is that of the negative exponent.
    """
    import ufl

    first, second = ufl.tr(C), (ufl.tr(C) ** 2 - ufl.inner(C, C)) / 2.0
    if exponent < 0.0:  # invariants of the inverse, whose determinant is one as well
        first, second, exponent = second, first, -exponent
    whole = int(np.ceil(exponent - _ROUND))
    sums = _sums_of_powers(first, second, whole)
    rest = exponent - whole
    if abs(rest) < _ROUND:
        return sums[whole]
    constant, residues, shifts = _fractions(rest)
    total = constant * sums[whole]
    for r, s in zip(residues, shifts, strict=True):
        # z^m/(z + s) = z^(m-1) - s z^(m-2) + ... + (-s)^m/(z + s)
        part = (3.0 * s * s + 2.0 * s * first + second) / (s**3 + s * s * first + s * second + 1.0)
        part = (-s) ** whole * part
        for k in range(whole):
            part = part + (-s) ** (whole - 1 - k) * sums[k]
        total = total + r * part
    return total


#: Fractional part of an exponent that is zero.
_ROUND = 1e-12


def _sums_of_powers(first: Any, second: Any, most: int) -> list[Any]:
    """Sums of whole powers of the eigenvalues by Newton's identities; the determinant is one."""
    sums: list[Any] = [3.0, first, first * first - 2.0 * second]
    while len(sums) <= most:
        sums.append(first * sums[-1] - second * sums[-2] + sums[-3])
    return sums


@cache
def _fractions(exponent: float) -> tuple[float, FloatArray, FloatArray]:
    """Constant, residues and shifts of a sum of fractions that approximates a power.

    By the algorithm AAA (Nakatsukasa, Sete, Trefethen 2018), whose poles are negative here.
    """
    from scipy.interpolate import AAA

    ends = np.log10(_RATIO) * 2.0 / 3.0
    z = np.logspace(-ends, ends, _SAMPLES)
    shifts = -AAA(z, z**exponent, rtol=1e-10).poles().real
    columns = 1.0 / (z[:, np.newaxis] + np.append(shifts, 0.0))
    columns[:, -1] = 1.0  # the constant
    found = np.linalg.lstsq(columns / z[:, np.newaxis] ** exponent, np.ones(len(z)))[0]
    return float(found[-1]), found[:-1], shifts


@declared
class HolzapfelGasserOgden(SolidLaw):
    """Soft tissue with two families of fibres (Holzapfel, Gasser, Ogden 2000; Gasser et al. 2006).

    ``c/2 (I1 - 3) + sum k1/(2 k2) (exp(k2 e^2) - 1)`` with ``e = d (I1 - 3) + (1 - 3 d)(I4 - 1)``
    where it is positive, I4 the square of the fibres' stretch, both of the shape; the volumetric
    part is added.

    Attributes:
        c: Shear modulus of the matrix, Pa.
        k1: Stiffness of the fibres, Pa.
        k2: Stiffening of the fibres.
        bulk_modulus: K, Pa.
        fibres: Directions at the start of one or two families, each (3,) or (m, 3) of the cells.
        dispersion: d, 0 (parallel) to 1/3 (isotropic).

    Raises:
        TypeError: A value is not a number.
        ValueError: A number out of its range, or a direction that is zero.
    """

    split = True

    c: Any = modulus(positive=True)
    k1: Any = modulus(positive=True)
    k2: Any = modulus(positive=True)
    bulk_modulus: Any = modulus(positive=True)
    fibres: Any = settled(default=())
    dispersion: float = number(default=0.0, nonnegative=True)

    def __post_init__(self) -> None:
        """Check the fibres."""
        owner = "HolzapfelGasserOgden"
        _checks.instance(owner, "fibres", self.fibres, (list, tuple))
        if not 1 <= len(self.fibres) <= 2:
            raise ValueError(
                f"{owner}: fibres must be one or two directions, got {len(self.fibres)}"
            )
        if self.dispersion > 1.0 / 3.0:
            raise ValueError(f"{owner}: dispersion must lie in [0, 1/3], got {self.dispersion:g}")
        units = tuple(unit_vectors(owner, f"fibres[{k}]", f) for k, f in enumerate(self.fibres))
        _checks.assign(self, fibres=units)

    @property
    def form(self) -> Any:
        """See :attr:`SolidLaw.form`."""
        return type(self), len(self.fibres)

    @property
    def parameters(self) -> Mapping[str, Parameter]:
        """See :attr:`SolidLaw.parameters`."""
        fibres = {f"fibre{k}": fibre for k, fibre in enumerate(self.fibres)}
        numbers = {"c": self.c, "k1": self.k1, "k2": self.k2, "d": self.dispersion}
        return numbers | {"bulk": self.bulk_modulus} | fibres

    def energy(self, F: Any, p: Any) -> Any:
        """See :meth:`SolidLaw.energy`."""
        import ufl

        C = isochoric(F)
        total = p.c / 2.0 * (ufl.tr(C) - 3.0) + volumetric(p.volume_ratio(F), p.bulk)
        for k in range(len(self.fibres)):
            a = p[f"fibre{k}"]
            e = p.d * (ufl.tr(C) - 3.0) + (1.0 - 3.0 * p.d) * (ufl.dot(a, C * a) - 1.0)
            pulled = ufl.conditional(ufl.gt(e, 0.0), e, 0.0)
            total = total + p.k1 / (2.0 * p.k2) * (ufl.exp(p.k2 * pulled**2) - 1.0)
        return total


def unit_vectors(owner: str, what: str, value: npt.ArrayLike) -> FloatArray:
    """Checked directions of length one, (1, 3) for one of all cells or (m, 3).

    Raises:
        TypeError: They are no numbers.
        ValueError: Another shape, or one is zero.
    """
    shape = (3,) if np.ndim(value) == 1 else (-1, 3)
    given = _checks.array(owner, what, value, shape)
    lengths = np.linalg.norm(given, axis=-1, keepdims=True)
    if not (lengths > 0.0).all():
        raise ValueError(f"{owner}: {what} must not be zero")
    return _checks.freeze((given / lengths).reshape(-1, 3))


@declared
class Hyperelastic(SolidLaw):
    """A law of a user's own.

    Attributes:
        function: Strain energy per volume at the start, J/m^3: a function of F, (3, 3) in UFL, and
            of the parameters p if it takes two arguments (``p.mu`` for that named "mu").
        values: Parameters by name: numbers, one for each cell (m,), functions of time, or vectors
            (1, 3) and (m, 3).
        damping: Dissipation potential, W/m^3: a function of F, its rate and p; None without.
        split: True if the function depends on the shape of F, ``F/J^(1/3)``, and on
            ``p.volume_ratio(F)`` alone: faster with the formulation "dilatation".

    Raises:
        TypeError: An argument has the wrong type.
        ValueError: A parameter is not finite.
    """

    function: Callable[..., Any] = function("F and p")
    values: Mapping[str, Parameter] = settled(default=MappingProxyType({}))
    damping: Callable[..., Any] | None = None
    split: bool = flag(default=False)

    def __post_init__(self) -> None:
        """Check the parameters."""
        owner = "Hyperelastic"
        if self.damping is not None and not callable(self.damping):
            raise TypeError(
                f"{owner}: damping must be a function of F, its rate and p, got "
                f"{_checks.show(self.damping)}"
            )
        _checks.instance(owner, "values", self.values, Mapping)
        for name, value in self.values.items():
            _checks.text(owner, "name of a parameter", name)
            if not callable(value):
                shape = {0: (), 1: (-1,), 2: (-1, 3)}.get(np.ndim(value))
                if shape is None:
                    raise ValueError(
                        f'{owner}: values["{name}"] must be a number, one of each cell or vectors, '
                        f"got {_checks.show(value)}"
                    )
                if shape == ():
                    _checks.number(owner, f'values["{name}"]', value)
                else:
                    _checks.array(owner, f'values["{name}"]', value, shape)
        _checks.assign(self, values=MappingProxyType(dict(self.values)))

    @property
    def form(self) -> Any:
        """See :attr:`SolidLaw.form`."""
        return type(self), self.function, self.damping, self.split

    @property
    def parameters(self) -> Mapping[str, Parameter]:
        """See :attr:`SolidLaw.parameters`."""
        return self.values

    def energy(self, F: Any, p: Any) -> Any:
        """See :meth:`SolidLaw.energy`."""
        return _call(self.function, F, p)

    def dissipation(self, F: Any, rate: Any, p: Any) -> Any:
        """See :meth:`SolidLaw.dissipation`."""
        return None if self.damping is None else _call(self.damping, F, rate, p)


def _call(function: Callable[..., Any], *arguments: Any) -> Any:
    """Call a function with all arguments, or without the last one, the parameters."""
    from inspect import signature

    wanted = len(signature(function).parameters)
    return function(*arguments[: min(wanted, len(arguments))])


def _without_history(owner: str, what: str, law: SolidLaw) -> None:
    """Refuse a law with internal variables within another one."""
    if len(law.initial):
        raise ValueError(
            f"{owner}: {what} must have no internal variables, got {_checks.show(law)}"
        )


@declared
class ActiveStress(SolidLaw):
    """A law with fibres that pull, as muscles: the energy of a force along them is added.

    The fibres' nominal stress is ``tension``, along their present direction: ``tension (l - 1)``
    with their stretch l is added to the energy.

    Attributes:
        passive: The law of the solid.
        tension: Pa; one number, of each cell, or a function of time.
        fibre: Direction at the start, (3,) or (m, 3) of the cells.

    Raises:
        TypeError: An argument has the wrong type.
        ValueError: The direction is zero, or the law has internal variables or such fibres itself.
    """

    passive: SolidLaw = instance(SolidLaw)
    tension: Any = settled(default=0.0)
    fibre: Any = settled(default=(1.0, 0.0, 0.0))

    def __post_init__(self) -> None:
        """Check tension and direction."""
        if not callable(self.tension):
            _checks.assign(self, tension=_values("ActiveStress", "tension", self.tension))
        _checks.assign(self, fibre=unit_vectors("ActiveStress", "fibre", self.fibre))
        _without_history("ActiveStress", "passive", self.passive)
        self.parameters  # noqa: B018 - names that the passive law has are refused

    @property
    def split(self) -> bool:  # type: ignore[override]
        """See :attr:`SolidLaw.split`."""
        return self.passive.split

    @property
    def form(self) -> Any:
        """See :attr:`SolidLaw.form`."""
        return type(self), self.passive.form

    @property
    def parameters(self) -> Mapping[str, Parameter]:
        """See :attr:`SolidLaw.parameters`."""
        own = {"tension": self.tension, "fibre": self.fibre}
        return joined("ActiveStress", self.passive.parameters, own)

    def energy(self, F: Any, p: Any) -> Any:
        """See :meth:`SolidLaw.energy`."""
        import ufl

        along = F * p.fibre
        return self.passive.energy(F, p) + p.tension * (ufl.sqrt(ufl.inner(along, along)) - 1.0)

    def dissipation(self, F: Any, rate: Any, p: Any) -> Any:
        """See :meth:`SolidLaw.dissipation`."""
        return self.passive.dissipation(F, rate, p)


@declared
class Growth(SolidLaw):
    """A law that grows, swells or is heated: its strains count from a larger natural shape.

    Its material is free of stress where all lengths are ``stretch`` times those at the start; for a
    temperature T that is ``1 + alpha T``.

    Attributes:
        grown: The law of the solid.
        stretch: Ratio of lengths; one number, of each cell, or a function of time.

    Raises:
        TypeError: An argument has the wrong type.
        ValueError: The ratio is not positive, or the law has internal variables or grows itself.
    """

    grown: SolidLaw = instance(SolidLaw)
    stretch: Any = settled(default=1.0)

    def __post_init__(self) -> None:
        """Check the stretch."""
        if not callable(self.stretch):
            checked_stretch = _values("Growth", "stretch", self.stretch, positive=True)
            _checks.assign(self, stretch=checked_stretch)
        _without_history("Growth", "grown", self.grown)
        self.parameters  # noqa: B018 - names that the law has are refused

    @property
    def form(self) -> Any:
        """See :attr:`SolidLaw.form`."""
        return type(self), self.grown.form

    @property
    def parameters(self) -> Mapping[str, Parameter]:
        """See :attr:`SolidLaw.parameters`."""
        return joined("Growth", self.grown.parameters, {"growth": self.stretch})

    def energy(self, F: Any, p: Any) -> Any:
        """See :meth:`SolidLaw.energy`."""
        return p.growth**3 * self.grown.energy(F / p.growth, p)

    def dissipation(self, F: Any, rate: Any, p: Any) -> Any:
        """See :meth:`SolidLaw.dissipation`."""
        return self.grown.dissipation(F, rate, p)
