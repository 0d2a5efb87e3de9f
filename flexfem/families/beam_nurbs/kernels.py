# SPDX-License-Identifier: LGPL-3.0-or-later
"""Kernels of NURBS elements: internal forces, their action on a step, strains.

``LANES`` elements are evaluated at once, see ``kernels.vectors``: the last axis of all arrays here.
The kernel of an element interpolates the unknowns of each of its points, calls that of
``forms.nurbs_beam`` for the point by address, and maps the sum of the points' forces to the nodes.
The data of the points are in place of coordinates, see :func:`constant_data`, so that the driver
gathers those of nodes, damping and sections alone. Coefficients are those of the kernel of a point,
the data of the nodes, and work space.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexfem._types import FloatArray
from flexfem.families.beam_nurbs.maps import (
    PLACE,
    RELATIVE,
    force_changes_into,
    forces_into,
    places_into,
    rate_changes_into,
    rates_into,
)
from flexfem.families.beam_nurbs.tables import Points
from flexfem.kernels.by_hand import ByHand, batched_by_hand, shaped
from flexfem.kernels.compiled import inlined, inlined_fused
from flexfem.kernels.driver import (
    LINE,
    CellKernel,
    Cells,
    Nodal,
    add_forces,
    cell_kernel,
    evaluate,
)
from flexfem.kernels.ffcx import Kernel, tabulate
from flexfem.kernels.lanes import LANES, in_rows, lanes
from flexfem.kernels.records import Record
from flexfem.kernels.vectors import add_to, load, store

__all__ = [
    "BY_VELOCITY",
    "FACTORS",
    "LARGEST",
    "RATES",
    "VECTORS",
    "VELOCITY",
    "ElementKernel",
    "action",
    "collect",
    "constant_data",
    "element_kernel",
    "evaluate_point",
    "forces",
    "nodal",
    "place",
    "points_of",
    "put_point",
    "put_starts",
    "strains",
]

#: Constants: corners for the kernel of a point, which does not depend on them, and its address,
#: which is below 2^53 and so exact; numbers of nodes and points, 1 for relative rotation vectors,
#: first nodal coefficient, number of entries of its own stiffness that each point has.
_ADDRESS, _NODES, _POINTS, VECTORS, _NODAL, _STIFF = 6, 7, 8, 9, 10, 11
#: Then the first coefficients of what the kernel of a point takes, -1 for what it does not, and two
#: factors of the tangent.
_UNKNOWNS, RATES, _START, _MATERIAL, _CHANGE, _RATE_CHANGE, FACTORS = 12, 13, 14, 16, 17, 18, 19
#: Numbers for each node before those of its position, rotation, twists, and of the work space:
#: relative rotation, place, rate of the place and dual force, then changes, then a point's force.
_POSITION, _ROTATION, VELOCITY, _TURN, _VELOCITY_CHANGE, BY_VELOCITY = 0, 3, 12, 18, 24, 30
_RELATIVE, _PLACE, _RATE, _DUAL, _MOVED, _RATE_MOVED, _MORE = 66, 75, 82, 89, 96, 103, 110
_DUAL_CHANGE, _FORCE_CHANGE, _MOMENT, _BEHIND = 117, 124, 130, 133
#: Largest number of results of the kernel of a point: the force and its derivatives by unknowns and
#: by rates.
LARGEST = 11 + 2 * 11**2
#: Nodal data: kind, field of the record of the nodes, numbers before them.
_FIELDS = {
    "position": (Nodal.POSITION, "frames", _POSITION),
    "rotation": (Nodal.ROTATION, "frames", _ROTATION),
    "velocity": (Nodal.TWIST, "velocity", VELOCITY),
    "turn": (Nodal.TWIST, "turn", _TURN),
    "velocity_change": (Nodal.TWIST, "velocity_change", _VELOCITY_CHANGE),
    "by_velocity": (Nodal.NUMBERS, "by_velocity", BY_VELOCITY),
}
#: Those that only matter where forces depend on the rates.
_OF_RATES = {"velocity", "velocity_change", "by_velocity"}


@dataclass(frozen=True)
class ElementKernel:
    """A kernel of elements and its constants."""

    call: CellKernel
    constants: FloatArray

    def add(self, cells: Cells, nodes: Record, scale: float, target: FloatArray) -> None:
        """Add ``scale`` times the results to the nodes, see ``driver.add_forces``."""
        add_forces(self.call.memory, cells.memory, nodes.memory, self.constants, scale, target)

    def write(self, cells: Cells, nodes: Record, values: FloatArray) -> None:
        """Write the results, see ``driver.evaluate``."""
        evaluate(self.call.memory, cells.memory, nodes.memory, self.constants, values)


def element_kernel(
    kernel: ByHand, point: Kernel, sizes: tuple[int, int, int], record: type[Record],
    more: Sequence[str] = (), *, widths: tuple[int, int, int], vectors: bool,
) -> ElementKernel:  # fmt: skip
    """A kernel of elements that calls one of points.

    Args:
        kernel: one of this module and ``tangent``.
        point: that of a form of ``forms.nurbs_beam``.
        sizes: numbers of nodes, points and results.
        record: class of the record of the nodes.
        more: nodal data that it takes beside position, rotation and velocity.
        widths: numbers of data of an element, of its section, and of a point's own stiffness.
        vectors: True for relative rotation vectors, see ``maps``.
    """
    (k, q, results), (damping, section, stiffness) = sizes, widths
    *at, first = point.offsets.tolist()
    at += [-1] * (7 - len(at))  # the form of strains has the first three
    names = {"position", "rotation", "velocity", *more} - (_OF_RATES if at[1] < 0 else set())
    nodal = {name: field for name, field in _FIELDS.items() if name in names}
    positions = {name: first + k * before for name, (_, _, before) in nodal.items()}
    positions |= {"damping": at[3], "material": at[4]}
    offsets = np.array([*positions.values(), first + k * _BEHIND + LARGEST])
    call = cell_kernel(
        Kernel(kernel.address(), offsets, (kernel, point), LANES), results, positions,
        {name: (kind, record.word(field)) for name, (kind, field, _) in nodal.items()},
        {"damping": (0, damping)}, {"material": (21, section - 21)},
        np.array([(i, j) for i in range(k) for j in (0, 3)]),
    )  # fmt: skip
    constants = [*LINE[0], point.address, k, q, vectors, first, stiffness, *at, 0.0, 0.0]
    return ElementKernel(call, np.array(constants, dtype=np.float64))


def constant_data(at: Points, starts: FloatArray, stiffness: FloatArray) -> FloatArray:
    """Constant data of elements with some points, a row for each call of a kernel.

    For each point these are the shape functions of all nodes, their derivatives, the weight, the
    strain without stress, which is one of ``starts`` (m, q, 6), and the upper triangle of its own
    stiffness, ``stiffness`` (m, q, 21), or (m, q, 0) where sections have it.
    """
    pieces = at.values, at.slopes, at.lengths[..., np.newaxis], starts, stiffness
    return in_rows(lanes(np.concatenate(pieces, axis=2)))


def put_starts(data: FloatArray, nodes: int, starts: FloatArray) -> None:
    """Write other strains without stress (m, q, 6) to :func:`constant_data` of elements."""
    split = lanes(starts)
    batches, q = split.shape[:2]
    if batches:
        first = 2 * nodes + 1
        data.reshape(batches, q, -1, LANES)[:, :, first : first + 6] = split


@inlined
def nodal(coefficients: FloatArray, constants: FloatArray, before: int, count: int) -> FloatArray:
    """Coefficients (k, count, L) of the nodes."""
    k = int(constants[_NODES])
    return shaped(coefficients, int(constants[_NODAL]) + k * before, (k, count))


@inlined
def points_of(constants: FloatArray, coordinates: FloatArray) -> FloatArray:
    """Constant data (q, 2 k + 7 + stiffness, L) of the points."""
    count = 2 * int(constants[_NODES]) + 7 + int(constants[_STIFF])
    return shaped(coordinates, 0, (int(constants[_POINTS]), count))


@inlined_fused
def _interpolate(at: FloatArray, places: FloatArray, data: FloatArray) -> None:
    """Write a point's unknowns (11, L) from nodal places (k, PLACE, L)."""
    k = places.shape[0]
    for i in range(PLACE):
        value = slope = 0.0
        for node in range(k):
            if node != k // 2:
                of_node = load(places, PLACE * node + i)
                value += load(at, node) * of_node
                slope += load(at, k + node) * of_node
        if i < 3:
            store(data, i, slope)
        else:
            store(data, i, value)
            store(data, i + 4, slope)


