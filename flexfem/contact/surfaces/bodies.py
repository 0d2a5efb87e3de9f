# SPDX-License-Identifier: LGPL-3.0-or-later
"""Which bodies a contact brings together, and which pairs of them do not touch."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.joint import Joint
from flexfem.core.marker import Attachment, Carrier, Ground, Marker
from flexfem.core.pose import Pose
from flexfem.layout.numbered_model import NumberedModel
from flexfem.model.bodies.basic import RigidBody
from flexfem.model.bodies.floating_body import FloatingBody
from flexfem.model.contact import Contact

__all__ = ["Connection", "ContactBodies", "check_pairs", "connections", "contact_bodies"]

#: Names of two bodies, or of one.
type Pair = frozenset[str]


@dataclass(frozen=True)
class Connection:
    """Two bodies that a joint with a rigid row connects.

    Attributes:
        bodies: their names.
        places: (2, 3) of its markers on them at the start, m.
        whole: True if the bodies do not touch at all: one is rigid, or slides on the other.
        joint: class and name of the joint.
    """

    bodies: tuple[str, str]
    places: FloatArray
    whole: bool
    joint: str


@dataclass(frozen=True)
class ContactBodies:
    """Bodies of one contact.

    Attributes:
        contact: of the model.
        bodies, against: names of the bodies that touch, and of those that they touch.
        excluded: pairs that do not touch, with the reason.
    """

    contact: Contact
    bodies: tuple[str, ...]
    against: tuple[str, ...]
    excluded: dict[Pair, str]

    def touch(self, first: str, second: str) -> bool:
        """Return True unless two bodies are excluded."""
        return frozenset((first, second)) not in self.excluded

    def pairs(self) -> Iterator[tuple[str, str]]:
        """All pairs of a body and one that it touches, each once."""
        seen = set[Pair]()
        for first, second in product(self.bodies, self.against):
            if self.touch(first, second) and frozenset((first, second)) not in seen:
                seen.add(frozenset((first, second)))
                yield first, second


def contact_bodies(
    serial: NumberedModel, contact: Contact, connected: list[Connection]
) -> ContactBodies:
    """Return the bodies of a contact.

    Args:
        serial: serial data of the model.
        contact: one of its contacts.
        connected: of :func:`connections`.

    Raises:
        ValueError: the model has nothing that touches.
    """
    bodies, against = contact.members(serial.model)
    excluded = {frozenset(pair): "exclude" for pair in contact.exclude}
    for one in connected:
        if one.whole and not _named(contact, one.bodies):
            excluded.setdefault(frozenset(one.bodies), one.joint)
    for name in {*bodies, *against}:
        if _rigid(serial, name):
            excluded.setdefault(frozenset((name,)), "a rigid body")
    return ContactBodies(contact, bodies, against, excluded)


def check_pairs(serial: NumberedModel) -> None:
    """Check that no pair touches in two contacts of a model.

    Raises:
        ValueError: two bodies, or a body and a surface, do.
    """
    contacts = serial.model.contacts
    connected = connections(serial) if len(contacts) > 1 else []
    seen = dict[frozenset[str | int], str]()
    for contact in contacts:
        who, owner = contact_bodies(serial, contact, connected), f'Contact "{contact.name}"'
        pairs: list[tuple[str | int, ...]] = list(who.pairs())
        pairs += [(name, id(one)) for name in who.bodies for one in contact.surfaces]
        for pair in pairs:
            before = seen.setdefault(frozenset(pair), owner)
            if before == owner:
                continue
            what = "the same surface" if isinstance(pair[-1], int) else f'"{pair[-1]}"'
            raise ValueError(
                f'{owner}: "{pair[0]}" and {what} touch in {before} already: leave them out of '
                "one of both, by names of bodies or exclude"
            )


def _named(contact: Contact, pair: tuple[str, str]) -> bool:
    """True if a contact names both bodies, one on each side, or one and a surface on the other."""
    named, others = contact.bodies or (), [*(contact.against or ())]
    others += [s.place.body for s in contact.surfaces if isinstance(s.place, Marker)]
    a, b = pair
    return (a in named and b in others) or (b in named and a in others)


def connections(serial: NumberedModel) -> list[Connection]:
    """Pairs of bodies that joints with rigid rows connect, once for every joint."""
    found = []
    for joint in serial.joints:
        for numbers in joint.pairs:
            a, b = (joint.markers[number] for number in numbers)
            if isinstance(a, Ground) or isinstance(b, Ground) or a.body == b.body:
                continue
            if not _has_rigid_row(serial, joint):
                break
            slides = any(isinstance(marker, Carrier) for marker in (a, b))
            whole = slides or _rigid(serial, a.body) or _rigid(serial, b.body)
            places = np.array([_pose(serial, joint, marker).position for marker in (a, b)])
            found.append(Connection((a.body, b.body), places, whole, joint.owner))
    return found


def _has_rigid_row(serial: NumberedModel, joint: Joint) -> bool:
    """True if a row of a joint is a constraint, not a force."""
    if joint.element is not None:
        return False
    poses = [_pose(serial, joint, marker) for marker in joint.markers]
    return any(row.law is None for row in joint.rows(poses, 0.0))


def _pose(serial: NumberedModel, joint: Joint, marker: Attachment) -> Pose:
    """Pose of a marker at the start; of a line that of what slides on it."""
    if isinstance(marker, Carrier):
        return serial.marker_pose(joint.markers[1])
    return serial.marker_pose(marker)


def _rigid(serial: NumberedModel, name: str) -> bool:
    """True for a body whose surfaces are rigid."""
    return isinstance(serial.model.get(name), (RigidBody, FloatingBody))
