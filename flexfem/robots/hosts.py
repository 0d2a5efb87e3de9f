# SPDX-License-Identifier: LGPL-3.0-or-later
"""Carriers of a robot's links: the ground, or a body that several links may share."""

from typing import Protocol

import numpy as np

from flexfem.core.marker import Attachment, Ground, Marker
from flexfem.core.pose import Pose
from flexfem.model.bodies.basic import Beam, RigidBody
from flexfem.model.bodies.floating_body import FloatingBody
from flexfem.model.bodies.shapes import CompoundShape, Shape
from flexfem.robots.description import check_inertial
from flexfem.robots.placement import Moving
from flexfem.robots.tree import LinkData

__all__ = ["Body", "GroundHost", "Host", "RigidHost", "rigid_host"]

Body = RigidBody | Beam | FloatingBody


class Host(Protocol):
    """Carries links.

    Attributes:
        body: the body, None for the ground.
    """

    @property
    def body(self) -> Body | None:
        """The body, None for the ground."""

    def marker(self, pose: Pose, joint: str | None = None) -> Attachment:
        """Marker on it that has a pose at the start.

        Args:
            pose: inertial axes.
            joint: name of the joint that attaches there, None for others.

        Raises:
            ValueError: the joint cannot attach there.
        """


class GroundHost:
    """The ground."""

    body = None

    def marker(self, pose: Pose, joint: str | None = None) -> Attachment:
        """See :meth:`Host.marker`."""
        return Ground(pose.position, pose.rotation)


class RigidHost:
    """A rigid body."""

    def __init__(self, body: RigidBody) -> None:
        """Take the body."""
        self.body = body

    def marker(self, pose: Pose, joint: str | None = None) -> Attachment:
        """See :meth:`Host.marker`."""
        offset = self.body.rotation.T @ (pose.position - self.body.position)
        return Marker(self.body.name, offset=offset, rotation=pose.rotation)


def rigid_host(
    name: str, start: Moving, links: list[tuple[LinkData, Pose]], shapes: list[tuple[Shape, Pose]]
) -> RigidHost:
    """A rigid body of links that do not move relative to one another.

    Args:
        name: of the body.
        start: the first link's frame, which is the body's.
        links: all of them, with their frames in the body's; together they have mass.
        shapes: pictures, with their frames in the body's.

    Raises:
        ValueError: the links together have no inertia tensor that a rigid body can have.
    """
    every = [(check_inertial(link), pose) for link, pose in links]
    heavy = [(inertial, pose) for inertial, pose in every if inertial is not None]
    mass = sum(inertial.mass for inertial, _ in heavy)
    centres = [pose.apply(inertial.centre) for inertial, pose in heavy]
    centre = sum((i.mass * c for (i, _), c in zip(heavy, centres, strict=True)), np.zeros(3)) / mass
    tensor = np.zeros((3, 3))
    for (inertial, pose), place in zip(heavy, centres, strict=True):
        arm = place - centre
        tensor += pose.rotation @ inertial.inertia @ pose.rotation.T
        tensor += inertial.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    try:
        body = RigidBody(
            name, mass, tensor,
            position=start.pose.position, rotation=start.pose.rotation, centre=centre,
            velocity=start.velocity,
            angular_velocity=start.angular_velocity,
            shape=CompoundShape(shapes) if shapes else None,
        )  # fmt: skip
    except ValueError as error:
        links[0][0].element.refuse(f"makes no rigid body: {error}")
    return RigidHost(body)
