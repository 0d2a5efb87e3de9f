# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nodes against rigid surfaces of simple shapes.

Contacts are evaluated in the axes of the surface, in which a node is at ``q = R^T (p - x)`` and the
force on it depends on q alone. The distance s has the gradient n, and its second derivative is
``kappa_1 e e^T + kappa_2 f f^T`` with e, f, n orthonormal.
"""

from enum import IntEnum

import numpy as np

from flexfem._types import FloatArray
from flexfem.contact.law.data import (
    BEND,
    FIRST,
    FORCE,
    GAP,
    NORMAL,
    PLACE,
    REACH,
    RIGID_FIELDS,
    SECOND,
    SLOPE,
    Found,
    Slaves,
)
from flexfem.kernels.compiled import inlined, kernel
from flexfem.kernels.records import Float1D, Memory, Record, unpack

__all__ = [
    "RigidShape",
    "ShapeKind",
    "add_rigid_actions",
    "add_rigid_forces",
    "distances_into",
    "find_rigid_contacts",
    "rigid_blocks_into",
]


class ShapeKind(IntEnum):
    """Shapes of rigid surfaces, with the side on which nodes are kept.

    A plane is z = 0 with z >= 0 free; spheres and cylinders have their centre at the origin and
    their axis along z. ``CYLINDER`` and ``TUBE`` have no ends when their length is infinite; a
    ``CYLINDER`` of finite length is closed by flat ends, a ``TUBE`` of finite length is open and
    acts between its ends only.
    """

    PLANE = 0
    SPHERE = 1
    HOLLOW_SPHERE = 2
    CYLINDER = 3
    TUBE = 4


class RigidShape(Record):
    """A rigid surface.

    Attributes:
        frame: At the trial state, shape (12,).
        kind: A :class:`ShapeKind`.
        radius: Metres.
        length: Along the axis, metres, or infinite.
    """

    frame: Float1D
    kind: int
    radius: float
    length: float


_PLANE, _SPHERE, _HOLLOW = int(ShapeKind.PLANE), int(ShapeKind.SPHERE), int(ShapeKind.HOLLOW_SPHERE)
_TUBE = int(ShapeKind.TUBE)
#: Distance from a centre or an axis, in radii, below which there is no normal.
_CENTRE = 1e-12


@inlined
def _put(contact: FloatArray, at: int, x: float, y: float, z: float) -> None:
    """Write a normal or direction."""
    contact[at], contact[at + 1], contact[at + 2] = x, y, z


@inlined
def _round(contact: FloatArray, x: float, y: float, size: float, sign: float) -> None:
    """Write normal and curvature of a lateral surface: e around the axis, f along it."""
    _put(contact, NORMAL, sign * x / size, sign * y / size, 0.0)
    _put(contact, FIRST, -y / size, x / size, 0.0)
    _put(contact, SECOND, 0.0, 0.0, 1.0)
    contact[BEND], contact[BEND + 1] = sign / size, 0.0


@inlined
def _flat(contact: FloatArray, sign: float) -> None:
    _put(contact, NORMAL, 0.0, 0.0, sign)
    _put(contact, FIRST, 1.0, 0.0, 0.0)
    _put(contact, SECOND, 0.0, 1.0, 0.0)
    contact[BEND] = contact[BEND + 1] = 0.0


@inlined
def _sphere(q: FloatArray, radius: float, sign: float, contact: FloatArray) -> float:
    """Distance to a sphere."""
    size = np.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2])
    if size < _CENTRE * radius:
        _flat(contact, 1.0)
        return float(sign * (size - radius))
    n, e, f = contact[NORMAL : NORMAL + 3], contact[FIRST : FIRST + 3], contact[SECOND : SECOND + 3]
    k = 0 if abs(q[0]) < 0.6 * size else 1
    length = 0.0
    for a in range(3):
        n[a] = sign * q[a] / size
    for a in range(3):
        e[a] = (1.0 if a == k else 0.0) - n[k] * n[a]
        length += e[a] * e[a]
    for a in range(3):
        e[a] /= np.sqrt(length)
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        f[a] = n[b] * e[c] - n[c] * e[b]
    contact[BEND] = contact[BEND + 1] = sign / size
    return float(sign * (size - radius))


@inlined
def _closed(q: FloatArray, size: float, radius: float, half: float, contact: FloatArray) -> float:
    """Distance to a solid cylinder of finite length; ``size`` is that from the axis."""
    end = 1.0 if q[2] >= 0.0 else -1.0
    above, beside = end * q[2] - half, size - radius
    if above <= 0.0 and beside >= above:
        _round(contact, q[0], q[1], size, 1.0)
        return beside
    if beside <= 0.0:
        _flat(contact, end)
        return float(above)
    s = np.sqrt(above * above + beside * beside)
    x, y, radial, axial = q[0] / size, q[1] / size, beside / s, end * above / s
    _put(contact, NORMAL, radial * x, radial * y, axial)
    _put(contact, FIRST, -y, x, 0.0)
    _put(contact, SECOND, -axial * x, -axial * y, radial)
    contact[BEND], contact[BEND + 1] = radial / size, 1.0 / s
    return float(s)


@inlined
def _distance(shape: RigidShape, q: FloatArray, contact: FloatArray) -> float:
    """Distance of a point in the surface's axes; writes normal, directions and curvatures."""
    kind, radius, length = shape.kind, shape.radius, shape.length
    if kind == _PLANE:
        _flat(contact, 1.0)
        return float(q[2])
    if kind in (_SPHERE, _HOLLOW):
        return _sphere(q, radius, 1.0 if kind == _SPHERE else -1.0, contact)
    size = np.sqrt(q[0] * q[0] + q[1] * q[1])
    if size < _CENTRE * radius:
        size = _CENTRE * radius
    if kind == _TUBE:
        if abs(q[2]) > 0.5 * length:
            return np.inf
        _round(contact, q[0], q[1], size, -1.0)
        return float(radius - size)
    if length < np.inf:
        return _closed(q, size, radius, 0.5 * length, contact)
    _round(contact, q[0], q[1], size, 1.0)
    return float(size - radius)


