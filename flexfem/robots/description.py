# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contents of a URDF file, checked.

Format: ROS wiki, urdf/XML (link, joint), as the parser urdfdom reads it. The rotation of an origin
is ``rpy``: about the fixed axes x, y, z in this order, ``R = Rz(yaw) Ry(pitch) Rx(roll)``.
"""

from math import cos, sin
from pathlib import Path

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.pose import Pose
from flexfem.robots.elements import Element, read_elements
from flexfem.robots.tree import (
    KINDS,
    SINGLE,
    Inertial,
    JointData,
    Limits,
    LinkData,
    RobotData,
    check_leaders,
    tree,
)

__all__ = ["check_inertial", "origin", "read_description", "rotation_of"]

_LINK = ("inertial", "visual", "collision", "contact", "sensor", "gazebo")
_JOINT = (
    "origin", "parent", "child", "axis", "limit", "dynamics", "mimic", "calibration",
    "safety_controller",
)  # fmt: skip
_LIMIT = ("lower", "upper", "effort", "velocity", "acceleration", "deceleration", "jerk")
_MOMENTS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
_ROUNDING = 1e-6  # of moments of inertia with six digits


def read_description(path: Path) -> RobotData:
    """Read a URDF file.

    Raises:
        ValueError: the first mistake, in one line that names file, line, element and value.
    """
    robot = read_elements(path)
    if robot.tag != "robot":
        robot.refuse("is not the root of a URDF file, <robot> is")
    for element in robot.children:
        if element.tag.startswith("xacro:"):
            element.refuse("is a macro: expand them first, `xacro robot.xacro > robot.urdf`")
    links: dict[str, LinkData] = {}
    for element in robot.all("link"):
        link = _link(element)
        if link.name in links:
            first = links[link.name].element.line
            element.refuse(f"is there a second time, the first is in line {first}")
        links[link.name] = link
    joints: dict[str, JointData] = {}
    for element in robot.all("joint"):
        joint = _joint(element)
        if joint.name in joints:
            first = joints[joint.name].element.line
            element.refuse(f"is there a second time, the first is in line {first}")
        joints[joint.name] = joint
    if not links:
        robot.refuse("has no <link>")
    check_leaders(joints)
    root, ordered = tree(links, joints)
    names = [root, *(joint.child for joint in ordered)]
    return RobotData(
        robot.text("name"),
        path,
        {name: links[name] for name in names},
        {joint.name: joint for joint in ordered},
        root,
    )


def origin(element: Element) -> Pose:
    """Pose in the ``<origin>`` of an element, the identity without one.

    Raises:
        ValueError: numbers are missing or wrong.
    """
    found = element.child("origin")
    if found is None:
        return Pose()
    found.only(("xyz", "rpy"))
    zero = (0.0, 0.0, 0.0)
    return Pose(found.numbers("xyz", 3, zero), rotation_of(found.numbers("rpy", 3, zero)))


def rotation_of(rpy: FloatArray) -> FloatArray:
    """Rotation matrix of roll, pitch and yaw (rad) about the fixed axes x, y, z."""
    (a, b, c), (d, e, f) = ([function(angle) for angle in rpy.tolist()] for function in (cos, sin))
    return np.array(
        [
            [b * c, c * d * e - a * f, a * c * e + d * f],
            [b * f, a * c + d * e * f, a * e * f - c * d],
            [-e, b * d, a * b],
        ]
    )


def _link(element: Element) -> LinkData:
    element.only(("name", "type"), _LINK)
    name = element.text("name")
    inertial = element.child("inertial")
    return LinkData(
        name,
        element,
        None if inertial is None else _inertial(inertial),
        tuple(element.all("visual")),
        tuple(element.all("collision")),
    )


def _inertial(element: Element) -> Inertial | None:
    """Inertia of a link, None for all zeros."""
    element.only((), ("origin", "mass", "inertia"))
    pose = origin(element)
    mass = element.required("mass").only(("value",)).number("value", nonnegative=True)
    tensor = element.required("inertia").only(_MOMENTS)
    xx, yy, zz, xy, xz, yz = (tensor.number(name) for name in _MOMENTS)
    moments = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    if mass == 0.0 and not moments.any():
        return None
    turned = pose.rotation @ moments @ pose.rotation.T
    return Inertial(mass, pose.position, 0.5 * (turned + turned.T))


def check_inertial(link: LinkData) -> Inertial | None:
    """Inertia of a link that moves; for others it may make no sense.

    Raises:
        ValueError: no mass, or moments of inertia that no body has.
    """
    inertial = link.inertial
    if inertial is None:
        return None
    smallest, middle, largest = np.linalg.eigvalsh(inertial.inertia).tolist()
    shown = f"principal moments {smallest:.6g}, {middle:.6g}, {largest:.6g}"
    element = link.element.required("inertial")
    if inertial.mass == 0.0:
        element.required("mass").refuse(f"value must be positive, got 0 with {shown}")
    if smallest < -_ROUNDING * abs(largest):
        element.required("inertia").refuse(f"must be positive definite, got {shown}")
    if largest > (smallest + middle) * (1.0 + _ROUNDING):
        element.required("inertia").refuse(f"breaks the triangle inequality, got {shown}")
    return inertial


def _joint(element: Element) -> JointData:
    element.only(("name", "type"), _JOINT)
    name, kind = element.text("name"), element.text("type")
    if kind not in KINDS:
        element.refuse(f'type must be one of {", ".join(KINDS)}, got "{kind}"')
    axis = element.child("axis")
    direction = np.array([1.0, 0.0, 0.0])
    if axis is not None:
        direction = axis.only(("xyz",)).numbers("xyz", 3)
    length = float(np.linalg.norm(direction))
    if axis is not None and kind not in ("fixed", "floating") and length < 1e-9:
        axis.refuse(f'xyz must not be zero, got "{axis.attributes["xyz"]}"')
    damping, friction = _dynamics(element, kind)
    leader, multiplier, offset = _mimic(element, kind)
    return JointData(
        name, kind,
        element.required("parent").only(("link",)).text("link"),
        element.required("child").only(("link",)).text("link"),
        element, origin(element), direction / (length or 1.0), _limits(element, kind),
        damping, friction, leader, multiplier, offset,
    )  # fmt: skip


def _limits(element: Element, kind: str) -> Limits:
    found = element.child("limit")
    if found is None:
        if kind in ("revolute", "prismatic"):
            element.refuse(f'of type "{kind}" has no <limit>')
        return Limits()
    found.only(_LIMIT)
    effort, velocity = (
        found.number(name, nonnegative=True) if name in found.attributes else None
        for name in ("effort", "velocity")
    )
    if kind not in ("revolute", "prismatic"):
        return Limits(effort=effort, velocity=velocity)
    lower, upper = (found.number(name, 0.0) for name in ("lower", "upper"))
    if lower > upper:
        found.refuse(f"lower must not be above upper, got {lower:g} and {upper:g}")
    return Limits(lower, upper, effort, velocity)


def _dynamics(element: Element, kind: str) -> tuple[float, float]:
    """Damping and friction."""
    found = element.child("dynamics")
    if found is None:
        return 0.0, 0.0
    found.only(("damping", "friction"))
    damping, friction = (found.number(x, 0.0, nonnegative=True) for x in ("damping", "friction"))
    if (damping or friction) and kind in ("planar", "floating"):
        found.refuse(f'of a joint of type "{kind}" has no meaning, got {damping:g}, {friction:g}')
    return damping, friction


def _mimic(element: Element, kind: str) -> tuple[str | None, float, float]:
    """Leader, multiplier and offset."""
    found = element.child("mimic")
    if found is None:
        return None, 1.0, 0.0
    found.only(("joint", "multiplier", "offset"))
    if kind not in SINGLE:
        found.refuse(f'needs a joint of type {", ".join(SINGLE)}, got "{kind}"')
    multiplier = found.number("multiplier", 1.0)
    if multiplier == 0.0:
        found.refuse('multiplier must not be zero, got "0": a fixed joint does not follow')
    return found.text("joint"), multiplier, found.number("offset", 0.0)
