# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact between shells, and of shells with rigid surfaces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexfem import _checks
from flexfem.core.marker import Ground
from flexfem.model.probe import AnyProbe, check_columns
from flexfem.model.shell import Shell

if TYPE_CHECKING:
    from flexfem.model.model import Model

__all__ = [
    "Contact",
    "ContactProbe",
    "RigidCylinder",
    "RigidPlane",
    "RigidSphere",
    "RigidSurface",
]


@dataclass(frozen=True, eq=False)
class RigidSurface:
    """Base class of the rigid surfaces.

    Attributes:
        place: Position and axes, in space.
    """

    place: Ground

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            TypeError: A value is of the wrong type.
            ValueError: A length is not positive.
        """
        if type(self) is RigidSurface:
            raise TypeError("RigidSurface: take a RigidPlane, RigidSphere or RigidCylinder")
        _checks.instance(type(self).__name__, "place", self.place, Ground)


@dataclass(frozen=True, eq=False)
class RigidPlane(RigidSurface):
    """The plane z = 0 of its place; shells are on the side z > 0."""


@dataclass(frozen=True, eq=False)
class RigidSphere(RigidSurface):
    """A sphere with its centre at its place.

    Attributes:
        radius: Metres.
        inside: Whether shells are inside.
    """

    radius: float = 0.0
    inside: bool = False

    def __post_init__(self) -> None:
        """See :class:`RigidSurface`."""
        super().__post_init__()
        _checks.number("RigidSphere", "radius", self.radius, positive=True)
        _checks.instance("RigidSphere", "inside", self.inside, bool)


@dataclass(frozen=True, eq=False)
class RigidCylinder(RigidSurface):
    """A cylinder around the z axis of its place, which is in the middle.

    Attributes:
        radius: Metres.
        length: Metres. From outside, a finite cylinder is closed by flat ends; from inside it is
            open and acts between its ends.
        inside: Whether shells are inside.
    """

    radius: float = 0.0
    length: float = np.inf
    inside: bool = False

    def __post_init__(self) -> None:
        """See :class:`RigidSurface`."""
        super().__post_init__()
        _checks.number("RigidCylinder", "radius", self.radius, positive=True)
        if self.length != np.inf:
            _checks.number("RigidCylinder", "length", self.length, positive=True)
        _checks.instance("RigidCylinder", "inside", self.inside, bool)


@dataclass(frozen=True, eq=False, init=False)
class Contact:
    """Contact of the nodes of shells with the triangles of shells, and with rigid surfaces.

    The normal force per area is the stiffness times the penetration. Mid-surfaces touch at half of
    the sum of the thicknesses, rigid surfaces at half of the thickness.

    Attributes:
        name: Unique name in the model.
        slaves: Names of the shells whose nodes touch.
        masters: Names of the shells whose triangles are touched: none, others than the slaves, or
            just these, for contact of all of them with each other and with themselves.
        surfaces: Rigid surfaces that the slaves touch.
        stiffness: Force per penetration and area, N/m^3. None: the smaller one of the stiffness
            through the thickness, ``A / h^2`` with the membrane stiffness A, and of the inertia per
            area in the matrix of the first time step, with which an impact takes two steps.
        friction: Coulomb's coefficient.
        damping: Viscous part of the normal force: the stiffness times this time, seconds, times
            the rate of penetration.
        two_pass: Whether masters and slaves change roles in a second pass, each with half of the
            stiffness.
        skin: How far candidates are looked for, metres: nothing gets through a surface if both
            move by less than half of it in a step. None: 0.4 edges of the mesh.
    """

    name: str
    slaves: tuple[str, ...]
    masters: tuple[str, ...]
    surfaces: tuple[RigidSurface, ...]
    stiffness: float | None
    friction: float
    damping: float
    two_pass: bool
    skin: float | None

    def __init__(
        self,
        name: str,
        slaves: str | Sequence[str],
        masters: str | Sequence[str] = (),
        surfaces: RigidSurface | Sequence[RigidSurface] = (),
        *,
        stiffness: float | None = None,
        friction: float = 0.0,
        damping: float = 0.0,
        two_pass: bool = True,
        skin: float | None = None,
    ) -> None:
        """Create a contact.

        Raises:
            TypeError: An argument has the wrong type.
            ValueError: Nothing that touches, a shell named twice, slaves and masters that overlap
                in part, or a number out of range.
        """
        owner = _checks.named(self, name)
        first, second = _names(owner, "slaves", slaves), _names(owner, "masters", masters)
        if not isinstance(surfaces, RigidSurface):
            _checks.instance(owner, "surfaces", surfaces, (list, tuple))
        rigid = (surfaces,) if isinstance(surfaces, RigidSurface) else tuple(surfaces)
        for surface in rigid:
            _checks.instance(owner, "surfaces", surface, RigidSurface)
        if not first or not (second or rigid):
            raise ValueError(f"{owner}: it needs slaves, and masters or surfaces")
        if set(first) & set(second) and set(first) != set(second):
            raise ValueError(
                f"{owner}: masters must be others than the slaves or just these, got "
                f"{_checks.show(list(second))} and {_checks.show(list(first))}"
            )
        _checks.instance(owner, "two_pass", two_pass, bool)
        for what, value in (("stiffness", stiffness), ("skin", skin)):
            if value is not None:
                _checks.number(owner, what, value, positive=True)
        _checks.assign(
            self,
            name=name, slaves=first, masters=second, surfaces=rigid, stiffness=stiffness,
            friction=_checks.number(owner, "friction", friction, nonnegative=True),
            damping=_checks.number(owner, "damping", damping, nonnegative=True),
            two_pass=two_pass, skin=skin,
        )  # fmt: skip

    def check(self, model: Model) -> None:
        """Check the names of the shells.

        Raises:
            ValueError: The model has no such shell.
        """
        for name in (*self.slaves, *self.masters):
            shell = model.get(name)
            if not isinstance(shell, Shell):
                raise ValueError(f'Contact "{self.name}": {model!r} has no shell "{name}"')
            if shell.element == "director":
                raise ValueError(
                    f'Contact "{self.name}": Shell "{name}": contact needs the element '
                    "rotation_free, got director"
                )


@dataclass(frozen=True, eq=False)
class ContactProbe(AnyProbe):
    """Penetration and forces of a contact.

    Columns: name_penetration, the largest one, m; name_fx, name_fy, name_fz, the force on the
    slaves, N; name_normal, the sum of the sizes of all normal forces, N.

    Attributes:
        name: Unique name in the model.
        contact: Name of the contact.
    """

    name: str
    contact: str

    def __post_init__(self) -> None:
        """Check the names.

        Raises:
            TypeError: One is no string.
        """
        owner = _checks.named(self, self.name)
        _checks.text(owner, "contact", self.contact)
        labels = ("penetration", "fx", "fy", "fz", "normal")
        columns = tuple(f"{self.name}_{label}" for label in labels)
        check_columns(owner, columns)
        _checks.assign(self, columns=columns)

    def check(self, model: Model) -> None:
        """See :meth:`AnyProbe.check`."""
        if not isinstance(model.get(self.contact), Contact):
            raise ValueError(
                f'ContactProbe "{self.name}": {model!r} has no contact "{self.contact}"'
            )


def _names(owner: str, what: str, names: str | Sequence[str]) -> tuple[str, ...]:
    """Return checked names, each there once."""
    if not isinstance(names, str):
        _checks.instance(owner, what, names, (list, tuple))
    several = (names,) if isinstance(names, str) else tuple(names)
    for name in several:
        _checks.text(owner, what, name)
    if len(set(several)) < len(several):
        raise ValueError(f"{owner}: {what} must be different, got {_checks.show(list(several))}")
    return several
