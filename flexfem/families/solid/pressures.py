# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pressures on the facets of solids of a rank, from UFL forms of a facet."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

from mpi4py import MPI

import basix.ufl
import numpy as np
import ufl

from flexfem._types import FloatArray, IntArray
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.families.solid.meshes.lagrange import lattice, reference_points
from flexfem.kernels.driver import CellKernel, Cells, Nodal, cell_kernel, evaluate, plain_cells
from flexfem.kernels.ffcx import compile_kernel
from flexfem.kernels.records import Float2D, Record
from flexfem.lie import se3

__all__ = ["FacetKind", "SolidPressures"]

_NOTHING = np.zeros(1)


class _Points(Record):
    """Positions (n, 3) of nodes, m."""

    points: Float2D


@dataclass(frozen=True)
class FacetKind:
    """Facets of one shape and degree; "interval" with the width, or axis, of a plane figure."""

    shape: str
    degree: int
    axisymmetric: bool


@dataclass(frozen=True)
class _FacetForms:
    """Forces of the unit pressure on a facet, and their derivatives."""

    kind: FacetKind

    @cached_property
    def position(self) -> Any:
        """Coefficient of the positions, m."""
        d = 1 if self.kind.shape == "interval" else 2
        domain = ufl.Mesh(basix.ufl.element("Lagrange", self.kind.shape, 1, shape=(d,)))
        element = basix.ufl.element(
            "Lagrange", self.kind.shape, self.kind.degree, shape=(3,),
            lagrange_variant=basix.LagrangeVariant.equispaced,
        )  # fmt: skip
        return ufl.Coefficient(ufl.FunctionSpace(domain, element))

    @cached_property
    def force(self) -> Any:
        """Forces on the nodes, N; the normal leaves the solid, the pressure pushes into it."""
        x = self.position
        sides = ufl.grad(x)
        if self.kind.shape == "interval":
            normal = ufl.as_vector([sides[1, 0], -sides[0, 0], 0.0])
            if self.kind.axisymmetric:
                normal = 2.0 * ufl.pi * x[0] * normal
        else:
            first, second = (ufl.as_vector([sides[i, j] for i in range(3)]) for j in range(2))
            normal = ufl.cross(first, second)
        space = x.ufl_function_space()
        order = 3 * self.kind.degree
        measure = ufl.dx(space.ufl_domain(), metadata={"quadrature_degree": order})
        return -ufl.inner(normal, ufl.TestFunction(space)) * measure

    @cached_property
    def stiffness(self) -> Any:
        """Derivatives of the forces by the positions, N/m."""
        return ufl.derivative(self.force, self.position)


class SolidPressures:
    """Pressures on facets of one kind; see :class:`flexfem.layout.inner_forces.InnerForces`.

    Attributes:
        nodes: (m, k) local nodes of the facets.
        body: (m k,) number of the body of each node of each facet.
    """

    def __init__(
        self, comm: MPI.Intracomm, kind: FacetKind, nodes: IntArray, body: IntArray,
        pressure: FloatArray, load: IntArray,
    ) -> None:  # fmt: skip
        """Compile the forms (collective).

        Args:
            comm: communicator.
            kind: of the facets.
            nodes: (m, k) local nodes.
            body: (m,) their bodies.
            pressure: (m,) Pa, times the width of edges, m.
            load: (m,) numbers of the loads whose amplitudes scale the pressures.
        """
        forms, count = _FacetForms(kind), nodes.shape[1]
        self.nodes, self.body = nodes.astype(np.int64), np.repeat(body, count)
        self._pressure, self._load = pressure, load
        # the tangent is asked for once for each action, at the same state
        self._used, self._state = np.unique(self.nodes), np.full(1, np.nan)
        self._tangent: FloatArray = np.empty((len(nodes), 3 * count, 3 * count))

        def compiled(form: Any, size: int) -> CellKernel:
            made = compile_kernel(comm, form, (forms.position,), batched=True)
            place = {"position": (Nodal.POSITION, _Points.word("points"))}
            return cell_kernel(made, size, ["position"], place, {})

        self._force = compiled(forms.force, 3 * count)
        self._stiffness = compiled(forms.stiffness, (3 * count) ** 2)
        corners = np.zeros((len(lattice(kind.shape, 1)), 3))
        points = reference_points(kind.shape, 1)
        corners[:, : points.shape[1]] = points
        self._cells: Cells = plain_cells(
            np.empty((len(nodes), 0)), np.ascontiguousarray(nodes, dtype=np.int32),
            corners.reshape(1, -1),
        )  # fmt: skip

    def _evaluated(self, call: CellKernel, block: FrameBlock, factors: FloatArray) -> FloatArray:
        """Results (m, s) at the present pressures."""
        at = _Points(points=np.ascontiguousarray(block.frames[:, :3]))
        out = np.empty((len(self.nodes), call.size))
        evaluate(call.memory, self._cells.memory, at.memory, _NOTHING, out)
        found: FloatArray = out * (self._pressure * factors[self._load])[:, np.newaxis]
        return found

    def _forces(self, block: FrameBlock, factors: FloatArray) -> FloatArray:
        """Forces (m, k, 3) on the nodes, inertial axes, N."""
        return self._evaluated(self._force, block, factors).reshape(*self.nodes.shape, 3)

    def add_residual(self, block: FrameBlock, factors: FloatArray, scale: float) -> None:
        """See :class:`flexfem.layout.inner_forces.InnerForces`."""
        turns = se3.rotation(block.frames)[self.nodes]
        own = np.einsum("mkba,mkb->mka", turns, self._forces(block, factors))
        np.add.at(block.residual[:, :3], self.nodes, -scale * own)

    def tangent(self, block: FrameBlock, factors: FloatArray, scale: float) -> FloatArray:
        """See :class:`flexfem.layout.inner_forces.InnerForces`."""
        state = np.concatenate([block.frames[self._used].ravel(), factors[self._load], [scale]])
        if not np.array_equal(state, self._state):
            m, k = self.nodes.shape
            matrices = self._evaluated(self._stiffness, block, factors).reshape(m, k, 3, k, 3)
            turns = se3.rotation(block.frames)[self.nodes]
            own = np.einsum("miba,mibjc,mjcd->miajd", turns, matrices, turns, optimize=True)
            self._tangent, self._state = -scale * own.reshape(m, 3 * k, 3 * k), state
        return self._tangent

    def add_action(self, block: FrameBlock, factors: FloatArray, scale: float) -> None:
        """See :class:`flexfem.layout.inner_forces.InnerForces`."""
        m, k = self.nodes.shape
        steps = block.step[self.nodes, :3].reshape(m, 3 * k, 1)
        action = self.tangent(block, factors, scale) @ steps
        np.add.at(block.residual[:, :3], self.nodes, action.reshape(m, k, 3))

    def states(self, block: FrameBlock, factors: FloatArray) -> FloatArray:
        """See :class:`flexfem.layout.inner_forces.InnerForces`."""
        out = np.zeros((self.nodes.size, 12))
        out[:, :3] = self._forces(block, factors).reshape(-1, 3)
        out[:, 6:9] = block.frames[self.nodes.ravel(), :3]
        return out
