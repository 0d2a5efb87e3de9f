# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loops of force elements: twists of markers, states, and equations of their rows."""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.constraints.rows.data import RowArrays
from flexfem.kernels.compiled import kernel
from flexfem.kernels.records import Float4D, Int1D, Int3D, Memory, Record, unpack

__all__ = [
    "MarkersAtNodes",
    "add_slopes",
    "along_nodes",
    "correct_states",
    "finite",
    "marker_twists",
    "write_rows",
]


class MarkersAtNodes(Record):
    """Elements with markers at nodes and equally many terms a row, see ``MarkerChanges``.

    Attributes:
        members: (k,) their places in the group.
        nodes: (k, t, 2) interface nodes of the terms of a row; marker m is side ``m % 2`` of term
            ``m // 2``.
        maps: (k, m, 6, 6) twists of the markers by those of their nodes.
    """

    members: Int1D
    nodes: Int3D
    maps: Float4D


@kernel
def finite(values: FloatArray) -> bool:
    """True if all values (n,) are finite."""
    total = 0.0
    for value in values:
        total += 0.0 * value  # NaN for what is not finite
    return total == 0.0


@kernel
def marker_twists(memory: Memory, velocities: FloatArray, out: FloatArray) -> None:
    """Twists of the markers of ``MarkersAtNodes`` in ``out`` (e, m, 6) of their group."""
    own = unpack(MarkersAtNodes, memory)
    for k in range(own.members.size):
        for m in range(own.maps.shape[1]):
            node, twist = own.nodes[k, m // 2, m % 2], out[own.members[k], m]
            for i in range(6):
                twist[i] = 0.0
                if node >= 0:
                    for j in range(6):
                        twist[i] += own.maps[k, m, i, j] * velocities[node, j]


@kernel
def along_nodes(
    memory: Memory, place: FloatArray, twist: FloatArray, velocities: FloatArray, out: FloatArray
) -> None:
    """Changes ``out`` (k, a, t, 2, 6) along steps of the nodes, of ``MarkersAtNodes``.

    Args:
        memory: that of the elements.
        place: (e, a, 6 m) derivatives of all elements of the group by displacements of the markers.
        twist: (e, a, 6 m) derivatives by their twists.
        velocities: (n, 6, 6) changes of the nodes' local twists along steps.
        out: see above.
    """
    own, by_step = unpack(MarkersAtNodes, memory), np.empty((6, 6))
    out[:] = 0.0
    for k in range(own.members.size):
        e = own.members[k]
        for m in range(own.maps.shape[1]):
            node, by_node = own.nodes[k, m // 2, m % 2], own.maps[k, m]
            if node < 0:
                continue
            for i in range(6):
                for j in range(6):
                    total = 0.0
                    for c in range(6):
                        total += by_node[i, c] * velocities[node, c, j]
                    by_step[i, j] = total
            for a in range(place.shape[1]):
                change = out[k, a, m // 2, m % 2]
                for i in range(6):
                    by_place, by_twist = place[e, a, 6 * m + i], twist[e, a, 6 * m + i]
                    for j in range(6):
                        change[j] += by_place * by_node[i, j] + by_twist * by_step[i, j]


@kernel
def add_slopes(
    members: IntArray, terms: IntArray, scale: FloatArray, change: FloatArray, out: FloatArray
) -> None:
    """Set ``out`` (t, 2, 6), derivatives of the rows' values along steps.

    Args:
        members: (k,) places of elements in their group.
        terms: (k, r, t) terms of their rows.
        scale: (e, r) of the equations of all elements of the group.
        change: (k, r, t, 2, 6) changes of the forces along steps.
        out: see above.
    """
    for k in range(members.size):
        for r in range(terms.shape[1]):
            for t in range(terms.shape[2]):
                for side in range(2):
                    for i in range(6):
                        changed = scale[members[k], r] * change[k, r, t, side, i]
                        out[terms[k, r, t], side, i] = changed


@kernel
def write_rows(
    memory: Memory, rows: IntArray, forces: FloatArray, place: FloatArray, twist: FloatArray,
    dynamics: FloatArray, scale: FloatArray,
) -> None:  # fmt: skip
    """Write values and compliances of elements' rows to ``RowArrays``; scales of the equations.

    Args:
        memory: that of the rows.
        rows: (e, r) the elements' rows.
        forces: (e, r) by the law.
        place: (e, r, 6 m) their derivatives by displacements of the markers.
        twist: (e, r, 6 m) those by their twists.
        dynamics: (2,) ``gamma/(beta h)``, zero for equilibrium, and ``beta h^2``.
        scale: (e, r) becomes the scales, zero for released rows.
    """
    own = unpack(RowArrays, memory)
    for e in range(rows.shape[0]):
        for a in range(rows.shape[1]):
            r, size = rows[e, a], 1.0 / dynamics[1]
            scale[e, a] = 0.0
            if not own.active[r]:
                continue
            for i in range(place.shape[2]):
                size += abs(place[e, a, i]) + dynamics[0] * abs(twist[e, a, i])
            scale[e, a] = 1.0 / size
            own.values[r] = (forces[e, a] - own.multipliers[r] / dynamics[1]) / size
            own.compliance[r] = 1.0 / (size * dynamics[1])


@kernel
def correct_states(
    missed: FloatArray, inverse: FloatArray, sizes: FloatArray, change: FloatArray
) -> float:
    """Newton's corrections of states in ``change`` (e, n); the largest one by the sizes (e, n).

    Args:
        missed: (e, n) residuals of the equations of the states.
        inverse: (e, n, n) of their matrices.
        sizes: (e, n) of the states.
        change: see above.
    """
    largest = 0.0
    for e in range(change.shape[0]):
        for i in range(change.shape[1]):
            total = 0.0
            for j in range(change.shape[1]):
                total += inverse[e, i, j] * missed[e, j]
            change[e, i] = total
            size = abs(total) / sizes[e, i]
            if size > largest or size != size:  # NaN stays
                largest = size
    return largest
