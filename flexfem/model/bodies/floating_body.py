# SPDX-License-Identifier: LGPL-3.0-or-later
"""Elastic bodies that move far and deform little: finite elements in a floating frame."""

from dataclasses import KW_ONLY, InitVar
from functools import cached_property

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._fields import (
    ZERO,
    Array,
    ArrayOrNone,
    Given,
    declared,
    flag,
    instance,
    rotation,
    settled,
    vector,
)
from flexfem._types import FloatArray, IntArray
from flexfem.core.marker import AmplitudeMarker, Marker
from flexfem.model.bodies.basic import inertia_matrix, set_spin
from flexfem.reduction.reduced_body import ReducedBody

__all__ = ["MEAN_AXES", "FloatingBody"]

#: Name of the frame that moves with the body on average.
MEAN_AXES = "mean_axes"


@declared
class FloatingBody:
    """Elastic body in a frame that moves with it.

    Displacements and rotations relative to the frame are small, as linear elasticity has them; the
    motion of the frame is not. A body that was reduced with ``derivatives`` has the nonlinear
    forces of moderate ones. Rotations of the interfaces count as rotation vectors, so that a
    slender body may bend moderately; one that bends far is better divided into several.

    Attributes:
        name: Unique name in the model.
        reduced: Its elastic and inertial data, see ``reduce_body``.
        frame: Name of the interface whose frame is the floating one ("node-fixed"), or "mean_axes"
            for the frame relative to which the body as a whole neither moves nor rotates. None for
            that of the first interface, without any the mean axes.
        position: Origin of the body's axes at the start, inertial axes, shape (3,), metres.
        rotation: Body axes at the start in inertial axes, shape (3, 3).
        velocity: Initial velocity of the origin, inertial axes, shape (3,), m/s.
        angular_velocity: Initial angular velocity, inertial axes, shape (3,), rad/s. It may be
            given in body axes instead, as ``local_angular_velocity``.
        stiffening: Forces and accelerations change the stiffness (geometric stiffening by stress of
            the frame's acceleration and of the interfaces' displacements); the reduced data must
            contain its terms.

    Its markers: the name of an interface as ``point``, or None for the floating frame. The names
    of the interfaces are those in ``reduced``, and so are those of lines for sliders (``Carrier``).

    Raises:
        TypeError: An argument has the wrong type.
        ValueError: A wrong shape, NaN, both angular velocities, a frame that the body does not
            have, or no data for geometric stiffening.
    """

    name: str
    reduced: ReducedBody = instance(ReducedBody)
    _: KW_ONLY
    frame: Given[str | None, str] = settled(default=None)
    position: Array = vector(default=ZERO)
    rotation: ArrayOrNone = rotation(default=None)
    velocity: Array = vector(default=ZERO)
    angular_velocity: ArrayOrNone = settled(default=None)
    local_angular_velocity: InitVar[npt.ArrayLike | None] = None
    stiffening: bool = flag(default=False)

    def __post_init__(self, local: npt.ArrayLike | None) -> None:
        """Choose the frame, and check that the reduced data suffice for it and for stiffening."""
        owner, reduced = _checks.named(self, self.name), self.reduced
        names = [interface.name for interface in reduced.interfaces]
        frame = self.frame
        if frame is None:
            frame = names[0] if names else MEAN_AXES
        if _checks.text(owner, "frame", frame) not in (*names, MEAN_AXES):
            known = ", ".join([*names, MEAN_AXES])
            raise ValueError(f'{owner}: frame must be one of {known}, got "{frame}"')
        if self.stiffening and (
            reduced.acceleration_stiffness is None or reduced.interface_stiffness is None
        ):
            raise ValueError(
                f"{owner}: the reduced body has no data for geometric stiffening, reduce it with "
                "geometric_stiffness=True"
            )
        if frame == MEAN_AXES and names and not reduced.free_rigid_motions.all():
            raise ValueError(
                f"{owner}: a body without motion out of its plane has no mean axes, take an "
                f"interface as frame: {', '.join(names)}"
            )
        _checks.assign(self, frame=frame)
        self._check_polynomial(owner, names)
        set_spin(self, local)

    def _check_polynomial(self, owner: str, names: list[str]) -> None:
        """Refuse what nonlinear elastic forces do not have."""
        if self.reduced.polynomial is None:
            return
        if names and self.frame != names[0]:
            raise ValueError(
                f'{owner}: its elastic forces are nonlinear in the frame of "{names[0]}", got '
                f'frame="{self.frame}"; reduce it with this interface first'
            )
        if self.stiffening:
            raise ValueError(
                f"{owner}: its elastic forces are nonlinear and stiffen already, without stiffening"
            )

    @property
    def mass(self) -> float:
        """Mass, kg."""
        return self.reduced.mass

    @property
    def inertia_matrix(self) -> FloatArray:
        """Inertia matrix (6, 6) at rest about the origin in body axes, translation first."""
        return inertia_matrix(self.mass, self.reduced.moments[:, 0], self.reduced.inertia)

    @cached_property
    def relative(self) -> IntArray:
        """Interfaces other than the frame's own."""
        names = [interface.name for interface in self.reduced.interfaces]
        return np.array([i for i, name in enumerate(names) if name != self.frame], dtype=np.int64)

    @property
    def has_frame_node(self) -> bool:
        """True if the frame is that of a node; mean axes follow from the interfaces."""
        return self.frame != MEAN_AXES or not self.reduced.interfaces

    @property
    def origin(self) -> FloatArray:
        """Origin of the frame at rest in the body's axes, (3,), m."""
        if self.frame == MEAN_AXES:
            return self.reduced.mass_centre
        return self.reduced.interfaces[self.reduced.interface(self.frame)].position

    @property
    def coordinates(self) -> IntArray:
        """Coordinates of the reduced body that are elastic ones here, in their order."""
        count = 6 * len(self.reduced.interfaces)
        own = (6 * self.relative[:, np.newaxis] + np.arange(6)).ravel()
        return np.concatenate([own, np.arange(count, self.reduced.size)])

    @property
    def functions(self) -> IntArray:
        """Functions of the reduced body in pictures that belong to the elastic coordinates."""
        beside = np.arange(self.reduced.size, self.reduced.functions)
        return np.concatenate([self.coordinates, beside])

    @property
    def amplitude_nodes(self) -> int:
        """Number of nodes that carry three amplitudes each."""
        return -(-self.reduced.modes // 3)

    @property
    def nodes(self) -> int:
        """Number of nodes: that of the frame, the other interfaces, the amplitudes."""
        return int(self.has_frame_node) + len(self.relative) + self.amplitude_nodes

    @property
    def places(self) -> FloatArray:
        """Positions (n, 3) at rest, body axes, m, of the frame's node and of the interfaces."""
        points = [self.reduced.interfaces[i].position for i in self.relative]
        return np.array([self.origin, *points] if self.has_frame_node else points)

    def node(self, marker: Marker) -> int:
        """Number of the node that carries a marker.

        Raises:
            ValueError: There is no such interface or amplitude, or the marker has an offset that
                amplitudes cannot have.
        """
        owner, own = f'Marker on "{self.name}"', int(self.has_frame_node)
        if isinstance(marker, AmplitudeMarker):
            if marker.number >= self.reduced.modes:
                raise ValueError(
                    f"{owner}: there is no amplitude {marker.number}, it has {self.reduced.modes}"
                )
            return own + len(self.relative) + marker.number // 3
        if marker.point in (None, self.frame):
            if not self.has_frame_node:
                raise ValueError(f"{owner}: the mean axes carry no marker, name an interface")
            return 0
        names = [self.reduced.interfaces[i].name for i in self.relative]
        if marker.point not in names:
            known = ", ".join(interface.name for interface in self.reduced.interfaces) or "none"
            raise ValueError(f'{owner}: there is no interface "{marker.point}"; it has {known}')
        return own + names.index(str(marker.point))
