# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact of bodies with each other and with rigid surfaces."""

from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY
from types import MappingProxyType
from typing import Any

from flexfem import _checks
from flexfem._fields import (
    Given,
    Renamed,
    checked,
    choice,
    declared,
    flag,
    number,
    renamed_arguments,
    text,
)
from flexfem.model.bodies.base import Body
from flexfem.model.bodies.basic import Beam, RigidBody
from flexfem.model.bodies.floating_body import FloatingBody
from flexfem.model.bodies.shell import Shell
from flexfem.model.probes.base import AnyProbe, check_columns, name_columns
from flexfem.model.rigid_surface import RigidSurface
from flexfem.model.structure.structure import Structure

__all__ = ["Contact", "ContactProbe", "can_touch"]

#: What a ContactProbe measures.
_MEASURED = ("gap", "penetration", "fx", "fy", "fz", "normal", "closed")


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
    """Return checked surfaces, each there once."""
    if isinstance(surfaces, RigidSurface):
        return (surfaces,)
    _checks.instance(owner, what, surfaces, (list, tuple))
    for surface in surfaces:
        _checks.instance(owner, what, surface, RigidSurface)
    if len({id(surface) for surface in surfaces}) < len(surfaces):
        raise ValueError(f"{owner}: {what} must be different, one is there twice")
    return tuple(surfaces)


def _pairs(owner: str, what: str, pairs: Any) -> tuple[tuple[str, str], ...]:
    """Return checked pairs of names."""
    _checks.instance(owner, what, pairs, (list, tuple))
    for pair in pairs:
        if not isinstance(pair, (list, tuple)) or len(pair) != 2:
            raise TypeError(
                f"{owner}: {what} must be pairs of names of bodies, got {_checks.show(pair)}"
            )
        for name in pair:
            _checks.text(owner, what, name)
    return tuple((first, second) for first, second in pairs)


def _not_found(model: Structure, name: str) -> str:
    """Text for a name that is none of a body that touches, with what else it is."""
    thing = model.get(name)
    text = f'{model!r} has no body that touches "{name}"'
    if thing is None:
        return text
    kind = type(thing).__name__
    if isinstance(thing, RigidBody):
        return (
            f"{text}, which is a {kind} without shape: give it one, shape=Sphere(...), or what it "
            f'touches with as surfaces=[RigidSphere(Marker("{name}"), ...)]'
        )
    if isinstance(thing, FloatingBody):
        return (
            f"{text}, which is a {kind}: give what it touches with as surfaces=[RigidSphere(Marker("
            f'"{name}"), ...)], or another RigidSurface'
        )
    if kind == "Solid":
        return f'{text}, which is a {kind}: name its surface, touching="boundary"'
    if isinstance(thing, Body):
        return f"{text}, which is a {kind}: it needs linear triangles and a thickness"
    return f"{text}, which is a {kind}"


