# SPDX-License-Identifier: LGPL-3.0-or-later
"""The user's own law of a section: an energy, and a dissipation where it is viscous.

Strains are measured from the initial shape, in section axes: in the order (gamma1, gamma2, gamma3,
kappa1, kappa2, kappa3) of ``flexfem.materials.section`` in beams, and in the order (eps11, eps22,
2 eps12, kappa11, kappa22, 2 kappa12) of ``flexfem.materials.shell_section`` in shells. With the
energy ``phi`` and the dissipation potential ``psi`` the stress resultants are (Rayleigh 1873)

``(N, Q2, Q3, T, M2, M3) = d phi / d strain + d psi / d strain_rate``

in beams, and (n11, n22, n12, m11, m22, m12) in shells.

With a potential instead of a viscous stress both halves of a law are one scalar, the damping matrix
is symmetric, and it can be checked that damping dissipates.
"""

import keyword
from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, replace
from types import MappingProxyType
from typing import Any, Self

from flexfem import _checks
from flexfem._fields import Given, checked, declared, flag, function

__all__ = ["BeamLaw", "SectionLaw", "ShellLaw"]


def _values(owner: str, what: str, given: Any) -> Mapping[str, float]:
    """Return a read-only copy of checked parameters."""
    if given is not None and not isinstance(given, Mapping):
        raise TypeError(f"{owner}: {what} must map names to numbers, got {_checks.show(given)}")
    values = {}
    for name, value in (given or {}).items():
        usable = isinstance(name, str) and name.isidentifier() and not keyword.iskeyword(name)
        if not usable or name.startswith("_"):
            raise ValueError(
                f"{owner}: the name of a parameter must be a plain Python identifier, got "
                f"{_checks.show(name)}"
            )
        values[name] = _checks.number(owner, f'parameter "{name}"', value)
    return MappingProxyType(values)


@declared
class SectionLaw:
    """Constitutive law of a section, written in UFL; base of those of beams and shells.

    The functions are called when a system is built, with UFL vectors of six components and an
    object with the parameters as attributes, and return a UFL scalar of these alone. Laws that
    differ in the values of parameters only share their compiled code.

    Attributes:
        energy: ``energy(strain, p)``, the strain energy per length, J/m, or area, J/m^2.
        dissipation: ``dissipation(strain, strain_rate, p)``, the dissipation potential per length,
            W/m, or area, W/m^2: half the dissipated power where the viscous stress is linear in the
            rate. None for none.
        parameters: Values of the parameters by name.
        allow_unstable: True if the stiffness at zero strain need not be positive definite, as in a
            beam that snaps between two shapes or a cable without bending stiffness.

    Functions are tried when a system is built.

    Raises:
        TypeError: A function cannot be called, or a parameter is not a number.
        ValueError: A parameter is not finite, or its name cannot be an attribute.
    """

    energy: Callable[..., Any] = function("strain and parameters")
    _: KW_ONLY
    dissipation: Callable[..., Any] | None = function(
        "strain, strain rate and parameters", default=None
    )
    parameters: Given[Mapping[str, float] | None, Mapping[str, float]] = checked(
        _values, default=None, none=False
    )
    allow_unstable: bool = flag(default=False)

    @property
    def _owner(self) -> str:
        return self.owner if callable(self.energy) else type(self).__name__

    @property
    def owner(self) -> str:
        """Class and quoted name of the energy function, as messages begin."""
        name = getattr(self.energy, "__name__", type(self.energy).__name__)
        return f'{type(self).__name__} "{name}"'

    def with_parameters(self, **changes: float) -> Self:
        """Create the same law with other values of some parameters.

        Raises:
            TypeError: A value is not a number.
            ValueError: A value is not finite, or the law has no such parameter.
        """
        for name in changes:
            if name not in self.parameters:
                known = ", ".join(self.parameters) or "none"
                raise ValueError(f'{self.owner}: no parameter "{name}", known are {known}')
        return replace(self, parameters={**self.parameters, **changes})


class BeamLaw(SectionLaw):
    """Law of a beam section; see :class:`SectionLaw`."""


class ShellLaw(SectionLaw):
    """Law of a shell section; see :class:`SectionLaw`."""
