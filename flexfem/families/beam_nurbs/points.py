# SPDX-License-Identifier: LGPL-3.0-or-later
"""Points of NURBS elements: their stiffness, and their strain without stress."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Protocol, Self

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.families.beam_nurbs.kernels import constant_data, put_starts
from flexfem.families.beam_nurbs.masses import ElementMasses
from flexfem.families.beam_nurbs.tables import Points
from flexfem.families.common.section_groups import (
    LinearMaterial,
    Material,
    upper_triangles,
    viscous_factors,
)
from flexfem.kernels.driver import Cells, plain_cells

__all__ = ["AlongBeam", "NurbsCells", "PointSet", "arcs_at"]


@dataclass(frozen=True)
class NurbsCells:
    """Constant data of elements of one degree p, k = p + 1.

    Attributes:
        nodes: (m, k) control points.
        body: (m,) number of the beam.
        section: (m,) number of the section.
        shape: (m, k, k) coefficients in powers of xi, from 0 to 1 in the element, of the weighted
            shape functions; the rational ones are these over their sum.
        damping: (m, 1) stiffness-proportional damping, s, or (m, 6) of each strain.
        vectors: True if they interpolate relative rotation vectors, False for quaternions.
        arc: (m, a) coefficients in powers of xi of the arc length from the beam's start, m; None
            if nothing is evaluated along it.
        stiffness: (m, p, 6, 6) that of the sections at the quadrature points; None if it is that of
            the section.
        masses: those of the elements, None if they are those of the section.
    """

    nodes: IntArray
    body: IntArray
    section: IntArray
    shape: FloatArray
    damping: FloatArray
    vectors: bool = False
    arc: FloatArray | None = None
    stiffness: FloatArray | None = None
    masses: ElementMasses | None = None

    def take(self, rows: IntArray) -> Self:
        """Some of the elements."""
        return replace(
            self,
            nodes=self.nodes[rows],
            body=self.body[rows],
            section=self.section[rows],
            shape=np.ascontiguousarray(self.shape[rows]),
            damping=self.damping[rows],
            arc=None if self.arc is None else self.arc[rows],
            stiffness=None if self.stiffness is None else self.stiffness[rows],
            masses=None if self.masses is None else self.masses.take(rows),
        )


class AlongBeam(Protocol):
    """What varies along one beam.

    Attributes:
        strained: True if it has initial strains; timed: True if they change with time.
    """

    @property
    def strained(self) -> bool:
        """See the class."""

    @property
    def timed(self) -> bool:
        """See the class."""

    def stiffness(self, at: FloatArray) -> FloatArray:
        """Stiffness (k, 6, 6) of the section at arc lengths (k,), m."""

    def rest(self, start: FloatArray, at: FloatArray) -> FloatArray:
        """Strains (k, 6) without stress, less those that change, from those at the start (k, 6)."""

    def change(self, at: FloatArray, time: float) -> FloatArray:
        """Initial strains (k, 6) that change with time, s."""


class PointSet:
    """Some points, as many in each of some elements.

    Attributes:
        at: shape functions at the points.
        cells: the elements in the format of the kernel driver; own data are the damping.
        start: (m, q, 6) strains of the initial configuration, with none subtracted.
        rest: (m, q, 6) present strains without stress.
    """

    def __init__(
        self, data: NurbsCells, xi: FloatArray, at: Points, material: Material,
        along: Mapping[int, AlongBeam], stiffness: FloatArray | None = None,
    ) -> None:  # fmt: skip
        """Prepare the points, from whose strains none are subtracted before :meth:`begin`.

        Args:
            data: the elements that they are in.
            xi: (q,) or (m, q) coordinates of points in them.
            at: shape functions at the points.
            material: that of the elements' sections.
            along: by number of the beam, what varies along it.
            stiffness: (m, q, 6, 6) of the points if it is known; otherwise it is evaluated.
        """
        m, q = at.lengths.shape
        self.at, self._data, self._material = at, data, material
        self._arcs = np.zeros((m, q)) if data.arc is None else arcs_at(data.arc, xi)
        bodies = np.unique(data.body).tolist()
        self._along = [(data.body == b, along[b]) for b in bodies if b in along]
        self._own = np.empty((m, q, 0))
        self._law: Material = material
        self._rows = np.repeat(data.section, q)
        if data.stiffness is not None:
            matrices = self._stiffness() if stiffness is None else stiffness
            self._own, matrices = upper_triangles(matrices), matrices.reshape(-1, 6, 6)
            self._law = LinearMaterial(matrices, np.zeros_like(matrices), material.damped)
            self._rows = np.arange(m * q)
        self.start = self.rest = self._constant = np.zeros((m, q, 6))
        self._instant: tuple[float, float] | None = None
        self.cells = self.resting_at(self.rest)

    def _stiffness(self) -> FloatArray:
        """Stiffness (m, q, 6, 6) of the sections at the points."""
        found = np.empty((*self._arcs.shape, 6, 6))
        for rows, along in self._along:
            found[rows] = along.stiffness(self._arcs[rows].ravel()).reshape(found[rows].shape)
        return found

    def begin(self, start: FloatArray, instant: tuple[float, float]) -> None:
        """Take strains at the start, and set initial strains as :meth:`set_initial_strains`."""
        self.start, self._constant = start, start.copy()
        for rows, along in self._along:
            if along.strained:
                own = along.rest(start[rows].reshape(-1, 6), self._arcs[rows].ravel())
                self._constant[rows] = own.reshape(start[rows].shape)
        self.set_initial_strains(instant)

    def set_initial_strains(self, instant: tuple[float, float]) -> None:
        """Set initial strains at a time, s, and the fraction of them that is there."""
        if instant == self._instant:
            return
        self._instant, (t, fraction) = instant, instant
        self.rest = self._constant.copy()
        for rows, along in self._along:
            if along.timed:
                change = along.change(self._arcs[rows].ravel(), t)
                self.rest[rows] += change.reshape(self.rest[rows].shape)
        if fraction != 1.0:
            self.rest = self.start + fraction * (self.rest - self.start)
        put_starts(self.cells.corners, self._data.nodes.shape[1], self.rest)

    def resting_at(self, rest: FloatArray) -> Cells:
        """The elements with other strains (m, q, 6) without stress."""
        data = self._data
        return plain_cells(
            viscous_factors(data.damping), data.nodes.astype(np.int32),
            constant_data(self.at, rest, self._own), data.section, self._material.data,
        )  # fmt: skip

    def response(self, strain: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Stress resultants (m, q, 6) and energies per length (m, q) of strains (m, q, 6)."""
        resultant, energy = self._law.response(strain.reshape(-1, 6), self._rows)
        return resultant.reshape(strain.shape), energy.reshape(strain.shape[:2])

    def viscous_stress(self, strain: FloatArray, rate: FloatArray) -> FloatArray:
        """Stress resultants (m q, 6) that strain rates (m q, 6) add to those of strains."""
        damping = np.repeat(self._data.damping, self.at.lengths.shape[1], axis=0)
        return self._law.viscous_stress(strain, rate, self._rows, damping)


def arcs_at(arc: FloatArray, xi: FloatArray) -> FloatArray:
    """Arc lengths (m, q), m, of points (q,) or (m, q) from their polynomials (m, a) in xi."""
    powers = np.asarray(xi)[..., np.newaxis] ** np.arange(arc.shape[1])
    if powers.ndim == 2:
        return arc @ powers.T
    found: FloatArray = np.einsum("mqa,ma->mq", powers, arc)
    return found
