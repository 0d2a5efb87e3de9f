# SPDX-License-Identifier: LGPL-3.0-or-later
"""Kernel of the exact derivatives of the internal forces of NURBS elements.

Along local twists of the nodes, places change by ``A`` (``maps.rates_into``) and the dual
forces by ``X = K A + C dA``; the nodal forces change by ``A^T X`` and by that of ``A`` itself. The
places of one node depend on its own twist and on that of the reference node alone, so that
``A`` is two 7x6 blocks for each of the other nodes: along the axes of each, ``[0]``, and of the
reference node, ``[1]``. The other nodes are counted without the reference node.
"""

import numpy as np

from flexfem._types import FloatArray
from flexfem.families.beam_nurbs.kernels import (
    BY_VELOCITY,
    FACTORS,
    LARGEST,
    RATES,
    VECTORS,
    VELOCITY,
    collect,
    evaluate_point,
    nodal,
    place,
    points_of,
    put_point,
)
from flexfem.families.beam_nurbs.maps import (
    PLACE,
    force_changes_into,
    rate_changes_into,
    rates_into,
)
from flexfem.kernels.by_hand import batched_by_hand, shaped
from flexfem.kernels.compiled import inlined, inlined_fused, subroutine
from flexfem.kernels.lanes import LANES
from flexfem.kernels.vectors import add_to, load, store

__all__ = ["tangent"]

# position of the derivatives by unknowns and by rates in forms.nurbs_beam.NurbsForms.tangent
_BY_UNKNOWNS, _BY_RATES = 11, 132


@inlined
def _other(node: int, ref: int) -> int:
    """Number of a node without the reference node."""
    return node - (node > ref)


