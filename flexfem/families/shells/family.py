# SPDX-License-Identifier: LGPL-3.0-or-later
"""Shells on the model's surface mesh, rotation-free or with directors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import combinations
from typing import TYPE_CHECKING, Any, override

from mpi4py import MPI

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.core.marker import Marker, SurfaceMarker
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.families.common.shell_surface import ShellSurface
from flexfem.families.shell_director.elements import DirectorShells
from flexfem.families.shell_director.surface import director_cells, shell_surface
from flexfem.families.shell_rotation_free.cells import shell_cells, shell_laws
from flexfem.families.shell_rotation_free.elements import RotationFreeShells
from flexfem.families.shells.couples import shell_couples
from flexfem.families.shells.facts import shell_facts, shell_inertia, shell_patches
from flexfem.families.shells.loads import pressures, shell_forces
from flexfem.families.shells.sensors import ShellEnergySensor, ShellStrainSensor
from flexfem.families.shells.strain_kernels import StrainKernels
from flexfem.families.shells.ufl_triangles import UFLDirectorTriangles, UFLRotationFreeTriangles
from flexfem.forms.strain_forms import director_strains, rotation_free_strains
from flexfem.layout.elements import ElementFamily
from flexfem.layout.family import ContactSurface, Family, Sensor
from flexfem.layout.inner_forces import InnerForces
from flexfem.layout.line_loads import by_kind
from flexfem.layout.mesh_facts import MeshFacts
from flexfem.layout.node_loads import Force
from flexfem.layout.numbered_model import NumberedModel
from flexfem.layout.surface_places import SurfacePlace
from flexfem.lie import se3
from flexfem.mesh.distributed.nodes import distributed
from flexfem.mesh.distributed.partition import strips
from flexfem.mesh.distributed.shell_mesh import create_shell_mesh
from flexfem.mesh.shells.patches import EdgeRule
from flexfem.mesh.surface_mesh import SurfaceMesh
from flexfem.mesh.triangles.topology import side_nodes
from flexfem.model.bodies.shell import Shell
from flexfem.model.contact import Contact
from flexfem.model.model import Model
from flexfem.model.probes.base import AnyProbe
from flexfem.model.probes.measured import ShellEnergyProbe, ShellStrainProbe
from flexfem.model.structure.place import Place

if TYPE_CHECKING:
    from flexfem.system.system import BlockPart

__all__ = ["ShellFamily"]

#: Cost of a third of a triangle relative to a beam element, measured on chains and sheets.
_TRIANGLE = 3
#: Corners of the four flat triangles between the nodes of a curved one.
_QUARTERS = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2], [3, 4, 5]])
#: Rows that one common node of two shells counts: on two ranks both have one matrix.
_SEAM = 12


class ShellFamily(Family):
    """See :class:`flexfem.layout.family.Family`."""

    axes = False
    noun = "shell"
    series = "flexfem.io.paraview.family_series:ShellSeries"

    serial: NumberedModel

    @classmethod
    def members(cls, model: Model) -> list[Shell]:
        """Bodies of a model that belong to the family."""
        return model.shells

    def __init__(self, serial: NumberedModel, kind: int) -> None:
        """Lay out the shells."""
        super().__init__(serial, kind)
        self.surface = shell_surface(serial.model)

    @property
    @override
    def bodies(self) -> list[Shell]:
        return self.serial.model.shells

    @property
    @override
    def frames(self) -> FloatArray:
        return self.surface.frames

    @property
    @override
    def velocities(self) -> FloatArray:
        return self.surface.velocities

    @property
    @override
    def held(self) -> BoolArray:
        return self.surface.held

    @property
    @override
    def body_of_node(self) -> IntArray:
        return self.surface.body_of_node

    @property
    @override
    def cluster_of_node(self) -> IntArray:
        return self.surface.cluster_of_node

    @override
    def fingerprint(self) -> Mapping[str, Any]:
        s = self.surface
        return {"surface": [s.mesh.triangles, s.frames, s.rules, s.held, s.averaged]}

    @override
    def elements(self, body: Shell) -> int:
        return len(self.surface.mesh.body_rows(body.body))

    @override
    def outline(self, body: Shell) -> FloatArray:
        return self.surface.mesh.points[self.surface.mesh.body_nodes(body.body)]

    @override
    def inertia(self, body: Shell, origin: FloatArray) -> FloatArray:
        return shell_inertia(self.surface, body, origin)

    @override
    def mesh_facts(self, body: Shell) -> MeshFacts:
        return shell_facts(self.surface, body)

    @override
    def patches(self) -> IntArray:
        return shell_patches(self.surface)

    @override
    def node(self, marker: Marker, place: Place | None) -> int:
        assert place is not None
        assert place.node is not None
        return place.node

    @override
    def surface_place(self, marker: Marker) -> SurfacePlace:
        if isinstance(marker, SurfaceMarker):
            return SurfacePlace(self.kind, marker.nodes, marker.weights)
        key = self.serial.key(marker)
        assert key is not None  # a line is not a single point
        return SurfacePlace(self.kind, (key[1],), (1.0,))

    @override
    def with_axes(self, marker: Marker, place: SurfacePlace) -> SurfacePlace:
        mesh = self.surface.mesh
        return place.on_triangle(mesh, mesh.bodies[self.serial.model[marker.body].body])

    @override
    def supports(self) -> tuple[IntArray, FloatArray]:
        surface = self.surface
        count = len(surface.mesh.points)  # nodes of directors come after those of the mesh
        nodes, axis = np.nonzero(surface.held[:count, :3])
        turned, axes = _held_slopes(surface)
        directions = np.zeros((len(nodes) + len(turned), 6))
        directions[np.arange(len(nodes)), axis] = 1.0
        back = np.swapaxes(se3.rotation(surface.frames[turned]), -1, -2)
        directions[len(nodes) :, 3:] = np.einsum("nij,nj->ni", back, axes)
        return np.concatenate([nodes, turned]), directions

    def contact_surface(self) -> ContactSurface:
        """Nodes and triangles; director shells have four for each of theirs."""
        surface = self.surface
        thickness = np.array([shell.section.thickness for shell in self.bodies])
        triangles, body, start = surface.mesh.triangles, surface.body, surface.mesh.points
        element = np.arange(len(body))
        if surface.directors is not None:
            triangles = surface.directors.nodes[:, _QUARTERS].reshape(-1, 3)
            body, element, start = np.repeat(body, 4), np.repeat(element, 4), surface.frames[:, :3]
        return ContactSurface(
            self.bodies, np.arange(len(start)), start, surface.body_of_node, surface.held,
            triangles.astype(np.int64), 0.5 * thickness[body], body, element,
        )  # fmt: skip

    @override
    def contact_numbers(self, body: Shell, contact: Contact) -> tuple[float, float]:
        return self.surface_numbers(body, 0.5 * body.section.thickness)

    @override
    def surface_numbers(self, body: Shell, radius: float) -> tuple[float, float]:
        section = body.section
        through = float(np.diag(section.stiffness)[:2].min()) / section.thickness**2
        return through, section.mass

    @override
    def costs(self) -> dict[str, tuple[int, int]]:
        bodies = self.surface.mesh.bodies
        return {shell.name: (len(bodies[shell.body]), _TRIANGLE) for shell in self.bodies}

    @override
    def links(self) -> dict[tuple[str, str], int]:
        mesh, found = self.surface.mesh, dict[tuple[str, str], int]()
        shells = dict[int, list[str]]()
        for shell in self.bodies:
            for node in np.unique(mesh.triangles[mesh.bodies[shell.body]]).tolist():
                shells.setdefault(node, []).append(shell.name)
        for names in shells.values():
            for pair in combinations(names, 2):
                found[pair] = found.get(pair, 0) + _SEAM
        return found

    @override
    def share(self, ranks: Mapping[str, IntArray]) -> tuple[IntArray, dict[str, tuple[int, ...]]]:
        mesh = self.surface.mesh
        triangles = np.empty(len(mesh.triangles), dtype=np.int64)
        for shell in self.bodies:
            rows = mesh.bodies[shell.body]
            triangles[rows] = strips(mesh, rows, ranks[shell.name])
        nodes = {
            shell.name: _node_ranks(mesh, mesh.bodies[shell.body], triangles)
            for shell in self.bodies
        }
        return triangles, nodes

    @override
    def block(self, comm: MPI.Intracomm, ranks: IntArray) -> tuple[FrameBlock, ElementFamily]:
        if self.surface.directors is None:
            return _rotation_free(self.surface, comm, ranks, self.serial.kernels)
        return _directors(self.surface, comm, ranks, self.serial.kernels)

    @override
    def forces(
        self, block: FrameBlock, elements: ElementFamily | None, node_body: IntArray
    ) -> tuple[list[Force], list[InnerForces]]:
        serial = self.serial
        assert isinstance(elements, (RotationFreeShells, DirectorShells))
        forces = list(shell_forces(serial, self.surface, block))
        inside: list[InnerForces] = [*pressures(serial, elements.carriers, elements.body)]
        couples = shell_couples(serial, self.kind, block, elements.carriers)
        return forces, inside + list(by_kind(couples, node_body, block))

    @override
    def sensor(self, probe: AnyProbe, part: BlockPart) -> Sensor | None:
        if isinstance(probe, ShellEnergyProbe):
            return ShellEnergySensor(part, self.serial, probe)
        if isinstance(probe, ShellStrainProbe):
            return ShellStrainSensor(part, self.serial, probe)
        return None


def _rotation_free(
    surface: ShellSurface, comm: MPI.Intracomm, ranks: IntArray, kernels: str
) -> tuple[FrameBlock, RotationFreeShells]:
    """Nodes and triangles of all rotation-free shells."""
    # averaged slopes depend on neighbours as well
    rings = 2 if surface.averaged.any() else 1
    mesh = create_shell_mesh(comm, surface.mesh, ranks, rings)
    ids = mesh.node_ids
    held = surface.held[ids] if surface.held.any() else None
    block = FrameBlock(
        "shells", comm, surface.frames[ids], surface.velocities[ids], ids, mesh.index_map,
        inertial=True, width=3, dirichlet=held,
    )  # fmt: skip
    own = np.sort(mesh.cell_ids[: mesh.owned])
    kinds = np.column_stack([surface.averaged, surface.smoothed])
    groups = [
        shell_cells(surface, rows[(kinds[rows] == kind).all(axis=1)], bool(kind[0]), bool(kind[1]),
                    numbers, law, mesh.local)
        for numbers, law in shell_laws(comm, surface)
        for rows in [own[np.isin(surface.section[own], numbers)]]
        for kind in np.unique(kinds[np.isin(surface.section, numbers)], axis=0)
    ]  # fmt: skip
    if kernels == "ufl":
        forms = StrainKernels(comm, rotation_free_strains())
        groups = [
            replace(group, triangles=UFLRotationFreeTriangles.of(group.triangles, forms))
            for group in groups
        ]
    return block, RotationFreeShells(groups, block)


def _directors(
    surface: ShellSurface, comm: MPI.Intracomm, ranks: IntArray, kernels: str
) -> tuple[FrameBlock, DirectorShells]:
    """Nodes and triangles of all director shells."""
    assert surface.directors is not None
    nodes = surface.directors.all
    owner = np.full(len(surface.frames), np.iinfo(np.int64).max)
    np.minimum.at(owner, nodes.ravel(), np.repeat(ranks, nodes.shape[1]))
    own = np.flatnonzero(ranks == comm.rank)
    ids, index_map = distributed(comm, owner, nodes[own].ravel())
    block = FrameBlock(
        "shells", comm, surface.frames[ids], surface.velocities[ids], ids, index_map,
        inertial=True, dirichlet=surface.held[ids],
    )  # fmt: skip
    cells = director_cells(surface, own, shell_laws(comm, surface), block.local_index)
    if kernels == "ufl":
        forms = StrainKernels(comm, director_strains())
        cells = replace(cells, triangles=UFLDirectorTriangles.of(cells.triangles, forms))
    return block, DirectorShells(cells, block)


def _node_ranks(mesh: SurfaceMesh, rows: IntArray, triangles: IntArray) -> tuple[int, ...]:
    """Ranks that may own nodes of some triangles: those of all triangles at these nodes."""
    touched = np.zeros(len(mesh.points), dtype=np.bool_)
    touched[mesh.triangles[rows]] = True
    near = touched[mesh.triangles].any(axis=1)
    return tuple(int(rank) for rank in np.unique(triangles[near]))


def _held_slopes(surface: ShellSurface) -> tuple[IntArray, FloatArray]:
    """Nodes at edges with fixed slopes, and axes (n, 3) about which the shell cannot rotate."""
    start, _ = side_nodes(surface.mesh.triangles)
    start = start.reshape(-1, 3)
    clamped = start[surface.rules == EdgeRule.CLAMPED]
    mirrored = surface.rules == EdgeRule.SYMMETRIC
    normals, nodes = surface.normals[mirrored], [np.repeat(clamped, 3)]
    axes = [np.tile(np.eye(3), (len(clamped), 1))]
    for e in np.eye(3):  # all rotations save that about the normal
        axes.append(np.cross(normals, e))
        nodes.append(start[mirrored])
    return np.concatenate(nodes).astype(np.int64), np.concatenate(axes)
