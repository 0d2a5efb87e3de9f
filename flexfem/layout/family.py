# SPDX-License-Identifier: LGPL-3.0-or-later
"""Families of bodies: the interface of the system to every kind of body, and the list of the kinds.

A family is a class derived from :class:`Family`; those of the package are in ``flexfem.families``.
A body of the model names its family in the attribute ``family``, as the class or, so that models
are built without DOLFINx and PETSc, as "module:class". Nothing else in the package distinguishes
kinds of bodies.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, runtime_checkable

import numpy as np

from flexfem._checks import InputError
from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.core.inertia import point_inertia
from flexfem.mesh.patches import coupled_nodes

if TYPE_CHECKING:
    from mpi4py import MPI

    from flexfem.core.joint import Joint
    from flexfem.core.marker import Carrier, Marker
    from flexfem.core.nodes.frame_block import FrameBlock
    from flexfem.layout.elements import ElementFamily
    from flexfem.layout.inner_forces import InnerForces
    from flexfem.layout.lines import Line
    from flexfem.layout.mesh_facts import MeshFacts
    from flexfem.layout.node_loads import Force
    from flexfem.layout.surface_places import SurfacePlace
    from flexfem.model.contact import Contact
    from flexfem.model.model import Model
    from flexfem.model.probes.base import AnyProbe
    from flexfem.model.structure.place import Place

__all__ = [
    "BUILT_IN", "ContactLine", "ContactSurface", "Family", "NodalSensor", "NodalValues", "Sensor",
    "SumOfValues", "registry",
]  # fmt: skip

#: Families of the package in the order of the nest; those of users follow.
BUILT_IN = (
    "flexfem.families.beam_se3.family:SE3BeamFamily",
    "flexfem.families.beam_nurbs.family:NurbsBeamFamily",
    "flexfem.families.shells.family:ShellFamily",
    "flexfem.families.rigid.family:RigidBodyFamily",
    "flexfem.families.floating.family:FloatingBodyFamily",
    "flexfem.families.ufl_body.family:UFLBodyFamily",
    "flexfem.families.cable.family:CableFamily",
    "flexfem.families.cable_net.family:CableNetFamily",
)

#: Methods that every family defines; the others depend on the abilities of its bodies.
_NEEDED = ("frames", "velocities", "body_of_node", "node", "costs", "block")


class Sensor(Protocol):
    """Measurement of the accepted state: the share of this rank in the columns of a probe."""

    def update(self) -> FloatArray:
        """Evaluate the accepted state and return this rank's share of the columns."""


class NodalValues(Protocol):
    """Numbers each of which depends on the configurations of few nodes.

    Attributes:
        block: of the nodes.
        support: (m, k) local nodes on which each row depends, -1 where there are fewer.
    """

    block: FrameBlock
    support: IntArray


@runtime_checkable
class NodalSensor(Sensor, Protocol):
    """Measurement that is a function of such numbers, and has derivatives.

    Attributes:
        nodal: the numbers.
    """

    @property
    def nodal(self) -> Sequence[NodalValues]:
        """See the class."""
        ...

    def linearised(
        self, weights: FloatArray
    ) -> Sequence[tuple[Callable[[], FloatArray], FloatArray]]:
        """Functions whose weighted sums change as ``weights @ columns`` do (collective).

        For each of the numbers it is a function that computes (m, c) values of this rank at the
        trial state, and weights (m, c): those numbers, or what they do to the columns to the first
        order about the present state.
        """


class SumOfValues:
    """Sensor whose columns are the sums of its own :class:`NodalValues`."""

    block: FrameBlock
    support: IntArray

    def values(self) -> FloatArray:
        """Values (m, c) of this rank at the trial state."""
        raise NotImplementedError

    def update(self) -> FloatArray:
        """See :class:`Sensor`."""
        found: FloatArray = self.values().sum(axis=0)
        return found

    @property
    def nodal(self) -> Sequence[NodalValues]:
        """See :class:`NodalSensor`."""
        return [self]

    def linearised(
        self, weights: FloatArray
    ) -> Sequence[tuple[Callable[[], FloatArray], FloatArray]]:
        """See :class:`NodalSensor`."""
        return [(self.values, np.broadcast_to(weights, self.values().shape))]


