# SPDX-License-Identifier: LGPL-3.0-or-later
"""Displacements and twists of the markers of force elements by those of the nodes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.constraints.elements.kernels import MarkersAtNodes, along_nodes, marker_twists
from flexfem.constraints.rows.placed_joint import RowLayout
from flexfem.lie import se3

__all__ = ["MarkerChanges", "marker_changes"]


@dataclass(frozen=True)
class MarkerChanges:
    """Elements of a group whose rows have equally many terms.

    All rows of an element have the same nodes at the same places of their terms: markers on nodes,
    of which the m-th is side ``m % 2`` of term ``m // 2``, move with these by constant maps. Those
    on lines have a row for each component of their twists, whose gradients are the maps.

    Attributes:
        members: (k,) their places in the group.
        rows: (k, r) their rows.
        terms: (k, r, t) terms of these.
        nodes: (k, t, 2) interface nodes of the terms of a row, -1 for none.
        maps: (k, m, 6, 6) twists of the markers, in their own axes, by those of their nodes; None
            on lines.
    """

    members: IntArray
    rows: IntArray
    terms: IntArray
    nodes: IntArray
    maps: FloatArray | None

    @property
    def on_lines(self) -> bool:
        """True if markers are on lines."""
        return self.maps is None

    @cached_property
    def _at_nodes(self) -> MarkersAtNodes:
        """Those at nodes in the format of the compiled loops."""
        assert self.maps is not None
        return MarkersAtNodes(members=self.members, nodes=self.nodes, maps=self.maps)

    def put_twists(self, gradients: FloatArray, velocities: FloatArray, out: FloatArray) -> None:
        """Write the twists of the markers to ``out`` (e, m, 6) of the group.

        Args:
            gradients: (t, 2, 6) of all rows.
            velocities: (n + 1, 6) twists of the interface nodes, that of the ground last.
            out: see above.
        """
        if self.maps is not None:
            marker_twists(self._at_nodes.memory, velocities, out)
            return
        by_nodes, moving = gradients[self.terms], velocities[self.nodes]
        flat = by_nodes.reshape(*by_nodes.shape[:2], -1)
        found: FloatArray = flat @ moving.reshape(len(flat), -1, 1)
        out[self.members] = found.reshape(len(flat), -1, 6)

    def along(
        self, place: FloatArray, twist: FloatArray, gradients: FloatArray, velocities: FloatArray,
        rates: FloatArray | None,
    ) -> FloatArray:  # fmt: skip
        """(k, a, t, 2, 6) changes along steps of the nodes.

        Args:
            place: (e, a, 6 m) derivatives by displacements of the markers, of the whole group.
            twist: (e, a, 6 m) derivatives by their twists.
            gradients: (t, 2, 6) of all rows.
            velocities: (n, 6, 6) changes of the nodes' local twists along steps.
            rates: (t, 2, 6) changes of the rates of rows, for markers on lines.
        """
        shape = (len(self.members), place.shape[1], *self.nodes.shape[1:], 6)
        if self.maps is None:
            assert rates is not None
            flat = (x[self.terms].reshape(*self.terms.shape[:2], -1) for x in (gradients, rates))
            by_place, by_rate = flat
            own = place[self.members] @ by_place + twist[self.members] @ by_rate
            return own.reshape(shape)
        out = np.empty(shape)
        along_nodes(self._at_nodes.memory, place, twist, velocities, out)
        return out


def marker_changes(
    table: RowLayout, joints: Sequence[int], rows: IntArray, markers: IntArray
) -> list[MarkerChanges]:
    """Elements by the number of terms of their rows.

    Args:
        table: layout of all rows.
        joints: (e,) numbers of the elements' joints.
        rows: (e, r) their rows.
        markers: (e, m) the markers that their law depends on.
    """
    first = table.term_start[rows]
    counts = table.term_start[rows[:, 0] + 1] - first[:, 0]
    lines = np.array([table.joints[i].on_lines for i in joints], dtype=np.bool_)
    found = []
    for count, on_lines in sorted({*zip(counts.tolist(), lines.tolist(), strict=True)}):
        members = np.flatnonzero((counts == count) & (lines == on_lines))
        terms = first[members][:, :, np.newaxis] + np.arange(count)
        nodes = table.term_nodes[terms[:, 0]]
        maps = None if on_lines else _maps(table, markers[members])
        found.append(MarkerChanges(members, rows[members], terms, nodes, maps))
    return found


def _maps(table: RowLayout, markers: IntArray) -> FloatArray:
    """(k, m, 6, 6) maps from the twists of nodes to those of markers, zero on the ground."""
    maps: FloatArray = se3.adjoint(se3.inverse(table.marker_offset[markers]))
    maps[table.marker_node[markers] < 0] = 0.0
    return maps
