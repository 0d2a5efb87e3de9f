# SPDX-License-Identifier: LGPL-3.0-or-later
"""NURBS elements of one degree and one material: their data and the calls of the kernels."""

from dataclasses import dataclass

from mpi4py import MPI

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.core.nodes.frame_kernels import Nodes
from flexfem.families.beam_nurbs.inertia import step_changes, step_rates
from flexfem.families.beam_nurbs.kernels import (
    FACTORS,
    ElementKernel,
    action,
    constant_data,
    element_kernel,
    forces,
    strains,
)
from flexfem.families.beam_nurbs.masses import NurbsMasses
from flexfem.families.beam_nurbs.motion import MassiveElements, add_element_motion
from flexfem.families.beam_nurbs.tables import Points, gauss, masses, points
from flexfem.families.beam_nurbs.tangent import tangent
from flexfem.families.common.section_groups import Material, symmetric
from flexfem.forms.nurbs_beam import nurbs_forms, strain_form
from flexfem.kernels.by_hand import ByHand
from flexfem.kernels.driver import Cells, plain_cells
from flexfem.kernels.form_kernels import compile_forms
from flexfem.kernels.records import Float2D, Record

__all__ = ["NurbsCells", "NurbsGroup", "NurbsKernels"]

_ALL, _NO_TWISTS, _NO_CHANGES = slice(None), np.empty((0, 6)), np.empty((0, 36))


@dataclass(frozen=True)
class NurbsCells:
    """Constant data of elements of one degree p, k = p + 1.

    Attributes:
        nodes: (m, k) control points.
        body: (m,) number of the beam.
        section: (m,) number of the section.
        shape: (m, k, k) coefficients in powers of xi, from 0 to 1 in the element, of the weighted
            shape functions; the rational ones are these over their sum.
        damping: (m,) stiffness-proportional damping, s.
        vectors: True if they interpolate relative rotation vectors, False for quaternions.
    """

    nodes: IntArray
    body: IntArray
    section: IntArray
    shape: FloatArray
    damping: FloatArray
    vectors: bool = False


class NurbsKernels:
    """Compiled kernels of a material and an interpolation, the same for all degrees.

    Attributes:
        residual, tangent, action, strain: see ``flexfem.forms.nurbs_beam``.
    """

    def __init__(self, comm: MPI.Intracomm, material: Material, vectors: bool) -> None:
        """Compile (collective)."""
        arguments = material.damped, material.law, vectors
        found = compile_forms(
            comm, nurbs_forms, arguments, {"residual": True, "tangent": True, "action": True}
        )
        self.residual, self.tangent, self.action = found.kernels.values()
        self.strain = compile_forms(comm, strain_form, (vectors,), {"strain": True})["strain"]


class _Moved(Record):
    """Frames (n, 12) and twists (n, 6) of nodes, and changes (n, 36) of these along twists."""

    frames: Float2D
    velocity: Float2D
    by_velocity: Float2D


#: Kernels of elements for those of points, the record of the nodes, and what they take of it
#: beside position, rotation and velocity.
_KERNELS: dict[str, tuple[ByHand, type[Record], tuple[str, ...]]] = {
    "residual": (forces, Nodes, ()),
    "tangent": (tangent, _Moved, ("by_velocity",)),
    "action": (action, Nodes, ("turn", "velocity_change")),
    "strain": (strains, _Moved, ()),
}


