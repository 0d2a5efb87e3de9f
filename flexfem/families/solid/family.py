# SPDX-License-Identifier: LGPL-3.0-or-later
"""Layout, nodes and elements of nonlinear solids."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, override

from mpi4py import MPI

import numpy as np
import ufl

from flexfem._checks import InputError, returned_number
from flexfem._faults import FAILURES, located
from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.core.load import NOTHING
from flexfem.core.marker import Carrier, Marker, SurfaceMarker
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.core.runs import starts
from flexfem.families.common.block_nodes import PositionFamily
from flexfem.families.solid.body import Solid, SolidMarker
from flexfem.families.solid.cells import Kernels, SolidCells, TimedParameter
from flexfem.families.solid.distribution import distributed_nodes, pieces_of, shared
from flexfem.families.solid.elements import SolidElements
from flexfem.families.solid.forms import CellKind, SolidForms
from flexfem.families.solid.laws.energies import SolidLaw
from flexfem.families.solid.loads import SurfacePressure, SurfaceTraction
from flexfem.families.solid.meshes.figure import WholeFigure
from flexfem.families.solid.meshes.lagrange import lattice
from flexfem.families.solid.node_rows import node_rows
from flexfem.families.solid.pressures import FacetKind, SolidPressures
from flexfem.families.solid.probes import MOTION, SolidProbe
from flexfem.families.solid.sensors import PlaceSensor, SolidSensor
from flexfem.layout.elements import ElementFamily
from flexfem.layout.family import ContactSurface, Sensor
from flexfem.layout.inner_forces import InnerForces
from flexfem.layout.lines import Line
from flexfem.layout.node_loads import Force
from flexfem.layout.surface_places import SurfacePlace, fitted_sides
from flexfem.lie import se3, so3
from flexfem.model.probes.base import AnyProbe

__all__ = ["SolidFamily"]

#: Cost of a cell relative to a beam element, by its number of nodes.
_COST = 2.0

#: Strain with which laws are tried at the start, and a bound of zero relative to its energy.
_STRAIN, _ZERO = 1e-2, 1e-7
#: Bulk modulus relative to the shear modulus below which it is none: a Poisson's ratio of -0.9998.
_VOLUMETRIC = 1e-4
#: A rotation in space that is not in the symmetry group of any likely body.
_TURN = np.array([0.7, -0.4, 1.1])

#: Cells of one law and kind: its form, sizes of its parameters, the kind.
type _Kind = tuple[Any, ...]


class SolidFamily(PositionFamily[Solid]):
    """See :class:`flexfem.layout.family.Family`."""

    name = "solids"
    series = "flexfem.io.paraview.solid_series:SolidSeries"
    noun = "solid"

    @override
    def _place_nodes(self) -> None:
        stored = next((body for body in self._bodies if body.stored), None)
        if stored is None:
            super()._place_nodes()
            return
        made = partial(node_rows, f'Solid "{stored.name}"', int(self.first[-1]))
        self._frames = made(12, partial(self._rows, np.zeros(12), _frames_at))
        self._velocities = made(6, partial(self._rows, np.zeros(6), _twists_at))
        self._held = made(3, partial(self._rows, np.zeros(3, dtype=np.bool_), Solid.held_at))

    def _rows(self, row: Any, at: Callable[[Solid, IntArray], Any], nodes: IntArray) -> Any:
        """Rows (k, w) of nodes, found body after body; ``row`` (w,) is one of zeros."""
        found, of = np.tile(row, (len(nodes), 1)), self.bodies_of(nodes)
        for k in np.unique(of).tolist():
            found[of == k] = at(self._bodies[k], nodes[of == k] - self.first[k])
        return found

    @property
    @override
    def moving(self) -> bool:
        return any(
            body.velocity.any() or body.angular_velocity.any() or body.start_velocities is not None
            for body in self._bodies
        )

    @property
    @override
    def placed(self) -> BoolArray:
        return np.broadcast_to(np.True_, (int(self.first[-1]),))

    @property
    @override
    def spread(self) -> FloatArray:
        return np.concatenate([body.figure.outline for body in self._bodies])

    @override
    def outline(self, body: Solid) -> FloatArray:
        return body.figure.outline

    @override
    def node_counts(self) -> tuple[IntArray, IntArray]:
        return np.diff(self.first), np.array([body.holds for body in self._bodies])

    @override
    def coupled(self) -> int:
        return sum(body.figure.pairs for body in self._bodies)

    @override
    def supports(self) -> tuple[IntArray, FloatArray]:
        rows = [
            3 * first + body.held_rows
            for first, body in zip(self.first[:-1], self._bodies, strict=True)
        ]
        nodes, axis = np.divmod(np.concatenate(rows), 3)
        return nodes, np.eye(6)[axis]

    @override
    def cells_of(self, body: Solid) -> IntArray:
        return body.nodes.cells

    @override
    def surface_place(self, marker: Marker) -> SurfacePlace:
        number = self.number(marker.body)
        first = int(self.first[number])
        if isinstance(marker, SolidMarker):
            nodes = tuple(first + node for node in marker.nodes)
            return SurfacePlace(self.kind, nodes, marker.weights)
        if isinstance(marker, SurfaceMarker):
            raise ValueError(
                f'Marker on "{marker.body}": a Solid takes those of its surface_marker and '
                f"point_marker, got a {type(marker).__name__}"
            )
        return SurfacePlace(self.kind, (first + self._bodies[number].node(marker),), (1.0,))

    @override
    def with_axes(self, marker: Marker, place: SurfacePlace) -> SurfacePlace:
        number = self.number(marker.body)
        figure, first = self._bodies[number].figure, int(self.first[number])
        own, weights = np.array(place.nodes) - first, np.array(place.weights)
        try:
            return replace(place, sides=fitted_sides(figure.places(own), weights))
        except ValueError:  # too few nodes, or on one line: those of the cells around join them
            around = figure.cell_nodes(figure.cells_around(own))
        more = np.setdiff1d(around, own)
        nodes = np.concatenate([own, more])
        sides = fitted_sides(figure.places(nodes), np.ones(len(nodes)))
        weights = np.concatenate([weights, np.zeros(len(more))])
        places = tuple((first + nodes).tolist())
        return SurfacePlace(self.kind, places, tuple(weights.tolist()), sides)

    @override
    def line(self, carrier: Carrier) -> Line:
        raise ValueError(f'Carrier on "{carrier.body}": a Solid has no line')

    @override
    def check_energy_momentum(self, dissipates: bool) -> None:
        for body in self._bodies:
            laws = [law for region, law in body.law.items() if body.figure.overlap(region, region)]
            for what, given in (
                ("plane stress", body.plane == "stress"),
                ("internal variables", any(len(law.initial) for law in laws)),
                ("parameters that change with time", any(map(_timed, laws))),
                (
                    "rho_inf below 1 for a law without positive moduli at rest",
                    dissipates
                    and not (np.array([law.small_strain_moduli() for law in laws]) > 0.0).all(),
                ),
            ):
                if given:
                    raise InputError(
                        f'Solid "{body.name}": the integrator energy_momentum does not support '
                        f"{what}"
                    )

    @override
    def costs(self) -> dict[str, tuple[int, int]]:
        found = {}
        for body in self._bodies:
            cost = int(_COST * len(lattice(body.mesh.cell, body.degree)))
            pieces = pieces_of(body)
            found[body.name] = pieces, cost * -(-body.elements // pieces)
        return found

    @override
    def share(self, ranks: Mapping[str, IntArray]) -> tuple[IntArray, dict[str, tuple[int, ...]]]:
        cells, of_bodies = [], {}
        for body in self._bodies:
            own = np.sort(ranks[body.name])
            of_bodies[body.name] = tuple(np.unique(own).tolist())
            cells.append(own if body.stored else self.in_order(body, own))
        return np.concatenate(cells), of_bodies

    @override
    def block(self, comm: MPI.Intracomm, ranks: IntArray) -> tuple[FrameBlock, ElementFamily]:
        shares = shared(self._bodies, ranks, comm)
        ids, index_map = distributed_nodes(self._bodies, shares, self.first, comm)
        fixed = any(body.holds for body in self._bodies)
        block = FrameBlock(
            self.name, comm, self._frames[ids], self._velocities[ids], ids, index_map,
            inertial=True, width=3, dirichlet=self._held[ids] if fixed else None,
        )  # fmt: skip
        own = [share.cells for share in shares]
        kinds = list(self._kinds().values())
        groups = [self._cells(comm, parts, own, block) for parts in kinds]
        plane = np.array([body.plane is not None for body in self._bodies])
        elements = SolidElements(
            groups, block, plane[self.bodies_of(ids)], int(self.first_cell[-1])
        )
        elements.bulk_over_shear = max(body.bulk_over_shear for body in self._bodies)
        for parts, group in zip(kinds, groups, strict=True):
            name = f'Solid "{self._bodies[parts[0][0]].name}"'
            check_start(comm, name, group, np.ascontiguousarray(block.frames[:, :3]))
        return block, elements

    def _kinds(self) -> dict[_Kind, list[tuple[int, str]]]:
        """Bodies and regions whose cells have the same kernels, in the order of the model."""
        found = dict[_Kind, list[tuple[int, str]]]()
        for k, body in enumerate(self._bodies):
            for region, law in body.law.items():
                sizes = tuple(_sizes(law).items())
                found.setdefault((law.form, sizes, kind_of(body)), []).append((k, region))
        return found

    def _cells(
        self, comm: MPI.Intracomm, parts: Sequence[tuple[int, str]], own: Sequence[IntArray],
        block: FrameBlock,
    ) -> SolidCells:  # fmt: skip
        """The cells of some regions on this rank (collective)."""
        body, region = self._bodies[parts[0][0]], parts[0][1]
        law, kind, sizes = body.law[region], kind_of(body), _sizes(body.law[region])
        try:
            forms = SolidForms(law, kind, sizes)
            if forms.damped and ufl.algorithms.expand_derivatives(forms.resistance).empty():
                raise ValueError("the dissipation does not depend on the rate of F")
            kernels = Kernels.compiled(comm, forms, without=("loss",))
        except ValueError as error:
            raise InputError(f'Solid "{body.name}": {error}') from None
        nodes, places, thickness, density, bodies, numbers = [], [], [], [], [], []
        moduli = list[FloatArray]()
        lumped = list[BoolArray]()
        parameters: dict[str, list[FloatArray]] = {name: [] for name in sizes}
        timed, first = list[TimedParameter](), 0
        for k, name in parts:
            one = self._bodies[k]
            cells = own[k][one.figure.in_region(name, own[k])]
            nodes.append(self.first[k] + one.figure.cell_nodes(cells))
            places.append(_places(one, kind, cells))
            moduli.append(np.tile(one.law[name].small_strain_moduli(), (len(cells), 1)))
            thickness.append(np.full(len(cells), one.thickness if one.plane else 1.0))
            density.append(one.density_of(cells))
            lumped.append(np.full(len(cells), one.mass == "lumped"))
            bodies.append(np.full(len(cells), k))
            numbers.append(self.first_cell[k] + cells)
            for key, size in sizes.items():
                parameters[key].append(values_of(one, name, key, size, cells))
                value = one.law[name].parameters[key]
                if callable(value):
                    rows = slice(first, first + len(cells))
                    owner = f'Solid "{one.name}": parameter "{key}"'
                    timed.append(TimedParameter(owner, key, rows, value))
            first += len(cells)
        found = SolidCells(
            kernels, kind,
            np.ascontiguousarray(block.local_index(np.concatenate(nodes)), dtype=np.int32),
            np.concatenate(places), np.concatenate(thickness),
            {key: np.concatenate(values) for key, values in parameters.items()},
            np.concatenate(bodies), np.concatenate(numbers),
        )  # fmt: skip
        found.timed = timed
        found.rest_moduli = np.concatenate(moduli)
        return found.with_masses(np.concatenate(density), np.concatenate(lumped))

    @override
    def contact_surface(self) -> ContactSurface | None:
        touching = [k for k, body in enumerate(self._bodies) if body.touches]
        if not touching:
            return None
        bodies = [self._bodies[k] for k in touching]
        first_piece = starts([pieces_of(body) for body in self._bodies])
        nodes, triangles, of, elements = [], [], [], []
        for number, k in enumerate(touching):
            own, cells = self._bodies[k].contact_triangles()
            nodes.append(self.first[k] + np.unique(own))
            triangles.append(self.first[k] + own)
            of.append(np.full(len(own), number))
            elements.append(first_piece[k] + cells)
        every, body = np.concatenate(nodes), np.concatenate(of)
        return ContactSurface(
            bodies, every, self._frames[every, :3],
            np.repeat(np.arange(len(bodies)), [len(n) for n in nodes]), self._held[every],
            np.concatenate(triangles), np.zeros(len(body)), body, np.concatenate(elements),
            closed=True,
        )  # fmt: skip

    @override
    def surface_numbers(self, body: Solid, radius: float) -> tuple[float, float]:
        area = body.figure.area_weights(f'Solid "{body.name}"', body.touching or "")[1].sum()
        return np.inf, float(body.masses[1].sum() / area)

    @override
    def forces(
        self, block: FrameBlock, elements: ElementFamily | None, node_body: IntArray
    ) -> tuple[list[Force], list[InnerForces]]:
        assert isinstance(elements, SolidElements)
        forces: list[Force] = []
        facets = dict[FacetKind, list[tuple[IntArray, int, float, int]]]()
        for number, load in enumerate(self.serial.model.loads):
            if not isinstance(load, (SurfacePressure, SurfaceTraction)):
                continue
            k = self.number(load.solid)
            if isinstance(load, SurfaceTraction):
                forces += self._traction(k, load, number, block)
                continue
            body = self._bodies[k]
            shape, nodes = body.figure.facets_of(f'SurfacePressure "{load.name}"', load.surface)
            kind = FacetKind(shape, body.degree, body.plane == "axisymmetric")
            width = body.thickness
            mine = self._own_facets(k, load.surface, elements)
            own = self.first[k] + nodes[mine], k, width * load.pressure, number
            facets.setdefault(kind, []).append(own)
        return forces, [self._pressures(block, kind, own) for kind, own in facets.items()]

    def _own_facets(self, k: int, surface: str, elements: SolidElements) -> BoolArray:
        """(f,) True for facets of a surface whose cell is on this rank."""
        body = self._bodies[k]
        cells = body.figure.facet_cells(surface)
        own = np.concatenate([np.empty(0, np.int64), *(g.number for g in elements.groups)])
        return np.isin(self.first_cell[k] + cells, own)

    def _pressures(
        self, block: FrameBlock, kind: FacetKind,
        facets: Sequence[tuple[IntArray, int, float, int]],
    ) -> SolidPressures:  # fmt: skip
        """Pressures on facets of a kind (collective)."""
        counts = [len(nodes) for nodes, *_ in facets]
        body, pressure, load = (np.repeat([f[i] for f in facets], counts) for i in (1, 2, 3))
        nodes = block.local_index(np.concatenate([nodes for nodes, *_ in facets]))
        return SolidPressures(block.comm, kind, nodes, body, pressure.astype(np.float64), load)

    def _traction(
        self, k: int, load: SurfaceTraction, number: int, block: FrameBlock
    ) -> Iterator[Force]:
        """Dead forces at the nodes of a surface that this rank owns."""
        owner = f'SurfaceTraction "{load.name}"'
        nodes, areas = self._bodies[k].figure.area_weights(owner, load.surface)
        local = block.owned_index(self.first[k] + nodes)
        still = se3.frame(np.zeros(3), np.eye(3))
        for at in np.flatnonzero(local >= 0):
            force = float(areas[at]) * load.traction
            yield Force(int(local[at]), still, force, NOTHING, False, number)

    @override
    def sensor(self, probe: AnyProbe, part: Any) -> Sensor | None:
        if not isinstance(probe, SolidProbe):
            return None
        number = self.number(probe.solid)
        if set(probe.measures) <= set(MOTION):
            return PlaceSensor(part, self._bodies[number], int(self.first[number]), probe)
        return SolidSensor(part, self._bodies, int(self.first_cell[number]), probe)


def kind_of(body: Solid) -> CellKind:
    """Kind of the cells of a body."""
    mesh = body.mesh
    simplex = mesh.cell in ("triangle", "tetrahedron")
    geometry = 0 if body.figure.straight else mesh.degree
    order = body.quadrature
    if order is None:
        order = 2 * body.degree - (2 if simplex and mesh.degree == 1 else 0)
        order += body.plane == "axisymmetric"
    lowered = body.lowered if body.formulation == "dilatation" else -1
    return CellKind(mesh.cell, body.degree, geometry, body.plane, lowered, order)


def _frames_at(body: Solid, nodes: IntArray) -> FloatArray:
    """Frames (k, 12) of nodes at the start."""
    return se3.frame(body.figure.places(nodes), np.tile(np.eye(3), (len(nodes), 1, 1)))


def _twists_at(body: Solid, nodes: IntArray) -> FloatArray:
    """Twists (k, 6) of nodes at the start."""
    found = np.zeros((len(nodes), 6))
    found[:, :3] = body.velocities_at(nodes)
    return found


def _places(body: Solid, kind: CellKind, cells: IntArray) -> FloatArray:
    """Nodes (m, g, 3) of the geometry of some cells, m."""
    width = len(lattice(kind.cell, max(kind.geometry, 1)))
    return body.figure.cell_places(cells)[:, :width]


def _sizes(law: SolidLaw) -> dict[str, int]:
    """Number of components of each parameter of a law."""
    sizes = {}
    for name, value in law.parameters.items():
        sizes[name] = 3 if not callable(value) and np.ndim(value) == 2 else 1
    return sizes


def _timed(law: SolidLaw) -> bool:
    """True if parameters change with time."""
    return any(callable(value) for value in law.parameters.values())


def values_of(body: Solid, region: str, name: str, size: int, cells: IntArray) -> FloatArray:
    """Values (m, 1) or (m, 3) of a parameter in some cells of a region at the start.

    Raises:
        InputError: as many as there are cells are needed, or a function of time fails.
    """
    value, figure = body.law[region].parameters[name], body.figure
    owner = f'Solid "{body.name}": parameter "{name}"'
    if callable(value):
        function = value
        try:
            value = returned_number(name, function(0.0))
        except FAILURES as error:
            raise InputError(f"{owner}: {located(function, error)}") from error
        if not np.isfinite(value):
            raise InputError(f"{owner} must be a finite number at t = 0 s, got {value}")
    given = np.asarray(value, dtype=np.float64)
    if given.ndim == 0 or (size == 3 and len(given) == 1):
        return np.tile(given.reshape(1, size), (len(cells), 1))
    count = figure.overlap(region, region)
    if len(given) != count:
        raise InputError(f"{owner} has {len(given)} values for {count} cells")
    assert isinstance(figure, WholeFigure)  # stored meshes have one value for all cells
    return given.reshape(count, size)[np.searchsorted(figure.cells_of(region), cells)]


def check_start(comm: MPI.Intracomm, owner: str, group: SolidCells, points: FloatArray) -> None:
    """Refuse energies that are not finite at the start, change as bodies rotate, or do not resist.

    Args:
        comm: communicator (collective).
        owner: of the law, for messages.
        group: its cells.
        points: (n, 3) positions of the nodes at the start, m.

    Raises:
        InputError: on all ranks.
    """
    in_plane = [0.0, 0.0, 1.0]
    about = {None: 1.0, "strain": in_plane, "stress": in_plane, "axisymmetric": 0.0}
    turn = _TURN * about[group.kind.plane]
    shear, swell = np.zeros((3, 3)), np.eye(3)
    # radii of axisymmetric bodies must stay positive, however far from the origin they are along y
    shear[(1, 0) if group.kind.plane == "axisymmetric" else (0, 1)] = 1.0
    swell[2, 2] = float(group.kind.plane is None)
    motions = [
        np.eye(3), so3.exp(turn),
        *(np.eye(3) + sign * _STRAIN * way for way in (shear, swell) for sign in (1.0, -1.0)),
    ]  # fmt: skip
    with np.errstate(all="ignore"):
        energies = [group.energy_at(points @ motion.T) for motion in motions]
        finite = np.isfinite(energies).all() and np.isfinite(group.force_at(points)).all()
    values = np.where(np.isfinite(energies), energies, 0.0)
    comm.Allreduce(MPI.IN_PLACE, values)
    if not comm.allreduce(bool(finite), op=MPI.LAND):
        raise InputError(f"{owner}: the energy or a derivative of it is not finite at the start")
    rest, rotated, *strained = values.tolist()
    for name, pair in (("shear", strained[:2]), ("change of volume", strained[2:])):
        resisted = 0.5 * sum(pair) - rest
        if not resisted > _ZERO * abs(rest):
            raise InputError(
                f"{owner}: the law has no stiffness: a {name} of {_STRAIN:g} changes its energy by "
                f"{resisted:.4g} J"
            )
    _check_moduli(comm, owner, group)
    least = min(0.5 * sum(strained[:2]), 0.5 * sum(strained[2:])) - rest
    if abs(rotated - rest) > _ZERO * max(least, abs(rest)):
        raise InputError(
            f"{owner}: the energy changes by {rotated - rest:.4g} J as the body rotates, where it "
            f"must stay; a strain of {_STRAIN:g} changes it by {least:.4g} J"
        )


def _check_moduli(comm: MPI.Intracomm, owner: str, group: SolidCells) -> None:
    """Refuse moduli of volume that are other numbers, which no strain in a plane may show.

    Raises:
        InputError: on all ranks.
    """
    found = (group.rest_moduli > 0.0).all(axis=1)  # NaN where a law does not say them
    weakest = np.inf, 0.0, 0.0
    if found.any():
        moduli = group.rest_moduli[found]
        shear, bulk = moduli[np.argmin(moduli[:, 1] / moduli[:, 0])].tolist()
        weakest = bulk / shear, bulk, shear
    ratio, bulk, shear = min(comm.allgather(weakest))
    if ratio < _VOLUMETRIC:
        raise InputError(
            f"{owner}: the law has no stiffness against changes of volume: its bulk modulus is "
            f"{bulk:.4g} Pa, its shear modulus {shear:.4g} Pa; for a Poisson's ratio there is "
            "NeoHookean.from_young"
        )
