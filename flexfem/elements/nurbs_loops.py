# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loops over NURBS elements: internal forces, their action on a step, strains.

``LANES`` elements are treated side by side; arrays that end with this axis are made by
``nurbs_tables.lanes``. ``tables`` (b, q, 2, k, L) holds shape functions and their derivatives by
the arc length at the q points of all elements, ``weights`` (b, q, L) the arc length of the points;
``vectors`` says what the elements interpolate, see ``nurbs_maps``.
"""

import numpy as np

from flexfem._types import FloatArray, IndexArray, IntArray
from flexfem.elements.nurbs_maps import (
    PLACE,
    RELATIVE,
    force_changes_into,
    forces_into,
    places_into,
    rate_changes_into,
    rates_into,
    twists_into,
)
from flexfem.la.kernel import tabulate
from flexfem.la.lanes import LANES
from flexfem.lie.compiled import inlined, kernel, subroutine

__all__ = [
    "CHANGE",
    "RATES",
    "RATE_CHANGE",
    "add_action",
    "add_residual",
    "collect",
    "interpolate",
    "point_strains",
    "put_elements",
    "put_points",
    "workspace",
]

# positions in the order of forms.nurbs_beam.NurbsForms.coefficients
_UNKNOWNS, RATES, _START, _DAMPING, _MATERIAL, CHANGE, RATE_CHANGE = 0, 1, 2, 3, 4, 5, 6


@inlined
def workspace(offsets: IntArray) -> tuple[FloatArray, IntArray, FloatArray, FloatArray]:
    """What kernels are called with: data, sections held in it, constants, points of a mesh."""
    points = np.zeros(6)
    points[3] = 1.0  # the forms do not depend on the size of the reference cell
    return np.zeros((offsets[-1], LANES)), np.full(LANES, -1), np.zeros(1), points


@subroutine
def interpolate(tables: FloatArray, places: FloatArray, first: int, data: FloatArray) -> None:
    """Write a point's unknowns, from nodal places (k, PLACE, L), to ``data`` from ``first`` on."""
    k = places.shape[0]
    for i in range(11):
        for lane in range(LANES):
            data[first + i, lane] = 0.0
    for node in range(k):
        if node == k // 2:
            continue
        for i in range(3):
            for lane in range(LANES):
                data[first + i, lane] += tables[1, node, lane] * places[node, i, lane]
        for i in range(3, 7):
            for lane in range(LANES):
                N, dN = tables[0, node, lane], tables[1, node, lane]
                data[first + i, lane] += N * places[node, i, lane]
                data[first + 4 + i, lane] += dN * places[node, i, lane]


@subroutine
def collect(
    tables: FloatArray, weights: FloatArray, force: FloatArray, first: int, dual: FloatArray
) -> None:
    """Add the force of a point, ``force`` from ``first`` on, to the dual (k, PLACE, L)."""
    k = dual.shape[0]
    for node in range(k):
        if node == k // 2:
            continue
        for i in range(3):
            for lane in range(LANES):
                dN = weights[lane] * tables[1, node, lane]
                dual[node, i, lane] += dN * force[first + i, lane]
        for i in range(3, 7):
            for lane in range(LANES):
                N = weights[lane] * tables[0, node, lane]
                dN = weights[lane] * tables[1, node, lane]
                bent = N * force[first + i, lane] + dN * force[first + 4 + i, lane]
                dual[node, i, lane] += bent


@subroutine
def put_elements(
    offsets: IntArray, damping: FloatArray, sections: IntArray, laws: FloatArray, first: int,
    held: IntArray, data: FloatArray,
) -> None:  # fmt: skip
    """Write the constants of the elements from ``first`` on; ``held`` (L,) are the sections there.

    ``laws`` (s, 21 + ...) holds what the kernels take of a section after its inertia.
    """
    for lane in range(LANES):
        c = min(first + lane, sections.size - 1)
        if offsets[_DAMPING] >= 0:
            data[offsets[_DAMPING], lane] = damping[c]
        if sections[c] != held[lane] and offsets[_MATERIAL] >= 0:
            held[lane] = sections[c]
            for i in range(laws.shape[1] - 21):
                data[offsets[_MATERIAL] + i, lane] = laws[held[lane], 21 + i]


@subroutine
def put_points(
    offsets: IntArray, tables: FloatArray, starts: FloatArray, places: FloatArray,
    rates: FloatArray, data: FloatArray,
) -> None:  # fmt: skip
    """Write the unknowns of one point of each element, their rates and the strain at the start."""
    interpolate(tables, places, offsets[_UNKNOWNS], data)
    if offsets[RATES] >= 0:
        interpolate(tables, rates, offsets[RATES], data)
    if offsets[_START] >= 0:
        for i in range(6):
            for lane in range(LANES):
                data[offsets[_START] + i, lane] = starts[i, lane]


@inlined
def _add_forces(
    cells: IndexArray, first: int, forces: FloatArray, scale: float, residual: FloatArray
) -> None:
    count, k = cells.shape
    for lane in range(min(LANES, count - first)):
        for node in range(k):
            to = cells[first + lane, node]
            for i in range(6):
                residual[to, i] += scale * forces[node, i, lane]


