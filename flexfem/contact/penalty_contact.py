# SPDX-License-Identifier: LGPL-3.0-or-later
"""What the penalty of nodes against triangles and rigid surfaces can do of a contact.

This is the one place that refuses contacts between bodies for which there is no penalty.
"""

from dataclasses import fields
from itertools import product

from flexfem.contact.surfaces.bodies import ContactBodies, connections, contact_bodies
from flexfem.contact.surfaces.shapes import axes_along, shape_mesh, simple_shapes
from flexfem.core.marker import Marker
from flexfem.layout.numbered_model import NumberedModel
from flexfem.model.bodies.base import Body
from flexfem.model.bodies.basic import Beam, RigidBody
from flexfem.model.bodies.shapes import Cylinder, Shape, Sphere
from flexfem.model.contact import Contact
from flexfem.model.rigid_surface import (
    RigidCylinder,
    RigidMesh,
    RigidObstacle,
    RigidSphere,
    RigidSurface,
)

__all__ = ["penalty_contacts"]


def penalty_contacts(serial: NumberedModel) -> list[Contact]:
    """Return the contacts of a model with all bodies by name, and shapes as rigid surfaces.

    ``bodies`` of these are the slaves, ``against`` the masters of the penalty.

    Raises:
        ValueError: a contact between bodies that the penalty cannot do, in one line.
    """
    if not serial.model.contacts:
        return []
    connected = connections(serial)
    return [
        _penalty(serial, contact_bodies(serial, contact, connected))
        for contact in serial.model.contacts
    ]


def _penalty(serial: NumberedModel, who: ContactBodies) -> Contact:
    """One contact."""
    contact, model = who.contact, serial.model
    owner = f'Contact "{contact.name}"'
    slaves = tuple(name for name in who.bodies if not _is(serial, name, RigidBody))
    masters = tuple(name for name in who.against if not _is(serial, name, (RigidBody, Beam)))
    for first, second in who.pairs():
        _check_pair(serial, owner, who, first, second)
    for name in dict.fromkeys([*who.bodies, *who.against]):
        body = model[name]
        if isinstance(body, Body) and not body.penalty:
            raise ValueError(
                f"{owner}: {_named(serial, name)} touches by the barrier alone, leave law out"
            )
    _check_surfaces(serial, owner, who)
    for name in slaves:
        if _is(serial, name, Beam) and model[name].formulation != "se3":
            raise ValueError(
                f'{owner}: Beam "{name}": contact needs the formulation se3, got '
                f"{model[name].formulation}"
            )
    for first, second in product(slaves, masters):
        if not who.touch(first, second):
            raise ValueError(_kept(serial, owner, who, first, second))
    surfaces = [*contact.surfaces, *_shapes(serial, owner, who, slaves)]
    if not slaves or not (masters or surfaces):
        raise ValueError(f"{owner}: nothing is left that touches: every pair of bodies is excluded")
    solid = [name for name in slaves if not _is(serial, name, Beam)]
    if set(solid) & set(masters) and set(solid) != set(masters):
        raise ValueError(
            f"{owner}: against must be others than the bodies or just these, got "
            f"{list(masters)} and {list(slaves)}"
        )
    given = {one.name: getattr(contact, one.name) for one in fields(contact)}
    return Contact(**given | {"bodies": slaves, "against": masters, "surfaces": surfaces})


def _check_pair(
    serial: NumberedModel, owner: str, who: ContactBodies, first: str, second: str
) -> None:
    """Raise for two bodies that the penalty does not bring together."""
    kinds = [("beams", Beam), ("rigid bodies", RigidBody)]
    for plural, kind in kinds:
        if _is(serial, first, kind) and _is(serial, second, kind):
            a, b = (_named(serial, name) for name in (first, second))
            other = "itself" if first == second else b
            raise ValueError(
                f"{owner}: {a} cannot touch {other} yet, there is no contact of {plural} with each "
                f'other: exclude=[("{first}", "{second}")] leaves it out'
            )
    if first in who.against and second in who.bodies:
        return
    rigid = _is(serial, first, RigidBody)
    if rigid or _is(serial, second, Beam):
        a, b = (_named(serial, name) for name in (first, second))
        side = "rigid bodies belong to against" if rigid else "beams belong to bodies"
        raise ValueError(f"{owner}: {a} cannot touch {b} this way round yet: {side}")


def _check_surfaces(serial: NumberedModel, owner: str, who: ContactBodies) -> None:
    """Raise for signed distances, and rigid bodies that are to touch rigid surfaces of others."""
    for surface in who.contact.surfaces:
        if isinstance(surface, RigidObstacle):
            raise ValueError(
                f"{owner}: bodies cannot touch a RigidObstacle by the penalty, which has planes, "
                "spheres, cylinders and meshes: leave law out"
            )
    for name, surface in product(who.bodies, who.contact.surfaces):
        carrier = surface.place.body if isinstance(surface.place, Marker) else ""
        if _is(serial, name, RigidBody) and who.touch(name, carrier) and carrier != name:
            raise ValueError(
                f"{owner}: {_named(serial, name)} cannot touch a {type(surface).__name__} yet, "
                "there is no contact of rigid bodies with each other: name the bodies that touch it"
            )


def _shapes(
    serial: NumberedModel, owner: str, who: ContactBodies, slaves: tuple[str, ...]
) -> list[RigidSurface]:
    """Surfaces of the rigid bodies that all slaves touch."""
    made = []
    for name in who.against:
        body = serial.model[name]
        if not isinstance(body, RigidBody):
            continue
        kept = [slave for slave in slaves if not who.touch(slave, name)]
        if len(kept) == len(slaves):
            continue
        if kept:
            raise ValueError(_kept(serial, owner, who, kept[0], name))
        assert body.shape is not None
        for shape, pose in simple_shapes(body.shape):
            place = Marker(name, offset=pose.position, rotation=body.rotation @ pose.rotation)
            made.append(_surface(_named(serial, name), shape, place))
    return made


def _surface(owner: str, shape: Shape, place: Marker) -> RigidSurface:
    """A shape as a rigid surface at a place."""
    if isinstance(shape, Sphere):
        return RigidSphere(place, shape.radius)
    if isinstance(shape, Cylinder):
        turned = Marker(
            place.body, offset=place.offset, rotation=place.rotation @ axes_along(shape.axis)
        )
        return RigidCylinder(turned, shape.radius, shape.length)
    mesh = shape_mesh(owner, shape)
    opened = bool((mesh.topology.neighbours < 0).any())
    try:
        return RigidMesh(place, mesh=mesh, two_sided=opened)
    except ValueError as error:
        raise ValueError(f"{owner}: its shape: {error}") from None


def _kept(serial: NumberedModel, owner: str, who: ContactBodies, first: str, second: str) -> str:
    """Text for a pair that does not touch although the penalty would have it touch."""
    reason = who.excluded[frozenset((first, second))]
    a, b = (_named(serial, name) for name in (first, second))
    return (
        f"{owner}: {a} and {b} ({reason}) cannot be left out yet where others touch: name bodies "
        "and against, in several contacts"
    )


def _named(serial: NumberedModel, name: str) -> str:
    """Class and name of a body."""
    return f'{type(serial.model[name]).__name__} "{name}"'


def _is(serial: NumberedModel, name: str, kinds: type | tuple[type, ...]) -> bool:
    return isinstance(serial.model[name], kinds)
