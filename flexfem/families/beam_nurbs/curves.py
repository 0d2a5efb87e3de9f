# SPDX-License-Identifier: LGPL-3.0-or-later
"""Serial data of all NURBS beams of a model: control points numbered along the curves."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from flexfem._fields import owner_of
from flexfem._types import FloatArray, IntArray
from flexfem.core.inertia import inertia_about
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.core.places.line_points import NURBS as NURBS_ELEMENT
from flexfem.core.places.line_points import NURBS_VECTORS, find_jacobian
from flexfem.core.runs import starts
from flexfem.families.beam_nurbs.along import CurveSection, VaryingSection, whole_arcs
from flexfem.families.beam_nurbs.points import arcs_at
from flexfem.families.beam_nurbs.tables import gauss
from flexfem.families.common.along import Walls, end_walls, refuse_large_twists, twists_at
from flexfem.families.common.initial_velocities import initial_velocities
from flexfem.layout.lines import Line
from flexfem.materials.section import Section
from flexfem.materials.section_table import SectionTable
from flexfem.mesh.nurbs.basis import greville
from flexfem.mesh.nurbs.curve import NurbsCurve
from flexfem.mesh.nurbs.elements import NurbsElements
from flexfem.mesh.nurbs.frames import control_frames
from flexfem.model.bodies.basic import Beam
from flexfem.model.model import Model

__all__ = ["NurbsLines", "elements_on_rank", "segments"]

#: Segments as which pictures show an element of degree two and more; linear elements are straight.
_SEGMENTS = 4
#: Gauss points for integrals over an element: they are evaluated at set-up only.
_FINE = 16


@dataclass(frozen=True, eq=False)
class NurbsLines:
    """Control points and elements of all NURBS beams, beam after beam, the same on every rank.

    Attributes:
        beams: the beams; ``numbers``: their numbers in the model.
        parts: elements of each beam; their nodes are numbers of the control points of its curve.
        first_node, first_cell: (n + 1,) first control point and first element of each beam.
        frames, velocities: (c, 12) and (c, 6) of the control points at the start.
        body_of_node: (c,) number of the beam in the model.
        sections: the beams' different sections, that in its middle of a beam along which it varies;
            ``section``: the number of that of each beam; ``owners``: their names in messages.
        along: what each beam has along it.
        varying: sections of the elements of each beam; None where they do not vary.
    """

    beams: list[Beam]
    numbers: IntArray
    parts: list[NurbsElements]
    first_node: IntArray
    first_cell: IntArray
    frames: FloatArray
    velocities: FloatArray
    body_of_node: IntArray
    sections: list[Section]
    section: IntArray
    owners: list[str]
    along: list[CurveSection]
    varying: list[VaryingSection | None]

    @classmethod
    def of(cls, model: Model) -> "NurbsLines":
        """Data of a model with NURBS beams.

        Raises:
            TypeError: A function along a beam returns something of the wrong type.
            ValueError: It fails or returns something unusable, a table ends elsewhere than its
                beam, or frames rotate too much inside an element.
        """
        beams = model.beams_of("nurbs")
        curves = [model.curve(beam) for beam in beams]
        along = [CurveSection(b, c.length) for b, c in zip(beams, curves, strict=True)]
        frames = [_frames(beam, curve) for beam, curve in zip(beams, curves, strict=True)]
        places = {id(beam): number for number, beam in enumerate(model.beams)}
        numbers = np.array([places[id(beam)] for beam in beams], dtype=np.int64)
        parts = [curve.elements for curve in curves]
        nodes = [len(f) for f in frames]
        sections, section = _numbered(along)
        own = zip(along, parts, strict=True)
        return cls(
            beams=beams,
            numbers=numbers,
            parts=parts,
            first_node=starts(nodes),
            first_cell=starts([len(p.nodes) for p in parts]),
            frames=np.concatenate(frames),
            velocities=np.concatenate(
                [initial_velocities(b, f) for b, f in zip(beams, frames, strict=True)]
            ),
            body_of_node=np.repeat(numbers, nodes),
            sections=sections,
            section=section,
            owners=[owner_of(beams[section.tolist().index(i)]) for i in range(len(sections))],
            along=along,
            varying=[_varying(one, elements) for one, elements in own],
        )

    def index(self, name: str) -> int:
        """Number of a beam among the NURBS beams.

        Raises:
            ValueError: there is none of this name.
        """
        if name not in self._by_name:
            raise ValueError(f'no NURBS beam "{name}"')
        return self._by_name[name]

    @cached_property
    def _by_name(self) -> dict[str, int]:
        return {beam.name: i for i, beam in enumerate(self.beams)}

    def kind(self, beam: int) -> tuple[int, bool, bool]:
        """Number of nodes of a beam's elements, True for rotation vectors, True if it varies.

        Elements are grouped by these.
        """
        given = self.beams[beam]
        return self.parts[beam].nodes.shape[1], given.vectors, given.varies

    def middle_section(self, beam: int) -> Section:
        """Section of a beam, that in its middle if it varies."""
        return self.sections[int(self.section[beam])]

    @property
    def walls(self) -> list[Walls]:
        """Boundaries at both ends of the sections that :meth:`drawn` numbers."""
        return self._drawn[0]

    def drawn(self, beam: int, elements: IntArray) -> IntArray:
        """Numbers in :attr:`walls` of the segments of some elements of a beam."""
        number = segments(self.parts[beam].nodes.shape[1])
        step = number if self.beams[beam].varies else 0
        inside = np.arange(number) * bool(step)
        found: IntArray = self._drawn[1][beam] + step * elements[:, np.newaxis] + inside
        return found.ravel()

    @cached_property
    def _drawn(self) -> tuple[list[Walls], IntArray]:
        """Walls, and the first of each beam."""
        walls: list[Walls] = [(one.walls, one.walls) for one in self.sections]
        first = self.section.copy()
        for i, beam in enumerate(self.beams):
            if beam.varies:
                first[i] = len(walls)
                walls += end_walls(beam, self._segment_ends(i))
        return walls, first

    def _segment_ends(self, beam: int) -> FloatArray:
        """Arc lengths of the ends of all segments of a beam, m."""
        parts = self.parts[beam]
        number = segments(parts.nodes.shape[1])
        return np.append(0.0, arcs_at(whole_arcs(parts), np.arange(1, number + 1) / number))

    def by_kind(self) -> list[int]:
        """Numbers of the beams in the order in which elements are grouped."""
        return sorted(range(len(self.beams)), key=self.kind)

    def element(self, beam: int) -> int:
        """Return the kind of interpolation of frames along a beam.

        See ``core.places.line_points``.
        """
        return NURBS_VECTORS if self.beams[beam].vectors else NURBS_ELEMENT

    def nodes(self, beam: int) -> IntArray:
        """(m, k) control points of a beam's elements, numbered among all."""
        numbers: IntArray = self.first_node[beam] + self.parts[beam].nodes
        return numbers

    def gauss(self, beam: int) -> tuple[FloatArray, FloatArray]:
        """Gauss points (q,), as many as nodes, in the elements of a beam, and lengths (m, q), m."""
        return self._points(beam, self.parts[beam].nodes.shape[1])

    def integrals(self, beam: int) -> FloatArray:
        """(m, k) integrals of the shape functions along the elements of a beam, m."""
        xi, lengths = self._points(beam, _FINE)
        shape = self.parts[beam].shape
        values = np.einsum("qj,mij->mqi", xi[:, np.newaxis] ** np.arange(shape.shape[-1]), shape)
        values /= values.sum(axis=-1, keepdims=True)
        total: FloatArray = np.einsum("mq,mqi->mi", lengths, values)
        return total

    def inertia(self, beam: int, origin: FloatArray) -> FloatArray:
        """Inertia matrix (6, 6) of a beam at the start about a frame (12,)."""
        nodes, shape, element = self.nodes(beam), self.parts[beam].shape, self.element(beam)
        cell, at, lengths, inertia = self._masses(beam)
        frames, jacobian = np.empty((len(cell), 12)), np.empty((6, 6 * nodes.shape[1] + 1))
        for k, (e, xi) in enumerate(zip(cell.tolist(), at.tolist(), strict=True)):
            own = np.ascontiguousarray(self.frames[nodes[e]])
            find_jacobian(element, own, shape[e], xi, frames[k], jacobian)
        return inertia_about(origin, frames, inertia, lengths)

    def _masses(self, beam: int) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
        """Element, place in it and length (n,) of points for masses, and inertia there."""
        varying = self.varying[beam]
        if varying is not None:
            return varying.cell, varying.xi, varying.lengths, varying.inertias
        xi, lengths = self._points(beam, _FINE)
        cell = np.repeat(np.arange(len(lengths)), len(xi))
        inertia = self.beams[beam].uniform.inertia
        return cell, np.tile(xi, len(lengths)), lengths.ravel(), inertia

    def _points(self, beam: int, count: int) -> tuple[FloatArray, FloatArray]:
        at, weights = np.polynomial.legendre.leggauss(count)
        xi, arc = 0.5 * (at + 1.0), self.parts[beam].arc
        power = np.arange(1, arc.shape[1])
        speed = (arc[:, 1:] * power) @ (xi ** (power[:, np.newaxis] - 1))
        return xi, 0.5 * weights * speed

    def line(self, beam: int, kind: int) -> Line:
        """Elements of a beam whose family has the number ``kind``."""
        parts = self.parts[beam]
        return Line(
            kind=kind,
            nodes=self.nodes(beam),
            cells=np.arange(self.first_cell[beam], self.first_cell[beam + 1]),
            shape=parts.shape,
            turns=None,
            starts=np.cumsum(parts.lengths) - parts.lengths,
            arc=parts.arc,
            element=self.element(beam),
        )