@inlined
def _add_changes(changes: FloatArray, moments: FloatArray, forces: FloatArray) -> None:
    """Add what ``nurbs_maps.force_changes_into`` writes to nodal forces (k, 6, L)."""
    k = forces.shape[0]
    for node in range(k):
        if node == k // 2:
            continue
        for lane in range(LANES):
            for i in range(6):
                forces[node, i, lane] += changes[node, i, lane]
            for i in range(3):
                forces[k // 2, 3 + i, lane] += moments[node, i, lane]


@kernel
def add_residual(
    address: int, offsets: IntArray, vectors: bool, cells: IndexArray, tables: FloatArray,
    weights: FloatArray, starts: FloatArray, damping: FloatArray, sections: IntArray,
    laws: FloatArray, frames: FloatArray, velocity: FloatArray, scale: float,
    residual: FloatArray,
) -> None:  # fmt: skip
    """Add ``scale`` times the internal forces of all elements to ``residual`` (n, 6)."""
    k = cells.shape[1]
    relative, places = np.zeros((k, RELATIVE, LANES)), np.zeros((k, PLACE, LANES))
    speeds, rates = np.zeros((k, 6, LANES)), np.zeros((k, PLACE, LANES))
    dual, forces = np.zeros((k, PLACE, LANES)), np.zeros((k, 6, LANES))
    force = np.empty((11, LANES))
    data, held, nothing, points = workspace(offsets)
    for batch in range(tables.shape[0]):
        first = batch * LANES
        places_into(vectors, cells, first, frames, relative, places)
        if offsets[RATES] >= 0:
            twists_into(cells, first, velocity, speeds)
            rates_into(vectors, relative, places, speeds, rates)
        put_elements(offsets, damping, sections, laws, first, held, data)
        dual[:] = 0.0
        for q in range(tables.shape[1]):
            put_points(offsets, tables[batch, q], starts[batch, q], places, rates, data)
            force[:] = 0.0
            tabulate(address, force, data, nothing, points)
            collect(tables[batch, q], weights[batch, q], force, 0, dual)
        forces_into(vectors, relative, places, dual, forces)
        _add_forces(cells, first, forces, scale, residual)


@kernel
def add_action(
    address: int, offsets: IntArray, vectors: bool, cells: IndexArray, tables: FloatArray,
    weights: FloatArray, starts: FloatArray, damping: FloatArray, sections: IntArray,
    laws: FloatArray, frames: FloatArray, velocity: FloatArray, steps: FloatArray,
    changes: FloatArray, scale: float, residual: FloatArray,
) -> None:  # fmt: skip
    """Add ``scale`` times the change of the internal forces to ``residual`` (n, 6).

    The nodes move by the local twists ``steps`` (n, 6), and their local velocities change by
    ``changes`` (n, 6).
    """
    nodal, shape = (cells.shape[1], 6, LANES), (cells.shape[1], PLACE, LANES)
    relative, moments = np.zeros((shape[0], RELATIVE, LANES)), np.zeros((shape[0], 3, LANES))
    places, speeds, turns = np.zeros(shape), np.zeros(nodal), np.zeros(nodal)
    rates, rate_changes = np.zeros(shape), np.zeros(shape)
    moved, more = np.zeros(shape), np.zeros(shape)
    dual, dual_change = np.zeros(shape), np.zeros(shape)
    forces, force_changes = np.zeros(nodal), np.zeros(nodal)
    force = np.empty((22, LANES))
    data, held, nothing, points = workspace(offsets)
    for batch in range(tables.shape[0]):
        first = batch * LANES
        places_into(vectors, cells, first, frames, relative, places)
        twists_into(cells, first, steps, turns)
        rates_into(vectors, relative, places, turns, moved)
        if offsets[RATES] >= 0:
            twists_into(cells, first, velocity, speeds)
            rates_into(vectors, relative, places, speeds, rates)
            rate_changes_into(vectors, relative, places, speeds, turns, moved, more)
            twists_into(cells, first, changes, speeds)
            rates_into(vectors, relative, places, speeds, rate_changes)
            rate_changes += more
        put_elements(offsets, damping, sections, laws, first, held, data)
        dual[:], dual_change[:] = 0.0, 0.0
        for q in range(tables.shape[1]):
            put_points(offsets, tables[batch, q], starts[batch, q], places, rates, data)
            interpolate(tables[batch, q], moved, offsets[CHANGE], data)
            if offsets[RATE_CHANGE] >= 0:
                interpolate(tables[batch, q], rate_changes, offsets[RATE_CHANGE], data)
            force[:] = 0.0
            tabulate(address, force, data, nothing, points)
            collect(tables[batch, q], weights[batch, q], force, 0, dual)
            collect(tables[batch, q], weights[batch, q], force, 11, dual_change)
        forces_into(vectors, relative, places, dual_change, forces)
        force_changes_into(vectors, relative, places, dual, turns, moved, force_changes, moments)
        _add_changes(force_changes, moments, forces)
        _add_forces(cells, first, forces, scale, residual)


@kernel
def point_strains(
    address: int, offsets: IntArray, vectors: bool, cells: IndexArray, tables: FloatArray,
    starts: FloatArray, frames: FloatArray, velocity: FloatArray, strains: FloatArray,
) -> None:  # fmt: skip
    """Write strains and their rates at all points to ``strains`` (b, q, 12, L)."""
    k = cells.shape[1]
    relative, places = np.zeros((k, RELATIVE, LANES)), np.zeros((k, PLACE, LANES))
    speeds, rates = np.zeros((k, 6, LANES)), np.zeros((k, PLACE, LANES))
    data, _, nothing, points = workspace(offsets)
    for batch in range(tables.shape[0]):
        first = batch * LANES
        places_into(vectors, cells, first, frames, relative, places)
        twists_into(cells, first, velocity, speeds)
        rates_into(vectors, relative, places, speeds, rates)
        for q in range(tables.shape[1]):
            put_points(offsets, tables[batch, q], starts[batch, q], places, rates, data)
            strains[batch, q] = 0.0
            tabulate(address, strains[batch, q], data, nothing, points)