@inlined_fused
def collect(at: FloatArray, force: FloatArray, dual: FloatArray) -> None:
    """Add the force of a point (11, L) to the dual (k, PLACE, L)."""
    k, weight = dual.shape[0], load(at, 2 * dual.shape[0])
    for node in range(k):
        if node != k // 2:
            N, dN = weight * load(at, node), weight * load(at, k + node)
            for i in range(3):
                add_to(dual, PLACE * node + i, dN * load(force, i))
            for i in range(3, PLACE):
                add_to(dual, PLACE * node + i, N * load(force, i) + dN * load(force, i + 4))


@inlined
def place(
    coefficients: FloatArray, constants: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Write relative rotations, places and, for a kernel that takes them, their rates."""
    relative = nodal(coefficients, constants, _RELATIVE, RELATIVE)
    places = nodal(coefficients, constants, _PLACE, PLACE)
    rates = nodal(coefficients, constants, _RATE, PLACE)
    positions = nodal(coefficients, constants, _POSITION, 3)
    rotations = nodal(coefficients, constants, _ROTATION, 9)
    vectors = constants[VECTORS] > 0.0
    places_into(vectors, positions, rotations, relative, places)
    if constants[RATES] >= 0.0:
        velocity = nodal(coefficients, constants, VELOCITY, 6)
        rates_into(vectors, relative, places, velocity, rates)
    return relative, places, rates


@inlined
def _put(
    coefficients: FloatArray, constants: FloatArray, name: int, at: FloatArray, places: FloatArray
) -> None:
    """Write interpolated places, or changes of places, if the kernel of a point takes them."""
    if constants[name] >= 0.0:
        _interpolate(at, places, shaped(coefficients, int(constants[name]), (11,)))


@inlined
def put_point(
    coefficients: FloatArray, constants: FloatArray, at: FloatArray, places: FloatArray,
    rates: FloatArray,
) -> None:  # fmt: skip
    """Write a point's unknowns, their rates, its strain without stress and its own stiffness."""
    own = 2 * places.shape[0] + 1
    _put(coefficients, constants, _UNKNOWNS, at, places)
    _put(coefficients, constants, RATES, at, rates)
    if constants[_START] >= 0.0:
        for i in range(6):
            store(coefficients, int(constants[_START]) + i, load(at, own + i))
    if constants[_MATERIAL] >= 0.0:
        for i in range(int(constants[_STIFF])):
            store(coefficients, int(constants[_MATERIAL]) + i, load(at, own + 6 + i))


@inlined
def evaluate_point(coefficients: FloatArray, constants: FloatArray, count: int) -> FloatArray:
    """Results (count, L) of the kernel of a point."""
    k = int(constants[_NODES])
    force = shaped(coefficients, int(constants[_NODAL]) + k * _BEHIND, (count,))
    force[:] = 0.0
    tabulate(int(constants[_ADDRESS]), force, coefficients, constants, constants)  # type: ignore[call-arg]
    return force


@batched_by_hand
def forces(
    tensor: FloatArray, coefficients: FloatArray, constants: FloatArray, coordinates: FloatArray
) -> None:
    """Internal forces (k, 6) on the nodes."""
    relative, places, rates = place(coefficients, constants)
    points = points_of(constants, coordinates)
    dual = nodal(coefficients, constants, _DUAL, PLACE)
    dual[:] = 0.0
    for q in range(points.shape[0]):
        put_point(coefficients, constants, points[q], places, rates)
        collect(points[q], evaluate_point(coefficients, constants, 11), dual)
    out = shaped(tensor, 0, (places.shape[0], 6))
    forces_into(constants[VECTORS] > 0.0, relative, places, dual, out)


@batched_by_hand
def action(
    tensor: FloatArray, coefficients: FloatArray, constants: FloatArray, coordinates: FloatArray
) -> None:
    """Change (k, 6) of the internal forces as the nodes move, see ``inertia.step_changes``."""
    vectors, k = constants[VECTORS] > 0.0, int(constants[_NODES])
    turns = nodal(coefficients, constants, _TURN, 6)
    moved = nodal(coefficients, constants, _MOVED, PLACE)
    rate_moved = nodal(coefficients, constants, _RATE_MOVED, PLACE)
    relative, places, rates = place(coefficients, constants)
    rates_into(vectors, relative, places, turns, moved)
    if constants[RATES] >= 0.0:
        more = nodal(coefficients, constants, _MORE, PLACE)
        velocity = nodal(coefficients, constants, VELOCITY, 6)
        changes = nodal(coefficients, constants, _VELOCITY_CHANGE, 6)
        rate_changes_into(vectors, relative, places, velocity, turns, moved, more)
        rates_into(vectors, relative, places, changes, rate_moved)
        rate_moved += more
    points = points_of(constants, coordinates)
    dual = nodal(coefficients, constants, _DUAL, PLACE)
    dual_change = nodal(coefficients, constants, _DUAL_CHANGE, PLACE)
    dual[:], dual_change[:] = 0.0, 0.0
    for q in range(points.shape[0]):
        put_point(coefficients, constants, points[q], places, rates)
        _put(coefficients, constants, _CHANGE, points[q], moved)
        _put(coefficients, constants, _RATE_CHANGE, points[q], rate_moved)
        force = evaluate_point(coefficients, constants, 22)
        collect(points[q], force, dual)
        collect(points[q], force[11:], dual_change)
    out = shaped(tensor, 0, (k, 6))
    force_change = nodal(coefficients, constants, _FORCE_CHANGE, 6)
    moments = nodal(coefficients, constants, _MOMENT, 3)
    forces_into(vectors, relative, places, dual_change, out)
    force_changes_into(vectors, relative, places, dual, turns, moved, force_change, moments)
    for node in range(k):
        if node == k // 2:
            continue
        for i in range(6):
            add_to(out, 6 * node + i, load(force_change, 6 * node + i))
        for i in range(3):
            add_to(out, 6 * (k // 2) + 3 + i, load(moments, 3 * node + i))


@batched_by_hand
def strains(
    tensor: FloatArray, coefficients: FloatArray, constants: FloatArray, coordinates: FloatArray
) -> None:
    """Strains and their rates (q, 12) at all points."""
    _, places, rates = place(coefficients, constants)
    points = points_of(constants, coordinates)
    for q in range(points.shape[0]):
        put_point(coefficients, constants, points[q], places, rates)
        found = evaluate_point(coefficients, constants, 12)
        for i in range(12):
            store(tensor, 12 * q + i, load(found, i))
