# SPDX-License-Identifier: LGPL-3.0-or-later
"""Links and joints as a URDF file has them, and the tree they form."""

from dataclasses import dataclass
from pathlib import Path

from flexfem._types import FloatArray
from flexfem.core.pose import Pose
from flexfem.robots.elements import Element

__all__ = [
    "KINDS",
    "SINGLE",
    "Inertial",
    "JointData",
    "Limits",
    "LinkData",
    "RobotData",
    "check_leaders",
    "tree",
]

#: Types of joints.
KINDS = ("fixed", "revolute", "continuous", "prismatic", "planar", "floating")
#: Those with one coordinate along or about the axis.
SINGLE = ("revolute", "continuous", "prismatic")


@dataclass(frozen=True, eq=False)
class Inertial:
    """Mass (kg), its centre (m) and inertia tensor about it (kg m^2), in the link's axes."""

    mass: float
    centre: FloatArray
    inertia: FloatArray


@dataclass(frozen=True, eq=False)
class LinkData:
    """A link; ``visual`` and ``collision`` are its elements of these names."""

    name: str
    element: Element
    inertial: Inertial | None
    visual: tuple[Element, ...]
    collision: tuple[Element, ...]


@dataclass(frozen=True)
class Limits:
    """Limits of a joint's coordinate.

    Attributes:
        lower, upper: rad or m; None without limit.
        effort: largest force of its drive, N m or N; None if the file does not say.
        velocity: largest rate, rad/s or m/s; None if the file does not say.
    """

    lower: float | None = None
    upper: float | None = None
    effort: float | None = None
    velocity: float | None = None


@dataclass(frozen=True, eq=False)
class JointData:
    """A joint.

    Attributes:
        name, kind, parent, child: as the file has them.
        element: where it stands.
        origin: the joint's frame in the parent link's.
        axis: unit vector in the joint's frame.
        limits: of its coordinate.
        damping: N m s/rad or N s/m.
        friction: N m or N.
        leader: name of the joint that it follows, None for none.
        multiplier, offset: its coordinate is ``multiplier`` times the leader's plus ``offset``.
    """

    name: str
    kind: str
    parent: str
    child: str
    element: Element
    origin: Pose
    axis: FloatArray
    limits: Limits
    damping: float
    friction: float
    leader: str | None
    multiplier: float
    offset: float


@dataclass(frozen=True, eq=False)
class RobotData:
    """A robot.

    Attributes:
        name: of the robot.
        path: of the file.
        links: in the order of the tree, parents first.
        joints: in the order of the tree; each leads to the link of the same place after the root.
        root: link that is no joint's child.
    """

    name: str
    path: Path
    links: dict[str, LinkData]
    joints: dict[str, JointData]
    root: str


def check_leaders(joints: dict[str, JointData]) -> None:
    """Check that leaders of joints exist and do not follow in a circle.

    Raises:
        ValueError: they do not.
    """
    good: set[str] = set()  # those that lead to one without a leader
    for joint in joints.values():
        seen, at = {joint.name}, joint
        while at.leader is not None and at.name not in good:
            mimic = at.element.required("mimic")
            if at.leader not in joints or joints[at.leader].kind not in SINGLE:
                mimic.refuse(f'joint "{at.leader}" must be one of type {", ".join(SINGLE)}')
            at = joints[at.leader]
            if at.name in seen:
                mimic.refuse(f'joint "{at.name}" follows itself')
            seen.add(at.name)
        good |= seen


def tree(links: dict[str, LinkData], joints: dict[str, JointData]) -> tuple[str, list[JointData]]:
    """The root, and the joints such that those towards the root come first.

    Raises:
        ValueError: a joint with a link that is not there, several roots, or a closed loop.
    """
    to: dict[str, JointData] = {}
    leaving: dict[str, list[JointData]] = {name: [] for name in links}
    for joint in joints.values():
        for side, name in (("parent", joint.parent), ("child", joint.child)):
            if name not in links:
                joint.element.required(side).refuse(f'link "{name}" is not in the file')
        if joint.child in to:
            joint.element.required("child").refuse(
                f'link "{joint.child}" is the child of joint "{to[joint.child].name}" as well: '
                "closed loops are no trees"
            )
        to[joint.child] = joint
        leaving[joint.parent].append(joint)
    roots = [name for name in links if name not in to]
    if len(roots) > 1:
        second = links[roots[1]].element
        second.refuse(f'has no joint to a parent, but "{roots[0]}" is the root already')
    ordered, waiting = list[JointData](), list(roots)
    for name in waiting:  # grows
        for joint in leaving[name]:
            ordered.append(joint)
            waiting.append(joint.child)
    if len(ordered) < len(joints):
        found = {joint.name for joint in ordered}
        lost = next(joint for joint in joints.values() if joint.name not in found)
        lost.element.refuse("is part of a closed loop of parents and children")
    return roots[0], ordered