class NurbsGroup:
    """Residual, tangent and stress resultants of the elements of one degree and material.

    Attributes:
        data: constant data of the elements; sections count those of the material.
        cells: the same in the format of the kernel driver; own data are the damping.
        lengths: (m,) arc lengths at the start, m.
        point_lengths: (m, q) arc length that each quadrature point stands for, m.
    """

    def __init__(
        self, kernels: NurbsKernels, data: NurbsCells, material: Material, start: FloatArray
    ) -> None:
        """Prepare the elements.

        Args:
            kernels: kernels of the material.
            data: constant data of this rank's elements.
            material: their material.
            start: (n, 12) frames of this rank's nodes at the start.
        """
        self.data, self._material, self._kernels, self._start = data, material, kernels, start
        k = data.nodes.shape[1]
        # as many points as the degree: exact enough for its order, and slender elements do not lock
        place, weights = gauss(k - 1)
        at = points(data.shape, data.nodes, start, place, weights)
        self.point_lengths = at.lengths
        self._made: dict[tuple[str, int], ElementKernel] = {}
        self._moved = _Moved(frames=start, velocity=_NO_TWISTS, by_velocity=_NO_CHANGES)
        self._points, self._starts = at, self._start_strains(at)
        self.cells = self._with_points(at, self._starts)
        integrals, inertias = (
            masses(data.shape, data.nodes, start),
            symmetric(material.data[:, :21]),
        )
        self.lengths = integrals.lengths
        self._inertia = NurbsMasses(data.nodes, integrals, inertias, data.section, len(start))
        self._massive = MassiveElements(
            nodes=data.nodes, products=integrals.products, weights=integrals.weights,
            section=data.section, inertias=inertias,
        )  # fmt: skip

    def _kernel(self, name: str, points: int | None = None) -> ElementKernel:
        """A kernel at some points, the quadrature points by default; compiled at the first call."""
        k = self.data.nodes.shape[1]
        q = k - 1 if points is None else points
        if (name, q) not in self._made:
            results = {"residual": 6 * k, "tangent": 36 * k * k, "action": 6 * k, "strain": 12 * q}
            by_hand, record, more = _KERNELS[name]
            self._made[name, q] = element_kernel(
                by_hand, getattr(self._kernels, name), (k, q, results[name]), record, more,
                section=self._material.data.shape[1], vectors=self.data.vectors,
            )  # fmt: skip
        return self._made[name, q]

    def _with_points(
        self, at: Points, starts: FloatArray, chosen: IntArray | slice = _ALL
    ) -> Cells:
        """Chosen elements with points in them, whose strains (m, q, 6) at the start are given."""
        data = self.data
        return plain_cells(
            data.damping[chosen, np.newaxis], data.nodes[chosen].astype(np.int32),
            constant_data(at, starts), data.section[chosen], self._material.data,
        )  # fmt: skip

    def _start_strains(self, at: Points, chosen: IntArray | slice = _ALL) -> FloatArray:
        """Strains (m, q, 6) of the initial configuration at points, with none subtracted."""
        rest, nothing = np.zeros((len(self._start), 6)), np.zeros((*at.lengths.shape, 6))
        cells = self._with_points(at, nothing, chosen)
        return self._strains(cells, at, self._start, rest)[:, :, :6]

    def _strains(
        self, cells: Cells, at: Points, frames: FloatArray, velocity: FloatArray
    ) -> FloatArray:
        """Strains and their rates (m, q, 12) at the points of some elements."""
        m, q = at.lengths.shape
        found = np.empty((m, 12 * q))
        self._kernel("strain", q).write(cells, self._at(frames, velocity), found)
        return found.reshape(m, q, 12)

    def _at(
        self, frames: FloatArray, velocity: FloatArray, by_velocity: FloatArray = _NO_CHANGES
    ) -> _Moved:
        """The nodes for strains and tangents."""
        nodes = self._moved
        nodes.frames, nodes.velocity, nodes.by_velocity = frames, velocity, by_velocity
        return nodes

    def _point_strains(self, frames: FloatArray, velocity: FloatArray) -> FloatArray:
        """Strains and their rates (m, q, 12) at the quadrature points."""
        return self._strains(self.cells, self._points, frames, velocity)

    def _present(self, frames: FloatArray) -> FloatArray:
        """Strains (m, q, 6) at the quadrature points."""
        return self._point_strains(frames, np.zeros((len(frames), 6)))[:, :, :6]

    def _cells_at(self, block: FrameBlock, strains: FloatArray | None) -> Cells:
        """Elements for whose initial strains the present strains are the given ones."""
        if strains is None:
            return self.cells
        starts = self._starts + self._present(block.frames) - strains
        return self._with_points(self._points, starts)

    def continued_strains(self, frames: FloatArray, steps: FloatArray) -> FloatArray:
        """Strains (m, q, 6) continued linearly along local twists ``steps`` of the nodes.

        See ``BeamGroup.continued_strains``; here the stresses at the quadrature points are the
        unknowns.
        """
        strains = self._point_strains(frames, steps)
        return strains[:, :, :6] + strains[:, :, 6:]

    def integrated_stresses(self, strains: FloatArray) -> FloatArray:
        """Stress resultants (m, q, 6) of strains (m, q, 6) times the lengths of the points."""
        resultant, _ = self._material.response(strains.reshape(-1, 6), self._point_sections)
        return resultant.reshape(strains.shape) * self.point_lengths[:, :, np.newaxis]

    def unstressed(self) -> FloatArray:
        """Zero strains (m, q, 6), for which the stresses are zero."""
        return np.zeros_like(self._starts)

    def add_residual(
        self, block: FrameBlock, gravity: FloatArray, scale: float,
        strains: FloatArray | None = None,
    ) -> None:  # fmt: skip
        """Add ``scale`` times internal, inertia and gravity forces to the block's residual.

        ``strains`` are those of :meth:`continued_strains`, None for the present ones.
        """
        cells = self._cells_at(block, strains)
        self._kernel("residual").add(cells, block.nodes, scale, block.residual)
        self._inertia.add_residual(block, gravity, scale)

    def tangent_into(
        self, block: FrameBlock, gravity: FloatArray, shifts: FloatArray, scale: float,
        values: FloatArray, strains: FloatArray | None = None, *, local: bool = False,
    ) -> None:  # fmt: skip
        """Write the matrices (m, 36 k k) ``scale (k K + C dv + M dw)``.

        ``shifts`` = (dv/dn, dw/dn, k), ``strains`` as in :meth:`add_residual`. With ``local`` the
        derivative K is that at fixed local velocities and accelerations. Terms of a node alone are
        in the matrix of one of its elements.
        """
        rates, factors = np.empty((2, len(block.frames), 6, 6)), np.array([shifts[2], scale])
        step_rates(
            self._inertia.nodes, block.nodes.memory, shifts,
            block.inertial_rates(shifts) and not local, rates,
        )  # fmt: skip
        if shifts[0] == 0.0 and shifts[2] == 0.0:
            values[:] = 0.0
        else:
            cells, kernel = self._cells_at(block, strains), self._kernel("tangent")
            nodes = self._at(block.frames, block.velocity, rates[0].reshape(-1, 36))
            kernel.constants[FACTORS:] = scale * shifts[2], scale
            kernel.write(cells, nodes, values)
        self._inertia.add_tangent(block, gravity, rates, factors, values)

    def add_action(
        self, block: FrameBlock, gravity: FloatArray, shifts: FloatArray, scale: float,
        strains: FloatArray | None = None, *, local: bool = False,
    ) -> None:  # fmt: skip
        """Add ``scale`` times the same tangent applied to the block's step to its residual."""
        inertial = block.inertial_rates(shifts) and not local
        step_changes(self._inertia.nodes, block.nodes.memory, shifts, inertial)
        if shifts[0] != 0.0 or shifts[2] != 0.0:
            cells = self._cells_at(block, strains)
            self._kernel("action").add(cells, block.nodes, scale, block.residual)
        self._inertia.add_action(block, gravity, scale)

    def response(
        self, frames: FloatArray, at: IntArray, xi: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Strains and resultants (m, q, 6) of the given elements in section axes.

        Args:
            frames: (n, 12) frames of the nodes.
            at: (m,) numbers of the elements.
            xi: (q,) or (m, q) coordinates of points in them, 0 to 1.
        """
        data, ones = self.data, np.ones(xi.shape[-1])
        there = points(data.shape[at], data.nodes[at], self._start, xi, ones)
        cells = self._with_points(there, self._start_strains(there, at), at)
        rest = np.zeros((len(frames), 6))
        strain = self._strains(cells, there, frames, rest)[:, :, :6]
        section = np.repeat(self.data.section[at], strain.shape[1])
        resultant, _ = self._material.response(strain.reshape(-1, 6), section)
        return strain, resultant.reshape(strain.shape)

    def stretches(self, frames: FloatArray) -> FloatArray:
        """Least stretch (m,) at the quadrature points, along the normal of the section."""
        strain = self._present(frames)
        stretched: FloatArray = 1.0 + strain[:, :, 0].min(axis=1)
        return stretched

    def energies(self, frames: FloatArray) -> FloatArray:
        """Strain energies (m,) of the elements, J."""
        strain = self._present(frames)
        _, energy = self._material.response(strain.reshape(-1, 6), self._point_sections)
        return (energy.reshape(self.point_lengths.shape) * self.point_lengths).sum(axis=1)

    @property
    def _point_sections(self) -> IntArray:
        return np.repeat(self.data.section, self.point_lengths.shape[1])

    @property
    def viscous(self) -> bool:
        """True if the material of the elements is viscous."""
        return self._material.viscous

    def viscosity(self, block: FrameBlock) -> tuple[FloatArray, FloatArray]:
        """Viscous stress resultants and strain rates (m q, 6) at the quadrature points."""
        both = self._point_strains(block.frames, block.velocity)
        strain, rate = (np.ascontiguousarray(h) for h in np.split(both.reshape(-1, 12), 2, axis=1))
        damping = np.repeat(self.data.damping, self.point_lengths.shape[1])[:, np.newaxis]
        stress = self._material.viscous_stress(strain, rate, self._point_sections, damping)
        return stress, rate

    def add_motion(self, block: FrameBlock, chosen: BoolArray, motion: FloatArray) -> None:
        """Add energy and momenta of the chosen (m,) elements, see ``flexfem.core.nodes.motion``."""
        add_element_motion(self._massive.memory, chosen, block.nodes.memory, motion)
