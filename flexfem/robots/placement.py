# SPDX-License-Identifier: LGPL-3.0-or-later
"""Forward kinematics: where the links of a robot are at the start, and how they move."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.pose import Pose
from flexfem.robots.coordinates import JointStart
from flexfem.robots.tree import RobotData

__all__ = ["Moving", "Placement", "place_links"]


@dataclass(frozen=True, eq=False)
class Moving:
    """A frame and its motion.

    Attributes:
        pose: in inertial axes.
        velocity: of its origin, inertial axes, m/s.
        angular_velocity: inertial axes, rad/s.
    """

    pose: Pose
    velocity: FloatArray
    angular_velocity: FloatArray

    def at(self, offset: FloatArray) -> FloatArray:
        """Velocity (3,) of a point of the body, given by its inertial vector from the origin."""
        moved: FloatArray = self.velocity + np.cross(self.angular_velocity, offset)
        return moved


@dataclass(frozen=True, eq=False)
class Placement:
    """A robot at the start.

    Attributes:
        links: frames of the links by name.
        joints: frames of the joints, fixed in their parent links, by name.
        starts: coordinates and rates of the joints by name.
    """

    links: Mapping[str, Moving]
    joints: Mapping[str, Pose]
    starts: Mapping[str, JointStart]


def place_links(robot: RobotData, starts: Mapping[str, JointStart], base: Moving) -> Placement:
    """Place all links from the root on."""
    links, frames = {robot.root: base}, dict[str, Pose]()
    for name, joint in robot.joints.items():
        parent, start = links[joint.parent], starts[name]
        frame = parent.pose @ joint.origin
        pose, turn = frame @ start.pose, frame.rotation
        frames[name] = frame
        links[joint.child] = Moving(
            pose,
            parent.at(pose.position - parent.pose.position) + turn @ start.velocity,
            parent.angular_velocity + turn @ start.angular_velocity,
        )
    return Placement(links, frames, starts)
