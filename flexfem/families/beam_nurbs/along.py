# SPDX-License-Identifier: LGPL-3.0-or-later
"""What varies along NURBS beams, as isogeometric elements take it: values at points.

The stiffness is that of the section at each quadrature point, so that deflections converge with the
order of uniform beams where it is smooth. Where a table jumps inside an element, each of its points
stands for a part of it as long as the point's weight: the compliances of what is on both sides of
the jump there are added. Masses are integrals between the ends of elements and the stations of
tables. The twist is in the frames of the control points, strains without stress are those at the
points.
"""

from dataclasses import dataclass

import numpy as np

from flexfem._fields import owner_of
from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.families.beam_nurbs.masses import ElementMasses
from flexfem.families.beam_nurbs.points import arcs_at
from flexfem.families.beam_nurbs.tables import gauss, shape_functions
from flexfem.families.common.along import (
    called_section,
    present_prestrains,
    prestrains,
    rest_curvatures,
    table_stiffness,
)
from flexfem.layout.lines import arc_cuts
from flexfem.materials.section import Section
from flexfem.materials.section_table import SectionTable
from flexfem.mesh.nurbs.elements import NurbsElements
from flexfem.model.bodies.basic import Beam

__all__ = ["CurveSection", "VaryingSection", "whole_arcs"]

#: Gauss points for masses between two kinks of what varies, at least; two more than nodes.
_POINTS = 8


