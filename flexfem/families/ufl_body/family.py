# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies of finite elements whose strain energy the user writes in UFL."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, override

from mpi4py import MPI

import numpy as np

from flexfem._checks import InputError
from flexfem._types import FloatArray, IntArray
from flexfem.core.load import NOTHING, Load
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.families.common.block_nodes import MeshFamily
from flexfem.families.shells.loads import Pressures
from flexfem.families.ufl_body.elements import EnergyCells, EnergyElements, EnergyKernels, Points
from flexfem.forms.energy import EnergyForms
from flexfem.kernels.driver import CellKernel, Nodal, cell_kernel
from flexfem.kernels.ffcx import Kernel, compile_kernel
from flexfem.layout.elements import ElementFamily
from flexfem.layout.family import ContactSurface
from flexfem.layout.inner_forces import InnerForces
from flexfem.layout.node_loads import Force
from flexfem.layout.numbered_model import NumberedModel
from flexfem.lie import se3
from flexfem.loads.pressure import Pressure
from flexfem.mesh.surface_mesh import SurfaceMesh
from flexfem.model.bodies.ufl_body import UFLBody
from flexfem.model.contact import Contact

__all__ = ["UFLBodyFamily"]

#: Approximate cost of a cell relative to a beam element.
_COST = 3
#: Strain at which energies at the start and of rotated bodies are compared; bound of zero.
_STRAIN, _ZERO = 1e-2, 1e-8
#: A rotation in space that is not in the symmetry group of any likely body.
_TURN = np.array([0.7, -0.4, 1.1])

type _Kind = tuple[Any, ...]


