# SPDX-License-Identifier: LGPL-3.0-or-later
"""NURBS elements of one degree and one material: their data and the calls of the compiled loops."""

from dataclasses import dataclass

from mpi4py import MPI

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.families.beam_nurbs.inertia import step_changes, step_rates
from flexfem.families.beam_nurbs.loops import (
    NurbsElements,
    PointKernel,
    add_action,
    add_residual,
    point_strains,
)
from flexfem.families.beam_nurbs.masses import NurbsMasses
from flexfem.families.beam_nurbs.motion import MassiveElements, add_element_motion
from flexfem.families.beam_nurbs.tables import Points, gauss, masses, points
from flexfem.families.beam_nurbs.tangent import tangent_into
from flexfem.families.common.section_groups import Material, symmetric
from flexfem.forms.nurbs_beam import nurbs_forms, strain_form
from flexfem.kernels.form_kernels import compile_forms
from flexfem.kernels.lanes import LANES, lanes, unlaned

__all__ = ["NurbsCells", "NurbsGroup", "NurbsKernels"]

_ALL = slice(None)


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
        forces = compile_forms(
            comm, nurbs_forms, arguments, {"residual": True, "tangent": True, "action": True}
        )
        strains = compile_forms(comm, strain_form, (vectors,), {"strain": True})
        self.residual, self.tangent, self.action, self.strain = (
            PointKernel(address=kernel.address, offsets=kernel.offsets)
            for kernel in (*forces.kernels.values(), strains["strain"])
        )


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
        self._elements = self._with_points(at)
        self._starts = self._start_strains(self._elements)
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

    def _with_points(self, at: Points, chosen: IntArray | slice = _ALL) -> NurbsElements:
        """Chosen elements with points in them."""
        data = self.data
        return NurbsElements(
            vectors=data.vectors, nodes=data.nodes[chosen], tables=at.tables,
            weights=lanes(at.lengths), damping=data.damping[chosen], section=data.section[chosen],
            sections=self._material.data,
        )  # fmt: skip

    def _start_strains(self, elements: NurbsElements) -> FloatArray:
        """Strains (b, q, 6, LANES) of the initial configuration, with none subtracted."""
        shape, rest = elements.tables.shape[:2], np.zeros((len(self._start), 6))
        nothing = np.zeros((*shape, 6, LANES))
        return self._strains(elements, nothing, self._start, rest)[:, :, :6].copy()

    def _strains(
        self, elements: NurbsElements, starts: FloatArray, frames: FloatArray, velocity: FloatArray
    ) -> FloatArray:
        """Strains and their rates (b, q, 12, LANES)."""
        strains = np.empty((*elements.tables.shape[:2], 12, LANES))
        kernel = self._kernels.strain
        point_strains(kernel.memory, elements.memory, starts, frames, velocity, strains)
        return strains

    def _point_strains(self, frames: FloatArray, velocity: FloatArray) -> FloatArray:
        """Strains and their rates (b, q, 12, LANES) at the quadrature points."""
        return self._strains(self._elements, self._starts, frames, velocity)

    def _present(self, frames: FloatArray) -> FloatArray:
        """Strains (b, q, 6, LANES) at the quadrature points."""
        return self._point_strains(frames, np.zeros((len(frames), 6)))[:, :, :6]

    def _starts_for(self, frames: FloatArray, strains: FloatArray | None) -> FloatArray:
        """Initial strains for which the present strains are the given ones."""
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
        """Zero strains (b, q, 6, LANES), for which the stresses are zero."""
        return np.zeros_like(self._starts)

    def add_residual(
        self, block: FrameBlock, gravity: FloatArray, scale: float,
        strains: FloatArray | None = None,
    ) -> None:  # fmt: skip
        """Add ``scale`` times internal, inertia and gravity forces to the block's residual.

        ``strains`` are those of :meth:`continued_strains`, None for the present ones.
        """
        starts = self._starts_for(block.frames, strains)
        kernel, elements = self._kernels.residual, self._elements
        add_residual(kernel.memory, elements.memory, starts, block.nodes.memory, scale)
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
            tangent_into(
                self._kernels.tangent.memory, self._elements.memory,
                self._starts_for(block.frames, strains), block.nodes.memory, rates[0], factors,
                values,
            )  # fmt: skip
        self._inertia.add_tangent(block, gravity, rates, factors, values)

    def add_action(
        self, block: FrameBlock, gravity: FloatArray, shifts: FloatArray, scale: float,
        strains: FloatArray | None = None, *, local: bool = False,
    ) -> None:  # fmt: skip
        """Add ``scale`` times the same tangent applied to the block's step to its residual."""
        nodes = block.nodes.memory
        step_changes(self._inertia.nodes, nodes, shifts, block.inertial_rates(shifts) and not local)
        if shifts[0] != 0.0 or shifts[2] != 0.0:
            starts = self._starts_for(block.frames, strains)
            kernel, elements = self._kernels.action, self._elements
            add_action(kernel.memory, elements.memory, starts, nodes, scale)
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
        elements, velocity = self._with_points(there, at), np.zeros((len(frames), 6))
        starts = self._start_strains(elements)
        strains = self._strains(elements, starts, frames, velocity)[:, :, :6]
        strain = unlaned(strains, len(at))
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
        """True if the material of the elements is viscous."""
        return self._material.viscous

    def viscosity(self, block: FrameBlock) -> tuple[FloatArray, FloatArray]:
        """Viscous stress resultants and strain rates (m q, 6) at the quadrature points."""
        both = unlaned(self._point_strains(block.frames, block.velocity), len(self.data.nodes))
        strain, rate = (np.ascontiguousarray(h) for h in np.split(both.reshape(-1, 12), 2, axis=1))
        damping = np.repeat(self.data.damping, self.point_lengths.shape[1])
        stress = self._material.viscous_stress(strain, rate, self._point_sections, damping)
        return stress, rate

    def add_motion(self, block: FrameBlock, chosen: BoolArray, motion: FloatArray) -> None:
        """Add energy and momenta of the chosen (m,) elements, see ``flexfem.core.nodes.motion``."""
        add_element_motion(self._massive.memory, chosen, block.nodes.memory, motion)