@dataclass(frozen=True)
class ContactSurface:
    """Contact surface: the triangles of the bodies of a family that may touch others.

    Attributes:
        bodies: the bodies.
        nodes: (n,) numbers of nodes in the family; start: (n, 3) their positions at the start, m.
        owner: (n,) number of the body of each node in ``bodies``.
        held: (n, width) fixed unknowns of the nodes.
        triangles: (m, 3) numbers of nodes in the family.
        radius: (m,) distance from the triangle at which it touches, m: half of the thickness, zero
            of surfaces that are closed.
        body: (m,) number of the body of each triangle; element: (m,) its element in the family.
        closed: True if triangles bound solids, False if they have matter on both sides.
    """

    bodies: Sequence[Any]
    nodes: IntArray
    start: FloatArray
    owner: IntArray
    held: BoolArray
    triangles: IntArray
    radius: FloatArray
    body: IntArray
    element: IntArray
    closed: bool = False


@dataclass(frozen=True)
class ContactLine:
    """Polyline on the axis of a body of lines, which may touch others.

    Attributes:
        nodes: (v, k) numbers in the family of the nodes that each of its points is a mean of.
        weights: (v, k) their weights, which add up to one.
        edges: (e, 2) points of its edges.
    """

    nodes: IntArray
    weights: FloatArray
    edges: IntArray


