# SPDX-License-Identifier: LGPL-3.0-or-later
"""NURBS elements of one degree and one material: their data and the calls of the kernels."""

from collections.abc import Mapping

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
    element_kernel,
    forces,
    strains,
)
from flexfem.families.beam_nurbs.masses import ElementMasses, NurbsMasses
from flexfem.families.beam_nurbs.points import AlongBeam, NurbsCells, PointSet
from flexfem.families.beam_nurbs.tables import gauss, masses, points
from flexfem.families.beam_nurbs.tangent import tangent
from flexfem.families.common.section_groups import Material, symmetric
from flexfem.forms.nurbs_beam import nurbs_forms, strain_form
from flexfem.kernels.by_hand import ByHand
from flexfem.kernels.driver import Cells
from flexfem.kernels.form_kernels import compile_forms
from flexfem.kernels.records import Float2D, Record

__all__ = ["NurbsGroup", "NurbsKernels"]

_NO_TWISTS, _NO_CHANGES = np.empty((0, 6)), np.empty((0, 36))


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
        lengths: (m,) arc lengths at the start, m.
        point_lengths: (m, q) arc length that each quadrature point stands for, m.
    """

    def __init__(
        self, kernels: NurbsKernels, data: NurbsCells, material: Material, start: FloatArray,
        along: Mapping[int, AlongBeam],
    ) -> None:  # fmt: skip
        """Prepare the elements.

        Args:
            kernels: kernels of the material.
            data: constant data of this rank's elements.
            material: their material.
            start: (n, 12) frames of this rank's nodes at the start.
            along: by number of the beam, what varies along it.
        """
        self.data, self._material, self._kernels, self._start = data, material, kernels, start
        self._along, k = along, data.nodes.shape[1]
        self._made: dict[tuple[str, int], ElementKernel] = {}
        self._moved = _Moved(frames=start, velocity=_NO_TWISTS, by_velocity=_NO_CHANGES)
        self._instant = 0.0, 1.0
        # as many points as the degree: exact enough for its order, and slender elements do not lock
        self._points = self._point_set(data, *gauss(k - 1), data.stiffness)
        self.point_lengths = self._points.at.lengths
        integrals = masses(data.shape, data.nodes, start)
        self.lengths, own = integrals.lengths, data.masses
        if own is None:
            inertias = symmetric(material.data[:, :21])
            own = ElementMasses.uniform(integrals, inertias, data.section)
        self._inertia = NurbsMasses(data.nodes, own, len(start))

    def _point_set(
        self, data: NurbsCells, xi: FloatArray, weights: FloatArray,
        stiffness: FloatArray | None = None,
    ) -> PointSet:  # fmt: skip
        """Points (q,) or (m, q) in some elements, with weights (q,)."""
        at = points(data.shape, data.nodes, self._start, xi, weights)
        found = PointSet(data, xi, at, self._material, self._along, stiffness)
        rest = np.zeros((len(self._start), 6))
        found.begin(self._strains(found, self._start, rest)[:, :, :6], self._instant)
        return found

    @property
    def cells(self) -> Cells:
        """The elements in the format of the kernel driver; own data are the damping."""
        return self._points.cells

    def set_initial_strains(self, t: float, fraction: float) -> None:
        """See :class:`flexfem.layout.elements.StrainedElements`."""
        self._instant = t, fraction
        self._points.set_initial_strains(self._instant)

    def eigenstate(self, frames: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Stresses, and strains without stress times lengths (m q, 6), at the quadrature points."""
        resultant, _ = self._points.response(self._present(frames))
        resting = self._points.rest * self.point_lengths[:, :, np.newaxis]
        return resultant.reshape(-1, 6), resting.reshape(-1, 6)

    def _kernel(self, name: str, points: int | None = None) -> ElementKernel:
        """A kernel at some points, the quadrature points by default; compiled at the first call."""
        data, k = self.data, self.data.nodes.shape[1]
        q = k - 1 if points is None else points
        if (name, q) not in self._made:
            results = {"residual": 6 * k, "tangent": 36 * k * k, "action": 6 * k, "strain": 12 * q}
            by_hand, record, more = _KERNELS[name]
            stiffness = 0 if data.stiffness is None else 21
            widths = data.damping.shape[1], self._material.data.shape[1], stiffness
            self._made[name, q] = element_kernel(
                by_hand, getattr(self._kernels, name), (k, q, results[name]), record, more,
                widths=widths, vectors=data.vectors,
            )  # fmt: skip
        return self._made[name, q]

    def _strains(self, points: PointSet, frames: FloatArray, velocity: FloatArray) -> FloatArray:
        """Strains and their rates (m, q, 12) at points of some elements."""
        m, q = points.at.lengths.shape
        found = np.empty((m, 12 * q))
        self._kernel("strain", q).write(points.cells, self._at(frames, velocity), found)
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
        return self._strains(self._points, frames, velocity)

    def _present(self, frames: FloatArray) -> FloatArray:
        """Strains (m, q, 6) at the quadrature points."""
        return self._point_strains(frames, np.zeros((len(frames), 6)))[:, :, :6]

    def _cells_at(self, block: FrameBlock, strains: FloatArray | None) -> Cells:
        """Elements for whose initial strains the present strains are the given ones."""
        if strains is None:
            return self.cells
        own = self._points
        return own.resting_at(own.rest + self._present(block.frames) - strains)

    def continued_strains(self, frames: FloatArray, steps: FloatArray) -> FloatArray:
        """Strains (m, q, 6) continued linearly along local twists ``steps`` of the nodes.

        See ``BeamGroup.continued_strains``; here the stresses at the quadrature points are the
        unknowns.
        """
        strains = self._point_strains(frames, steps)
        return strains[:, :, :6] + strains[:, :, 6:]

    def integrated_stresses(self, strains: FloatArray) -> FloatArray:
        """Stress resultants (m, q, 6) of strains (m, q, 6) times the lengths of the points."""
        return self._points.response(strains)[0] * self.point_lengths[:, :, np.newaxis]

    def unstressed(self) -> FloatArray:
        """Zero strains (m, q, 6), for which the stresses are zero."""
        return np.zeros_like(self._points.rest)

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

    def points_at(self, at: IntArray, xi: FloatArray) -> PointSet:
        """Points (q,) or (m, q), 0 to 1, in the elements of given numbers (m,)."""
        return self._point_set(self.data.take(at), xi, np.ones(xi.shape[-1]))

    def response(self, frames: FloatArray, points: PointSet) -> tuple[FloatArray, FloatArray]:
        """Strains and resultants (m, q, 6) at points of :meth:`points_at`, in section axes.

        Args:
            frames: (n, 12) frames of the nodes.
            points: the points.
        """
        points.set_initial_strains(self._instant)
        strain = self._strains(points, frames, np.zeros((len(frames), 6)))[:, :, :6]
        return strain, points.response(strain)[0]

    def stretches(self, frames: FloatArray) -> FloatArray:
        """Least stretch (m,) at the quadrature points, along the normal of the section."""
        strain = self._present(frames)
        stretched: FloatArray = 1.0 + strain[:, :, 0].min(axis=1)
        return stretched

    def energies(self, frames: FloatArray) -> FloatArray:
        """Strain energies (m,) of the elements, J."""
        _, energy = self._points.response(self._present(frames))
        return (energy * self.point_lengths).sum(axis=1)

    @property
    def viscous(self) -> bool:
        """True if the material of the elements is viscous."""
        return self._material.viscous

    def viscosity(self, block: FrameBlock) -> tuple[FloatArray, FloatArray]:
        """Viscous stress resultants and strains (m q, 6) at the quadrature points."""
        both = self._point_strains(block.frames, block.velocity)
        strain, rate = (np.ascontiguousarray(h) for h in np.split(both.reshape(-1, 12), 2, axis=1))
        stress = self._points.viscous_stress(strain, rate)
        return stress, strain + self._points.rest.reshape(-1, 6)

    def add_motion(self, block: FrameBlock, chosen: BoolArray, motion: FloatArray) -> None:
        """Add energy and momenta of the chosen (m,) elements, see ``flexfem.core.nodes.motion``."""
        self._inertia.add_motion(block, chosen, motion)