@inlined
def _local(frame: FloatArray, p: FloatArray, q: FloatArray) -> None:
    """Write a point in the axes of a frame."""
    for a in range(3):
        q[a] = 0.0
        for b in range(3):
            q[a] += frame[3 + 3 * b + a] * (p[b] - frame[b])


@kernel
def distances_into(
    points: FloatArray, frame: FloatArray, shape: Memory, distances: FloatArray
) -> None:
    """Write the distances (n,) of points (n, 3) from a surface with another frame (12,)."""
    own, contact, q = unpack(RigidShape, shape), np.empty(RIGID_FIELDS), np.empty(3)
    for i in range(len(points)):
        _local(frame, points[i], q)
        distances[i] = _distance(own, q, contact)


@kernel
def find_rigid_contacts(points: FloatArray, slaves: Memory, shape: Memory, found: Memory) -> None:
    """Write all contacts: their slaves, geometry, gaps and reaches.

    ``points`` (n, 3) are positions, m.
    """
    touching, surface, own = unpack(Slaves, slaves), unpack(RigidShape, shape), unpack(Found, found)
    nodes, offsets, frame = touching.nodes, touching.offsets, surface.frame
    ends, contacts = own.ends, own.numbers
    closed = 0
    for i in range(len(nodes)):
        contact = contacts[closed]
        q = contact[PLACE : PLACE + 3]
        _local(frame, points[nodes[i]], q)
        gap = _distance(surface, q, contact) - offsets[i]
        if gap < 0.0:
            contact[GAP], contact[REACH], ends[closed, 0] = gap, offsets[i], i
            closed += 1
    own.closed[0] = closed


@inlined
def _turned(frame: FloatArray, v: FloatArray, a: int) -> float:
    """Component a in inertial axes of a vector in those of a frame."""
    return float(frame[3 + 3 * a] * v[0] + frame[4 + 3 * a] * v[1] + frame[5 + 3 * a] * v[2])


