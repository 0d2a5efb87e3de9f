# SPDX-License-Identifier: LGPL-3.0-or-later
"""Links of a robot that are flexible bodies."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexfem import _checks
from flexfem._types import FloatArray
from flexfem.core.marker import Attachment, Marker
from flexfem.core.pose import Pose
from flexfem.materials.section import Section
from flexfem.mesh.line_mesh import LineMesh, section_frames
from flexfem.mesh.nurbs.curve import NurbsCurve
from flexfem.model.bodies.basic import FORMULATIONS, Beam
from flexfem.model.bodies.floating_body import FloatingBody
from flexfem.reduction.reduced_body import ReducedBody
from flexfem.robots.placement import Moving

__all__ = ["BeamHost", "BeamLink", "FloatingHost", "FloatingLink"]

_PARALLEL = 0.9  # cosine from which a beam counts as running along the link's y axis
_SAME_PLACE = 1e-6  # relative to the size of the body
_AT_END = 1e-9  # relative to the length of a beam


@dataclass(frozen=True)
class BeamLink:
    """A link that is a straight beam from its frame's origin to the next joint.

    Its mass is that of the section: the file's ``<inertial>`` does not count. Joints off the line
    attach rigidly to the nearest node ("se3") or place ("nurbs").

    Attributes:
        section: stiffness and inertia.
        end: where it ends: name of a joint that leaves the link, or a point (x, y, z) in the link's
            frame, m; None for the only joint.
        elements: number of elements.
        formulation: "se3", which needs ``Model(mesh=robot.mesh)``, or "nurbs" (cubic).
        orientation: approximate direction of the section's e2 in the link's axes; None for y, or x
            where the beam runs along y.
        damping: stiffness-proportional damping, s.
    """

    section: Section
    end: str | Sequence[float] | None = None
    elements: int = 8
    formulation: str = "se3"
    orientation: Sequence[float] | None = None
    damping: float = 0.0

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            TypeError: an argument has the wrong type.
            ValueError: no element, an unknown formulation, a zero direction, negative damping.
        """
        _checks.instance("BeamLink", "section", self.section, Section)
        if isinstance(self.end, str):
            _checks.text("BeamLink", "end", self.end)
        elif self.end is not None:
            _checks.vector("BeamLink", "end", self.end)
        _checks.instance("BeamLink", "elements", self.elements, int)
        if self.elements < 1:
            raise ValueError(f"BeamLink: elements must be at least 1, got {self.elements}")
        if self.formulation not in FORMULATIONS:
            known = " or ".join(FORMULATIONS)
            shown = _checks.show(self.formulation)
            raise ValueError(f"BeamLink: formulation must be {known}, got {shown}")
        if self.orientation is not None:
            _checks.vector("BeamLink", "orientation", self.orientation, nonzero=True)
        _checks.number("BeamLink", "damping", self.damping, nonnegative=True)


@dataclass(frozen=True, eq=False)
class FloatingLink:
    """A link that is an elastic body in a floating frame; its axes are the link's.

    The interfaces of the reduced body have the names of the joints at the link, and their places.
    Its mass is that of the reduced body: the file's ``<inertial>`` does not count.

    Attributes:
        reduced: elastic and inertial data.
        frame: see ``FloatingBody``.
        stiffening: see ``FloatingBody``.
    """

    reduced: ReducedBody
    frame: str | None = None
    stiffening: bool = False

    def __post_init__(self) -> None:
        """Check the reduced body.

        Raises:
            TypeError: it is none.
        """
        _checks.instance("FloatingLink", "reduced", self.reduced, ReducedBody)


