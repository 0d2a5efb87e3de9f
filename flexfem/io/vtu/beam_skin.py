# SPDX-License-Identifier: LGPL-3.0-or-later
"""Surfaces of beams: the boundaries of their sections swept along the cells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexfem.io.vtu.beam_fields import BeamFields
from flexfem.io.vtu.polygons import between, cut
from flexfem.materials.section_wall import SectionWall

__all__ = ["BeamSkin", "SkinSection"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


class SkinSection:
    """One section, or that of an element from end to end, as surfaces show it.

    Attributes:
        counts: Vertices of each boundary; none of a section that is not shown.
        points: Vertices of all boundaries at both ends (2, k, 2), m.
        stress: See `SectionWall`, for all of them (2, k, 2, 6); NaN where it is not known.
        faces: Quadrilaterals of the end that e1 points out of (m, 4).
    """

    def __init__(
        self, walls: Sequence[SectionWall], last: Sequence[SectionWall] | None = None
    ) -> None:
        """Put the boundaries together: the outer one, and none or one inner of as many vertices.

        Args:
            walls: At the first end.
            last: At the other end, with as many vertices, else the section is not shown; None for
                the same.
        """
        ends = [walls, walls if last is None else last]
        counts = [tuple(len(wall.points) for wall in end) for end in ends]
        if counts[0] != counts[1]:
            walls, ends, counts = (), [(), ()], [(), ()]
        self.counts = counts[0]
        self.points, self.stress = (
            np.stack(parts) for parts in zip(*map(_joined, ends), strict=True)
        )
        self.faces = np.zeros((0, 4), dtype=np.int64)
        if len(walls) == 1:
            self.faces = cut(walls[0].points)
        elif walls:
            self.faces = between(self.counts[0])

    @property
    def kind(self) -> tuple[tuple[int, ...], bytes]:
        """Key of sections that can be swept together."""
        return self.counts, self.faces.tobytes()

    def sides(self) -> IntArray:
        """Quadrilaterals between the vertices at both ends of a cell, outward (k, 4)."""
        found, start, other = [np.zeros((0, 4), dtype=np.int64)], 0, self.points.shape[1]
        for number, k in enumerate(self.counts):
            j = start + np.arange(k)
            nxt = start + (np.arange(k) + 1) % k
            quads = np.stack([j, nxt, other + nxt, other + j], axis=1)
            found.append(quads[:, ::-1] if number else quads)
            start += k
        return np.concatenate(found)


def _joined(walls: Sequence[SectionWall]) -> tuple[FloatArray, FloatArray]:
    """Vertices (k, 2) of some boundaries, and their stresses (k, 2, 6)."""
    unknown = [np.full((len(wall.points), 2, 6), np.nan) for wall in walls]
    known = [wall.stress for wall in walls]
    values = [u if s is None else s for u, s in zip(unknown, known, strict=True)]
    points = np.concatenate([np.zeros((0, 2)), *(wall.points for wall in walls)])
    return points, np.concatenate([np.zeros((0, 2, 6)), *values])


@dataclass(frozen=True)
class _Group:
    """Cells whose sections are swept together, and the first of their points in the surface."""

    cells: IntArray
    stress: FloatArray
    section: IntArray  # of each cell, in the order of ``stress``


class BeamSkin:
    """Topology of the surfaces of some cells.

    Every cell has its own points: resultants and the stresses from them jump from cell to cell, and
    so do section axes where beams meet at an angle.

    Attributes:
        node, cell: Node and cell of every point (p,).
        arm: Vector (p, 3) from the node to the point, in the axes of the node, m.
        quads: Quadrilaterals (q, 4).
        owner: Cell of every quadrilateral (q,).
    """

    def __init__(
        self, beams: BeamFields, sections: Sequence[SkinSection], *, caps: bool = True
    ) -> None:
        """Sweep the sections.

        Args:
            beams: The cells.
            sections: By the numbers of ``beams.section``.
            caps: True if the ends of the beams are closed.
        """
        self._key = (beams.cells.copy(), beams.section.copy())
        self._groups: list[_Group] = []
        node, cell = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
        arm, start = [np.zeros((0, 3))], 0
        quads, owner = [np.zeros((0, 4), np.int64)], [np.zeros(0, np.int64)]
        free = _free_ends(
            beams, np.array([bool(one.counts) for one in sections], dtype=np.bool_)[beams.section]
        )
        kinds: dict[object, list[int]] = {}
        for number in np.unique(beams.section).tolist():
            if sections[number].counts:
                kinds.setdefault(sections[number].kind, []).append(number)
        for numbers in kinds.values():
            one, table = sections[numbers[0]], np.stack([sections[n].points for n in numbers])
            cells = np.flatnonzero(np.isin(beams.section, numbers))
            of = np.searchsorted(numbers, beams.section[cells])
            stress = np.stack([sections[n].stress for n in numbers])
            self._groups.append(_Group(cells, stress, of))
            k, m = one.points.shape[1], len(cells)
            node.append(np.repeat(beams.cells[cells].reshape(-1), k))
            cell.append(np.repeat(cells, 2 * k))
            # section axes are rotated against those of the node, by a constant
            turn = beams.turn[cells, :, :, 1:]
            arm.append(np.einsum("meij,mekj->meki", turn, table[of]).reshape(-1, 3))
            first = start + 2 * k * np.arange(m)
            parts = [(one.sides(), cells, first)]
            if caps:
                at = free[cells]
                parts += [
                    (one.faces[:, ::-1], cells[at[:, 0]], first[at[:, 0]]),
                    (one.faces + k, cells[at[:, 1]], first[at[:, 1]]),
                ]
            for faces, whose, base in parts:
                quads.append((base[:, None, None] + faces).reshape(-1, 4))
                owner.append(np.repeat(whose, len(faces)))
            start += 2 * k * m
        self.node, self.cell = np.concatenate(node), np.concatenate(cell)
        self.quads, self.owner = np.concatenate(quads), np.concatenate(owner)
        self.arm = np.concatenate(arm)
        self._turned = bool(np.any(self.arm[:, 0]))

    def fits(self, beams: BeamFields) -> bool:
        """Return True if the topology belongs to these cells."""
        cells, section = self._key
        return np.array_equal(cells, beams.cells) and np.array_equal(section, beams.section)

    def points(self, beams: BeamFields) -> FloatArray:
        """Positions of all points (p, 3) in the deformed state, m."""
        x: FloatArray = beams.position.take(self.node, axis=0)
        for i in range(0 if self._turned else 1, 3):
            axis = beams.rotation[:, :, i].take(self.node, axis=0)
            axis *= self.arm[:, i : i + 1]
            x += axis
        return x

    def stress_factors(self) -> FloatArray:
        """Axial and shear stress of every point per resultant (p, 2, 6), of cells in their order.

        NaN where stresses are not known.
        """
        found = [np.zeros((0, 2, 6))]
        found += [group.stress[group.section].reshape(-1, 2, 6) for group in self._groups]
        return np.concatenate(found)

    def stresses(self, beams: BeamFields) -> FloatArray:
        """Axial stress and shear stress (p, 2) at all points, Pa; NaN where not known."""
        found = [np.zeros((0, 2))]
        for group in self._groups:
            values = np.einsum(
                "mekij,mj->meki", group.stress[group.section], beams.resultant[group.cells]
            )
            found.append(values.reshape(-1, 2))
        return np.concatenate(found)


def _free_ends(beams: BeamFields, shown: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return flags (m, 2): first and last nodes without a next cell of the same beam.

    Cells whose section is not ``shown`` (m,) do not count.
    """
    bodies = int(beams.body.max(initial=0)) + 1
    key = (beams.cells * bodies + beams.body[:, None])[shown]
    _, inverse, counts = np.unique(key, return_inverse=True, return_counts=True)
    free = np.zeros((len(shown), 2), dtype=np.bool_)
    free[shown] = (counts[inverse] == 1).reshape(-1, 2)
    return free
