# SPDX-License-Identifier: LGPL-3.0-or-later
"""Places where joints, loads and probes attach."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._fields import ZERO, Array, ArrayOrNone, checked, declared, rotation, text, vector
from flexfem._types import FloatArray
from flexfem.core.pose import Pose

#: Words that name the ends of a line instead of a physical point group.
LINE_ENDS = ("start", "end")

#: Round-off of a sum of weights.
_ONE = 1e-12


def _place(owner: str, what: str, value: Any) -> str | float | tuple[float, float, float]:
    """Return a checked name, position or fraction."""
    if isinstance(value, str):
        return _checks.text(owner, what, value)
    if isinstance(value, (tuple, list, np.ndarray)):
        x, y, z = _checks.vector(owner, what, value).tolist()
        return x, y, z
    fraction = _checks.number(owner, what, value)
    if not 0.0 <= fraction <= 1.0:
        raise ValueError(f"{owner}: {what} must be a fraction in [0, 1], got {fraction}")
    return fraction


@declared
class Marker:
    """Frame that moves with a rigid body or a place on a beam or shell.

    Attributes:
        body: Name of a Beam, Shell, RigidBody or FloatingBody.
        point: For beams, a place on the line: name of a physical point group, "start" or "end", or
            a fraction of the arc length in [0, 1], also inside an element. For shells: name of a
            node of the surface mesh, or a position (x, y, z) at the start, for the shell's nearest
            node. None for rigid bodies.
        offset: Position of the marker relative to the node (in section axes) or to the reference
            point of the rigid body (in body axes), shape (3,), metres.
        rotation: Orientation of the marker in inertial axes at the initial time, shape (3, 3); from
            then on it rotates with the body.

    Raises:
        TypeError: An argument has the wrong type.
        ValueError: A fraction outside [0, 1], a wrong shape, NaN or no rotation matrix.
    """

    body: str
    point: str | float | tuple[float, float, float] | None = checked(_place, default=None)
    offset: Array = vector(default=ZERO)
    rotation: ArrayOrNone = rotation(default=None)

    @property
    def _owner(self) -> str:
        return f'Marker on "{_checks.text("Marker", "body", self.body)}"'

    def __str__(self) -> str:
        """Return body and point, for tables and messages."""
        point: object = self.point
        if isinstance(point, tuple):
            point = "(" + ", ".join(f"{value:.5g}" for value in point) + ")"
        place = self.body if point is None else f"{self.body}:{point}"
        return f"{place}+offset" if self.offset.any() else place


class Carrier(Marker):
    """A whole line of a body, along which the other marker of a joint slides.

    The line of a beam; a smooth line through points of a rigid body; or one that the reduced data
    of a body in a floating frame hold (``reduce_body``), which moves as the body deforms. Its frame
    is that of the section where the slider is, the first axis along the line.

    Attributes:
        line: Points (n, 3) in the axes of a rigid body, metres, or the name of a line of a body in
            a floating frame; None for beams.
    """

    line: FloatArray | str | None

    def __init__(self, body: str, line: npt.ArrayLike | None = None) -> None:
        """Name the body and the line.

        Raises:
            TypeError: The name is not a string, or the line neither a name nor points.
            ValueError: A name is empty or not printable, or there are fewer than two points or
                neighbours at one place.
        """
        super().__init__(body)
        owner = f'Carrier on "{body}"'
        if isinstance(line, str):
            _checks.assign(self, line=_checks.text(owner, "line", line))
        else:
            _checks.assign(self, line=None if line is None else line_points(owner, line))


def line_points(owner: str, points: npt.ArrayLike) -> FloatArray:
    """Return the checked points (n, 3) of a line.

    Raises:
        TypeError: They are no numbers.
        ValueError: Fewer than two, or neighbours at one place.
    """
    found = _checks.array(owner, "line", points, (-1, 3))
    if len(found) < 2 or not (np.linalg.norm(np.diff(found, axis=0), axis=1) > 0.0).all():
        raise ValueError(
            f"{owner}: line must have two points at least, neighbours at different places"
        )
    return found


class ShellLine(Marker):
    """A row of nodes of a shell along a named line of the surface mesh, for joints of lines."""

    point: str

    def __init__(self, body: str, line: str) -> None:
        """Name the shell and the line.

        Raises:
            TypeError: A name is not a string.
            ValueError: A name is empty or not printable.
        """
        super().__init__(body, _checks.text(f'ShellLine on "{body}"', "line", line))

    @property
    def line(self) -> str:
        """Name of the line."""
        return self.point


class AmplitudeMarker(Marker):
    """Three amplitudes, which are coordinates of a floating-frame body.

    Attributes:
        number: Number of an amplitude; the marker is at the node that carries it.
    """

    number: int

    def __init__(self, body: str, number: int) -> None:
        """Name the body and the amplitude.

        Raises:
            TypeError: The number is not a whole number.
            ValueError: It is negative.
        """
        super().__init__(body)
        owner = f'AmplitudeMarker on "{body}"'
        (checked,) = _checks.indices(owner, "number", [number], np.iinfo(np.int64).max, 1).ravel()
        _checks.assign(self, number=int(checked))

    def __str__(self) -> str:
        """Return body and number, for tables and messages."""
        return f"{self.body}:amplitude {self.number}"


class SurfaceMarker(Marker):
    """Place on an edge or in a triangle of a shell, for joints; inertial axes at the start.

    It stays at its place between the nodes. Where a joint needs axes, they are those of the
    triangle, of one at the edge or node.

    Attributes:
        nodes: One node, two of an edge or three of a triangle, by their numbers in the mesh.
        weights: Their parts in the position: 1, or those of the ends, or area coordinates.
    """

    nodes: tuple[int, ...]
    weights: tuple[float, ...]

    def __init__(
        self,
        body: str,
        nodes: Sequence[int],
        weights: Sequence[float],
        offset: npt.ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        """Create the marker; the offset is in inertial axes at the start, metres.

        Raises:
            TypeError: Nodes or weights are no numbers.
            ValueError: Not one to three nodes with a weight each, or weights that are negative or
                do not add up to one.
        """
        super().__init__(body, None, offset)
        owner = f'SurfaceMarker on "{body}"'
        parts = _checks.array(owner, "weights", weights, (-1,))
        places = _checks.indices(owner, "nodes", nodes, np.iinfo(np.int64).max, 1)
        if places.ndim != 1 or not 1 <= len(set(places.tolist())) == len(parts) <= 3:
            raise ValueError(
                f"{owner}: needs one to three nodes with a weight each, got {_checks.show(nodes)} "
                f"and {_checks.show(weights)}"
            )
        if (parts < 0.0).any() or abs(parts.sum() - 1.0) > _ONE:
            raise ValueError(
                f"{owner}: weights must not be negative and add up to one, got "
                f"{_checks.show(weights)}"
            )
        _checks.assign(self, nodes=tuple(places.tolist()), weights=tuple(parts.tolist()))

    def __str__(self) -> str:
        """Return body and nodes, for tables and messages."""
        return f"{self.body}:{'-'.join(str(node) for node in self.nodes)}"


@declared(eq=True)
class SlidingMarker:
    """Section of a carrier at which the slider of a sliding joint is, for probes and events.

    Attributes:
        joint: Name of the joint.

    Raises:
        TypeError: It is not a string.
        ValueError: It is empty or not printable.
    """

    joint: str = text()

    def __str__(self) -> str:
        """Return a short text for tables and messages."""
        return f"slider of {self.joint}"


@declared
class Ground:
    """Marker fixed in the inertial frame.

    Attributes:
        position: Position in inertial axes, shape (3,), metres.
        rotation: Orientation in inertial axes, shape (3, 3).

    Raises:
        TypeError: An argument does not consist of numbers.
        ValueError: A wrong shape, NaN or no rotation matrix.
    """

    position: Array = vector(default=ZERO)
    rotation: ArrayOrNone = rotation(default=None)

    @property
    def pose(self) -> Pose:
        """Position and orientation as one frame."""
        return Pose(self.position, self.rotation)

    def __str__(self) -> str:
        """Return a short text for tables and messages."""
        return "ground"


#: Ends of a joint.
Attachment = Marker | Ground

#: Markers that probes and events observe.
Observed = Marker | Ground | SlidingMarker
OBSERVED = (Marker, Ground, SlidingMarker)
