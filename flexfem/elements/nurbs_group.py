# SPDX-License-Identifier: LGPL-3.0-or-later
"""NURBS elements of one degree and one material: their data and the calls of the compiled loops."""

from dataclasses import dataclass

from mpi4py import MPI

import numpy as np

from flexfem._types import BoolArray, FloatArray, IndexArray, IntArray
from flexfem.core.frame_block import FrameBlock
from flexfem.elements.beam_material import Material, symmetric
from flexfem.elements.nurbs_inertia import step_changes, step_rates
from flexfem.elements.nurbs_loops import add_action, add_residual, point_strains
from flexfem.elements.nurbs_masses import NurbsMasses
from flexfem.elements.nurbs_motion import add_element_motion
from flexfem.elements.nurbs_tables import gauss, masses, points
from flexfem.elements.nurbs_tangent import tangent_into
from flexfem.forms.nurbs_beam import nurbs_forms, strain_form
from flexfem.la.kernel import Kernel, compile_kernel
from flexfem.la.lanes import LANES, lanes, unlaned

__all__ = ["NurbsCells", "NurbsGroup", "NurbsKernels"]


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
        vectors: they interpolate relative rotation vectors, not quaternions.
    """

    nodes: IndexArray
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
        forms = nurbs_forms(material.damped, material.law, vectors)
        fields = tuple(forms.coefficients.values())
        self.residual = compile_kernel(comm, forms.residual, fields, batched=True)
        self.tangent = compile_kernel(comm, forms.tangent, fields, batched=True)
        self.action = compile_kernel(comm, forms.action, fields, batched=True)
        strain, coefficients = strain_form(vectors)
        self.strain = compile_kernel(comm, strain, tuple(coefficients.values()), batched=True)


class NurbsGroup:
    """Residual, tangent and stress resultants of the elements of one degree and material.

    Attributes:
        data: constant data of the elements; sections count those of the material.
        lengths: (m,) arc lengths at the start, m.
        point_lengths: (m, q) arc length that each quadrature point stands for, m.
    """

    def __init__(
        self, kernels: NurbsKernels, data: NurbsCells, material: Material, start: FloatArray
    ) -> None:
        """Prepare the elements.

        Args:
            kernels: the material's.
            data: constant data of this rank's elements.
            material: what they are made of.
            start: (n, 12) frames of this rank's nodes at the start.
        """
        self.data, self._material, self._kernels, self._start = data, material, kernels, start
        k = data.nodes.shape[1]
        # as many points as the degree: exact enough for its order, and slender elements do not lock
        place, weights = gauss(k - 1)
        at = points(data.shape, data.nodes, start, place, weights)
        self.point_lengths = at.lengths
        self._tables, self._weights = at.tables, lanes(at.lengths)
        self._starts = self._start_strains(self._tables, data.nodes)
        self._masses = masses(data.shape, data.nodes, start)
        self.lengths = self._masses.lengths
        self._inertias = symmetric(material.data[:, :21])
        self._inertia = NurbsMasses(
            data.nodes, self._masses, self._inertias, data.section, len(start)
        )

    def _start_strains(self, tables: FloatArray, cells: IndexArray) -> FloatArray:
        """Strains (b, q, 6, LANES) of the start as such."""
        nothing, rest = np.zeros((*tables.shape[:2], 6, LANES)), np.zeros((len(self._start), 6))
        return self._strains(tables, cells, nothing, self._start, rest)[:, :, :6].copy()

    def _strains(
        self, tables: FloatArray, cells: IndexArray, starts: FloatArray, frames: FloatArray,
        velocity: FloatArray,
    ) -> FloatArray:  # fmt: skip
        """Strains and their rates (b, q, 12, LANES)."""
        strains = np.empty((*tables.shape[:2], 12, LANES))
        kernel = self._kernels.strain
        point_strains(
            kernel.address, kernel.offsets, self.data.vectors, cells, tables, starts, frames,
            velocity, strains,
        )  # fmt: skip
        return strains

    def _point_strains(self, frames: FloatArray, velocity: FloatArray) -> FloatArray:
        """Strains and their rates (b, q, 12, LANES) at the quadrature points."""
        return self._strains(self._tables, self.data.nodes, self._starts, frames, velocity)

    def _present(self, frames: FloatArray) -> FloatArray:
        """Strains (b, q, 6, LANES) at the quadrature points."""
        return self._point_strains(frames, np.zeros((len(frames), 6)))[:, :, :6]

    def _starts_for(self, frames: FloatArray, strains: FloatArray | None) -> FloatArray:
        """Strains at the start from which given ones lead to the present ones."""
        if strains is None:
            return self._starts
        return np.ascontiguousarray(self._starts + self._present(frames) - strains)

    def continued_strains(self, frames: FloatArray, steps: FloatArray) -> FloatArray:
        """Strains (b, q, 6, LANES) continued linearly along local twists ``steps`` of the nodes.

        See ``BeamGroup.continued_strains``; here the stresses at the quadrature points are the
        unknowns.
        """
        strains = self._point_strains(frames, steps)
        return strains[:, :, :6] + strains[:, :, 6:]

    def unstressed(self) -> FloatArray:
        """No strains (b, q, 6, LANES), and so no stresses."""
        return np.zeros_like(self._starts)

    def add_residual(
        self, block: FrameBlock, gravity: FloatArray, scale: float,
        strains: FloatArray | None = None,
    ) -> None:  # fmt: skip
        """Add ``scale`` times internal, inertia and gravity forces to the block's residual.

        ``strains`` are those of :meth:`continued_strains`, None for the present ones.
        """
        starts = self._starts_for(block.frames, strains)
        add_residual(
            *self._loop_data(self._kernels.residual, starts), block.frames, block.velocity, scale,
            block.residual,
        )  # fmt: skip
        self._inertia.add_residual(block, gravity, scale)

    def _loop_data(
        self, kernel: Kernel, starts: FloatArray
    ) -> tuple[
        int, IntArray, bool, IndexArray, FloatArray, FloatArray, FloatArray, FloatArray, IntArray,
        FloatArray,
    ]:  # fmt: skip
        """What the loops over quadrature points take of the elements."""
        data = self.data
        return (
            kernel.address, kernel.offsets, data.vectors, data.nodes, self._tables,
            self._weights, starts, data.damping, data.section, self._material.data,
        )  # fmt: skip

    def tangent_into(
        self, block: FrameBlock, gravity: FloatArray, shifts: FloatArray, scale: float,
        values: FloatArray, strains: FloatArray | None = None, *, local: bool = False,
    ) -> None:  # fmt: skip
        """Write the matrices (m, 36 k k) ``scale (k K + C dv + M dw)``.

        ``shifts`` = (dv/dn, dw/dn, k), ``strains`` as in :meth:`add_residual`. With ``local`` the
        derivative K is that at fixed local velocities and accelerations. What belongs to a node
        alone is in the matrix of one of its elements.
        """
        by_v, by_w = np.empty((2, len(block.frames), 6, 6))
        step_rates(
            self._inertia.nodes, block.inertial_rates(shifts) and not local, block.increment,
            block.velocity, block.acceleration, shifts, by_v, by_w,
        )  # fmt: skip
        if shifts[0] == 0.0 and shifts[2] == 0.0:
            values[:] = 0.0
        else:
            tangent_into(
                *self._loop_data(self._kernels.tangent, self._starts_for(block.frames, strains)),
                block.frames, block.velocity, by_v, shifts[2], scale, values,
            )  # fmt: skip
        self._inertia.add_tangent(block, gravity, by_v, by_w, shifts[2], scale, values)

    def add_action(
        self, block: FrameBlock, gravity: FloatArray, shifts: FloatArray, scale: float,
        strains: FloatArray | None = None, *, local: bool = False,
    ) -> None:  # fmt: skip
        """Add ``scale`` times the same tangent applied to the block's step to its residual."""
        steps, dv, dw = np.empty((3, len(block.frames), 6))
        step_changes(
            self._inertia.nodes, block.inertial_rates(shifts) and not local, block.increment,
            block.velocity, block.acceleration, shifts, block.step, steps, dv, dw,
        )  # fmt: skip
        if shifts[0] != 0.0 or shifts[2] != 0.0:
            starts = self._starts_for(block.frames, strains)
            add_action(
                *self._loop_data(self._kernels.action, starts), block.frames, block.velocity,
                steps, dv, scale, block.residual,
            )  # fmt: skip
        self._inertia.add_action(block, gravity, steps, dv, dw, scale)

    def response(
        self, frames: FloatArray, at: IntArray, xi: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Strains and resultants (m, q, 6) of the given elements in section axes.

        Args:
            frames: (n, 12) frames of the nodes.
            at: (m,) the elements meant.
            xi: (q,) or (m, q) places in them, 0 to 1.
        """
        data, ones = self.data, np.ones(xi.shape[-1])
        cells = data.nodes[at]
        tables = points(data.shape[at], cells, self._start, xi, ones).tables
        starts = self._start_strains(tables, cells)
        velocity = np.zeros((len(frames), 6))
        strains = self._strains(tables, cells, starts, frames, velocity)[:, :, :6]
        strain = unlaned(strains, len(cells))
        section = np.repeat(self.data.section[at], strain.shape[1])
        resultant, _ = self._material.response(strain.reshape(-1, 6), section)
        return strain, resultant.reshape(strain.shape)

    def stretches(self, frames: FloatArray) -> FloatArray:
        """Least stretch (m,) at the quadrature points, along the normal of the section."""
        strain = unlaned(self._present(frames), len(self.data.nodes))
        stretched: FloatArray = 1.0 + strain[:, :, 0].min(axis=1)
        return stretched

    def energies(self, frames: FloatArray) -> FloatArray:
        """Strain energies (m,) of the elements, J."""
        strain = unlaned(self._present(frames), len(self.data.nodes))
        _, energy = self._material.response(strain.reshape(-1, 6), self._point_sections)
        return (energy.reshape(self.point_lengths.shape) * self.point_lengths).sum(axis=1)

    @property
    def _point_sections(self) -> IntArray:
        return np.repeat(self.data.section, self.point_lengths.shape[1])

    @property
    def viscous(self) -> bool:
        """Whether the elements resist the rate of their strain."""
        return self._material.viscous

    def viscosity(self, block: FrameBlock) -> tuple[FloatArray, FloatArray]:
        """Viscous stress resultants and strain rates (m q, 6) at the quadrature points."""
        both = unlaned(self._point_strains(block.frames, block.velocity), len(self.data.nodes))
        strain, rate = (np.ascontiguousarray(h) for h in np.split(both.reshape(-1, 12), 2, axis=1))
        damping = np.repeat(self.data.damping, self.point_lengths.shape[1])
        stress = self._material.viscous_stress(strain, rate, self._point_sections, damping)
        return stress, rate

    def add_motion(self, block: FrameBlock, chosen: BoolArray, motion: FloatArray) -> None:
        """Add energy and momenta of the chosen (m,) elements, see ``flexfem.core.motion``."""
        add_element_motion(
            self.data.nodes, chosen, self._masses.products, self._masses.weights,
            self.data.section, self._inertias, block.frames, block.velocity, motion,
        )  # fmt: skip
