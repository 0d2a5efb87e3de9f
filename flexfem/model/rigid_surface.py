# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rigid surfaces that shells and beams touch: fixed in space, or moving with a body."""

from collections.abc import Callable
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._fields import Array, checked, declared, flag, function, instance, number
from flexfem._types import FloatArray
from flexfem.core.marker import Attachment, Carrier, Ground, Marker, ShellLine, SurfaceMarker
from flexfem.kernels.users.signed_distance import SignedDistance
from flexfem.mesh.surface_mesh import SurfaceMesh
from flexfem.mesh.triangles.topology import connected_parts, vector_areas
from flexfem.model.bodies.basic import Beam, RigidBody
from flexfem.model.bodies.floating_body import FloatingBody
from flexfem.model.structure.structure import Structure

__all__ = [
    "RigidCylinder", "RigidMesh", "RigidObstacle", "RigidPlane", "RigidSphere", "RigidSurface",
]  # fmt: skip

#: Volume relative to that of a sphere of the same area, below which a part has no inside.
_FLAT = 1e-9


@declared
class RigidSurface:
    """Base class of the rigid surfaces.

    Attributes:
        place: Position and axes: in space, or moving with a rigid body, a node of an SE(3) beam or
            an interface of a floating-frame body, on which the forces then act.

    Raises:
        TypeError: A value is of the wrong type.
        ValueError: A length is not positive.
    """

    place: Attachment = instance((Ground, Marker))

    part_of: ClassVar[str] = "Contact"

    def __post_init__(self) -> None:
        """Check that the place is a frame."""
        kind = type(self).__name__
        if type(self) is RigidSurface:
            raise TypeError(
                "RigidSurface: take a RigidPlane, RigidSphere, RigidCylinder, RigidMesh or "
                "RigidObstacle"
            )
        if isinstance(self.place, (Carrier, ShellLine, SurfaceMarker)):
            raise TypeError(
                f"{kind}: place must be a Ground or a plain Marker, got {type(self.place).__name__}"
            )

    def check(self, model: Structure, owner: str) -> None:
        """Check the carrier of the surface.

        Raises:
            ValueError: It is no body of the model, or one that carries no surface.
        """
        if isinstance(self.place, Ground):
            return
        body = model.get(self.place.body)
        se3 = isinstance(body, Beam) and body.formulation == "se3"
        if not (se3 or isinstance(body, (RigidBody, FloatingBody))):
            what = "nothing of that name" if body is None else f"a {type(body).__name__}"
            raise ValueError(
                f"{owner}: {type(self).__name__} must be on the ground, on a RigidBody, a "
                f'FloatingBody or an SE(3) Beam, got "{self.place.body}", {what} in {model!r}'
            )
        model.marker_place(self.place)


@declared
class RigidPlane(RigidSurface):
    """The plane z = 0 of its place; shells are on the side z > 0."""


@declared
class RigidSphere(RigidSurface):
    """A sphere with its centre at its place.

    Attributes:
        radius: Metres.
        inside: True if shells are inside.
    """

    radius: float = number(default=0.0, positive=True, as_given=True)
    inside: bool = flag(default=False)


def _length(owner: str, what: str, value: float) -> None:
    """Check a length, which may be infinite."""
    if value != np.inf:
        _checks.number(owner, what, value, positive=True)


@declared
class RigidCylinder(RigidSurface):
    """A cylinder around the z axis of its place, which is in the middle.

    Attributes:
        radius: Metres.
        length: Metres. From outside, a finite cylinder is closed by flat ends; from inside it is
            open and acts between its ends.
        inside: True if shells are inside.
    """

    radius: float = number(default=0.0, positive=True, as_given=True)
    length: float = checked(_length, default=np.inf, as_given=True)
    inside: bool = flag(default=False)


def _box(owner: str, what: str, value: npt.ArrayLike) -> FloatArray:
    """Return checked corners of a box."""
    box = _checks.array(owner, what, value, (2, 3))
    if not (box[0] < box[1]).all():
        raise ValueError(
            f"{owner}: {what} must be its lowest and its highest corner, got {box.tolist()}"
        )
    return box


