# SPDX-License-Identifier: LGPL-3.0-or-later
"""Serial data of all NURBS beams of a model: control points numbered along the curves."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.core.inertia import inertia_about
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.core.places.line_points import NURBS as NURBS_ELEMENT
from flexfem.core.places.line_points import NURBS_VECTORS, find_jacobian
from flexfem.core.runs import starts
from flexfem.families.common.initial_velocities import initial_velocities
from flexfem.layout.lines import Line
from flexfem.materials.section import Section
from flexfem.mesh.nurbs.elements import NurbsElements
from flexfem.mesh.nurbs.frames import control_frames
from flexfem.model.bodies.basic import Beam
from flexfem.model.model import Model

__all__ = ["NurbsLines", "elements_on_rank"]

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
        sections: the beams' different sections; ``section``: the number of that of each beam.
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

    @classmethod
    def of(cls, model: Model) -> "NurbsLines":
        """Data of a model with NURBS beams."""
        beams = model.beams_of("nurbs")
        curves = [model.curve(beam) for beam in beams]
        frames = [
            control_frames(c, b.orientation, b.vectors) for c, b in zip(curves, beams, strict=True)
        ]
        numbers = np.array([model.beams.index(beam) for beam in beams], dtype=np.int64)
        parts = [curve.elements for curve in curves]
        nodes = [len(f) for f in frames]
        sections = list({id(b.section): b.uniform for b in beams}.values())
        place = {id(section): i for i, section in enumerate(sections)}
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
            section=np.array([place[id(b.section)] for b in beams], dtype=np.int64),
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

    def kind(self, beam: int) -> tuple[int, bool]:
        """Number of nodes of a beam's elements, and True if these interpolate rotation vectors."""
        return self.parts[beam].nodes.shape[1], self.beams[beam].vectors

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
        xi, lengths = self._points(beam, _FINE)
        nodes, shape, element = self.nodes(beam), self.parts[beam].shape, self.element(beam)
        frames = np.empty((len(nodes), len(xi), 12))
        jacobian = np.empty((6, 6 * nodes.shape[1] + 1))
        for e, q in np.ndindex(len(nodes), len(xi)):
            own = np.ascontiguousarray(self.frames[nodes[e]])
            find_jacobian(element, own, shape[e], float(xi[q]), frames[e, q], jacobian)
        inertia = self.beams[beam].uniform.inertia
        return inertia_about(origin, frames.reshape(-1, 12), inertia, lengths.ravel())

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
