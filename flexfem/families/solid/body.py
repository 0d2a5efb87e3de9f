# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nonlinear solids in the model."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._faults import FAILURES, located
from flexfem._fields import ZERO, Array, checked, choice, declared, number, settled, vector
from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.core.load import Load
from flexfem.core.marker import Marker, SurfaceMarker
from flexfem.core.pose import Pose
from flexfem.families.solid.laws.energies import SolidLaw
from flexfem.families.solid.loads import SurfacePressure, SurfaceTraction
from flexfem.families.solid.meshes.figure import Figure, WholeFigure
from flexfem.families.solid.meshes.lagrange import Lagrange
from flexfem.families.solid.meshes.mesh import SolidMesh
from flexfem.families.solid.meshes.stored import StoredSolidMesh
from flexfem.families.solid.node_rows import node_rows
from flexfem.mesh.body_mesh import BodyMesh
from flexfem.model.bodies.base import Body

__all__ = ["Solid", "SolidMarker"]

#: Formulations, and degree of the dilatation below that of the positions.
FORMULATIONS = ("displacement", "dilatation")
#: States of plane figures.
PLANES = ("strain", "stress", "axisymmetric")
#: Mass matrices.
MASSES = ("consistent", "lumped")
#: Weight of a node that has none at a point, and difference of a sum of weights from one.
_NONE, _ONE = 1e-9, 1e-9
#: Names of what forms of cells have beside the parameters of a law.
TAKEN = frozenset({
    "asked", "position", "velocity", "step", "rate", "inverse", "size", "place", "dilatation",
    "multiplier", "dilatation_step", "multiplier_step", "history", "history_step", "span", "excess",
    "stretch", "stretch_step",
})  # fmt: skip


class SolidMarker(SurfaceMarker):
    """Point inside a solid, or mean place of a surface of it, for joints.

    Joints that need axes take those of the affine motion that fits the nodes best: a surface may
    deform, and its rotation is the mean one.

    Attributes:
        nodes: Nodes of the solid.
        weights: Their parts in the position, which add up to one.
    """

    def __init__(self, body: str, nodes: npt.ArrayLike, weights: npt.ArrayLike) -> None:
        """Create the marker; :meth:`Solid.surface_marker` and :meth:`Solid.point_marker` do.

        Raises:
            TypeError: Nodes or weights are no numbers.
            ValueError: A node twice, not as many weights as nodes, or weights that do not add up.
        """
        Marker.__init__(self, body)
        owner = f'SolidMarker on "{body}"'
        own = _checks.indices(owner, "nodes", nodes, np.iinfo(np.int64).max, 1).tolist()
        parts = _checks.array(owner, "weights", weights, (-1,)).tolist()
        if not own or len(set(own)) < len(own) or len(own) != len(parts):
            raise ValueError(
                f"{owner}: needs different nodes with a weight each, got {_checks.show(own)} and "
                f"{_checks.show(parts)}"
            )
        if abs(sum(parts) - 1.0) > _ONE:
            raise ValueError(f"{owner}: weights must add up to one, got {_checks.show(parts)}")
        _checks.assign(self, nodes=tuple(own), weights=tuple(parts))

    def __str__(self) -> str:
        """Return body and number of nodes, for tables and messages."""
        return f"{self.body}:{len(self.nodes)} nodes"


def _degree(owner: str, what: str, value: Any) -> int:
    if type(value) is not int or not 1 <= value <= 3:
        raise ValueError(f"{owner}: {what} must be 1, 2 or 3, got {_checks.show(value)}")
    return value


def _quadrature(owner: str, what: str, value: Any) -> int:
    return _checks.count(owner, what, value, 0)


