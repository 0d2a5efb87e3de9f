# SPDX-License-Identifier: LGPL-3.0-or-later
"""From the description of a robot to bodies and joints of a model."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.joint import Joint
from flexfem.core.pose import Pose
from flexfem.mesh.line_mesh import LineMesh
from flexfem.robots.connections import Connection, connection_items, coupling, stop
from flexfem.robots.flexible import BeamHost, BeamLink, FloatingHost, FloatingLink
from flexfem.robots.hosts import GroundHost, Host, rigid_host
from flexfem.robots.pictures import link_shapes
from flexfem.robots.placement import Placement
from flexfem.robots.robot import Robot
from flexfem.robots.tree import SINGLE, JointData, LinkData, RobotData

__all__ = ["Choices", "assembled"]


@dataclass(frozen=True, kw_only=True)
class Choices:
    """Arguments of ``read_urdf`` on a robot, checked."""

    fixed: bool
    flexible: Mapping[str, BeamLink | FloatingLink]
    stops: Mapping[str, tuple[float, float]]
    friction: bool
    friction_velocity: float
    separate: frozenset[str]
    pictures: str
    packages: Mapping[str, Path]
    prefix: str


def assembled(robot: RobotData, placement: Placement, choices: Choices) -> Robot:
    """The robot as parts of a model.

    Raises:
        ValueError: a moving link without mass, a flexible one that does not fit, two things of one
            name, or an error of bodies and joints.
    """
    parts = _Parts(robot, placement, choices)
    hosts = list({id(host): host for host in parts.hosts.values()}.values())
    items: list[Any] = [host.body for host in hosts if host.body is not None]
    items += parts.joints()
    _check_names(robot, items)
    lines = [host.mesh for host in hosts if isinstance(host, BeamHost) and host.mesh]
    single = {name: joint for name, joint in robot.joints.items() if joint.kind in SINGLE}
    return Robot(
        choices.prefix + robot.name,
        tuple(items),
        LineMesh.join(lines) if lines else None,
        {name: parts.hosts[name].body for name in robot.links},
        {name: it.joint for name, it in parts.connections.items() if it.joint is not None},
        {name: moving.pose for name, moving in placement.links.items()},
        {name: placement.starts[name].value for name in single},
        {name: joint.limits for name, joint in single.items()},
        parts.hosts,
        parts.connections,
    )


class _Parts:
    """Hosts of the links, then connections between them.

    Attributes:
        hosts: by link.
        connections: by joint, of those that connect two bodies.
    """

    def __init__(self, robot: RobotData, placement: Placement, choices: Choices) -> None:
        self._robot, self._placement, self._choices = robot, placement, choices
        self._first, self._within = self._groups()
        self.hosts: dict[str, Host] = {}
        parents = {joint.child: joint for joint in robot.joints.values()}
        for name in robot.links:
            if self._first[name] == name:
                host = self._host(name, parents.get(name))
            else:
                host = self.hosts[self._first[name]]
            self.hosts[name] = host
        self.connections = {
            joint.name: self._connection(joint)
            for joint in robot.joints.values()
            if self.hosts[joint.parent] is not self.hosts[joint.child]
        }

    def _groups(self) -> tuple[dict[str, str], dict[str, Pose]]:
        """First link of the group that moves as one, and the frame in that link's, by link."""
        robot, choices = self._robot, self._choices
        first, within = {robot.root: robot.root}, {robot.root: Pose()}
        for name, joint in robot.joints.items():
            joins = joint.kind == "fixed" and name not in choices.separate
            joins = joins and not {joint.parent, joint.child} & set(choices.flexible)
            first[joint.child] = first[joint.parent] if joins else joint.child
            within[joint.child] = within[joint.parent] @ joint.origin if joins else Pose()
        return first, within

    def _host(self, name: str, joint: JointData | None) -> Host:
        """Return the carrier of a group of links, given the name of its first."""
        link, choices = self._robot.links[name], self._choices
        start = self._placement.links[name]
        flexible = choices.flexible.get(name)
        if joint is None and choices.fixed:
            if flexible is not None:
                link.element.refuse('is the root: it is flexible only with base="free"')
            return GroundHost()
        if isinstance(flexible, FloatingLink):
            return FloatingHost(choices.prefix + name, flexible, start)
        if flexible is not None:
            end = self._beam_end(link, flexible)
            return BeamHost(choices.prefix + name, flexible, end, start)
        group = [
            (self._robot.links[other], self._within[other])
            for other, first in self._first.items()
            if first == name
        ]
        if all(member.inertial is None for member, _ in group):
            return self._massless(link, joint)
        shapes = [
            (shape, pose @ own)
            for member, pose in group
            for shape, own in link_shapes(
                member, choices.pictures, choices.packages, self._robot.path.parent
            )
        ]
        return rigid_host(choices.prefix + name, start, group, shapes)

    def _massless(self, link: LinkData, joint: JointData | None) -> Host:
        """The parent's host for links without mass that are fixed to it."""
        if joint is None:
            link.element.refuse('has no mass: base="free" needs an <inertial>')
        if joint.kind != "fixed":
            link.element.refuse(
                f'has no mass but moves on joint "{joint.name}": it needs an <inertial>, or links '
                "with mass fixed to it"
            )
        if joint.name in self._choices.separate:
            link.element.refuse(f'has no mass: joint "{joint.name}" cannot be separate')
        return self.hosts[joint.parent]

    def _beam_end(self, link: LinkData, beam: BeamLink) -> FloatArray:
        """Return the end of a beam in the link's frame."""
        end, joints = beam.end, self._robot.joints
        leaving = [joint.name for joint in joints.values() if joint.parent == link.name]
        if isinstance(end, str):
            if end not in leaving:
                known = ", ".join(leaving) or "none"
                link.element.refuse(f'has no joint "{end}" where its beam could end: {known}')
            return joints[end].origin.position
        if end is not None:
            return np.array(end, dtype=np.float64)
        if len(leaving) != 1:
            link.element.refuse(
                f"has {len(leaving)} joints that leave it, its BeamLink needs an end"
            )
        return joints[leaving[0]].origin.position

    def _connection(self, joint: JointData) -> Connection:
        frame, child = self._placement.joints[joint.name], self._placement.links[joint.child].pose
        name = self._choices.prefix + joint.name
        if joint.name in self._robot.links:  # a model has one list of names
            name += "_joint"
        a = self.hosts[joint.parent].marker(frame, joint.name)
        b = self.hosts[joint.child].marker(child, joint.name)
        return Connection.between(name, joint, a, b, self._placement.starts[joint.name])

    def joints(self) -> list[Joint]:
        """Joints, friction and actuators in them, stops and couplings."""
        choices, items = self._choices, list[Joint]()
        for name, it in self.connections.items():
            items += connection_items(it, choices.friction_velocity if choices.friction else None)
            if name in choices.stops:
                items.append(stop(it, choices.stops[name]))
            if it.data.leader is not None:
                items.append(coupling(it, self.connections))
        return items


def _check_names(robot: RobotData, items: list[Any]) -> None:
    """Check that names in the model are unique."""
    used: dict[str, Any] = {}
    for item in items:
        if item.name in used:
            raise ValueError(
                f'"{robot.path}": {type(item).__name__} and {type(used[item.name]).__name__} would '
                f'both be called "{item.name}"'
            )
        used[item.name] = item
