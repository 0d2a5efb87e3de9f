# SPDX-License-Identifier: LGPL-3.0-or-later
"""Serial data of all SE(3) beams of a model: nodes of the mesh numbered, frames at the start."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.core.inertia import inertia_about
from flexfem.families.beam_se3.along import cell_sections, initial_strains, rest_twists
from flexfem.families.beam_se3.elements import BeamCells, node_frames
from flexfem.families.common.along import (
    Places,
    Walls,
    end_walls,
    refuse_large_twists,
    twists_at,
)
from flexfem.families.common.initial_velocities import initial_velocities
from flexfem.lie import se3
from flexfem.materials.section import Section
from flexfem.mesh.geometry.topology import trace_lines
from flexfem.mesh.line_mesh import frames_of_lines
from flexfem.model.bodies.basic import Beam
from flexfem.model.model import Model

__all__ = ["BeamMesh"]

#: Gauss points in a cell, relative to its length.
_GAUSS = 0.5 + 0.5 / np.sqrt(3.0) * np.array([-1.0, 1.0])


@dataclass(frozen=True)
class _Cells:
    """Cells of one beam, each with what it takes of the beam.

    Attributes:
        nodes: (m, 2) in the mesh; frames: (m, 2, 12) of the section at their ends.
        arcs: (m, 2) arc lengths of the ends, m; zero for beams along which nothing varies.
        rest: (m, 6) relative twists of the ends without stress, none for those of the frames.
        sections: the section of all cells, or that of each.
        walls: boundaries at both ends of the cells of each of these.
    """

    nodes: IntArray
    frames: FloatArray
    arcs: FloatArray
    rest: FloatArray
    sections: list[Section]
    walls: list[Walls]

    @classmethod
    def of(cls, beam: Beam, nodes: IntArray, frames: FloatArray) -> _Cells:
        """Cells of a beam in the order along it.

        Args:
            beam: the beam.
            nodes: (m, 2) in the mesh.
            frames: (m, 2, 12) of sections without twist at their ends.
        """
        rest = np.empty((0, 6))
        arcs = np.zeros(len(nodes) + 1)
        if _varies(beam):
            _check_chain(beam, nodes)
            arcs[1:] = np.cumsum(_lengths(frames))
            twists = twists_at(beam, arcs, float(arcs[-1]))
            refuse_large_twists(beam, np.stack([twists[:-1], twists[1:]], axis=1))
            frames = _twisted(frames, twists)
        if beam.strained:
            rest = rest_twists(beam, arcs, _twists(frames))
        walls: list[Walls]
        if isinstance(beam.section, Section):
            sections, walls = [beam.section], [(beam.section.walls, beam.section.walls)]
        else:
            sections, walls = cell_sections(beam, arcs), end_walls(beam, arcs)
        if beam.timed:  # a mistake in it is found on all ranks
            initial_strains(beam, Places.of(arcs), 0.0)
        ends = np.stack([arcs[:-1], arcs[1:]], axis=1)
        return cls(nodes, frames, ends, rest, sections, walls)


@dataclass(frozen=True, eq=False)
class BeamMesh:
    """Nodes and cells of all SE(3) beams, the same on every rank.

    Attributes:
        cells: all cells with their frames; nodes are numbered among those that they use.
        points, frames, velocities: (n, 3), (n, 12) and (n, 6) of the nodes at the start.
        body_of_node: (n,) number of the beam in the model.
        sections: the beams' different sections, by the numbers in ``cells``; a beam whose section
            varies has one for each cell.
        walls: boundaries of the sections at both ends of their cells.
        owners: names of the sections in messages.
        node_of_mesh: number of each node by its number in the model's mesh.
    """

    cells: BeamCells
    points: FloatArray
    frames: FloatArray
    velocities: FloatArray
    body_of_node: IntArray
    sections: list[Section]
    walls: list[Walls]
    owners: list[str]
    node_of_mesh: dict[int, int]

    @classmethod
    def of(cls, model: Model) -> BeamMesh:
        """Data of a model with SE(3) beams.

        Raises:
            TypeError: A function along a beam returns something of the wrong type.
            ValueError: It fails or returns something unusable, a table ends elsewhere than its
                beam, or something varies along a group that branches or falls apart.
        """
        beams, mesh = model.beams_of("se3"), model.mesh
        assert mesh is not None  # checked by validate()
        lines = [mesh.cells[_along(model, beam)] for beam in beams]
        counts = [len(line) for line in lines]
        axes = frames_of_lines(mesh.points, lines, [beam.orientation for beam in beams])
        at_start = se3.frame(mesh.points[np.concatenate(lines)], np.concatenate(axes))
        each = zip(beams, lines, np.split(at_start, np.cumsum(counts)[:-1]), strict=True)
        parts = [_Cells.of(*one) for one in each]
        used, nodes = np.unique(np.concatenate([p.nodes for p in parts]), return_inverse=True)
        points = mesh.points[used]
        nodes = nodes.reshape(-1, 2).astype(np.int64)
        sections, number = _numbered(beams, parts)
        frames = np.concatenate([part.frames for part in parts])
        rest, strained = _twists(frames), np.repeat([beam.strained for beam in beams], counts)
        rest[strained] = np.concatenate([part.rest for part in parts])
        places = {id(beam): i for i, beam in enumerate(model.beams)}
        body = np.array([places[id(beam)] for beam in beams])
        cells = BeamCells(
            cells=nodes,
            body=np.repeat(body, counts),
            section=number,
            frames=frames,
            rest=rest,
            strained=strained,
            arcs=np.concatenate([part.arcs for part in parts]),
            damping=_dampings(beams, counts),
        )
        body_of_node = np.empty(len(used), dtype=np.int64)
        body_of_node[nodes] = cells.body[:, np.newaxis]
        at_nodes, velocities = node_frames(nodes, frames, len(used)), np.zeros((len(used), 6))
        for beam, cells_of_beam in zip(beams, np.split(nodes, np.cumsum(counts)[:-1]), strict=True):
            if beam.velocity.any() or beam.angular_velocity.any():
                own = np.unique(cells_of_beam)
                velocities[own] = initial_velocities(beam, at_nodes[own])
        node_of_mesh = {int(node): i for i, node in enumerate(used)}
        different, walls, owners = zip(*sections, strict=True)
        return cls(
            cells, points, at_nodes, velocities, body_of_node, list(different), list(walls),
            list(owners), node_of_mesh,
        )  # fmt: skip

    def numbers(self, nodes: Sequence[int]) -> IntArray:
        """Numbers of nodes given by their numbers in the model's mesh."""
        return np.array([self.node_of_mesh[node] for node in nodes], dtype=np.int64)

    def nodes(self, beam: int) -> IntArray:
        """(m, 2) nodes of the cells of a beam, by its number in the model."""
        nodes: IntArray = self.cells.cells[self.own(beam)].astype(np.int64)
        return nodes

    def own(self, beam: int) -> slice:
        """Cells of a beam, by its number in the model; beams are in its order."""
        first, last = np.searchsorted(self.cells.body, [beam, beam + 1]).tolist()
        return slice(first, last)

    def common_nodes(self) -> IntArray:
        """(k, 2) numbers of two beams for each node that both have."""
        count = int(self.cells.body.max()) + 1
        pairs = np.unique(count * self.cells.cells.ravel() + np.repeat(self.cells.body, 2))
        node, body = np.divmod(pairs, count)
        again = node[1:] == node[:-1]
        return np.stack([body[:-1][again], body[1:][again]], axis=1)

    def section(self, beam: int) -> Section:
        """Section of a beam, by its number in the model: that in its middle, if it varies."""
        numbers = self.cells.section[self.own(beam)]
        return self.sections[int(numbers[len(numbers) // 2])]

    def inertia(self, beam: int, origin: FloatArray) -> FloatArray:
        """Inertia matrix (6, 6) of a beam at the start about a frame (12,)."""
        own = self.own(beam)
        ends, numbers = self.cells.frames[own], self.cells.section[own]
        twists = _twists(ends)
        weights = 0.5 * np.linalg.norm(twists[:, :3], axis=1)
        inertias = np.array([self.sections[i].inertia for i in numbers])
        total = np.zeros((6, 6))
        for xi in _GAUSS:
            frames = se3.retract(ends[:, 0], xi * twists)
            total += inertia_about(origin, frames, inertias, weights)
        return total


def _numbered(
    beams: Sequence[Beam], parts: Sequence[_Cells]
) -> tuple[list[tuple[Section, Walls, str]], IntArray]:
    """Different sections with their walls and owners, and the number of that of each cell."""
    found: list[tuple[Section, Walls, str]] = []
    known: dict[int, int] = {}
    numbers = []
    for beam, part in zip(beams, parts, strict=True):
        for section, walls in zip(part.sections, part.walls, strict=True):
            if id(section) not in known:
                known[id(section)] = len(found)
                found.append((section, walls, f'Beam "{beam.name}"'))
        own = np.array([known[id(section)] for section in part.sections], dtype=np.int64)
        numbers.append(own if len(own) == len(part.nodes) else np.repeat(own, len(part.nodes)))
    return found, np.concatenate(numbers)


def _dampings(beams: Sequence[Beam], counts: Sequence[int]) -> FloatArray:
    """Damping (m, 1) of all cells, s, or (m, 6) if a beam has one for each strain."""
    width = max(np.size(beam.damping) for beam in beams)
    rows = np.array([np.broadcast_to(beam.damping, (width,)) for beam in beams])
    return np.repeat(rows, counts, axis=0)


def _varies(beam: Beam) -> bool:
    """Return True if a beam needs the arc lengths of its nodes."""
    return beam.varies or beam.twist is not None or beam.strained


def _check_chain(beam: Beam, cells: IntArray) -> None:
    """Raise for a group along which there is no arc length."""
    lines = trace_lines(cells)
    if len(lines) != 1 or lines[0].reversed.any() or (np.diff(lines[0].cells) != 1).any():
        raise ValueError(
            f'Beam "{beam.name}": what varies along it needs one line, but its group '
            f'"{beam.group}" branches or falls apart'
        )


def _twists(ends: FloatArray) -> FloatArray:
    """Relative twists (m, 6) of frames (m, 2, 12)."""
    twists: FloatArray = se3.log(se3.compose(se3.inverse(ends[:, 0]), ends[:, 1]))
    return twists


def _lengths(ends: FloatArray) -> FloatArray:
    """Arc lengths (m,) between frames (m, 2, 12), m."""
    lengths: FloatArray = np.linalg.norm(_twists(ends)[:, :3], axis=1)
    return lengths


def _twisted(frames: FloatArray, angles: FloatArray) -> FloatArray:
    """Frames (m, 2, 12) rotated about their first axes by the angles (m + 1,) at the nodes, rad."""
    if not angles.any():
        return frames
    turns = np.zeros((len(frames), 2, 6))
    turns[:, 0, 3], turns[:, 1, 3] = angles[:-1], angles[1:]
    turned: FloatArray = se3.retract(frames, turns)
    return turned


def _along(model: Model, beam: Beam) -> IntArray:
    """Cells of a beam ordered along it, so that consecutive cells are neighbours in space."""
    rows = model.beam_cells(beam)
    assert model.mesh is not None
    assert beam.group is not None
    order = model.mesh.order(beam.group)
    if order is None:
        return rows
    rank = np.empty(len(model.mesh.points), dtype=np.int64)
    rank[order] = np.arange(len(order))
    return rows[np.argsort(rank[model.mesh.cells[rows]].min(axis=1), kind="stable")]
