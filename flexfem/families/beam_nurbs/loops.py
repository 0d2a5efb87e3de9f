# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loops over NURBS elements: internal forces, their action on a step, strains.

``LANES`` elements are evaluated at once (SIMD); arrays that end with this axis are made by
``tables.lanes``.

These are not loops of ``kernels.driver``: it would copy frames, shape functions and strains of the
start in every call, which takes 2.3 microseconds for 16 cubic elements beside the 5.2 of
:func:`add_residual`, twice in a step of 82 of the slider-crank, and 25 beside 62 for 400 quadratic
ones.
"""

import numpy as np

from flexfem._types import FloatArray, IndexArray, IntArray
from flexfem.core.nodes.frame_kernels import Nodes
from flexfem.families.beam_nurbs.maps import (
    PLACE,
    RELATIVE,
    force_changes_into,
    forces_into,
    places_into,
    rate_changes_into,
    rates_into,
    twists_into,
)
from flexfem.kernels.compiled import inlined, kernel, subroutine
from flexfem.kernels.ffcx import tabulate
from flexfem.kernels.lanes import LANES
from flexfem.kernels.records import (
    Float1D,
    Float2D,
    Float3D,
    Float5D,
    Int1D,
    Int2D,
    Memory,
    Record,
    unpack,
)

__all__ = [
    "CHANGE",
    "RATES",
    "RATE_CHANGE",
    "NurbsElements",
    "PointKernel",
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


class PointKernel(Record):
    """A kernel of ``forms.nurbs_beam``, called at points of ``LANES`` elements.

    Attributes:
        address: of the function.
        offsets: (8,) first entry of each coefficient, then their number.
    """

    address: int
    offsets: Int1D


class NurbsElements(Record):
    """Elements with k nodes and q points each, in b batches of ``LANES`` (L).

    Attributes:
        vectors: True for relative rotation vectors, see ``maps``.
        nodes: (m, k) control points.
        tables: (b, q, 2, k, L) shape functions and their derivatives by the arc length, 1/m.
        weights: (b, q, L) arc length that each point stands for, m.
        damping: (m,) stiffness-proportional damping, s.
        section: (m,) number of the section.
        sections: (s, 21 + ...) inertia of each section, then its data for the kernels.
    """

    vectors: bool
    nodes: Int2D
    tables: Float5D
    weights: Float3D
    damping: Float1D
    section: Int1D
    sections: Float2D


@inlined
def workspace(offsets: IntArray) -> tuple[FloatArray, IntArray, FloatArray, FloatArray]:
    """Arguments of kernels: data, numbers of its sections, constants, points of a mesh."""
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
    offsets: IntArray, elements: NurbsElements, first: int, held: IntArray, data: FloatArray
) -> None:
    """Write the constants of elements from ``first`` on; ``held`` (L,): their sections."""
    section, sections = elements.section, elements.sections
    for lane in range(LANES):
        c = min(first + lane, section.size - 1)
        if offsets[_DAMPING] >= 0:
            data[offsets[_DAMPING], lane] = elements.damping[c]
        if section[c] != held[lane] and offsets[_MATERIAL] >= 0:
            held[lane] = section[c]
            for i in range(sections.shape[1] - 21):
                data[offsets[_MATERIAL] + i, lane] = sections[held[lane], 21 + i]


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
    """Add a result of ``maps.force_changes_into`` to nodal forces (k, 6, L)."""
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
    kernel: Memory, elements: Memory, starts: FloatArray, nodes: Memory, scale: float
) -> None:
    """Add ``scale`` times the internal forces of all elements to the residual of the nodes.

    Args:
        kernel: :class:`PointKernel`.
        elements: :class:`NurbsElements`.
        starts: (b, q, 6, L) strains at the start.
        nodes: ``Nodes`` of the block.
        scale: see above.
    """
    call, own = unpack(PointKernel, kernel), unpack(NurbsElements, elements)
    state = unpack(Nodes, nodes)
    offsets, vectors, cells = call.offsets, own.vectors, own.nodes
    tables, weights, k = own.tables, own.weights, own.nodes.shape[1]
    relative, places = np.zeros((k, RELATIVE, LANES)), np.zeros((k, PLACE, LANES))
    speeds, rates = np.zeros((k, 6, LANES)), np.zeros((k, PLACE, LANES))
    dual, forces = np.zeros((k, PLACE, LANES)), np.zeros((k, 6, LANES))
    force = np.empty((11, LANES))
    data, held, nothing, points = workspace(offsets)
    for batch in range(tables.shape[0]):
        first = batch * LANES
        places_into(vectors, cells, first, state.frames, relative, places)
        if offsets[RATES] >= 0:
            twists_into(cells, first, state.velocity, speeds)
            rates_into(vectors, relative, places, speeds, rates)
        put_elements(offsets, own, first, held, data)
        dual[:] = 0.0
        for q in range(tables.shape[1]):
            put_points(offsets, tables[batch, q], starts[batch, q], places, rates, data)
            force[:] = 0.0
            tabulate(call.address, force, data, nothing, points)
            collect(tables[batch, q], weights[batch, q], force, 0, dual)
        forces_into(vectors, relative, places, dual, forces)
        _add_forces(cells, first, forces, scale, state.residual)


@kernel
def add_action(
    kernel: Memory, elements: Memory, starts: FloatArray, nodes: Memory, scale: float
) -> None:
    """Add ``scale`` times the change of the internal forces to the residual of the nodes.

    The nodes move as ``inertia.step_changes`` says; arguments as for :func:`add_residual`.
    """
    call, own = unpack(PointKernel, kernel), unpack(NurbsElements, elements)
    state = unpack(Nodes, nodes)
    offsets, vectors, cells = call.offsets, own.vectors, own.nodes
    tables, weights = own.tables, own.weights
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
        places_into(vectors, cells, first, state.frames, relative, places)
        twists_into(cells, first, state.turn, turns)
        rates_into(vectors, relative, places, turns, moved)
        if offsets[RATES] >= 0:
            twists_into(cells, first, state.velocity, speeds)
            rates_into(vectors, relative, places, speeds, rates)
            rate_changes_into(vectors, relative, places, speeds, turns, moved, more)
            twists_into(cells, first, state.velocity_change, speeds)
            rates_into(vectors, relative, places, speeds, rate_changes)
            rate_changes += more
        put_elements(offsets, own, first, held, data)
        dual[:], dual_change[:] = 0.0, 0.0
        for q in range(tables.shape[1]):
            put_points(offsets, tables[batch, q], starts[batch, q], places, rates, data)
            interpolate(tables[batch, q], moved, offsets[CHANGE], data)
            if offsets[RATE_CHANGE] >= 0:
                interpolate(tables[batch, q], rate_changes, offsets[RATE_CHANGE], data)
            force[:] = 0.0
            tabulate(call.address, force, data, nothing, points)
            collect(tables[batch, q], weights[batch, q], force, 0, dual)
            collect(tables[batch, q], weights[batch, q], force, 11, dual_change)
        forces_into(vectors, relative, places, dual_change, forces)
        force_changes_into(vectors, relative, places, dual, turns, moved, force_changes, moments)
        _add_changes(force_changes, moments, forces)
        _add_forces(cells, first, forces, scale, state.residual)


@kernel
def point_strains(
    kernel: Memory, elements: Memory, starts: FloatArray, frames: FloatArray, velocity: FloatArray,
    strains: FloatArray,
) -> None:  # fmt: skip
    """Write strains and their rates at all points to ``strains`` (b, q, 12, L)."""
    call, own = unpack(PointKernel, kernel), unpack(NurbsElements, elements)
    offsets, vectors, cells, tables = call.offsets, own.vectors, own.nodes, own.tables
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
            tabulate(call.address, strains[batch, q], data, nothing, points)
