# SPDX-License-Identifier: LGPL-3.0-or-later
"""NURBS beams as fields for ParaView: every element is drawn as some straight segments."""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.families.beam_nurbs.curves import elements_on_rank, segments
from flexfem.families.beam_nurbs.elements import NurbsBeams
from flexfem.families.beam_nurbs.family import NurbsBeamFamily
from flexfem.io.vtu.beam_fields import BeamFields
from flexfem.layout.element_places import ElementPlaces
from flexfem.lie import se3
from flexfem.system.system import BlockPart

__all__ = ["CurveSampler"]


class CurveSampler:
    """Points along this rank's elements of NURBS beams, shared by neighbouring elements."""

    def __init__(self, part: BlockPart, first_section: int) -> None:
        """Choose the points; ``first_section`` is the number of the first section."""
        assert isinstance(part.family, NurbsBeamFamily)
        curves, beams = part.family.curves, part.elements
        assert isinstance(beams, NurbsBeams)
        self._block = part.block
        chosen = elements_on_rank(curves, part.block)
        family = np.argsort(beams.rows)  # numbers of the cells in the order of the beams
        none = np.empty(0, dtype=np.int64)
        self._points: list[ElementPlaces] = []
        ends, bodies, sections = [none.reshape(0, 2)], [none], [none]
        cells: dict[int, list[IntArray]] = {}
        count = first = 0
        for beam in curves.by_kind():
            mine, nodes = chosen[beam], curves.nodes(beam)[chosen[beam]]
            number = segments(nodes.shape[1])
            element, xi, pieces = _sample(mine, number)
            local, shape = part.block.local_index(nodes), curves.parts[beam].shape[mine]
            self._points.append(
                ElementPlaces(local[element], shape[element], xi, curves.element(beam))
            )
            ends.append(count + pieces)
            bodies.append(np.full(len(pieces), curves.numbers[beam]))
            sections.append(first_section + curves.drawn(beam, mine))
            cells.setdefault(number, []).append(family[first : first + len(mine)])
            count, first = count + len(xi), first + len(mine)
        self._segments = np.concatenate(ends)
        self._body, self._section = np.concatenate(bodies), np.concatenate(sections)
        self._middles = [
            beams.points_at((np.arange(number) + 0.5) / number, np.concatenate(rows))
            for number, rows in cells.items()
        ]
        self._start = self._motion(part.block.start_frames)[0]

    def fields(self) -> BeamFields:
        """State of the points and segments."""
        frames, twists = self._motion(self._block.frames)
        rotation, strains, resultants = se3.rotation(frames), [], []
        for points in self._middles:
            found = points.resultants(self._block.frames)
            strains.append(found[0].reshape(-1, 6))
            resultants.append(found[1].reshape(-1, 6))
        return BeamFields(
            position=frames[:, :3],
            displacement=frames[:, :3] - self._start[:, :3],
            rotation=rotation,
            velocity=np.einsum("nij,nj->ni", rotation, twists[:, :3]),
            angular_velocity=np.einsum("nij,nj->ni", rotation, twists[:, 3:]),
            cells=self._segments,
            body=self._body,
            strain=np.concatenate(strains),
            resultant=np.concatenate(resultants),
            section=self._section,
            turn=np.broadcast_to(np.eye(3), (len(self._section), 2, 3, 3)),
        )

    def _motion(self, frames: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Frames (n, 12) and local twists (n, 6) of all points, given frames of the nodes."""
        found = [points.at(frames, self._block.velocity) for points in self._points]
        return np.concatenate([f for f, _ in found]), np.concatenate([t for _, t in found])


def _sample(elements: IntArray, number: int) -> tuple[IntArray, FloatArray, IntArray]:
    """Points along some elements of one beam, each cut into ``number`` segments.

    Args:
        elements: (m,) numbers of the elements along the beam, ascending.
        number: of segments.

    Returns:
        Element (n,), counted among the given ones, and place in it (n,) of every point, and the
        points at both ends of every segment (m number, 2). Neighbours share the point between them.
    """
    m = len(elements)
    last = np.append(np.diff(elements) != 1, True)[:m]  # the next element is not there
    start = np.arange(m) * number + np.cumsum(last) - last
    element = np.repeat(np.arange(m), number + last)
    xi = (np.arange(len(element)) - start[element]) / number
    first = (start[:, np.newaxis] + np.arange(number)).ravel()
    return element, xi, np.stack([first, first + 1], axis=1)