@declared
class RigidObstacle(RigidSurface):
    """An obstacle of any shape, by its signed distance in the axes of its place.

    A function of points (k, 3), m, returns their distances (k,), m, from the surface: positive
    outside, where shells are, negative inside. A function in UFL, of a vector, returns a scalar; it
    is compiled and its derivatives are exact, which are found by differences otherwise. What is not
    quite a distance, as a smooth union of several ones, is allowed: points touch the surface
    itself, at their true distance from it. A slope far from 1 is refused.

    Attributes:
        distance: The function.
        box: Lowest and highest coordinates of the surface, shape (2, 3), metres: there the function
            is checked and the surface drawn. It acts beyond, too.
    """

    distance: Callable[[Any], Any] = function("points (k, 3)")
    box: Array = checked(_box)

    def __post_init__(self) -> None:
        """Check the function in the box."""
        super().__post_init__()
        _ = self.surface

    @cached_property
    def surface(self) -> SignedDistance:
        """The surface of the distance."""
        where = "the ground" if isinstance(self.place, Ground) else f'"{self.place.body}"'
        return SignedDistance(f"RigidObstacle on {where}", self.distance, self.box)


@declared
class RigidMesh(RigidSurface):
    """A surface of triangles, in the axes of its place.

    A closed surface acts on the side that its normals point to, which is the outside. One that
    is open, or touched from both sides, has ``two_sided``: then a node stays on the side on which
    it came near, as with shells, and gets round the rim of an open surface. It touches at half
    of the thickness of shells, at the radius of beams.

    Attributes:
        mesh: Triangles; the names of its bodies do not matter. Metres.
        inside: True if shells are inside of closed surfaces, whose normals then point inwards.
        two_sided: True if both sides act, whatever the normals are.
    """

    mesh: SurfaceMesh = instance(SurfaceMesh, kw_only=True)
    inside: bool = flag(default=False)
    two_sided: bool = flag(default=False)

    def __post_init__(self) -> None:
        """Join the bodies of the mesh, and check that the surface is closed and its normals."""
        super().__post_init__()
        # faces of several bodies that share their edges are one surface
        rows = np.arange(len(self.mesh.triangles))
        whole = SurfaceMesh(self.mesh.points, self.mesh.triangles, {"surface": rows})
        _checks.assign(self, mesh=whole)
        if not self.two_sided:
            self._check_closed()

    def _check_closed(self) -> None:
        """Raise where a part of the surface is open, or its normals point to the wrong side."""
        mesh, neighbours = self.mesh, self.mesh.topology.neighbours
        if (neighbours < 0).any():
            row = int(np.argmax((neighbours < 0).any(axis=1)))
            side = int(np.argmax(neighbours[row] < 0))
            ends = [int(mesh.triangles[row, (side + k) % 3]) for k in (1, 2)]
            raise ValueError(
                f"RigidMesh: the surface is open at the edge between nodes {ends[0]} and "
                f"{ends[1]}: close it, or give two_sided=True, with which it acts on both sides"
            )
        # about a point of the mesh: of a closed surface the volume does not depend on it
        x = mesh.points[mesh.triangles] - mesh.points[0]
        areas = vector_areas(mesh.points, mesh.triangles)
        volumes = np.einsum("mi,mi->m", x.mean(axis=1), areas) / 3.0
        parts = connected_parts(neighbours)
        for part in np.unique(parts):
            own = parts == part
            volume = float(volumes[own].sum())
            area = float(np.linalg.norm(areas[own], axis=1).sum())
            sign = -1.0 if self.inside else 1.0
            if sign * volume > _FLAT * area**1.5:
                continue
            way = "outwards" if self.inside else "inwards"
            rest = "which inside=True does not allow" if self.inside else (
                "reverse them, or give inside=True where shells are inside"
            )  # fmt: skip
            raise ValueError(
                f"RigidMesh: the normals at triangle {int(np.argmax(own))} point {way} (volume "
                f"{volume:.3g} m^3), {rest}"
            )