class UFLBodyFamily(MeshFamily[UFLBody]):
    """See :class:`flexfem.layout.family.Family`."""

    name = "ufl_bodies"
    series = "flexfem.io.paraview.energy_series:EnergySeries"

    def __init__(self, serial: NumberedModel, kind: int) -> None:
        """Number the nodes body after body.

        Raises:
            ValueError: an energy that is not a scalar UFL expression of its positions and
                parameters.
        """
        super().__init__(serial, kind)
        self._forms = {kind: _forms(bodies[0]) for kind, bodies in _kinds(self._bodies).items()}

    @override
    def costs(self) -> dict[str, tuple[int, int]]:
        return {body.name: (len(body.mesh.cells), _COST) for body in self._bodies}

    @override
    def block(self, comm: MPI.Intracomm, ranks: IntArray) -> tuple[FrameBlock, ElementFamily]:
        block, mine = self.own_nodes(comm, ranks)
        own = [np.flatnonzero(cells) for cells in mine]
        ids = block.node_ids
        groups = []
        for kind, bodies in _kinds(self._bodies).items():
            forms = self._forms[kind]
            wanted = (forms.energy, forms.force, forms.stiffness, forms.mass)
            coefficients = (forms.position, *forms.parameters)
            compiled = [compile_kernel(comm, form, coefficients) for form in wanted]
            *kernels, mass = _cell_kernels(bodies[0], compiled)
            numbers = [self._bodies.index(body) for body in bodies]
            group = self._cells(EnergyKernels(*kernels), mass, numbers, own, block)
            _check_start(comm, bodies, group, self._frames[ids][:, :3])
            groups.append(group)
        return block, EnergyElements(groups, block)

    def _cells(
        self, kernels: EnergyKernels, mass: Any, numbers: Sequence[int], own: Sequence[IntArray],
        block: FrameBlock,
    ) -> EnergyCells:  # fmt: skip
        """The cells of some bodies on this rank."""
        bodies = [self._bodies[k] for k in numbers]
        nodes = np.concatenate(
            [self.first[k] + self._bodies[k].mesh.cells[own[k]] for k in numbers]
        )
        body = np.repeat(numbers, [len(own[k]) for k in numbers]).astype(np.int64)
        columns = [
            np.concatenate(
                [b.parameters[name][own[k]] for k, b in zip(numbers, bodies, strict=True)]
            )
            for name in bodies[0].parameters
        ]
        start = np.ascontiguousarray(self._frames[nodes, :3])
        empty = np.empty((len(nodes), 0))
        made = EnergyCells(
            kernels=kernels,
            nodes=np.ascontiguousarray(block.local_index(nodes), dtype=np.int32),
            start=start,
            parameters=np.ascontiguousarray(np.column_stack([empty, *columns])),
            mass=np.empty(0),
            size=np.empty(0),
            body=body,
            corners=bodies[0].mesh.dimension + 1,
        )
        return made.with_mass(mass, np.array([b.density for b in self._bodies])[body])

    @override
    def contact_surface(self) -> ContactSurface | None:
        touching = [k for k, body in enumerate(self._bodies) if body.touches]
        if not touching:
            return None
        bodies = [self._bodies[k] for k in touching]
        nodes = [np.arange(self.first[k], self.first[k + 1]) for k in touching]
        rows = [np.arange(self.first_cell[k], self.first_cell[k + 1]) for k in touching]
        triangles = [self.first[k] + self._bodies[k].mesh.cells for k in touching]
        counts, cells = [len(n) for n in nodes], [len(r) for r in rows]
        radius = [0.5 * float(body.thickness or 0.0) for body in bodies]
        every = np.concatenate(nodes)
        return ContactSurface(
            bodies, every, self._frames[every, :3], np.repeat(np.arange(len(bodies)), counts),
            self._held[every], np.concatenate(triangles), np.repeat(radius, cells),
            np.repeat(np.arange(len(bodies)), cells), np.concatenate(rows),
        )  # fmt: skip

    @override
    def contact_numbers(self, body: UFLBody, contact: Contact) -> tuple[float, float]:
        raise ValueError(
            f'UFLBody "{body.name}": its energy has no stiffness through the thickness, give '
            "Contact(stiffness=...)"
        )

    @override
    def surface_numbers(self, body: UFLBody, radius: float) -> tuple[float, float]:
        return np.inf, body.density

    @override
    def forces(
        self, block: FrameBlock, elements: ElementFamily | None, node_body: IntArray
    ) -> tuple[list[Force], list[InnerForces]]:
        names = {body.name: k for k, body in enumerate(self._bodies)}
        forces, inside = list[Force](), list[InnerForces]()
        for number, load in enumerate(self.serial.model.loads):
            for name in load.shells:
                if name not in names:
                    continue
                k = names[name]
                surface = self._bodies[k].surface
                assert surface is not None  # checked by the model
                if isinstance(load, Pressure):
                    inside.append(self._pressure(k, surface, load, number, block, elements))
                else:
                    forces += self._spread(k, surface, load, number, block)
        return forces, inside

    def _pressure(
        self, k: int, surface: SurfaceMesh, load: Pressure, number: int, block: FrameBlock,
        elements: ElementFamily | None,
    ) -> Pressures:  # fmt: skip
        """Pressure on the triangles of a body on this rank."""
        assert isinstance(elements, EnergyElements)
        own = [g.nodes[g.body == k] for g in elements.groups if (g.body == k).any()]
        nodes = np.concatenate([np.empty((0, 3), np.int64), *own])
        turned = (surface.triangles != self._bodies[k].mesh.cells).any(axis=1)
        reverse = np.flatnonzero(turned)
        if len(reverse):  # those whose sides differ from the first one's
            known = {tuple(row) for row in (self.first[k] + surface.triangles[turned]).tolist()}
            ids = block.node_ids[nodes]
            swap = [tuple(row) in known for row in ids[:, [0, 2, 1]].tolist()]
            nodes[swap] = nodes[swap][:, [0, 2, 1]]
        count = len(nodes)
        return Pressures(
            nodes.astype(np.int64), np.full(count, k), np.full(count, load.pressure),
            np.full(count, number),
        )  # fmt: skip

    def _spread(
        self, k: int, surface: SurfaceMesh, load: Load, number: int, block: FrameBlock
    ) -> Iterator[Force]:
        """A dead force per area at the nodes of a body that this rank owns."""
        share = np.repeat(surface.areas / 3.0, 3)
        sizes = np.bincount(surface.triangles.ravel(), share)
        local = block.owned_index(self.first[k] + np.arange(len(sizes)))
        still = se3.frame(np.zeros(3), np.eye(3))
        for node in np.flatnonzero(local >= 0):
            force = float(sizes[node]) * load.wrench[0]
            yield Force(int(local[node]), still, force, NOTHING, False, number)

    @override
    def fingerprint(self) -> Mapping[str, Any]:
        return {"energy": [[b.mesh.points, b.mesh.cells, b.held] for b in self._bodies]}


