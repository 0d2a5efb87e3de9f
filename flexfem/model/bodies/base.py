# SPDX-License-Identifier: LGPL-3.0-or-later
"""Base class of the bodies of further families, which users may define outside the package."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar

from flexfem._types import FloatArray
from flexfem.core.load import Load
from flexfem.core.marker import Marker
from flexfem.core.pose import Pose
from flexfem.mesh.surface_mesh import SurfaceMesh

__all__ = ["Body"]


class Body(ABC):
    """Base class of bodies whose family may be defined outside of the package.

    Attributes:
        name: Unique name in the model.
        family: The family, a class derived from `flexfem.layout.family.Family`, or its name as
            "module:class", so that models are built without DOLFINx and PETSc.
        velocity: Initial velocity of the point of the (extended) body at the inertial origin,
            inertial axes, shape (3,), m/s.
        angular_velocity: Initial angular velocity, inertial axes, shape (3,), rad/s.
        width: Unknowns of a node, 3 (positions) or 6 (positions and rotations).
        touches: Whether contacts may name it.
        penalty: Whether contacts may have the penalty, beside the barrier.
        continuum: Whether elements fill a continuum, so that large bodies are solved iteratively.
        bulk_over_shear: Largest ratio of the moduli of a continuum at small strains, by which that
            depends on it; zero if there is none.
    """

    family: ClassVar[Any]

    name: str
    velocity: FloatArray
    angular_velocity: FloatArray
    width: ClassVar[int] = 3
    touches: bool = False
    penalty: ClassVar[bool] = True
    continuum: ClassVar[bool] = False
    bulk_over_shear: float = 0.0

    @property
    def surface(self) -> SurfaceMesh | None:
        """Triangles with one body of this name, on which pressures act; None without any."""
        return None

    @property
    @abstractmethod
    def points(self) -> FloatArray:
        """(n, 3) places of the nodes at the start, m."""

    @property
    @abstractmethod
    def elements(self) -> int:
        """Number of finite elements."""

    @property
    def holds(self) -> int:
        """Number of fixed unknowns."""
        return 0

    @property
    @abstractmethod
    def masses(self) -> tuple[FloatArray, FloatArray]:
        """Points (q, 3) at the start, m, and masses (q,), kg, with the inertia of the body."""

    @property
    def materials(self) -> Sequence[tuple[float, float, float]]:
        """Young's modulus (Pa), density (kg/m^3) and speed of longitudinal waves (m/s) of each.

        For the check of units; NaN where unknown.
        """
        return ()

    @property
    @abstractmethod
    def details(self) -> str:
        """The most important values, for the table of the model."""

    @abstractmethod
    def node(self, marker: Marker) -> int:
        """Return the number of the node of a marker, in the order of :attr:`points`.

        Its point is None, a name, a fraction in [0, 1] or a place at the start; the body defines
        which of them it accepts. A body whose nodes have no axes refuses offsets: nothing else
        does.

        Raises:
            ValueError: There is no such node, or the marker has an offset where none can be.
        """

    def check_load(self, owner: str, load: Load) -> None:
        """Check a load that names this body (``Load.bodies``), which its family then applies.

        Raises:
            ValueError: The body takes no such load; the message begins with the owner.
        """
        raise ValueError(f'{owner}: {type(self).__name__} "{self.name}" takes no such load')

    @abstractmethod
    def moved(self, motion: Pose) -> "Body":
        """Return the body moved rigidly, ``x`` to ``R x + p``, with its initial velocities.

        Raises:
            ValueError: It cannot be moved so.
        """
