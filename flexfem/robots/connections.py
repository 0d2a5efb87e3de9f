# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joints of a robot as joints of a model, with their damping, friction, stops and couplings."""

from collections.abc import Mapping
from dataclasses import dataclass

from flexfem.core.joint import Joint
from flexfem.core.marker import Attachment
from flexfem.joints.coupling import Coupling
from flexfem.joints.joint_friction import JointFriction
from flexfem.joints.limit_stop import LimitStop
from flexfem.joints.planar import Planar
from flexfem.joints.prismatic import Prismatic
from flexfem.joints.revolute import Revolute
from flexfem.joints.rigid import Rigid
from flexfem.robots.coordinates import JointStart
from flexfem.robots.tree import JointData

__all__ = ["Connection", "Stops", "connection_items", "coupling", "stop"]

#: Stiffness (N m/rad or N/m) and damping (N m s/rad or N s/m) of stops.
Stops = tuple[float, float]

_AXIS_JOINTS = {
    "revolute": Revolute,
    "continuous": Revolute,
    "prismatic": Prismatic,
    "planar": Planar,
}


@dataclass(frozen=True, eq=False)
class Connection:
    """A joint between two bodies.

    Attributes:
        name: of the joint in the model.
        data: data of the file.
        a: marker on the parent, the joint's frame.
        b: marker on the child, the child link's frame.
        axis: unit vector in inertial axes at the start.
        start: coordinate and rate at the start.
        joint: the joint of the model; None for a floating one.
    """

    name: str
    data: JointData
    a: Attachment
    b: Attachment
    axis: tuple[float, float, float]
    start: JointStart
    joint: Joint | None

    @classmethod
    def between(
        cls, name: str, data: JointData, a: Attachment, b: Attachment, start: JointStart
    ) -> "Connection":
        """Create the joint of the model for that of the file."""
        x, y, z = (a.rotation @ data.axis).tolist()
        axis = (x, y, z)
        joint: Joint | None = None
        if data.kind == "fixed":
            joint = Rigid(name, a, b)
        elif data.kind in _AXIS_JOINTS:
            joint = _AXIS_JOINTS[data.kind](name, a, b, axis=axis)
        return cls(name, data, a, b, axis, start, joint)

    @property
    def motion(self) -> str:
        """Kind of its coordinate: "rotation" or "translation"."""
        return "translation" if self.data.kind == "prismatic" else "rotation"


def connection_items(it: Connection, friction_velocity: float | None) -> list[Joint]:
    """The joint, and its friction and damping unless the velocity is None."""
    if it.joint is None:
        return []
    items = [it.joint]
    if friction_velocity is not None and (it.data.damping or it.data.friction):
        force, viscous, v = it.data.friction, it.data.damping, friction_velocity
        name = f"{it.name}_friction"
        items.append(JointFriction(name, it.joint, force=force, viscous=viscous, velocity=v))
    return items


def stop(it: Connection, stops: Stops) -> LimitStop:
    """End stops at the limits of a joint.

    Raises:
        ValueError: the joint starts beyond its limits, or these leave no motion.
    """
    owner, limits, start = f'stop of joint "{it.data.name}"', it.data.limits, it.start.value
    assert limits.lower is not None  # checked with the arguments
    assert limits.upper is not None
    if limits.lower == limits.upper:
        it.data.element.required("limit").refuse(
            f"has no range between its stops, lower and upper are {limits.lower:g}"
        )
    margin = 1e-9 * max(1.0, abs(start))
    if not limits.lower - margin <= start <= limits.upper + margin:
        raise ValueError(
            f"{owner}: it starts at {start:g}, beyond its limits {limits.lower:g} to "
            f"{limits.upper:g}; give another configuration"
        )
    # angles count from the start, displacements do not
    zero = start if it.motion == "rotation" else 0.0
    return LimitStop(
        f"{it.name}_stop", it.a, it.b, axis=it.axis, motion=it.motion,
        lower=limits.lower - zero, upper=limits.upper - zero,
        stiffness=stops[0], damping=stops[1],
    )  # fmt: skip


def coupling(it: Connection, connections: Mapping[str, Connection]) -> Coupling:
    """Return the coupling that makes a joint follow its leader."""
    assert it.data.leader is not None
    leader = connections[it.data.leader]
    return Coupling(
        f"{it.name}_mimic", leader.a, leader.b, it.a, it.b, axis=leader.axis, second_axis=it.axis,
        ratio=it.data.multiplier, motions=(leader.motion, it.motion),
    )  # fmt: skip