def _kinds(bodies: Sequence[UFLBody]) -> dict[_Kind, list[UFLBody]]:
    """Bodies whose cells have the same kernels, in the order of the model."""
    found = dict[_Kind, list[UFLBody]]()
    for body in bodies:
        mesh = body.mesh
        key = body.energy, mesh.cell, mesh.degree, body.quadrature, tuple(body.parameters)
        found.setdefault(key, []).append(body)
    return found


def _forms(body: UFLBody) -> EnergyForms:
    """Forms of the energy of a body."""
    mesh = body.mesh
    try:
        return EnergyForms.of(
            body.energy, mesh.cell, mesh.degree, list(body.parameters), body.quadrature
        )
    except ValueError as error:
        raise ValueError(f'UFLBody "{body.name}": {error}') from None


def _cell_kernels(body: UFLBody, compiled: Sequence[Kernel]) -> list[CellKernel]:
    """Kernels of energy, forces, stiffnesses and masses, with positions of the data of cells."""
    count = body.mesh.cells.shape[1]
    parameters = {f"parameter {j}": (j, 1) for j in range(len(body.parameters))}
    nodal = {"position": (Nodal.POSITION, Points.word("points"))}
    sizes = 1, 3 * count, (3 * count) ** 2, count**2
    return [
        cell_kernel(kernel, size, [*nodal, *parameters], nodal, parameters)
        for kernel, size in zip(compiled, sizes, strict=True)
    ]


def _check_start(
    comm: MPI.Intracomm, bodies: Sequence[UFLBody], cells: EnergyCells, points: FloatArray
) -> None:
    """Refuse energies that are not finite, not zero at the start, or not invariant under rotation.

    Raises:
        InputError: on all ranks.
    """
    turned = points @ se3.rotation(se3.exp(np.concatenate([np.zeros(3), _TURN]))).T
    strained = (1.0 + _STRAIN) * points
    states = [Points(points=np.ascontiguousarray(x)) for x in (points, turned, strained)]
    with np.errstate(all="ignore"):
        values = np.array([float(cells.energies(state).sum()) for state in states])
        slopes = [cells.forces(states[0]), cells.stiffnesses(states[0])]
        finite = np.isfinite(values).all() and all(np.isfinite(one).all() for one in slopes)
    rest, rotated, stretched = comm.allreduce(np.where(np.isfinite(values), values, 0.0))
    names = ", ".join(f'UFLBody "{body.name}"' for body in bodies[:1])
    if not comm.allreduce(int(finite), op=MPI.MIN):
        raise InputError(f"{names}: the energy or a derivative of it is not finite at the start")
    if abs(rest) > _ZERO * abs(stretched) or stretched == 0.0:
        raise InputError(
            f"{names}: the energy is {rest:.6g} J at the start, where it must vanish, and "
            f"{stretched:.6g} J at a strain of {_STRAIN:g}"
        )
    if abs(rotated) > _ZERO * abs(stretched):
        raise InputError(
            f"{names}: the energy changes by {rotated:.6g} J as the body rotates, where it must "
            f"stay zero; at a strain of {_STRAIN:g} it is {stretched:.6g} J"
        )