@inlined_fused
def _add_point(at: FloatArray, values: FloatArray, first: int, K: FloatArray) -> None:
    """Add the matrix (11, 11) of a point to that of the places, (k - 1, PLACE, k - 1, PLACE, L)."""
    k = K.shape[0] + 1
    weight, width = load(at, 2 * k), PLACE * (k - 1)
    for I in range(k):  # noqa: E741
        for J in range(k):
            if k // 2 in (I, J):
                continue
            N, dN = weight * load(at, I), weight * load(at, k + I)
            M, dM = load(at, J), load(at, k + J)
            to = PLACE * (width * _other(I, k // 2) + _other(J, k // 2))
            for i in range(PLACE):
                for j in range(PLACE):
                    by = first + 11 * i + j
                    if i < 3:
                        own, slope = dN * load(values, by), dN * load(values, by + 4)
                    else:
                        own = N * load(values, by) + dN * load(values, by + 44)
                        slope = N * load(values, by + 4) + dN * load(values, by + 48)
                    change = own * dM if j < 3 else own * M + slope * dM
                    add_to(K, to + width * i + j, change)


@inlined
def _axis(side: int, j: int, twists: FloatArray) -> None:
    """Unit twists (k, 6, L) along axis j of the reference node (1) or all others (0)."""
    k = twists.shape[0]
    twists[:] = 0.0
    for node in range(k):
        if (node == k // 2) == (side == 1):
            twists[node, j] = 1.0


@inlined
def _columns(matrices: FloatArray, side: int, j: int, twists: FloatArray) -> None:
    """Column j of nodal matrices (k, 36, L), as :func:`_axis` chooses the nodes."""
    k = twists.shape[0]
    twists[:] = 0.0
    for node in range(k):
        if (node == k // 2) == (side == 1):
            for i in range(6):
                store(twists, 6 * node + i, load(matrices, 36 * node + 6 * i + j))


@inlined
def _keep(values: FloatArray, side: int, j: int, A: FloatArray) -> None:
    """Store nodal values as columns j of the blocks ``A`` (2, k - 1, ..., 6, L)."""
    k, count = values.shape[0], values.shape[1]
    for node in range(k):
        if node != k // 2:
            other = side * (k - 1) + _other(node, k // 2)
            for i in range(count):
                store(A, 6 * (count * other + i) + j, load(values, count * node + i))


@inlined_fused
def _add_columns(K: FloatArray, A: FloatArray, X: FloatArray) -> None:
    """Add ``K A`` to ``X`` (k - 1, PLACE, k, 6, L)."""
    others, k = K.shape[0], K.shape[0] + 1
    width, side = PLACE * others, 6 * PLACE * others
    for row in range(width):
        for b in range(others):
            own, ref = 6 * (k * row + b + (b >= k // 2)), 6 * (k * row + k // 2)
            for m in range(PLACE):
                factor = load(K, width * row + PLACE * b + m)
                # the relative rotations do not depend on translations
                for j in range(3 * (m >= 3), 6):
                    at = 6 * (PLACE * b + m) + j
                    add_to(X, own + j, factor * load(A, at))
                    add_to(X, ref + j, factor * load(A, side + at))


@inlined_fused
def _add_rows(A: FloatArray, X: FloatArray, E: FloatArray) -> None:
    """Add ``A^T X`` to ``E`` (k, 6, k, 6, L)."""
    others, k = X.shape[0], X.shape[2]
    width, side = 6 * k, 6 * PLACE * others
    for a in range(others):
        own, ref = 6 * (a + (a >= k // 2)), 6 * (k // 2)
        for m in range(PLACE):
            for i in range(3 * (m >= 3), 6):
                at = 6 * (PLACE * a + m) + i
                by_own, by_ref = load(A, at), load(A, side + at)
                for j in range(width):
                    x = load(X, width * (PLACE * a + m) + j)
                    add_to(E, width * (own + i) + j, by_own * x)
                    add_to(E, width * (ref + i) + j, by_ref * x)


@inlined_fused
def _add_geometry(changes: FloatArray, moments: FloatArray, factor: float, E: FloatArray) -> None:
    """Add the changes of ``maps.force_changes_into`` along all axes to ``E``."""
    others, k = changes.shape[1], E.shape[0]
    for side in range(2):
        for a in range(others):
            node, block = a + (a >= k // 2), side * others + a
            at = 6 * (k // 2 if side else node)
            for i in range(6):
                for j in range(6):
                    change = factor * load(changes, 6 * (6 * block + i) + j)
                    add_to(E, 6 * k * (6 * node + i) + at + j, change)
            for i in range(3):
                for j in range(6):
                    change = factor * load(moments, 6 * (3 * block + i) + j)
                    add_to(E, 6 * k * (6 * (k // 2) + 3 + i) + at + j, change)


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
    vectors: bool, relative: FloatArray, places: FloatArray, speeds: FloatArray,
    by_v: FloatArray, factors: FloatArray, maps: FloatArray,
) -> None:  # fmt: skip
    """Change ``maps[1]`` of the rates of the places along all axes, ``maps[0]`` that of these.

    ``factors`` are those of the change with the places, and with the velocities.
    """
    A, k = maps[0], places.shape[0]
    twists, moved, change = np.zeros_like(speeds), np.zeros_like(places), np.zeros_like(places)
    for side in range(2):
        for j in range(6):
            _axis(side, j, twists)
            for node in range(k):
                if node != k // 2:
                    for i in range(PLACE):
                        at = PLACE * (side * (k - 1) + _other(node, k // 2)) + i
                        store(moved, PLACE * node + i, load(A, 6 * at + j))
            rate_changes_into(vectors, relative, places, speeds, twists, moved, change)
            _columns(by_v, side, j, twists)
            rates_into(vectors, relative, places, twists, moved)
            for at in range(PLACE * k):
                both = factors[0] * load(change, at) + factors[1] * load(moved, at)
                store(moved, at, both)
            _keep(moved, side, j, maps[1])


@batched_by_hand
def tangent(
    tensor: FloatArray, coefficients: FloatArray, constants: FloatArray, coordinates: FloatArray
) -> None:
    """Matrix (k, 6, k, 6) ``a K + b C dv`` of the internal forces.

    dv is the change of each node's local velocity along its local twist, a and b are the factors
    among the constants.
    """
    vectors, viscous = constants[VECTORS] > 0.0, constants[RATES] >= 0.0
    factors = constants[FACTORS : FACTORS + 2]
    relative, places, rates = place(coefficients, constants)
    k, others = places.shape[0], places.shape[0] - 1
    maps, dual = np.empty((2, 2, others, PLACE, 6, LANES)), np.zeros_like(places)
    A, B = maps[0], maps[1]
    changes, moments = np.empty((2, others, 6, 6, LANES)), np.empty((2, others, 3, 6, LANES))
    square = (others, PLACE, others, PLACE, LANES)
    K, C, X = np.zeros(square), np.zeros(square), np.zeros((others, PLACE, k, 6, LANES))
    points = points_of(constants, coordinates)
    for q in range(points.shape[0]):
        put_point(coefficients, constants, points[q], places, rates)
        force = evaluate_point(coefficients, constants, LARGEST)
        collect(points[q], force, dual)
        _add_point(points[q], force, _BY_UNKNOWNS, K)
        if viscous:
            _add_point(points[q], force, _BY_RATES, C)
    _maps_into(vectors, relative, places, dual, A, changes, moments)
    _add_columns(K, A, X)
    X *= factors[0]
    if viscous:
        velocity = nodal(coefficients, constants, VELOCITY, 6)
        by_velocity = nodal(coefficients, constants, BY_VELOCITY, 36)
        _rate_maps_into(vectors, relative, places, velocity, by_velocity, factors, maps)
        _add_columns(C, B, X)
    E = shaped(tensor, 0, (k, 6, k, 6))
    _add_rows(A, X, E)
    _add_geometry(changes, moments, factors[0], E)
