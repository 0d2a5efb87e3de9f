# SPDX-License-Identifier: LGPL-3.0-or-later
"""URDF files as bodies and joints."""

from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import numpy.typing as npt

from flexfem import _checks
from flexfem.core.pose import Pose
from flexfem.robots.assembly import Choices, assembled
from flexfem.robots.coordinates import joint_starts
from flexfem.robots.description import read_description
from flexfem.robots.flexible import BeamLink, FloatingLink
from flexfem.robots.pictures import PICTURES
from flexfem.robots.placement import Moving, place_links
from flexfem.robots.robot import Robot
from flexfem.robots.tree import RobotData

__all__ = ["read_urdf"]

_ZERO = (0.0, 0.0, 0.0)
_BASES = ("fixed", "free")


def read_urdf(
    file: str | PathLike[str],
    *,
    base: str = "fixed",
    position: npt.ArrayLike = _ZERO,
    rotation: npt.ArrayLike | None = None,
    velocity: npt.ArrayLike = _ZERO,
    angular_velocity: npt.ArrayLike = _ZERO,
    configuration: Mapping[str, Any] | None = None,
    rates: Mapping[str, Any] | None = None,
    flexible: Mapping[str, BeamLink | FloatingLink] | None = None,
    stops: tuple[float, float] | Mapping[str, tuple[float, float]] | None = None,
    friction: bool = True,
    friction_velocity: float = 1e-3,
    separate: Sequence[str] = (),
    pictures: str = "visual",
    packages: Mapping[str, str | PathLike[str]] | None = None,
    prefix: str = "",
) -> Robot:
    """Read a robot from a URDF file.

    Links that fixed joints join become one rigid body; links without mass need such a joint to one
    with mass, or to the ground. Joints that ``<mimic>`` others become couplings. Every body starts
    where the joints' coordinates put it, with the velocity that their rates give it.

    Args:
        file: the file; xacro must be expanded.
        base: "fixed": the root link is the ground; "free": it is a body.
        position: of the root link's frame, inertial axes, m.
        rotation: of the root link's frame, inertial axes.
        velocity: of the root link's origin with a free base, inertial axes, m/s.
        angular_velocity: of the root link with a free base, inertial axes, rad/s.
        configuration: coordinates at the start by the joint's name, zero where not given: rad or m;
            for a planar joint two displacements along its axes x and y, rotated onto the plane, and
            an angle; for a floating one the ``Pose`` of the child in the joint's frame.
        rates: their rates: rad/s or m/s; for a planar joint three; for a floating one velocity and
            angular velocity of the child in the joint's axes, six numbers.
        flexible: links that are flexible bodies, by name: ``BeamLink`` or ``FloatingLink``.
        stops: elastic stops at the joints' limits: stiffness (N m/rad or N/m) and damping, for all
            joints with limits or by the joint's name; None for none.
        friction: whether the joints' damping and friction count.
        friction_velocity: rate of joints, rad/s or m/s, about which friction changes its sign, see
            ``JointFriction``.
        separate: fixed joints that do not join their links: they become ``Rigid`` joints, the
            reactions of which can be recorded.
        pictures: pictures of rigid links: "visual", "collision", or "none" for boxes of their mass
            and inertia.
        packages: folders of packages by name, for meshes ``package://name/...``; others are looked
            for around the file and in ROS_PACKAGE_PATH.
        prefix: prefix of the names of all bodies and joints in the model.

    Returns:
        The robot; ``model.add(*robot.items)``.

    Raises:
        TypeError: an argument has the wrong type.
        ValueError: an argument makes no sense, or a mistake in the file; one line with file, line,
            element and value.
    """
    _checks.instance("read_urdf", "file", file, (str, PathLike))
    path = Path(file)
    robot = read_description(path)
    owner = f'robot "{robot.name}"'
    for what, text, known in (("base", base, _BASES), ("pictures", pictures, PICTURES)):
        if text not in known:
            shown = _checks.show(text)
            raise ValueError(f"{owner}: {what} must be {' or '.join(known)}, got {shown}")
    _checks.instance(owner, "friction", friction, bool)
    _checks.number(owner, "friction_velocity", friction_velocity, positive=True)
    start = Moving(
        Pose(
            _checks.vector(owner, "position", position),
            _checks.rotation(owner, "rotation", rotation),
        ),
        _checks.vector(owner, "velocity", velocity),
        _checks.vector(owner, "angular_velocity", angular_velocity),
    )
    if base == "fixed" and (start.velocity.any() or start.angular_velocity.any()):
        raise ValueError(f'{owner}: velocity and angular_velocity are for base="free"')
    starts = joint_starts(robot, configuration or {}, rates or {})
    choices = Choices(
        fixed=base == "fixed",
        flexible=_flexible(owner, robot, flexible or {}),
        stops=_stops(owner, robot, stops),
        friction=friction,
        friction_velocity=friction_velocity,
        separate=_separate(owner, robot, separate),
        pictures=pictures,
        packages=_packages(owner, packages or {}),
        prefix=_checks.text(owner, "prefix", prefix) if prefix else "",
    )
    return assembled(robot, place_links(robot, starts, start), choices)


