# SPDX-License-Identifier: LGPL-3.0-or-later
"""A robot as parts of a model."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NoReturn

import numpy.typing as npt

from flexfem import _checks
from flexfem.core.joint import Joint
from flexfem.core.marker import Attachment
from flexfem.core.pose import Pose
from flexfem.joints.actuator import Actuator
from flexfem.joints.prescribed_angle import PrescribedAngle
from flexfem.joints.prescribed_displacement import PrescribedDisplacement
from flexfem.mesh.line_mesh import LineMesh
from flexfem.model.probes.base import Probe
from flexfem.robots.connections import Connection
from flexfem.robots.coordinate_probe import coordinate_probe
from flexfem.robots.hosts import Body, Host
from flexfem.robots.tree import SINGLE, Limits

__all__ = ["Robot"]


@dataclass(frozen=True, eq=False)
class Robot:
    """Robot that ``read_urdf`` makes of a file: ``model.add(*robot.items)``.

    Links and joints are called by their names in the file here; in the model these names have the
    prefix that was asked for.

    Attributes:
        name: of the robot.
        items: bodies, joints, friction, stops and couplings, to be added to a model.
        mesh: for ``Model(mesh=...)``, the lines of links that are beams; None without any.
        links: the body of every link by the link's name; links that fixed joints join have one in
            common, and those fixed to the ground None.
        joints: joints of the model by the joint's name; floating ones and those that joined links
            are not among them.
        frames: frames of the links at the start, inertial axes.
        configuration: coordinates at the start of the joints that have one, rad or m.
        limits: of the joints that have one coordinate, also their effort and velocity.
    """

    name: str
    items: tuple[Any, ...]
    mesh: LineMesh | None
    links: Mapping[str, Body | None]
    joints: Mapping[str, Joint]
    frames: Mapping[str, Pose]
    configuration: Mapping[str, float]
    limits: Mapping[str, Limits]
    _hosts: Mapping[str, Host] = field(repr=False)
    _connections: Mapping[str, Connection] = field(repr=False)

    def marker(
        self,
        link: str,
        offset: npt.ArrayLike = (0.0, 0.0, 0.0),
        rotation: npt.ArrayLike | None = None,
    ) -> Attachment:
        """A marker on a link; on a flexible one at the nearest node or interface, rigidly.

        Args:
            link: name of the link.
            offset: position in the link's frame, m.
            rotation: orientation at the start in inertial axes; the link's own when None.

        Raises:
            TypeError: an argument has the wrong type.
            ValueError: there is no such link, or an argument has a wrong shape.
        """
        if link not in self.frames:
            self._refuse("link", link, self.frames)
        frame = self.frames[link]
        place = frame.apply(_checks.vector(f'robot "{self.name}"', "offset", offset))
        turn = frame.rotation if rotation is None else rotation
        return self._hosts[link].marker(Pose(place, turn))

    def drive(self, joint: str, position: Callable[[float], float]) -> Joint:
        """A prescribed motion of a joint, named after it with ``_drive``.

        Args:
            joint: name of a joint with one coordinate.
            position: the coordinate as the file counts it (rad or m) over time (s); at t = 0 that
                of the start.

        Raises:
            TypeError: the position is not a function.
            ValueError: there is no such joint, or its value at t = 0 is not a number.
        """
        it = self._single(joint)
        _checks.function(f'drive of joint "{joint}"', "position", position, ())
        zero = it.start.value

        def motion(t: float) -> float:
            return float(position(t)) - zero

        name = f"{it.name}_drive"
        if it.motion == "rotation":
            return PrescribedAngle(name, it.a, it.b, axis=it.axis, angle=motion)
        return PrescribedDisplacement(name, it.a, it.b, axis=it.axis, displacement=motion)

    def actuator(
        self,
        joint: str,
        force: Callable[[float], float] = lambda t: 0.0,
        *,
        saturate: bool = False,
    ) -> Actuator:
        """A force or torque in a joint, named after it with ``_actuator``.

        Args:
            joint: name of a joint with one coordinate.
            force: N m or N over time (s).
            saturate: keep it within the effort that the file gives the joint.

        Raises:
            TypeError: the force is not a function.
            ValueError: there is no such joint, its value at t = 0 is not a number, or the file has
                no positive effort to keep within.
        """
        it = self._single(joint)
        _checks.function(f'actuator of joint "{joint}"', "force", force, ())
        limited = force
        if saturate:
            effort = it.data.limits.effort
            if not effort:
                it.data.element.refuse(f"has no positive effort to saturate at, got {effort}")
            bound = effort

            def limited(t: float) -> float:
                return min(max(float(force(t)), -bound), bound)

        name = f"{it.name}_actuator"
        return Actuator(name, it.a, it.b, axis=it.axis, motion=it.motion, force=limited)

    def probe(self, *joints: str, name: str | None = None) -> Probe:
        """A probe of coordinates (rad or m) as the file counts them, and their rates.

        Args:
            *joints: names of joints with one coordinate; all of them when none is given.
            name: of the probe; that of the robot with ``_joints`` when None.

        Returns:
            A probe with the columns ``<joint>`` and ``<joint>_rate`` for each, with the prefix.

        Raises:
            ValueError: there is no such joint.
        """
        named = joints or tuple(self.configuration)
        places = [self._single(joint) for joint in named]
        return coordinate_probe(f"{self.name}_joints" if name is None else name, places)

    def _single(self, joint: str) -> Connection:
        """A joint with one coordinate."""
        it = self._connections.get(joint)
        if it is None or it.data.kind not in SINGLE:
            self._refuse("joint with one coordinate", joint, self.configuration)
        return it

    def _refuse(self, what: str, name: object, known: Mapping[str, Any]) -> NoReturn:
        names = _checks.show(", ".join(known), 200)
        raise ValueError(
            f'robot "{self.name}": there is no {what} {_checks.show(name)}; it has {names}'
        )

    def __str__(self) -> str:
        """Return the parts of the robot in one line."""
        bodies = {id(body) for body in self.links.values() if body is not None}
        return (
            f'robot "{self.name}": {len(self.links)} links, {len(bodies)} bodies, '
            f"{len(self.configuration)} joints with one coordinate"
        )
