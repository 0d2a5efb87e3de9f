# SPDX-License-Identifier: LGPL-3.0-or-later
"""Coordinates and rates of a robot's joints at the start."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexfem import _checks
from flexfem._types import FloatArray
from flexfem.core.pose import Pose
from flexfem.robots.tree import SINGLE, JointData, RobotData

__all__ = ["JointStart", "joint_starts"]


@dataclass(frozen=True, eq=False)
class JointStart:
    """Motion of a joint's child link relative to the joint's frame at the start.

    Attributes:
        value: the coordinate (rad or m) of a joint with one, zero for others.
        pose: of the child's frame in the joint's.
        velocity: of the child's origin, in the joint's axes, m/s.
        angular_velocity: in the joint's axes, rad/s.
        rate: of the coordinate, rad/s or m/s.
    """

    value: float
    pose: Pose
    velocity: FloatArray
    angular_velocity: FloatArray
    rate: float = 0.0


def joint_starts(
    robot: RobotData, configuration: Mapping[str, Any], rates: Mapping[str, Any]
) -> dict[str, JointStart]:
    """Starts of all joints; coordinates not given are zero, and mimic joints follow.

    Raises:
        TypeError: a value is of the wrong kind.
        ValueError: an unknown, fixed or following joint, a wrong number of values, or a coordinate
            beyond its limits.
    """
    for what, values in (("configuration", configuration), ("rates", rates)):
        _checks.instance(_owner(robot), what, values, Mapping)
        for name in values:
            _check_joint(robot, what, name)
    return {name: _start(robot, joint, configuration, rates) for name, joint in _all(robot)}


def _owner(robot: RobotData) -> str:
    return f'robot "{robot.name}"'


def _all(robot: RobotData) -> list[tuple[str, JointData]]:
    return list(robot.joints.items())


def _check_joint(robot: RobotData, what: str, name: object) -> None:
    """Check that a joint has coordinates of its own."""
    joint = robot.joints.get(name) if isinstance(name, str) else None
    if joint is None:
        moving = ", ".join(joint.name for _, joint in _all(robot) if joint.kind != "fixed")
        raise ValueError(
            f"{_owner(robot)}: {what}: there is no joint {_checks.show(name)}; there are "
            f"{_checks.show(moving, 200)}"
        )
    if joint.kind == "fixed":
        raise ValueError(f'{_owner(robot)}: {what}: joint "{name}" is fixed')
    if joint.leader is not None:
        raise ValueError(
            f'{_owner(robot)}: {what}: joint "{name}" follows "{joint.leader}", give that one'
        )


def _start(
    robot: RobotData, joint: JointData, configuration: Mapping[str, Any], rates: Mapping[str, Any]
) -> JointStart:
    owner = f'{_owner(robot)}: joint "{joint.name}"'
    if joint.kind in SINGLE:
        value, rate = _single(robot, joint, configuration, rates)
        return _along_axis(joint, value, rate)
    if joint.kind == "planar":
        return _planar(
            joint,
            _checks.vector(owner, "configuration", configuration.get(joint.name, (0.0,) * 3)),
            _checks.vector(owner, "rates", rates.get(joint.name, (0.0,) * 3)),
        )
    pose = configuration.get(joint.name, Pose())
    _checks.instance(owner, "configuration", pose, Pose)
    twist = _checks.array(owner, "rates", rates.get(joint.name, (0.0,) * 6), (6,))
    return JointStart(0.0, pose, twist[:3], twist[3:])


def _single(
    robot: RobotData, joint: JointData, configuration: Mapping[str, Any], rates: Mapping[str, Any]
) -> tuple[float, float]:
    """Coordinate and rate of a joint with one, or of the joint it follows."""
    if joint.leader is not None:
        value, rate = _single(robot, robot.joints[joint.leader], configuration, rates)
        return joint.multiplier * value + joint.offset, joint.multiplier * rate
    owner = f'{_owner(robot)}: joint "{joint.name}"'
    value = _checks.number(owner, "configuration", configuration.get(joint.name, 0.0))
    rate = _checks.number(owner, "rates", rates.get(joint.name, 0.0))
    lower, upper = joint.limits.lower, joint.limits.upper
    if joint.name in configuration and lower is not None and upper is not None:
        margin = 1e-9 * max(1.0, abs(value))  # a limit given with the digits of the file
        if not lower - margin <= value <= upper + margin:
            raise ValueError(
                f"{owner}: configuration must lie within its limits {lower:g} to {upper:g}, got "
                f"{value:g}"
            )
    return value, rate


def _along_axis(joint: JointData, value: float, rate: float) -> JointStart:
    zero = np.zeros(3)
    if joint.kind == "prismatic":
        return JointStart(value, Pose(value * joint.axis), rate * joint.axis, zero, rate)
    turned = Pose(rotation=_turn(joint.axis, value))
    return JointStart(value, turned, zero, rate * joint.axis, rate)


def _planar(joint: JointData, place: FloatArray, rates: FloatArray) -> JointStart:
    """Displacements along the joint's x and y axes, rotated onto the plane, and the angle.

    The axes are rotated by the smallest rotation that takes z to the normal; about x by half a turn
    if that is -z.
    """
    x, y, z = joint.axis.tolist()
    if z < -1.0 + 1e-12:
        axes = np.diag([1.0, -1.0, -1.0])
    else:
        k = 1.0 / (1.0 + z)
        axes = np.array(
            [[1.0 - k * x * x, -k * x * y, x], [-k * x * y, 1.0 - k * y * y, y], [-x, -y, z]]
        )
    turned = _turn(joint.axis, float(place[2]))
    flat = np.array([1.0, 1.0, 0.0])
    return JointStart(
        0.0, Pose(axes @ (flat * place), turned), axes @ (flat * rates), rates[2] * joint.axis
    )


def _turn(axis: FloatArray, angle: float) -> FloatArray:
    """Rotation about a unit vector (Rodrigues)."""
    x, y, z = axis.tolist()
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    half = np.sin(0.5 * angle)
    turned: FloatArray = np.eye(3) + np.sin(angle) * skew + 2.0 * half * half * skew @ skew
    return turned
