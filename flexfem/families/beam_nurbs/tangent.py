# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loop for the exact derivatives of the internal forces of NURBS elements.

Along local twists of the nodes, places change by ``A`` (``maps.rates_into``) and the dual
forces by ``X = K A + C dA``; the nodal forces change by ``A^T X`` and by that of ``A`` itself. The
places of one node depend on its own twist and on that of the reference node alone, so that
``A`` is two 7x6 blocks for each of the other nodes: along the axes of each, ``[0]``, and of the
reference node, ``[1]``. The other nodes are counted without the reference node.
"""

import numpy as np

from flexfem._types import FloatArray, IndexArray
from flexfem.core.nodes.frame_kernels import Nodes
from flexfem.families.beam_nurbs.loops import (
    RATES,
    NurbsElements,
    PointKernel,
    collect,
    put_elements,
    put_points,
    workspace,
)
from flexfem.families.beam_nurbs.maps import (
    PLACE,
    RELATIVE,
    force_changes_into,
    places_into,
    rate_changes_into,
    rates_into,
    twists_into,
)
from flexfem.kernels.compiled import inlined, kernel, subroutine
from flexfem.kernels.ffcx import tabulate
from flexfem.kernels.lanes import LANES
from flexfem.kernels.records import Memory, unpack

__all__ = ["tangent_into"]

# position of the derivatives by unknowns and by rates in forms.nurbs_beam.NurbsForms.tangent
_BY_UNKNOWNS, _BY_RATES, _SIZE = 11, 132, 253


@inlined
def _other(node: int, ref: int) -> int:
    """Number of a node without the reference node."""
    return node - (node > ref)


@subroutine
def _add_point(
    tables: FloatArray, weights: FloatArray, values: FloatArray, first: int, K: FloatArray
) -> None:
    """Add the matrix (11, 11) of a point to that of the places, (k - 1, PLACE, k - 1, PLACE, L)."""
    k = tables.shape[1]
    for I in range(k):  # noqa: E741
        for J in range(k):
            if k // 2 in (I, J):
                continue
            a, b = _other(I, k // 2), _other(J, k // 2)
            for i in range(7):
                for j in range(7):
                    at = first + 11 * i + j
                    for lane in range(LANES):
                        M, dM = tables[0, J, lane], tables[1, J, lane]
                        dN = weights[lane] * tables[1, I, lane]
                        N = weights[lane] * tables[0, I, lane]
                        if i < 3:
                            own, slope = dN * values[at, lane], dN * values[at + 4, lane]
                        else:
                            own = N * values[at, lane] + dN * values[at + 44, lane]
                            slope = N * values[at + 4, lane] + dN * values[at + 48, lane]
                        change = own * dM if j < 3 else own * M + slope * dM
                        K[a, i, b, j, lane] += change


@inlined
def _axis(side: int, j: int, twists: FloatArray) -> None:
    """Unit twists (k, 6, L) along axis j of the reference node (1) or all others (0)."""
    k = twists.shape[0]
    twists[:] = 0.0
    for node in range(k):
        if (node == k // 2) == (side == 1):
            twists[node, j] = 1.0


@inlined
def _columns(
    cells: IndexArray, first: int, matrices: FloatArray, side: int, j: int, twists: FloatArray
) -> None:
    """Column j of nodal matrices (n, 6, 6), as :func:`_axis` chooses the nodes."""
    count, k = cells.shape
    twists[:] = 0.0
    for node in range(k):
        if (node == k // 2) == (side == 1):
            for lane in range(LANES):
                c = min(first + lane, count - 1)
                for i in range(6):
                    twists[node, i, lane] = matrices[cells[c, node], i, j]


@inlined
def _keep(values: FloatArray, side: int, j: int, A: FloatArray) -> None:
    """Store nodal values as columns j of the blocks ``A`` (2, k - 1, ..., 6, L)."""
    k = values.shape[0]
    for node in range(k):
        if node != k // 2:
            for i in range(values.shape[1]):
                for lane in range(LANES):
                    A[side, _other(node, k // 2), i, j, lane] = values[node, i, lane]


@subroutine
def _add_columns(K: FloatArray, A: FloatArray, X: FloatArray) -> None:
    """Add ``K A`` to ``X`` (k - 1, PLACE, k, 6, L)."""
    others = K.shape[0]
    ref = (others + 1) // 2
    for a in range(others):
        for i in range(PLACE):
            for b in range(others):
                node = b + (b >= ref)
                for m in range(PLACE):
                    # the relative rotations do not depend on translations
                    for j in range(3 * (m >= 3), 6):
                        for lane in range(LANES):
                            factor = K[a, i, b, m, lane]
                            X[a, i, node, j, lane] += factor * A[0, b, m, j, lane]
                            X[a, i, ref, j, lane] += factor * A[1, b, m, j, lane]


@subroutine
def _rows_into(A: FloatArray, X: FloatArray, E: FloatArray) -> None:
    """``A^T X`` (k, 6, k, 6, L)."""
    others, k = X.shape[0], X.shape[2]
    ref = k // 2
    E[:] = 0.0
    for a in range(others):
        node = a + (a >= ref)
        for m in range(PLACE):
            for i in range(3 * (m >= 3), 6):
                for J in range(k):
                    for j in range(6):
                        for lane in range(LANES):
                            x = X[a, m, J, j, lane]
                            E[node, i, J, j, lane] += A[0, a, m, i, lane] * x
                            E[ref, i, J, j, lane] += A[1, a, m, i, lane] * x


@subroutine
def _add_geometry(changes: FloatArray, moments: FloatArray, factor: float, E: FloatArray) -> None:
    """Add the changes of ``maps.force_changes_into`` along all axes to ``E``."""
    others = changes.shape[1]
    ref = (others + 1) // 2
    for side in range(2):
        for a in range(others):
            node = a + (a >= ref)
            at = ref if side else node
            for i in range(6):
                for j in range(6):
                    for lane in range(LANES):
                        E[node, i, at, j, lane] += factor * changes[side, a, i, j, lane]
            for i in range(3):
                for j in range(6):
                    for lane in range(LANES):
                        E[ref, 3 + i, at, j, lane] += factor * moments[side, a, i, j, lane]


@inlined
def _write(E: FloatArray, first: int, scale: float, values: FloatArray) -> None:
    k = E.shape[0]
    for lane in range(min(LANES, values.shape[0] - first)):
        for I in range(k):  # noqa: E741
            for i in range(6):
                for J in range(k):
                    for j in range(6):
                        at = (6 * I + i) * 6 * k + 6 * J + j
                        values[first + lane, at] = scale * E[I, i, J, j, lane]


@subroutine
def _maps_into(
    vectors: bool, relative: FloatArray, places: FloatArray, dual: FloatArray, A: FloatArray,
    changes: FloatArray, moments: FloatArray,
) -> None:  # fmt: skip
    """``A`` and the changes of the nodal forces at a fixed dual along all axes."""
    k = places.shape[0]
    twists, change, moved = np.zeros((k, 6, LANES)), np.zeros((k, 6, LANES)), np.zeros_like(places)
    moment = np.zeros((k, 3, LANES))
    for side in range(2):
        for j in range(6):
            _axis(side, j, twists)
            rates_into(vectors, relative, places, twists, moved)
            _keep(moved, side, j, A)
            force_changes_into(vectors, relative, places, dual, twists, moved, change, moment)
            _keep(change, side, j, changes)
            _keep(moment, side, j, moments)


@subroutine
def _rate_maps_into(
    elements: NurbsElements, first: int, relative: FloatArray, places: FloatArray,
    speeds: FloatArray, by_v: FloatArray, factor: float, maps: FloatArray,
) -> None:  # fmt: skip
    """Change ``maps[1]`` of the rates of the places along all axes, ``maps[0]`` that of these."""
    vectors, A, B, k = elements.vectors, maps[0], maps[1], places.shape[0]
    twists, moved, change = np.zeros_like(speeds), np.zeros_like(places), np.zeros_like(places)
    for side in range(2):
        for j in range(6):
            _axis(side, j, twists)
            for node in range(k):
                if node != k // 2:
                    other = _other(node, k // 2)
                    for i in range(PLACE):
                        for lane in range(LANES):
                            moved[node, i, lane] = A[side, other, i, j, lane]
            rate_changes_into(vectors, relative, places, speeds, twists, moved, change)
            _columns(elements.nodes, first, by_v, side, j, twists)
            rates_into(vectors, relative, places, twists, moved)
            for node in range(k):
                if node != k // 2:
                    for i in range(PLACE):
                        for lane in range(LANES):
                            moved[node, i, lane] += factor * change[node, i, lane]
            _keep(moved, side, j, B)


@kernel
def tangent_into(
    kernel: Memory, elements: Memory, starts: FloatArray, nodes: Memory, by_v: FloatArray,
    factors: FloatArray, values: FloatArray,
) -> None:  # fmt: skip
    """Write ``s (k K + C dv)`` of the internal forces of all elements to ``values``.

    ``by_v`` (n, 6, 6) is dv, the change of each node's local velocity along its local twist,
    ``factors`` (2,) are k and s; ``values`` (m, 36 k k). The rest is as in
    ``loops.add_residual``.
    """
    call, own = unpack(PointKernel, kernel), unpack(NurbsElements, elements)
    state = unpack(Nodes, nodes)
    offsets, vectors, cells = call.offsets, own.vectors, own.nodes
    tables, weights, stiffness = own.tables, own.weights, factors[0]
    k, others, viscous = cells.shape[1], cells.shape[1] - 1, offsets[RATES] >= 0
    relative, places = np.zeros((k, RELATIVE, LANES)), np.zeros((k, PLACE, LANES))
    speeds, rates, dual = np.zeros((k, 6, LANES)), np.zeros_like(places), np.zeros_like(places)
    maps = np.zeros((2, 2, others, PLACE, 6, LANES))
    A, B = maps[0], maps[1]
    changes, moments = np.zeros((2, others, 6, 6, LANES)), np.zeros((2, others, 3, 6, LANES))
    square = (others, PLACE, others, PLACE, LANES)
    K, C = np.zeros(square), np.zeros(square)
    X, E = np.zeros((others, PLACE, k, 6, LANES)), np.zeros((k, 6, k, 6, LANES))
    force = np.empty((_SIZE, LANES))
    data, held, nothing, points = workspace(offsets)
    for batch in range(tables.shape[0]):
        first = batch * LANES
        places_into(vectors, cells, first, state.frames, relative, places)
        if viscous:
            twists_into(cells, first, state.velocity, speeds)
            rates_into(vectors, relative, places, speeds, rates)
        put_elements(offsets, own, first, held, data)
        dual[:], K[:], C[:], X[:] = 0.0, 0.0, 0.0, 0.0
        for q in range(tables.shape[1]):
            put_points(offsets, tables[batch, q], starts[batch, q], places, rates, data)
            force[:] = 0.0
            tabulate(call.address, force, data, nothing, points)
            collect(tables[batch, q], weights[batch, q], force, 0, dual)
            _add_point(tables[batch, q], weights[batch, q], force, _BY_UNKNOWNS, K)
            if viscous:
                _add_point(tables[batch, q], weights[batch, q], force, _BY_RATES, C)
        _maps_into(vectors, relative, places, dual, A, changes, moments)
        _add_columns(K, A, X)
        X *= stiffness
        if viscous:
            _rate_maps_into(own, first, relative, places, speeds, by_v, stiffness, maps)
            _add_columns(C, B, X)
        _rows_into(A, X, E)
        _add_geometry(changes, moments, stiffness, E)
        _write(E, first, factors[1], values)