class BeamHost:
    """A link that is a beam.

    Attributes:
        body: the beam.
        mesh: its line, None for one along a curve.
    """

    def __init__(self, name: str, link: BeamLink, end: FloatArray, start: Moving) -> None:
        """Create the beam.

        Args:
            name: of the body.
            link: link of the robot.
            end: where it ends, in the link's frame, m.
            start: the link's frame.

        Raises:
            ValueError: it has no length, or runs along its orientation.
        """
        pose, owner = start.pose, f'BeamLink "{name}"'
        length = float(np.linalg.norm(end))
        if length == 0.0:
            raise ValueError(f"{owner}: end must not be the origin of the link's frame, got {end}")
        second = link.orientation
        if second is None:
            second = (1.0, 0.0, 0.0) if abs(end[1]) > _PARALLEL * length else (0.0, 1.0, 0.0)
        self._direction, self._length, self._link = pose.rotation @ end / length, length, link
        self._start = pose.position
        points = np.array([pose.position, pose.apply(end)])
        cells, e2 = np.array([[0, 1]]), pose.rotation @ np.asarray(second, dtype=np.float64)
        try:
            self._section = section_frames(points, cells, e2)[0, 0]
        except ValueError as error:
            raise ValueError(f"{owner}: {error}") from None
        nurbs = link.formulation == "nurbs"
        self.mesh = None if nurbs else LineMesh.straight({name: points}, link.elements)
        self.body = Beam(
            name, link.section,
            curve=NurbsCurve.line(*points, elements=link.elements) if nurbs else None,
            orientation=e2, damping=link.damping,
            velocity=start.at(-pose.position), angular_velocity=start.angular_velocity,
        )  # fmt: skip

    def marker(self, pose: Pose, joint: str | None = None) -> Attachment:
        """See :meth:`Host.marker`."""
        along = float(self._direction @ (pose.position - self._start)) / self._length
        along = min(max(along, 0.0), 1.0)
        if self.mesh is not None:
            along = round(along * self._link.elements) / self._link.elements
        elif abs(along - round(along)) < _AT_END:
            along = float(round(along))
        place = self._start + along * self._length * self._direction
        arm = pose.position - place
        if np.linalg.norm(arm) < 1e-12 * self._length:
            arm = np.zeros(3)
        point = {0.0: "start", 1.0: "end"}.get(along, along)
        return Marker(self.body.name, point, self._section.T @ arm, pose.rotation)


class FloatingHost:
    """A link that is an elastic body in a floating frame.

    Attributes:
        body: the body.
    """

    def __init__(self, name: str, link: FloatingLink, start: Moving) -> None:
        """Create the body; its frame is the link's.

        Raises:
            TypeError: an argument has the wrong type.
            ValueError: see ``FloatingBody``.
        """
        turn = start.pose.rotation
        self.body = FloatingBody(
            name, link.reduced, frame=link.frame, stiffening=link.stiffening,
            position=start.pose.position, rotation=turn, velocity=start.velocity,
            angular_velocity=start.angular_velocity,
        )  # fmt: skip

    def marker(self, pose: Pose, joint: str | None = None) -> Attachment:
        """See :meth:`Host.marker`; others than joints attach to the nearest interface."""
        body, interfaces = self.body, self.body.reduced.interfaces
        owner = f'FloatingLink "{body.name}"'
        if not interfaces:
            raise ValueError(f"{owner}: the reduced body has no interfaces")
        names = [interface.name for interface in interfaces]
        places = np.array([interface.position for interface in interfaces])
        place = body.rotation.T @ (pose.position - body.position)
        gaps = np.linalg.norm(places - place, axis=1)
        if joint is not None:
            if joint not in names:
                known = ", ".join(names)
                raise ValueError(f'{owner}: it has no interface "{joint}" for the joint: {known}')
            at = names.index(joint)
            if gaps[at] > _SAME_PLACE * np.abs([*places, place]).max():
                here, there = (
                    ", ".join(f"{x:.6g}" for x in p.round(12) + 0.0) for p in (places[at], place)
                )
                raise ValueError(
                    f'{owner}: interface "{joint}" is at ({here}), the joint at ({there}) in the '
                    "link's frame"
                )
            return Marker(body.name, joint, rotation=pose.rotation)
        at = int(np.argmin(gaps))
        return Marker(body.name, names[at], place - places[at], pose.rotation)