class Family:
    """All bodies of one kind in a model, the same on every rank.

    Nodes are numbered within the family, and bodies as in :attr:`bodies`.

    Attributes:
        kind: number of the family, its row in the nest.
        serial: serial data of the model, an ``NumberedModel``.
        bodies_have_places: True if every node is a point of a body, False if some are amplitudes of
            shapes.
        axes: True if nodes have rotations, on which moments and follower forces of markers act.
        series: class of the series for ParaView, or its name as "module:class", see
            ``flexfem.io.paraview.family_series``; families may share one. None: no pictures.
        follows: True for bodies without elements, which are on the rank of the bodies that they are
            joined to.
        noun: what tables of bodies call one of them.
    """

    noun: ClassVar[str] = "element body"
    follows: ClassVar[bool] = False
    axes: ClassVar[bool] = True
    series: ClassVar[Any] = None
    bodies_have_places: ClassVar[bool] = True

    def __init__(self, serial: Any, kind: int) -> None:
        """Number the nodes of the model's bodies of the kind and place them at the start.

        Raises:
            ValueError: a mistake in the model, in one line.
        """
        self.serial, self.kind = serial, kind

    @classmethod
    def members(cls, model: Model) -> Sequence[Any]:
        """Bodies of a model that belong to the family, in its order."""
        return [body for body in model.other_bodies if _loaded(body.family) is cls]

    # -- Layout: the same on every rank ---------------------------------------------------------

    @property
    def bodies(self) -> Sequence[Any]:
        """Bodies of the model whose numbers are in :attr:`body_of_node`."""
        return self.members(self.serial.model)

    @property
    def own(self) -> Sequence[Any]:
        """Bodies of this family in the order of the model."""
        return self.members(self.serial.model)

    @property
    def frames(self) -> FloatArray:
        """Frames (n, 12) of all nodes at the start, m."""
        raise NotImplementedError

    @property
    def velocities(self) -> FloatArray:
        """Local twists (n, 6) of all nodes at the start, m/s and rad/s."""
        raise NotImplementedError

    @property
    def moving(self) -> bool:
        """True if a node has a velocity at the start."""
        return bool(self.velocities.any())

    @property
    def held(self) -> BoolArray:
        """(n, width) fixed unknowns of all nodes; :meth:`block` keeps them."""
        width = getattr(self.own[0], "width", 6)  # rigid bodies and beams do not say it
        return np.zeros((len(self.frames), width), dtype=np.bool_)

    @property
    def bound(self) -> BoolArray:
        """(n, width) unknowns that are fixed, or that :meth:`ties` keep, for summaries."""
        return self.held

    @property
    def placed(self) -> BoolArray:
        """(n,) True for nodes with a position in space; the others are amplitudes of shapes."""
        return np.ones(len(self.frames), dtype=np.bool_)

    @property
    def body_of_node(self) -> IntArray:
        """(n,) number of the body that each node belongs to."""
        raise NotImplementedError

    @property
    def cluster_of_node(self) -> IntArray:
        """(n,) number of the cluster of each node: bodies that share nodes are one matrix."""
        return self.body_of_node

    def bodies_of(self, nodes: IntArray) -> IntArray:
        """Numbers (k,) of the bodies that some nodes belong to."""
        return self.body_of_node[nodes]

    def clusters_of(self, nodes: IntArray) -> IntArray:
        """Numbers (k,) of the clusters of some nodes."""
        return self.cluster_of_node[nodes]

    def supports(self) -> tuple[IntArray, FloatArray]:
        """Nodes (k,) with supports, and the local twists (k, 6) that these fix."""
        nothing = np.zeros(0, dtype=np.int64)
        return nothing, np.zeros((0, 6))

    @property
    def owner(self) -> str:
        """Name of the first body in messages."""
        return f'{type(self.own[0]).__name__} "{self.own[0].name}"'

    def check_energy_momentum(self, dissipates: bool) -> None:
        """Refuse what has no mean forces over a step, see ``layout.elements.SteppedElements``.

        Args:
            dissipates: True if the integrator ``energy_momentum`` dissipates.

        Raises:
            InputError: naming a body, the same on all ranks; here of all families that have none.
        """
        raise InputError(
            f"{self.owner}: the integrator energy_momentum is for beams of the formulation "
            '"se3", solids, nets of cables and rigid bodies'
        )

    def fingerprint(self) -> Mapping[str, Any]:
        """Further data, by their names, in the hash that assigns a checkpoint to a model."""
        return {}

    def joints(self) -> Sequence[Joint]:
        """Joints that the bodies need beside those of the model."""
        return ()

    def ties(self) -> Sequence[Joint]:
        """Joints that keep nodes which move with other bodies at markers there."""
        return ()

    # -- Facts for summaries and checks ---------------------------------------------------------

    def elements(self, body: Any) -> int:
        """Number of the finite elements of a body."""
        count: int = body.elements
        return count

    def outline(self, body: Any) -> FloatArray:
        """Points (n, 3) at the start about which the box of a body is, m."""
        points: FloatArray = body.points
        return points

    @property
    def spread(self) -> FloatArray:
        """Points (n, 3) about which the box is that of all nodes with a position, m."""
        return self.frames[self.placed, :3]

    def node_counts(self) -> tuple[IntArray, IntArray]:
        """Numbers of the nodes of each body, and of their fixed unknowns."""
        bodies, fixed = self.body_of_node, self.bound.sum(axis=1)
        count = len(self.bodies)
        held = np.bincount(bodies, fixed, minlength=count).astype(np.int64)
        return np.bincount(bodies, minlength=count), held

    def coupled(self) -> int:
        """Number of pairs of nodes, in both orders and with themselves, of one of `patches`."""
        return coupled_nodes(self.patches())

    def inertia(self, body: Any, origin: FloatArray) -> FloatArray:
        """Inertia matrix (6, 6) of an unstrained body at the start, translation first.

        Args:
            body: of this family.
            origin: frame (12,) about whose origin and in whose axes it is.
        """
        return point_inertia(origin, *body.masses)

    def mesh_facts(self, body: Any) -> MeshFacts | None:
        """Sizes and stiffness of the elements of a body, None where checks have no use for them."""
        return None

    def patches(self) -> IntArray:
        """(m, k) nodes that one element each couples in the matrix of a step, -1 for none."""
        return np.arange(len(self.frames))[:, np.newaxis]

    # -- Markers --------------------------------------------------------------------------------

    def node(self, marker: Marker, place: Place | None) -> int:
        """Number of the node that carries a marker, from the marker's place in the model.

        Of a body derived from ``flexfem.Body`` ``place.node`` is the value of its ``node``, a
        number in the body.
        """
        raise NotImplementedError

    def surface_place(self, marker: Marker) -> SurfacePlace | None:
        """Place of a marker on nodes without axes of their own; None where nodes have axes."""
        return None

    def with_axes(self, marker: Marker, place: SurfacePlace) -> SurfacePlace:
        """The same point on nodes that define its axes: three of a triangle, or more with sides.

        Raises:
            ValueError: there are no such nodes.
        """
        raise NotImplementedError

    def line(self, carrier: Carrier) -> Line:
        """Line of a carrier, along which sliders move.

        Raises:
            ValueError: the body has no line.
        """
        raise NotImplementedError

    # -- Distribution over ranks ----------------------------------------------------------------

    def costs(self) -> Mapping[str, tuple[int, int]]:
        """Number of elements of each body by name, and their cost relative to a beam element."""
        raise NotImplementedError

    def links(self) -> Mapping[tuple[str, str], int]:
        """Unknowns that two bodies share, by their names."""
        return {}

    def share(
        self, ranks: Mapping[str, IntArray]
    ) -> tuple[IntArray, Mapping[str, tuple[int, ...]]]:
        """Ranks of all elements of the family, and ranks with nodes of each body.

        Args:
            ranks: rank of each element of every body of the family by name, ascending.
        """
        own = {body.name: ranks[body.name] for body in self.own}
        of_bodies = {name: tuple(dict.fromkeys(found.tolist())) for name, found in own.items()}
        return np.concatenate(list(own.values())), of_bodies

    def block(
        self, comm: MPI.Intracomm, ranks: IntArray
    ) -> tuple[FrameBlock, ElementFamily | None]:
        """Nodes and elements of this rank (collective).

        Args:
            comm: communicator.
            ranks: rank of each element, of :meth:`share`.
        """
        raise NotImplementedError

    # -- Contact --------------------------------------------------------------------------------

    def contact_surface(self) -> ContactSurface | None:
        """Triangles of all bodies of the family, None for bodies without surface."""
        return None

    def contact_chain(self, name: str) -> IntArray | None:
        """Nodes (m, 2) of the two-node elements of a body of lines, None for other bodies."""
        return None

    def contact_line(self, name: str) -> ContactLine | None:
        """Polyline on the axis of a body of lines, None for other bodies."""
        return None

    def surface_numbers(self, body: Any, radius: float) -> tuple[float, float]:
        """Stiffness through the thickness of a body, N/m^3, and its mass per area, kg/m^2.

        The area of a beam is its length times its diameter. An unknown number is infinite.

        Args:
            body: of this family.
            radius: half of its thickness, m.
        """
        return np.inf, np.inf

    def contact_numbers(self, body: Any, contact: Contact) -> tuple[float, float]:
        """Stiffness through the thickness of a body, N/m^3, and its mass per area, kg/m^2.

        Raises:
            ValueError: neither the body nor the contact gives a stiffness.
        """
        raise NotImplementedError

    # -- Forces and measures --------------------------------------------------------------------

    def forces(
        self, block: FrameBlock, elements: ElementFamily | None, node_body: IntArray
    ) -> tuple[list[Force], list[InnerForces]]:
        """Loads at the owned nodes and inside the elements of this rank (collective).

        Those of markers at nodes are not among them.

        Args:
            block: of :meth:`block`.
            elements: of :meth:`block`.
            node_body: (n,) bodies of the block's nodes.
        """
        return [], []

    def masses(self, block: FrameBlock) -> tuple[list[int], list[FloatArray]]:
        """Owned nodes that are bodies, with inertia matrices (6, 6) in the nodes' axes."""
        return [], []

    def deflections(self, part: Any) -> tuple[IntArray, FloatArray]:
        """Numbers (m,) of linear elastic bodies of this rank, and how far each bends, rad.

        That is the largest rotation of an interface in the body's frame, or three times the root
        mean square of the displacements there over the body's size, which is as much for a
        cantilever. Bodies whose equations hold at any displacement are not among them.

        Args:
            part: the family's ``BlockPart``.
        """
        return np.empty(0, dtype=np.int64), np.empty(0)

    def missing(self, part: Any) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
        """Numbers (m,) of reduced bodies of this rank, what they miss, and how far they deform.

        A nonlinear body misses the displacement with which functions beside its coordinates would
        answer to the forces that these leave out of balance. It and the body's own are in the
        energy norm; those of linear bodies are zero. The last is the norm of a strain of one.

        Args:
            part: the family's ``BlockPart``.
        """
        return np.empty(0, dtype=np.int64), np.empty(0), np.empty(0), np.empty(0)

    def sensor(self, probe: AnyProbe, part: Any) -> Sensor | None:
        """Sensor of a probe that the family measures, None for other probes (collective).

        Args:
            probe: of the model.
            part: the family's ``BlockPart``.
        """
        old = getattr(self, "gauge", None)  # families written for version 0.1 lack these
        if old is None:
            return None
        warnings.warn(
            f"{type(self).__name__}.gauge is sensor now", DeprecationWarning, stacklevel=2
        )
        made: Sensor | None = old(probe, part)
        return made


