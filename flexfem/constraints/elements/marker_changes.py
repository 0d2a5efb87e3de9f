# SPDX-License-Identifier: LGPL-3.0-or-later
"""Displacements and twists of the markers of force elements by those of the nodes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.constraints.rows.placed_joint import RowLayout
from flexfem.lie import se3

__all__ = ["MarkerChanges", "marker_changes"]


@dataclass(frozen=True)
class MarkerChanges:
    """Elements of a group whose rows have equally many terms.

    All rows of an element have the same nodes at the same places of their terms. Markers on nodes
    move with them by constant maps. Those on lines have a row for each component of their twists,
    whose gradients are the maps.

    Attributes:
        members: (k,) their places in the group.
        rows: (k, r) their rows.
        terms: (k, r, t) terms of these.
        nodes: (k, t, 2) interface nodes of the terms of a row, -1 for none.
        maps: (k, 6 m, t, 2, 6) twists of the markers, in their own axes, by those of the nodes;
            None on lines.
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

    def displacements(self, gradients: FloatArray) -> FloatArray:
        """(k, 6 m, t, 2, 6) twists of the markers by those of the nodes.

        Args:
            gradients: (t, 2, 6) of all rows.
        """
        return gradients[self.terms] if self.maps is None else self.maps

    def twists(self, gradients: FloatArray, velocities: FloatArray) -> FloatArray:
        """(k, m, 6) twists of the markers by those of the nodes (n + 1, 6), the ground's last."""
        by_nodes, moving = self.displacements(gradients), velocities[self.nodes]
        flat = by_nodes.reshape(*by_nodes.shape[:2], -1)
        found = (flat @ moving.reshape(len(flat), -1, 1)).reshape(len(flat), -1, 6)
        return found

    def twist_changes(
        self, displacements: FloatArray, velocities: FloatArray, rates: FloatArray | None
    ) -> FloatArray:
        """(k, 6 m, t, 2, 6) changes of these twists along steps of the nodes.

        Args:
            displacements: result of :meth:`displacements`.
            velocities: (n + 1, 6, 6) changes of the nodes' local twists.
            rates: (t, 2, 6) changes of the rates of rows, for markers on lines.
        """
        if rates is not None:
            return rates[self.terms]
        found: FloatArray = np.einsum("ectsi,etsij->ectsj", displacements, velocities[self.nodes])
        return found


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
        maps = None if on_lines else _maps(table, markers[members], count)
        found.append(MarkerChanges(members, rows[members], terms, nodes, maps))
    return found


def _maps(table: RowLayout, markers: IntArray, count: int) -> FloatArray:
    """(k, 6 m, t, 2, 6) maps from nodes to markers, two of these at each term in their order."""
    size = markers.shape[1]
    maps = np.zeros((len(markers), size, 6, count, 2, 6))
    for m in range(size):
        own = markers[:, m]
        to_marker = se3.adjoint(se3.inverse(table.marker_offset[own]))
        to_marker[table.marker_node[own] < 0] = 0.0  # the ground
        maps[:, m, :, m // 2, m % 2] = to_marker
    return maps.reshape(len(markers), 6 * size, count, 2, 6)
