# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact between shells, and of shells with rigid surfaces."""

from collections.abc import Sequence
from dataclasses import KW_ONLY
from typing import Any

from flexfem import _checks
from flexfem._fields import Given, checked, declared, flag, number, text
from flexfem.model.bodies.base import Body
from flexfem.model.bodies.basic import Beam, RigidBody
from flexfem.model.bodies.floating_body import FloatingBody
from flexfem.model.bodies.shell import Shell
from flexfem.model.probes.base import AnyProbe, name_columns
from flexfem.model.rigid_surface import RigidSurface
from flexfem.model.structure.structure import Structure

__all__ = ["Contact", "ContactProbe"]


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


def _surfaces(owner: str, what: str, surfaces: Any) -> tuple[RigidSurface, ...]:
    """Return checked surfaces."""
    if isinstance(surfaces, RigidSurface):
        return (surfaces,)
    _checks.instance(owner, what, surfaces, (list, tuple))
    for surface in surfaces:
        _checks.instance(owner, what, surface, RigidSurface)
    return tuple(surfaces)


def _not_found(model: Structure, wanted: str, name: str) -> str:
    """Text for a name that is none of the wanted bodies, with what else it is."""
    thing = model.get(name)
    text = f'{model!r} has no {wanted} "{name}"'
    if thing is None:
        return text
    kind = type(thing).__name__
    if isinstance(thing, (RigidBody, FloatingBody)):
        return (
            f"{text}, which is a {kind}: give what it touches with as surfaces=[RigidSphere(Marker("
            f'"{name}"), ...)], or another RigidSurface'
        )
    return f"{text}, which is a {kind}"


@declared
class Contact:
    """Contact of the nodes of shells with the triangles of shells, and with rigid surfaces.

    The normal force per area is the stiffness times the penetration. Mid-surfaces touch at half of
    the sum of the thicknesses, rigid surfaces at half of the thickness. Of director shells the four
    triangles between corners and midpoints of edges touch.

    Beams may be slaves, SE(3) ones: points along the chords of their elements touch at their
    radius, with the area of their length times their diameter. Forces act at the centre line.

    Attributes:
        name: Unique name in the model.
        slaves: Names of the shells whose nodes touch, and of beams.
        masters: Names of the shells whose triangles are touched: none, others than the slaves, or
            just these, for contact of all of them with each other and with themselves.
        surfaces: Rigid surfaces that the slaves touch.
        stiffness: Force per penetration and area, N/m^3. None: at first contact the smaller one of
            the stiffness through the thickness, ``A / h^2`` with the membrane stiffness A, and of
            the inertia per area in the matrix of the first time step, with which an impact takes
            two steps; then the force grows up to ten times as fast, half of that at a tenth of the
            distance of touching. It aims at loads of a few nodes that penetrate by less than a
            fifth of the thickness, and at impacts that do not gain energy; see the penetration.
        friction: Coulomb's coefficient; statics leave friction and damping out.
        damping: Viscous part of the normal force: the stiffness times this time, seconds, times
            the rate of penetration.
        two_pass: True if masters, shells or meshes of rigid surfaces, and slaves change roles in a
            second pass, each with half of the stiffness; beams are slaves only.
        skin: Distance within which candidates are searched, metres: nothing passes through a
            surface if both move by less than half of it in a step. None: 0.4 edges of the mesh.
        radius: Of the beams, metres; None for that of their circular sections.

    Raises:
        TypeError: An argument has the wrong type.
        ValueError: Nothing that touches, a shell named twice, slaves and masters that overlap in
            part, or a number out of range.
    """

    name: str
    slaves: Given[str | Sequence[str], tuple[str, ...]] = checked(_names)
    masters: Given[str | Sequence[str], tuple[str, ...]] = checked(_names, default=())
    surfaces: Given[RigidSurface | Sequence[RigidSurface], tuple[RigidSurface, ...]] = checked(
        _surfaces, default=()
    )
    _: KW_ONLY
    stiffness: float | None = number(default=None, positive=True, as_given=True)
    friction: float = number(default=0.0, nonnegative=True)
    damping: float = number(default=0.0, nonnegative=True)
    two_pass: bool = flag(default=True)
    skin: float | None = number(default=None, positive=True, as_given=True)
    radius: float | None = number(default=None, positive=True, as_given=True)

    def __post_init__(self) -> None:
        """Check slaves, masters and surfaces."""
        owner, slaves, masters = _checks.named(self, self.name), self.slaves, self.masters
        if not slaves or not (masters or self.surfaces):
            raise ValueError(f"{owner}: it needs slaves, and masters or surfaces")
        if set(slaves) & set(masters) and set(slaves) != set(masters):
            raise ValueError(
                f"{owner}: masters must be others than the slaves or just these, got "
                f"{_checks.show(list(masters))} and {_checks.show(list(slaves))}"
            )

    def check(self, model: Structure) -> None:
        """Check the names of shells and beams, and the carriers of the surfaces.

        Raises:
            ValueError: The model has no such shell or beam, or contact does not support it.
        """
        owner = f'Contact "{self.name}"'
        for name in self.slaves:
            body = model.get(name)
            if isinstance(body, Beam):
                self._check_beam(owner, body)
            elif not (isinstance(body, Shell) or _has_surface(body)):
                raise ValueError(f"{owner}: {_not_found(model, 'shell or beam', name)}")
        for name in self.masters:
            body = model.get(name)
            if not (isinstance(body, Shell) or _has_surface(body)):
                raise ValueError(f"{owner}: masters: {_not_found(model, 'shell', name)}")
        for surface in self.surfaces:
            surface.check(model, owner)

    def _check_beam(self, owner: str, beam: Beam) -> None:
        """Raise for beams that contact does not support."""
        if beam.formulation != "se3":
            raise ValueError(
                f'{owner}: Beam "{beam.name}": contact needs the formulation se3, got '
                f"{beam.formulation}"
            )
        self.beam_radius(beam)

    def beam_radius(self, beam: Beam) -> float:
        """Return the distance from its axis at which a beam touches, metres.

        Raises:
            ValueError: Its section is not round and no radius is given.
        """
        if self.radius is not None:
            return self.radius
        owner = f'Contact "{self.name}": Beam "{beam.name}"'
        if beam.varies:
            raise ValueError(f"{owner}: its section varies, give Contact(radius=...)")
        radius = beam.uniform.round_radius
        if radius is None:
            raise ValueError(f"{owner}: its section is not round, give Contact(radius=...)")
        return radius


@declared
class ContactProbe(AnyProbe):
    """Penetration and forces of a contact.

    Columns: name_penetration, the largest one, m; name_fx, name_fy, name_fz, the force on the
    slaves, N; name_normal, the sum of the sizes of all normal forces, N; name_closed, the number of
    touching points, those of both passes.

    Attributes:
        name: Unique name in the model.
        contact: Name of the contact.

    Raises:
        TypeError: A name is no string.
    """

    name: str
    contact: str = text()

    def __post_init__(self) -> None:
        """Name the columns."""
        name_columns(self, ("penetration", "fx", "fy", "fz", "normal", "closed"))

    def check(self, model: Structure) -> None:
        """See :meth:`AnyProbe.check`."""
        if not isinstance(model.get(self.contact), Contact):
            raise ValueError(
                f'ContactProbe "{self.name}": {model!r} has no contact "{self.contact}"'
            )


def _has_surface(body: object) -> bool:
    """True if a body has triangles and a thickness, so that it can touch others."""
    return isinstance(body, Body) and body.touches