@dataclass(frozen=True)
class CurveSection:
    """See :class:`flexfem.families.beam_nurbs.points.AlongBeam`.

    Attributes:
        beam: the beam; length: its length, m.
    """

    beam: Beam
    length: float

    @property
    def strained(self) -> bool:
        """See the protocol."""
        return self.beam.strained

    @property
    def timed(self) -> bool:
        """See the protocol."""
        return self.beam.timed

    @property
    def unit(self) -> float:
        """Unit of the stations of a table, m.

        Raises:
            ValueError: it ends elsewhere than the beam.
        """
        assert isinstance(self.beam.section, SectionTable)
        return self.beam.section.scale(owner_of(self.beam), self.length)

    def at(self, s: float) -> Section:
        """Section at an arc length, m.

        Raises:
            TypeError: a function of the section returns no Section.
            ValueError: it fails, or returns a section with a law of its own; or as :attr:`unit`.
        """
        section = self.beam.section
        if isinstance(section, Section):
            return section
        if isinstance(section, SectionTable):
            stiffness, inertia = (found[0] for found in section.at(np.array([s / self.unit])))
            return Section(stiffness, inertia, section.outline_at(s / self.unit))
        return called_section(owner_of(self.beam), section, s)

    def matrices(self, at: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Stiffness and inertia (k, 6, 6) at arc lengths (k,), m; raises as :meth:`at`."""
        if isinstance(self.beam.section, SectionTable):
            return self.beam.section.at(at / self.unit)
        found = [self.at(s) for s in at.tolist()]
        stiffness = np.array([one.stiffness for one in found]).reshape(-1, 6, 6)
        return stiffness, np.array([one.inertia for one in found]).reshape(-1, 6, 6)

    def stiffness(self, at: FloatArray) -> FloatArray:
        """See the protocol; raises as :meth:`at`."""
        return self.matrices(at)[0]

    def rest(self, start: FloatArray, at: FloatArray) -> FloatArray:
        """See the protocol.

        Raises:
            TypeError: a function along the beam does not return numbers.
            ValueError: it fails or returns something else.
        """
        rest = start.copy()
        if self.beam.rest_curvature is not None:
            rest[:, 3:] = rest_curvatures(self.beam, at)
        if self.beam.prestrain is not None and not self.timed:
            rest += prestrains(self.beam, at, 0.0)
        return rest

    def change(self, at: FloatArray, time: float) -> FloatArray:
        """See the protocol, and ``present_prestrains``."""
        return present_prestrains(self.beam, at, time)

    def check(self, at: FloatArray) -> None:
        """Evaluate initial strains at arc lengths (k,), which fails on all ranks alike."""
        self.rest(np.zeros((len(at), 6)), at)
        if self.timed:
            prestrains(self.beam, at, 0.0)


@dataclass(frozen=True)
class VaryingSection:
    """Section along all elements of a beam.

    Attributes:
        stiffness: (m, p, 6, 6) at the quadrature points.
        masses: of the elements.
        cell, xi, lengths: (n,) element of each point for integrals of masses, its place there, and
            the length it stands for, m; inertias: (n, 6, 6) at these points.
    """

    stiffness: FloatArray
    masses: ElementMasses
    cell: IntArray
    xi: FloatArray
    lengths: FloatArray
    inertias: FloatArray

    @classmethod
    def of(cls, section: CurveSection, parts: NurbsElements) -> "VaryingSection":
        """Evaluate a section that varies along the elements of its beam.

        Raises:
            TypeError: as :meth:`CurveSection.at`.
            ValueError: as :meth:`CurveSection.at`.
        """
        cell, xi, lengths, at = _mass_points(section, parts)
        inertias = section.matrices(at)[1]
        functions = shape_functions(parts.shape[cell], xi[:, np.newaxis])[0][:, 0]
        return cls(
            _point_stiffness(section, parts),
            ElementMasses.varying(parts.nodes, cell, functions, inertias, lengths),
            cell, xi, lengths, inertias,
        )  # fmt: skip


def _point_stiffness(section: CurveSection, parts: NurbsElements) -> FloatArray:
    """Stiffness (m, p, 6, 6) at the quadrature points of all elements."""
    m, k = parts.nodes.shape
    xi, weights = gauss(k - 1)
    arc = whole_arcs(parts)
    found = section.stiffness(arcs_at(arc, xi).ravel()).reshape(m, k - 1, 6, 6)
    table = section.beam.section
    if isinstance(table, SectionTable):
        jumps = section.unit * table.jumps
        ends = arcs_at(arc, np.append(0.0, np.cumsum(weights)))
        for e in np.flatnonzero(_inside(jumps, ends)):
            found[e] = table_stiffness(table, section.unit, ends[e])
    return found


def _inside(places: FloatArray, ends: FloatArray) -> BoolArray:
    """Return True (m,) for elements with a place between their ends; ``ends`` (m, j) arcs, m."""
    first, last = ends[:, :1], ends[:, -1:]
    margin = 1e-9 * (last - first)
    found: BoolArray = ((places > first + margin) & (places < last - margin)).any(axis=1)
    return found


def _mass_points(
    section: CurveSection, parts: NurbsElements
) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
    """Element, place in it, length (m) and arc length (m), (n,) each, of points for masses."""
    m, k = parts.nodes.shape
    kinks, table = np.empty(0), section.beam.section
    if isinstance(table, SectionTable):
        kinks = section.unit * np.unique(table.stations)
    starts = np.cumsum(parts.lengths) - parts.lengths
    cuts = [np.array(arc_cuts(parts.arc[e], kinks - starts[e])) for e in range(m)]
    cell = np.repeat(np.arange(m), [len(own) - 1 for own in cuts])
    low = np.concatenate([own[:-1] for own in cuts])
    size = np.concatenate([np.diff(own) for own in cuts])
    at, weights = gauss(max(_POINTS, k + 2))
    xi = low[:, np.newaxis] + size[:, np.newaxis] * at
    powers = np.arange(1, parts.arc.shape[1])
    speed = arcs_at(powers * parts.arc[cell, 1:], xi)
    lengths = size[:, np.newaxis] * weights * speed
    arcs = arcs_at(whole_arcs(parts)[cell], xi)
    return np.repeat(cell, len(at)), xi.ravel(), lengths.ravel(), arcs.ravel()


def whole_arcs(parts: NurbsElements) -> FloatArray:
    """Polynomials (m, a) in powers of xi of the arc length from the beam's start, m."""
    arc = parts.arc.copy()
    arc[:, 0] += np.cumsum(parts.lengths) - parts.lengths
    return arc