@renamed_arguments(slaves="bodies", masters="against")
@declared
class Contact:
    """Contact of bodies with each other, with themselves and with rigid surfaces.

    ``Contact("all")`` is that of everything that touches with everything: shells at half of their
    thickness from the mid-surface (of director shells the four triangles between corners and
    midpoints of edges), membranes (:class:`UFLBody`) with a ``thickness`` likewise, beams at their
    radius from the axis, rigid bodies with their ``shape``. Rigid surfaces, fixed in space or on
    bodies, are added by ``surfaces``. Each kind of contact is one object with its own friction.

    Bodies that automatic lists bring together do not touch where a joint with a rigid row connects
    them: not at all if one of them is rigid or a slider's, otherwise near the markers of the joint.
    Bodies that are both named, or a surface given for named ones, do. A rigid body does not touch
    itself, nor a surface that it carries.

    There are two laws. A barrier repels all surfaces, vertices, edges and triangles of each other,
    that are nearer than ``reach``, and never lets them touch; in motions its forces are discrete
    derivatives of its potential, whose work is exact, and act by impulses. It is used between
    bodies for which there is no penalty (rigid bodies with each other, beams with beams, NURBS
    beams), and where one of ``reach``, ``restitution``, ``static_friction`` or ``slip_speed`` is
    given.

    With the penalty the nodes of ``bodies`` touch the triangles of ``against``, in a second pass
    also the other way round, and rigid surfaces: the normal force per area is the stiffness times
    the penetration. Beams touch by points along the chords of their elements, with the area of
    their length times their diameter; forces act at the centre line. Shells that a joint connects
    touch at half of their distance at the start where that is less than their thickness: panels
    that are folded at a hinge overlap beside it.

    Attributes:
        name: Unique name in the model.
        bodies: Names of the bodies that touch: shells, beams, membranes and rigid bodies with a
            shape. None: all of them.
        against: Names of the bodies that these touch, others or themselves. None: all bodies;
            only the surfaces where there are some and ``bodies`` are named.
        surfaces: Rigid surfaces that the bodies touch.
        exclude: Pairs of names of bodies that do not touch; (name, name) for one that does not
            touch itself.
        reach: Gap below which surfaces repel, metres; None: a tenth of the radius (half of the
            thickness), and a thousandth of the size of bodies without. It is smaller where bodies
            are nearer at the start: that gap, of a rigid body that moves all around, of flexible
            ones where they are so near.
        law: "barrier" or "penalty"; None: see above. All contacts of a model have the same.
        stiffness: Force per penetration and area, N/m^3; of the barrier the scale of its force.
            None: with the barrier that of the mass per area and the speeds at the start, at most
            that through the thickness; with the penalty, at first contact the smaller one of
            the stiffness through the thickness, ``A / h^2`` with the membrane stiffness A, and of
            the inertia per area in the matrix of the first time step, with which an impact takes
            two steps; then the force grows up to ten times as fast, half of that at a tenth of the
            distance of touching. It aims at loads of a few nodes that penetrate by less than a
            fifth of the thickness, and at impacts that do not gain energy; see the penetration.
        friction: Coulomb's coefficient; statics leave friction and damping out.
        damping: Viscous part of the normal force: of the penalty the stiffness times this time,
            seconds, times the rate of penetration; of the barrier its force times this number,
            s/m, times the speed of approach (Hunt, Crossley 1975).
        restitution: Part of the speed of approach with which surfaces separate, 0 to 1; barrier.
        static_friction: Coefficient of surfaces at rest, at least ``friction``; barrier.
        slip_speed: Speed of slip from which on friction is that of Coulomb, m/s; barrier. None:
            that of a fall through a small part of the reach.
        two_pass: True if both sides, shells or meshes of rigid surfaces, change roles in a second
            pass, each with half of the stiffness; beams have one role only.
        skin: Distance within which candidates are searched, metres: nothing passes through a
            surface if both move by less than half of it in a step. None: 0.4 edges of the mesh.
        radius: Of the beams, metres; None for that of their circular sections.

    ``slaves`` and ``masters`` are former names of ``bodies`` and ``against``.

    Raises:
        TypeError: An argument has the wrong type.
        ValueError: Nothing that touches, a body or surface named twice, a number out of range, or
            an argument of the other law.
    """

    name: str
    bodies: Given[str | Sequence[str] | None, tuple[str, ...] | None] = checked(
        _names, default=None
    )
    against: Given[str | Sequence[str] | None, tuple[str, ...] | None] = checked(
        _names, default=None
    )
    surfaces: Given[RigidSurface | Sequence[RigidSurface], tuple[RigidSurface, ...]] = checked(
        _surfaces, default=()
    )
    _: KW_ONLY
    exclude: Given[Sequence[tuple[str, str]], tuple[tuple[str, str], ...]] = checked(
        _pairs, default=()
    )
    reach: float | None = number(default=None, positive=True, as_given=True)
    law: str | None = choice(("barrier", "penalty"), default=None)
    stiffness: float | None = number(default=None, positive=True, as_given=True)
    friction: float = number(default=0.0, nonnegative=True)
    damping: float = number(default=0.0, nonnegative=True)
    restitution: float = number(default=1.0, nonnegative=True)
    static_friction: float | None = number(default=None, nonnegative=True, as_given=True)
    slip_speed: float | None = number(default=None, positive=True, as_given=True)
    two_pass: bool = flag(default=True)
    skin: float | None = number(default=None, positive=True, as_given=True)
    radius: float | None = number(default=None, positive=True, as_given=True)

    slaves = Renamed("bodies")
    masters = Renamed("against")

    def __post_init__(self) -> None:
        """Check that there may be something that touches."""
        owner = _checks.named(self, self.name)
        if self.restitution > 1.0:
            raise ValueError(f"{owner}: restitution must lie in [0, 1], got {self.restitution:g}")
        if self.static_friction is not None and self.static_friction < self.friction:
            raise ValueError(
                f"{owner}: static_friction must not be less than friction {self.friction:g}, got "
                f"{self.static_friction:g}"
            )
        self._check_law(owner)
        if self.bodies == () or (self.against == () and not self.surfaces):
            raise ValueError(
                f"{owner}: it needs bodies, and others or surfaces that they touch (leave bodies "
                "out for all)"
            )

    def _check_law(self, owner: str) -> None:
        """Raise for arguments of the law that the contact does not have."""
        if self.law == "penalty" and self._of_barrier:
            wrong, right = self._of_barrier[0], 'law="barrier"'
        elif self.needs_barrier and (self.skin is not None or not self.two_pass):
            wrong, right = "skin" if self.skin is not None else "two_pass", 'law="penalty"'
        else:
            return
        given = f'law="{self.law}"' if self.law is not None else self._of_barrier[0]
        raise ValueError(f"{owner}: {wrong} belongs to {right}, got {given}: leave one of them out")

    @property
    def _of_barrier(self) -> list[str]:
        """Arguments that are given and only the barrier has."""
        names = ("reach", "static_friction", "slip_speed")
        given = [name for name in names if getattr(self, name) is not None]
        return [*given, *(["restitution"] if self.restitution < 1.0 else [])]

    @property
    def needs_barrier(self) -> bool:
        """True if the law is the barrier, or an argument is given that the penalty has not."""
        return self.law == "barrier" or bool(self._of_barrier)

    def members(self, model: Structure) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Return the names of the bodies and of those that they touch, automatic ones included.

        Raises:
            ValueError: The model has nothing that touches.
        """
        every = tuple(body.name for body in model.bodies if can_touch(body))
        bodies = every if self.bodies is None else self.bodies
        if self.against is not None:
            against = self.against
        else:
            against = () if self.surfaces and self.bodies is not None else every
        if not bodies or not (against or self.surfaces):
            raise ValueError(
                f'Contact "{self.name}": {model!r} has nothing that touches: no shells, no beams, '
                "no membranes with a thickness and no rigid bodies with a shape"
            )
        return bodies, against

    def check(self, model: Structure) -> None:
        """Check the names of the bodies, and the carriers of the surfaces.

        Raises:
            ValueError: The model has no such body, or nothing can touch it.
        """
        owner = f'Contact "{self.name}"'
        bodies, against = self.members(model)
        for what, names in (("", bodies), ("against: ", against)):
            for name in names:
                body = model.get(name)
                if not can_touch(body):
                    raise ValueError(f"{owner}: {what}{_not_found(model, name)}")
                if isinstance(body, Beam):
                    self.beam_radius(body)
        known = {body.name for body in model.bodies}
        for name in dict.fromkeys(name for pair in self.exclude for name in pair):
            if name not in known:
                raise ValueError(f'{owner}: exclude: {model!r} has no body "{name}"')
        for surface in self.surfaces:
            surface.check(model, owner)

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


def can_touch(body: object) -> bool:
    """Return True for what has a surface and a thickness, a line or a shape."""
    if isinstance(body, RigidBody):
        return body.shape is not None
    return isinstance(body, (Shell, Beam)) or (isinstance(body, Body) and body.touches)


def _columns(owner: str, what: str, names: Any) -> Mapping[str, str]:
    """Return checked names of columns by what they hold."""
    _checks.instance(owner, what, names, Mapping)
    for measured, name in names.items():
        _checks.word(owner, what, measured, _MEASURED)
        _checks.text(owner, f'{what}["{measured}"]', name)
    return MappingProxyType(dict(names))


@declared
class ContactProbe(AnyProbe):
    """Gap and forces of a contact.

    Columns: name_gap, the least one between surfaces, m, or the gap below which they repel if none
    is smaller; name_penetration, the largest one, m; name_fx, name_fy, name_fz, the force on the
    ``bodies`` that have nodes, N; name_normal, the sum of the sizes of all normal forces, N;
    name_closed, the number of touching points, those of both passes. Forces of the penalty are
    those at the end of the last step, friction that which has acted there.

    Attributes:
        name: Unique name in the model.
        contact: Name of the contact.
        names: Other names of some columns, such as ``{"gap": "clearance", "fz": "lift"}``.

    Raises:
        TypeError: A name is no string.
        ValueError: ``names`` has no such column, or one that would break the table.
    """

    name: str
    contact: str = text()
    names: Mapping[str, str] = checked(_columns, default=MappingProxyType({}))

    def __post_init__(self) -> None:
        """Name the columns."""
        name_columns(self, _MEASURED)
        pairs = zip(_MEASURED, self.columns, strict=True)
        columns = tuple(self.names.get(measured, column) for measured, column in pairs)
        check_columns(_checks.named(self, self.name), columns)
        _checks.assign(self, columns=columns)

    def check(self, model: Structure) -> None:
        """See :meth:`AnyProbe.check`."""
        if not isinstance(model.get(self.contact), Contact):
            raise ValueError(
                f'ContactProbe "{self.name}": {model!r} has no contact "{self.contact}"'
            )