@kernel
def add_rigid_forces(
    slaves: Memory, shape: Memory, found: Memory, scale: float, residual: FloatArray,
    wrench: FloatArray,
) -> None:  # fmt: skip
    """Add ``scale`` times the derivative of the energy.

    The residual (n, 3) is that of all nodes, in inertial axes; the wrench (6,), force and moment,
    that of the surface's frame, in its axes.
    """
    touching, frame, own = (
        unpack(Slaves, slaves),
        unpack(RigidShape, shape).frame,
        unpack(Found, found),
    )
    nodes, stiffness, f = touching.nodes, touching.stiffness, np.empty(3)
    for c in range(own.closed[0]):
        i, contact = own.ends[c, 0], own.numbers[c]
        force, q = scale * stiffness[i] * contact[FORCE], contact[PLACE : PLACE + 3]
        for a in range(3):
            f[a] = force * contact[NORMAL + a]
        for a in range(3):
            residual[nodes[i], a] += _turned(frame, f, a)
            wrench[a] -= f[a]
            wrench[3 + a] -= q[(a + 1) % 3] * f[(a + 2) % 3] - q[(a + 2) % 3] * f[(a + 1) % 3]


@inlined
def _stiff(contact: FloatArray, k: float, dq: FloatArray, df: FloatArray) -> None:
    """Write the change (3,) of the force on the node for a change of its position."""
    normal = e = f = 0.0
    for a in range(3):
        normal += contact[NORMAL + a] * dq[a]
        e += contact[FIRST + a] * dq[a]
        f += contact[SECOND + a] * dq[a]
    normal *= contact[SLOPE]
    e, f = e * contact[BEND] * contact[FORCE], f * contact[BEND + 1] * contact[FORCE]
    for a in range(3):
        along = normal * contact[NORMAL + a] + e * contact[FIRST + a] + f * contact[SECOND + a]
        df[a] = k * along


@inlined
def _change(
    contact: FloatArray, k: float, frame: FloatArray, step: FloatArray, twist: FloatArray,
    change: FloatArray,
) -> None:  # fmt: skip
    """Write the change of the node's force (inertial axes) and of the frame's wrench, (9,)."""
    q, n = contact[PLACE : PLACE + 3], contact[NORMAL : NORMAL + 3]
    dq, df = np.empty(3), np.empty(3)
    turn, force = twist[3:], k * contact[FORCE]
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        dq[a] = q[b] * turn[c] - q[c] * turn[b] - twist[a]
        for d in range(3):
            dq[a] += frame[3 + 3 * d + a] * step[d]
    _stiff(contact, k, dq, df)
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        change[3 + a] = -df[a]
        change[6 + a] = -force * (dq[b] * n[c] - dq[c] * n[b]) - (q[b] * df[c] - q[c] * df[b])
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        dq[a] = df[a] + force * (turn[b] * n[c] - turn[c] * n[b])
    for a in range(3):
        change[a] = _turned(frame, dq, a)


@kernel
def add_rigid_actions(
    slaves: Memory, shape: Memory, found: Memory, scale: float, steps: FloatArray,
    twist: FloatArray, residual: FloatArray, wrench: FloatArray,
) -> None:  # fmt: skip
    """Add ``scale`` times the tangent applied to steps of nodes (n, 3) and the frame's twist."""
    touching, frame, own = (
        unpack(Slaves, slaves),
        unpack(RigidShape, shape).frame,
        unpack(Found, found),
    )
    stiffness, change = touching.stiffness, np.empty(9)
    for c in range(own.closed[0]):
        i = own.ends[c, 0]
        node, k = touching.nodes[i], scale * stiffness[i]
        _change(own.numbers[c], k, frame, steps[node], twist, change)
        for a in range(3):
            residual[node, a] += change[a]
        for a in range(6):
            wrench[a] += change[3 + a]


@kernel
def rigid_blocks_into(
    slaves: Memory, shape: Memory, found: Memory, scale: float, blocks: FloatArray
) -> None:
    """Write ``scale`` times the tangents (c, 9, 9): node, then twist of the frame."""
    stiffness, frame = unpack(Slaves, slaves).stiffness, unpack(RigidShape, shape).frame
    own, step, change = unpack(Found, found), np.zeros(9), np.empty(9)
    for c in range(own.closed[0]):
        k = scale * stiffness[own.ends[c, 0]]
        for b in range(9):
            step[b] = 1.0
            _change(own.numbers[c], k, frame, step[:3], step[3:], change)
            step[b] = 0.0
            for a in range(9):
                blocks[c, a, b] = change[a]