def registry(model: Model) -> list[type[Family]]:
    """Families by kind: those of the package, then those of the model's other bodies.

    Raises:
        ValueError: the family of a body is not a family, in one line.
    """
    others = map(_family_of, model.other_bodies)
    return list(dict.fromkeys([*map(_loaded, BUILT_IN), *others]))


def _family_of(body: Any) -> type[Family]:
    """The class of the family of a body.

    Raises:
        ValueError: it is not a family, or lacks a required method.
    """
    owner = f'{type(body).__name__} "{body.name}"'
    try:
        found = _loaded(body.family)
    except (AttributeError, ImportError, ValueError) as error:
        raise ValueError(f"{owner}: its family cannot be loaded: {error}") from error
    if not (isinstance(found, type) and issubclass(found, Family)):
        raise ValueError(f"{owner}: family must be a class derived from Family, got {found!r}")
    missing = [name for name in _NEEDED if getattr(found, name) is getattr(Family, name)]
    if missing:
        raise ValueError(f"{owner}: its family {found.__name__} must define {', '.join(missing)}")
    return found


def _loaded(family: str | type[Family]) -> type[Family]:
    """The class of a family that is given as "module:class" or as a class."""
    if not isinstance(family, str):
        return family
    module, _, name = family.partition(":")
    found: type[Family] = getattr(import_module(module), name)
    return found