@declared
class Solid(Body):
    """Body of solid finite elements with large strains, or a plane or axisymmetric one.

    The unknowns are the positions of the nodes, which have no axes. Each cell's energy is that of
    its law; see ``flexfem.laws``, :class:`flexfem.laws.Hyperelastic` for one of a user's own.

    Attributes:
        name: Unique name in the model.
        law: The material, or one for each region of the mesh by its name.
        mesh: :class:`SolidMesh`, :class:`StoredSolidMesh`, of which each rank reads its part,
            :class:`BodyMesh` or a DOLFINx mesh.
        density: At the start, kg/m^3, or one for each region by its name.
        degree: Degree of the positions, 1 to 3; linear tetrahedra and triangles lock.
        formulation: "displacement", or "dilatation" for nearly incompressible materials: the change
            of volume is one degree lower (two on triangles and tetrahedra), and does not lock.
        plane: "strain", "stress" or "axisymmetric" of meshes of plane cells (about the y axis),
            None of solids.
        thickness: Of bodies in plane strain or stress at the start, m.
        mass: "consistent", or "lumped": diagonal of the consistent matrix of each cell, scaled to
            its mass (Hinton, Rock, Zienkiewicz 1976), which is positive at all nodes.
        quadrature: Degree of polynomials that are integrated exactly. None: with 4 points in
            quadratic tetrahedra, (p + 1)^3 in hexahedra.
        fixed: Directions in which nodes are fixed, some of "xyz", by the name of a surface or of a
            set of nodes.
        touching: Name of the surface that touches in contacts, "boundary" for all of it; None for
            bodies without contact.
        velocity: Initial velocity of the point of the (extended) body at the inertial origin,
            inertial axes, shape (3,), m/s.
        angular_velocity: Initial angular velocity, inertial axes, shape (3,), rad/s; a point at x
            starts with `velocity + angular_velocity x x`.
        start_velocities: Further initial velocities, a function of places (n, 3), m, that returns
            (n, 3), m/s; None without.

    Raises:
        TypeError: An argument has the wrong type.
        ValueError: A value out of range, or a region, surface or set that the mesh does not have.
    """

    penalty = False
    continuum = True
    family = "flexfem.families.solid.family:SolidFamily"

    name: str
    law: Any = settled(default=None)
    mesh: Any = settled(default=None)
    _: KW_ONLY
    density: Any = settled(default=None)
    degree: int = checked(_degree, default=2)
    formulation: str = choice(FORMULATIONS, default="displacement")
    plane: str | None = choice(PLANES, default=None)
    thickness: float = number(default=1.0, positive=True)
    mass: str = choice(MASSES, default="consistent")
    quadrature: int | None = checked(_quadrature, default=None)
    fixed: Mapping[str, str] = settled(default=MappingProxyType({}))
    touching: str | None = None
    velocity: Array = vector(default=ZERO)
    angular_velocity: Array = vector(default=ZERO)
    start_velocities: Callable[[FloatArray], npt.ArrayLike] | None = None

    def __post_init__(self) -> None:
        """Check what depends on the mesh."""
        owner = _checks.named(self, self.name)
        _checks.assign(self, mesh=_mesh(owner, self.mesh))
        mesh = self.mesh
        if (self.plane is None) != (mesh.dimension == 3):
            what = "plane cells: give plane" if self.plane is None else "solid cells: no plane"
            raise ValueError(f"{owner}: its mesh has {what}, got {_checks.show(self.plane)}")
        if self.plane == "axisymmetric" and (mesh.points[:, 0] < 0.0).any():
            at = int(np.argmin(mesh.points[:, 0]))
            raise ValueError(
                f"{owner}: node {at} of an axisymmetric body is at x = {mesh.points[at, 0]:g}, "
                "on the other side of the axis"
            )
        if self.stored:
            self._check_stored(owner)
        if self.degree < mesh.degree:
            raise ValueError(
                f"{owner}: degree {self.degree} is less than that of the mesh's geometry, "
                f"{mesh.degree}"
            )
        if self.formulation == "dilatation" and self.lowered < 0:
            raise ValueError(f'{owner}: formulation "dilatation" needs degree 2 at least')
        if self.formulation == "dilatation" and self.plane == "stress":
            raise ValueError(f'{owner}: plane "stress" does not lock: no formulation "dilatation"')
        if self.plane not in ("strain", "stress") and self.thickness != 1.0:
            raise ValueError(
                f"{owner}: thickness belongs to bodies in plane strain or stress, got "
                f"{self.thickness:g}"
            )
        if mesh.cell == "prism" and self.degree > 2:
            raise ValueError(f"{owner}: wedges have degree 1 or 2, got {self.degree}")
        if self.quadrature is not None and self.quadrature < 2 * (self.degree - 1):
            raise ValueError(
                f"{owner}: quadrature must be at least {2 * (self.degree - 1)} of cells of degree "
                f"{self.degree}, got {self.quadrature}"
            )
        laws = self._by_region(owner, "law", self.law, _law)
        densities = self._by_region(owner, "density", self.density, _density)
        _checks.instance(owner, "fixed", self.fixed, Mapping)
        _checks.assign(self, law=laws, density=densities, fixed=MappingProxyType(dict(self.fixed)))
        for place, axes in self.fixed.items():
            self.figure.nodes_of(f"{owner}: fixed", place)
            if not isinstance(axes, str) or not axes or not set(axes) <= set("xyz"):
                raise ValueError(
                    f'{owner}: fixed["{place}"] must be some of "xyz", got {_checks.show(axes)}'
                )
        if self.touching is not None:
            _checks.text(owner, "touching", self.touching)
            mesh.surface(f"{owner}: touching", self.touching)
            if self.plane is not None:
                raise ValueError(
                    f"{owner}: plane bodies do not touch, got touching="
                    f"{_checks.show(self.touching)}"
                )
        if self.start_velocities is not None:
            self._checked_velocities(owner)

    def _check_stored(self, owner: str) -> None:
        """Refuse what needs the whole mesh, or another degree than the stored one."""
        if self.degree != self.mesh.order:
            raise ValueError(
                f"{owner}: its mesh is stored for cells of degree {self.mesh.order}, got degree "
                f"{self.degree}"
            )
        laws = self.law.values() if isinstance(self.law, Mapping) else [self.law]
        of_cells = [
            name for law in laws for name, value in getattr(law, "parameters", {}).items()
            if not callable(value) and np.ndim(value) > 0 and len(value) > 1
        ]  # fmt: skip
        for what, given in (
            ("contact (touching)", self.touching is not None),
            ("start_velocities", self.start_velocities is not None),
            (f'the parameter "{"".join(of_cells[:1])}" of each cell', bool(of_cells)),
        ):
            if given:
                raise ValueError(
                    f"{owner}: {what} needs the whole mesh, not a stored one, of which each rank "
                    "reads its part; give the SolidMesh"
                )

    def _by_region(
        self, owner: str, what: str, value: Any, check: Callable[[str, str, Any], None]
    ) -> Mapping[str, Any]:
        """One value for each region, "" for the only one."""
        if isinstance(value, Mapping) and set(value) == {""}:  # of a copy
            value = self._as_given(value)
        if not isinstance(value, Mapping):
            check(owner, what, value)
            return MappingProxyType({"": value})
        for name, one in value.items():
            if name not in self.mesh.region_names:
                known = ", ".join(self.mesh.region_names) or "none"
                raise ValueError(
                    f"{owner}: {what}: the mesh has no region {_checks.show(name)}; there are "
                    f"{known}"
                )
            check(owner, f'{what}["{name}"]', one)
        if fault := self.mesh.region_fault(value):
            raise ValueError(
                f"{owner}: {what}: {fault} region of {_checks.show(sorted(value), 200)}"
            )
        return MappingProxyType(dict(value))

    def _checked_velocities(self, owner: str) -> FloatArray:
        """Further initial velocities of the nodes (n, 3), m/s."""
        assert self.start_velocities is not None
        if not callable(self.start_velocities):
            raise TypeError(
                f"{owner}: start_velocities must be a function of places, got "
                f"{_checks.show(self.start_velocities)}"
            )
        try:
            given = self.start_velocities(self.points)
        except FAILURES as error:
            raise ValueError(f"{owner}: {located(self.start_velocities, error)}") from error
        return _checks.array(owner, "start_velocities(x)", given, (len(self.points), 3))

    @property
    def lowered(self) -> int:
        """Degree of the dilatation, -1 without."""
        return self.degree - (2 if self.mesh.cell in ("triangle", "tetrahedron") else 1)

    @cached_property
    def figure(self) -> Figure:
        """The cells with their nodes."""
        if isinstance(self.mesh, StoredSolidMesh):
            return self.mesh.figure(self.degree)
        return WholeFigure(self.mesh, self.degree, self.plane, self.thickness)

    @property
    def stored(self) -> bool:
        """True if each rank reads its part of the mesh."""
        return isinstance(self.mesh, StoredSolidMesh)

    @property
    def nodes(self) -> Lagrange:
        """Numbering of the nodes, not of a stored mesh."""
        figure = self.figure
        if isinstance(figure, WholeFigure):
            return figure.nodes
        found: Lagrange = self.mesh.nodes  # which refuses it
        return found

    @property
    def points(self) -> FloatArray:
        """See :attr:`Body.points`: rows that are read when they are asked for, of a stored mesh."""
        figure = self.figure
        if isinstance(figure, WholeFigure):
            return figure.nodes.points
        found: FloatArray = node_rows(self.mesh.owner, figure.count, 3, figure.places)
        return found

    @property
    def elements(self) -> int:
        """See :attr:`Body.elements`."""
        count: int = self.mesh.elements
        return count

    @property
    def touches(self) -> bool:  # type: ignore[override]
        """True if a surface is named that touches."""
        return self.touching is not None

    @property
    def holds(self) -> int:
        """See :attr:`Body.holds`."""
        return len(self.held_rows)

    @property
    def details(self) -> str:
        """See :attr:`Body.details`."""
        laws = ", ".join(dict.fromkeys(type(law).__name__ for law in self.law.values()))
        plural = {
            "tetrahedron": "tetrahedra", "hexahedron": "hexahedra", "prism": "wedges",
            "triangle": "triangles", "quadrilateral": "quadrilaterals",
        }[self.mesh.cell]  # fmt: skip
        return f"{self.elements} {plural} of degree {self.degree}, {laws}"

    @cached_property
    def materials(self) -> list[tuple[float, float, float]]:
        """See :attr:`Body.materials`."""
        found = []
        for region, law in self.law.items():
            own = self.figure.overlap(region, region)
            shares = {name: self.figure.overlap(region, name) / own for name in self.density}
            density = float(sum(self.density[name] * share for name, share in shares.items()))
            shear, bulk = law.small_strain_moduli()
            modulus = 9.0 * bulk * shear / (3.0 * bulk + shear)
            found.append((modulus, density, ((bulk + 4.0 / 3.0 * shear) / density) ** 0.5))
        return found

    @cached_property
    def bulk_over_shear(self) -> float:  # type: ignore[override]
        """See :class:`Body`; laws without positive moduli at rest do not count."""
        moduli = [law.small_strain_moduli() for law in self.law.values()]
        return max((bulk / shear for shear, bulk in moduli if shear > 0.0 < bulk), default=0.0)

    @cached_property
    def masses(self) -> tuple[FloatArray, FloatArray]:
        """Points (q, 3) in the body at the start, m, and masses (q,), kg, with its inertia."""
        return self.figure.masses(self.density)

    def density_of(self, cells: IntArray) -> FloatArray:
        """(m,) density of cells, ascending, kg/m^3."""
        found = np.empty(len(cells))
        for region, value in self.density.items():
            found[self.figure.in_region(region, cells)] = value
        return found

    @cached_property
    def held_rows(self) -> IntArray:
        """Fixed coordinates (k,), ascending: 3 times the node plus the axis; z of plane figures."""
        nodes = np.arange(self.figure.count if self.plane is not None else 0)
        found = [3 * nodes + 2]
        for name, axes in self.fixed.items():
            nodes = self.figure.nodes_of(f'Solid "{self.name}"', name)
            found += [3 * nodes + "xyz".index(axis) for axis in axes]
        return np.unique(np.concatenate(found))

    def held_at(self, nodes: IntArray) -> BoolArray:
        """(k, 3) directions in which nodes (k,) are fixed."""
        return np.isin(3 * nodes[:, np.newaxis] + np.arange(3), self.held_rows)

    @property
    def held(self) -> BoolArray:
        """(n, 3) the same of all nodes."""
        held = np.zeros((self.figure.count, 3), dtype=np.bool_)
        held.reshape(-1)[self.held_rows] = True
        return held

    @property
    def node_velocities(self) -> FloatArray:
        """(n, 3) inertial velocities of the nodes at the start, m/s."""
        speed = self._rigid_velocities(self.points)
        if self.start_velocities is not None:
            speed = speed + self._checked_velocities(f'Solid "{self.name}"')
        return np.where(self.held, 0.0, speed)

    def velocities_at(self, nodes: IntArray) -> FloatArray:
        """(k, 3) the same of some nodes."""
        if self.start_velocities is not None:  # a function of all places
            return self.node_velocities[nodes]
        speed = self._rigid_velocities(self.figure.places(nodes))
        return np.where(self.held_at(nodes), 0.0, speed)

    def _rigid_velocities(self, places: FloatArray) -> FloatArray:
        speed: FloatArray = self.velocity + np.cross(self.angular_velocity, places)
        return speed

    def node(self, marker: Marker) -> int:
        """Return the node of a marker: that of a set of one, or the one nearest to a position.

        Raises:
            ValueError: It names no single node and is near none, or has an offset.
        """
        owner, point = f'Marker on "{self.name}"', marker.point
        if marker.offset.any():
            raise ValueError(f"{owner}: a node has no axes for offsets, got {marker.offset}")
        if isinstance(point, str):
            nodes = self.figure.nodes_of(owner, point)
            if len(nodes) > 1:
                raise ValueError(
                    f'{owner}: "{point}" has {len(nodes)} nodes; its mean place, for joints, is '
                    f'Solid.surface_marker("{point}")'
                )
            return int(nodes[0])
        if not isinstance(point, tuple):
            raise ValueError(
                f"{owner}: point must name a set of one node or be a position (x, y, z), got "
                f"{_checks.show(point)}"
            )
        figure = self.figure
        node = figure.nearest(np.array(point))
        place, beside = figure.places(np.array(node)), figure.cells_around(np.array([node]))
        gap = float(np.linalg.norm(place - np.array(point)))
        around = figure.places(figure.cell_nodes(beside))
        reach = float(np.linalg.norm(around - place, axis=2).max())
        if gap > reach:
            raise ValueError(
                f"{owner}: the nearest node to {_checks.show(list(point))} is {gap:.4g} m "
                f"away, more than its own neighbours are, {reach:.4g} m"
            )
        return node

    def check_load(self, owner: str, load: Load) -> None:
        """See :meth:`Body.check_load`: loads on surfaces."""
        if not isinstance(load, (SurfacePressure, SurfaceTraction)):
            super().check_load(owner, load)
            return
        if isinstance(load, SurfacePressure) and self.plane == "stress":
            raise ValueError(
                f'{owner}: the edges of Solid "{self.name}" in plane stress become thinner or '
                "thicker, which a pressure on them does not see; a SurfaceTraction acts on the "
                "area at the start"
            )
        self.figure.facets_of(owner, load.surface)

    def contact_triangles(self) -> tuple[IntArray, IntArray]:
        """Flat triangles (t, 3) between nodes of the surface that touches, and their cells (t,)."""
        figure = self.figure
        assert isinstance(figure, WholeFigure)  # of a stored mesh nothing touches
        return figure.triangles(f'Solid "{self.name}": touching', self.touching or "")

    def surface_marker(self, surface: str) -> SolidMarker:
        """Return the mean place of a surface, weighted by area, or of a set of nodes.

        Raises:
            ValueError: There is neither.
        """
        owner = f'Marker on "{self.name}"'
        if self.figure.has_surface(surface):
            nodes, weights = self.figure.area_weights(owner, surface)
        else:
            nodes = self.figure.nodes_of(owner, surface)
            weights = np.ones(len(nodes))
        used = np.abs(weights) > _NONE * np.abs(weights).max()  # not corners of quadratic triangles
        return SolidMarker(self.name, nodes[used], weights[used] / weights[used].sum())

    def node_markers(self, surface: str) -> list[SolidMarker]:
        """Return markers of all nodes of a surface or set, for :class:`RigidPoints`.

        Nodes that are fixed in all directions are left out.

        Raises:
            ValueError: There is neither.
        """
        nodes = self.figure.nodes_of(f'Marker on "{self.name}"', surface)
        free = nodes[~self.held_at(nodes).all(axis=1)]
        return [SolidMarker(self.name, [node], [1.0]) for node in free.tolist()]

    def point_marker(self, position: npt.ArrayLike) -> SolidMarker:
        """Return a point inside the solid, anywhere between its nodes.

        Args:
            position: At the start, inertial axes, shape (3,), metres.

        Raises:
            ValueError: It is outside of all cells.
        """
        owner = f'Marker on "{self.name}"'
        cell, weights = self.figure.located(owner, _checks.vector(owner, "position", position))
        used = np.abs(weights) > _NONE
        kept = weights[used] / weights[used].sum()
        nodes = self.figure.cell_nodes(np.array([cell]))[0]
        return SolidMarker(self.name, nodes[used], kept)

    def moved(self, motion: Pose) -> Solid:
        """Return the body moved rigidly with its initial velocities.

        Raises:
            ValueError: Nodes are fixed along axes that would not be inertial, or it is plane.
        """
        turn = motion.rotation
        if (self.fixed or self.plane) and not np.array_equal(turn, np.eye(3)):
            raise ValueError(f'Solid "{self.name}": fixed nodes cannot be rotated')
        if self.plane is not None and motion.position[2] != 0.0:
            raise ValueError(f'Solid "{self.name}": a plane body stays at z = 0')
        spin, further = turn @ self.angular_velocity, self.start_velocities
        return Solid(
            self.name, self._as_given(self.law), self.mesh.moved(motion.apply(self.mesh.points)),
            density=self._as_given(self.density), degree=self.degree,
            formulation=self.formulation, plane=self.plane, thickness=self.thickness,
            mass=self.mass, quadrature=self.quadrature, fixed=self.fixed, touching=self.touching,
            velocity=turn @ self.velocity - np.cross(spin, motion.position),
            angular_velocity=spin,
            start_velocities=None if further is None else (
                lambda x: np.asarray(further((x - motion.position) @ turn)) @ turn.T
            ),
        )  # fmt: skip

    @staticmethod
    def _as_given(values: Mapping[str, Any]) -> Any:
        return values.get("", values)


def _law(owner: str, what: str, value: Any) -> None:
    """Refuse what is no law, or has a parameter of a name that forms use."""
    _checks.instance(owner, what, value, SolidLaw)
    for name in value.parameters:
        if name in TAKEN or name.startswith("_"):
            raise ValueError(f'{owner}: {what}: a parameter must have another name than "{name}"')


def _density(owner: str, what: str, value: Any) -> None:
    _checks.number(owner, what, value, positive=True)


def _mesh(owner: str, mesh: Any) -> SolidMesh | StoredSolidMesh:
    """The mesh as one of arrays (collective for distributed ones)."""
    if isinstance(mesh, (SolidMesh, StoredSolidMesh)):
        return mesh
    if isinstance(mesh, BodyMesh):
        return SolidMesh.from_dolfinx(mesh.mesh, mesh.cell_tags, mesh.facet_tags, mesh.groups)
    if type(mesh).__module__.startswith("dolfinx"):
        return SolidMesh.from_dolfinx(mesh)
    raise TypeError(
        f"{owner}: mesh must be a SolidMesh, a StoredSolidMesh, a BodyMesh or a mesh of DOLFINx, "
        f"got {_checks.show(mesh)}"
    )