def _flexible(
    owner: str, robot: RobotData, flexible: Mapping[str, Any]
) -> dict[str, BeamLink | FloatingLink]:
    """Flexible links, checked."""
    _checks.instance(owner, "flexible", flexible, Mapping)
    for name, link in flexible.items():
        _known(owner, "flexible", name, robot.links, "link")
        _checks.instance(owner, f'flexible["{name}"]', link, (BeamLink, FloatingLink))
    return dict(flexible)


def _stops(owner: str, robot: RobotData, stops: Any) -> dict[str, tuple[float, float]]:
    """Stiffness and damping of the stops by joint, checked."""
    if stops is None:
        return {}
    if not isinstance(stops, Mapping):
        limited = [name for name, joint in robot.joints.items() if joint.limits.lower is not None]
        stops = dict.fromkeys(limited, stops)
    for name, values in stops.items():
        _known(owner, "stops", name, robot.joints, "joint")
        if robot.joints[name].limits.lower is None:
            kind = robot.joints[name].kind
            raise ValueError(f'{owner}: stops: joint "{name}" has no limits, its type is {kind}')
        stiffness, damping = _checks.array(
            f'{owner}: stops of joint "{name}"', "stiffness and damping", values, (2,)
        ).tolist()
        if stiffness <= 0.0 or damping < 0.0:
            raise ValueError(
                f'{owner}: stops of joint "{name}": stiffness must be positive and damping not '
                f"negative, got {stiffness:g} and {damping:g}"
            )
    return {name: (float(values[0]), float(values[1])) for name, values in stops.items()}


def _separate(owner: str, robot: RobotData, names: Sequence[str]) -> frozenset[str]:
    """Names of fixed joints, checked."""
    if isinstance(names, str):
        raise TypeError(f"{owner}: separate must be a list of names, got {_checks.show(names)}")
    for name in names:
        _known(owner, "separate", name, robot.joints, "joint")
        if robot.joints[name].kind != "fixed":
            kind = robot.joints[name].kind
            raise ValueError(f'{owner}: separate: joint "{name}" is not fixed but {kind}')
    return frozenset(names)


def _packages(owner: str, packages: Mapping[str, str | PathLike[str]]) -> dict[str, Path]:
    """Folders of packages, checked."""
    _checks.instance(owner, "packages", packages, Mapping)
    for name, folder in packages.items():
        _checks.text(owner, "package", name)
        if not Path(folder).is_dir():
            raise ValueError(f'{owner}: packages: "{name}": there is no folder "{folder}"')
    return {name: Path(folder) for name, folder in packages.items()}


def _known(owner: str, what: str, name: object, things: Mapping[str, Any], kind: str) -> None:
    """Check that there is a link or joint of a name."""
    if name not in things:
        known = _checks.show(", ".join(things), 200)
        raise ValueError(
            f"{owner}: {what}: there is no {kind} {_checks.show(name)}; there are {known}"
        )