def elements_on_rank(curves: NurbsLines, block: FrameBlock) -> list[IntArray]:
    """Numbers along each beam of the elements on this rank."""
    return [
        np.flatnonzero(block.owned_index(curves.nodes(beam)[:, -1]) >= 0)
        for beam in range(len(curves.beams))
    ]


def segments(nodes: int) -> int:
    """Straight segments as which pictures show an element of some nodes."""
    return 1 if nodes == 2 else _SEGMENTS


def _frames(beam: Beam, curve: NurbsCurve) -> FloatArray:
    """Frames (c, 12) of the control points of a beam at the start."""
    twists = None
    if beam.twist is not None or isinstance(beam.section, SectionTable):
        arcs = curve.arc_length(greville(curve.degree, curve.knots))
        twists = twists_at(beam, arcs, curve.length)
        refuse_large_twists(beam, twists[curve.elements.nodes])
    try:
        return control_frames(curve, beam.orientation, beam.vectors, twists)
    except ValueError as error:
        raise ValueError(f"{owner_of(beam)}: {error}") from None


def _numbered(along: Sequence[CurveSection]) -> tuple[list[Section], IntArray]:
    """Different sections of beams, and the number of that of each."""
    found: list[Section] = []
    known: dict[int, int] = {}
    numbers = []
    for one in along:
        key = id(one.beam if one.beam.varies else one.beam.section)
        if key not in known:
            known[key] = len(found)
            found.append(one.at(0.5 * one.length))
        numbers.append(known[key])
    return found, np.array(numbers, dtype=np.int64)


def _varying(along: CurveSection, parts: NurbsElements) -> VaryingSection | None:
    """Sections along a beam, if they vary; checks its initial strains."""
    if along.strained:
        xi, _ = gauss(parts.nodes.shape[1] - 1)
        along.check(arcs_at(whole_arcs(parts), xi).ravel())
    return VaryingSection.of(along, parts) if along.beam.varies else None
