# SPDX-License-Identifier: LGPL-3.0-or-later
"""Matrices of linear beam cells over a step: their sum, and the parts by velocity and acceleration.

They are the exact derivatives of the forces of ``forms.beam`` at nodes with inertial translations,
written out. With the relative twist ``d = (r, t)``, its change ``[-L R]`` along the local twists of
both ends, where L and R are the inverses of the left and the right tangent map, and the stress
resultants s, the inner forces change by ``([-L R]^T C / length + H) [-L R]``. H, the derivative of
``[-L R]^T s`` by d, is made of

    P = +-skew(n)/2 + e ((t.n) I + t n^T - 2 n t^T) + e1 z t^T,   z = t (t.n) - (t.t) n,

the derivative of the rotation's map transposed times a vector n, for force and moment, with minus
for the first end, and of that of ``P r`` with the force. The acceleration of a mass centre c at a
node with the acceleration A and the angular velocity o, both along its axes, changes along the
node's local twist (u, theta) by

    A x theta + cw u - (cw skew(c) + cv (skew(o x c) + skew(o) skew(c))) T theta

with the inverse tangent map T of the increment, and cv and cw, the changes of rates and
accelerations with increments. By velocity alone translations change nothing: they are integrated in
inertial axes.

The generated code of these matrices is a statement for each product of each of their entries, and
takes 4 us a cell.
"""

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.nodes.frame_kernels import Nodes
from flexfem.kernels.compiled import fused, fused_subroutine, inlined, inlined_fused
from flexfem.kernels.driver import Cells, put_rotation, put_twist, turn_matrix
from flexfem.kernels.lanes import LANES
from flexfem.kernels.records import Float2D, Memory, Record, unpack
from flexfem.kernels.vectors import add_to, load, store
from flexfem.lie import so3
from flexfem.lie._blocks import Triple, cross, dot
from flexfem.lie._coefficients import relative_derivatives

__all__ = ["LinearSections", "linear_matrices", "linear_sections"]


class LinearSections(Record):
    """Linear sections.

    Attributes:
        stiffness: (s, 36) stiffness matrices in blocks (2, 2, 3, 3).
        inertia: (s, 13) mass per length, mass centre, rotary inertia about it (3, 3).
    """

    stiffness: Float2D
    inertia: Float2D


def linear_sections(
    stiffness: FloatArray, mass: FloatArray, centres: FloatArray, rotary: FloatArray
) -> LinearSections:
    """The record of stiffness matrices (s, 6, 6), masses (s,), their centres and inertias."""
    blocks = stiffness.reshape(-1, 2, 3, 2, 3).transpose(0, 1, 3, 2, 4).reshape(-1, 36)
    inertia = np.column_stack([mass, centres, rotary.reshape(-1, 9)])
    return LinearSections(stiffness=np.ascontiguousarray(blocks), inertia=inertia)


#: First entries of a cell's data: relative twist, without stress, rotations of both ends, their
#: velocities and accelerations, inverse tangent maps of their increments; of its section.
_TWIST, _REST, _TURNS, _VELOCITY, _ACCELERATION, _MAPS = 0, 6, 12, 30, 42, 54
_STIFFNESS, _INERTIA, _LENGTH = 72, 108, 121
#: Work space, blocks (3, 3): inverses of the tangent maps of both ends (A and U in
#: ``[[A, U], [0, A]]``); P of force and moment for both ends, and the derivative of ``P r``;
#: changes of the forces of an end by d, (2, 2) blocks; rotation from the second end's axes to those
#: of the first, and back.
_A, _U, _P, _Q, _BY_TWIST, _ACROSS = 122, 140, 158, 194, 203, 239
#: Changes of a node's acceleration and of its moment with its rotation, for each end and matrix;
#: those of the force of an end, (2 ends, translation and rotation); one more.
_MOVED, _MOMENTS, _FORCE, _MORE = 257, 311, 365, 401
#: The matrices (12, 12): by velocity, by acceleration, of the step.
_MATRICES, _SIZE = 410, 410 + 3 * 144
_BY_VELOCITY, _BY_ACCELERATION, _STEP = range(3)


@inlined_fused
def _vector(w: FloatArray, at: int) -> Triple:
    return load(w, at), load(w, at + 1), load(w, at + 2)


@fused_subroutine
def _add_skew(w: FloatArray, at: int, stride: int, factor: float, v: Triple) -> None:
    """Add ``factor skew(v)`` to a block."""
    x, y, z = factor * v[0], factor * v[1], factor * v[2]
    add_to(w, at + 1, -z)
    add_to(w, at + 2, y)
    add_to(w, at + stride, z)
    add_to(w, at + stride + 2, -x)
    add_to(w, at + 2 * stride, -y)
    add_to(w, at + 2 * stride + 1, x)


@fused_subroutine
def _add_outer(w: FloatArray, at: int, factor: float, a: Triple, b: Triple) -> None:
    """Add ``factor a b^T`` to a block."""
    for i in range(3):
        own = factor * a[i]
        for j in range(3):
            add_to(w, at + 3 * i + j, own * b[j])


@inlined_fused
def _add_unit(w: FloatArray, at: int, factor: float) -> None:
    for i in range(3):
        add_to(w, at + 4 * i, factor)


@fused_subroutine
def _add_block(w: FloatArray, at: int, stride: int, factor: float, block: int) -> None:
    """Add a block times a factor."""
    for i in range(3):
        for j in range(3):
            add_to(w, at + stride * i + j, factor * load(w, block + 3 * i + j))


@fused_subroutine
def _add_product(w: FloatArray, at: int, stride: int, factor: float, a: int, b: int) -> None:
    """Add ``factor a b`` of blocks."""
    for i in range(3):
        x, y, z = _vector(w, a + 3 * i)
        x, y, z = factor * x, factor * y, factor * z
        for j in range(3):
            own = x * load(w, b + j) + y * load(w, b + 3 + j) + z * load(w, b + 6 + j)
            add_to(w, at + stride * i + j, own)


@fused_subroutine
def _add_transposed(w: FloatArray, at: int, factor: float, a: int, b: int) -> None:
    """Add ``factor a^T b`` of blocks."""
    for i in range(3):
        x, y, z = load(w, a + i), load(w, a + 3 + i), load(w, a + 6 + i)
        x, y, z = factor * x, factor * y, factor * z
        for j in range(3):
            own = x * load(w, b + j) + y * load(w, b + 3 + j) + z * load(w, b + 6 + j)
            add_to(w, at + 3 * i + j, own)


@fused_subroutine
def _add_cross(w: FloatArray, at: int, factor: float, v: Triple, block: int) -> None:
    """Add ``factor skew(v)`` times a block."""
    for j in range(3):
        x, y, z = load(w, block + j), load(w, block + 3 + j), load(w, block + 6 + j)
        add_to(w, at + j, factor * (v[1] * z - v[2] * y))
        add_to(w, at + 3 + j, factor * (v[2] * x - v[0] * z))
        add_to(w, at + 6 + j, factor * (v[0] * y - v[1] * x))


@inlined_fused
def _times(w: FloatArray, block: int, v: Triple) -> Triple:
    """A block times a vector."""
    return (
        dot(_vector(w, block), v), dot(_vector(w, block + 3), v), dot(_vector(w, block + 6), v)
    )  # fmt: skip


@inlined_fused
def _stress(w: FloatArray) -> tuple[Triple, Triple]:
    """Force and moment."""
    length = load(w, _LENGTH)
    r, t = _vector(w, _TWIST), _vector(w, _TWIST + 3)
    r0, t0 = _vector(w, _REST), _vector(w, _REST + 3)
    r = (r[0] - r0[0]) / length, (r[1] - r0[1]) / length, (r[2] - r0[2]) / length
    t = (t[0] - t0[0]) / length, (t[1] - t0[1]) / length, (t[2] - t0[2]) / length
    a, b = _times(w, _STIFFNESS, r), _times(w, _STIFFNESS + 9, t)
    c, d = _times(w, _STIFFNESS + 18, r), _times(w, _STIFFNESS + 27, t)
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2]), (c[0] + d[0], c[1] + d[1], c[2] + d[2])


@fused_subroutine
def _maps(w: FloatArray, r: Triple, t: Triple, e: Triple) -> None:
    """Inverses of the left and the right tangent map."""
    x, along = dot(t, t), dot(t, r)
    for end in range(2):
        A, U, half = _A + 9 * end, _U + 9 * end, end - 0.5
        _add_unit(w, A, 1.0 - e[0] * x)
        _add_skew(w, A, 3, half, t)
        _add_outer(w, A, e[0], t, t)
        _add_unit(w, U, -2.0 * e[0] * along - e[1] * along * x)
        _add_skew(w, U, 3, half, r)
        _add_outer(w, U, e[0], t, r)
        _add_outer(w, U, e[0], r, t)
        _add_outer(w, U, e[1] * along, t, t)


@fused_subroutine
def _add_bent(w: FloatArray, at: int, t: Triple, n: Triple, e: Triple) -> None:
    """Add the even part of P."""
    x, along = dot(t, t), dot(t, n)
    z = t[0] * along - x * n[0], t[1] * along - x * n[1], t[2] * along - x * n[2]
    _add_unit(w, at, e[0] * along)
    _add_outer(w, at, e[0], t, n)
    _add_outer(w, at, -2.0 * e[0], n, t)
    _add_outer(w, at, e[1], z, t)


@fused_subroutine
def _add_bent_again(w: FloatArray, at: int, r: Triple, t: Triple, n: Triple, e: Triple) -> None:
    """Add the derivative of ``P r``."""
    x, tn, tr, nr = dot(t, t), dot(t, n), dot(t, r), dot(n, r)
    z = t[0] * tn - x * n[0], t[1] * tn - x * n[1], t[2] * tn - x * n[2]
    y = (
        tn * r[0] + nr * t[0] - 2.0 * tr * n[0],
        tn * r[1] + nr * t[1] - 2.0 * tr * n[1],
        tn * r[2] + nr * t[2] - 2.0 * tr * n[2],
    )
    _add_unit(w, at, e[0] * nr + e[1] * tr * tn)
    _add_outer(w, at, e[0], r, n)
    _add_outer(w, at, -2.0 * e[0], n, r)
    _add_outer(w, at, e[1], y, t)
    _add_outer(w, at, e[1] * tr, t, n)
    _add_outer(w, at, -2.0 * e[1] * tr, n, t)
    _add_outer(w, at, e[1], z, r)
    _add_outer(w, at, e[2] * tr, z, t)


@inlined_fused
def _inner(w: FloatArray) -> None:
    """Add the changes of the inner forces."""
    r, t = _vector(w, _TWIST), _vector(w, _TWIST + 3)
    e = relative_derivatives(dot(t, t))
    n, m = _stress(w)
    _maps(w, r, t, e)
    for end in range(2):
        half = end - 0.5
        for k in range(2):
            at, s = _P + 18 * end + 9 * k, n if k == 0 else m
            _add_bent(w, at, t, s, e)
            _add_skew(w, at, 3, half, s)
    _add_bent_again(w, _Q, r, t, n, e)
    over = 1.0 / load(w, _LENGTH)
    for end in range(2):
        sign, A, U, P = 2.0 * end - 1.0, _A + 9 * end, _U + 9 * end, _P + 18 * end
        by = _BY_TWIST
        for k in range(36):
            store(w, by + k, 0.0 * over)
        for k in range(2):
            _add_transposed(w, by + 9 * k, over, A, _STIFFNESS + 9 * k)
            _add_transposed(w, by + 18 + 9 * k, over, U, _STIFFNESS + 9 * k)
            _add_transposed(w, by + 18 + 9 * k, over, A, _STIFFNESS + 18 + 9 * k)
        _add_block(w, by + 9, 3, 1.0, P)
        _add_block(w, by + 18, 3, 1.0, P)
        _add_block(w, by + 27, 3, 1.0, P + 9)
        _add_block(w, by + 27, 3, 1.0, _Q)
        for other in range(2):
            factor, A, U = sign * (2.0 * other - 1.0), _A + 9 * other, _U + 9 * other
            for k in range(2):
                at = _MATRICES + 144 * _STEP + 12 * (6 * end + 3 * k) + 6 * other
                _add_product(w, at, 12, factor, by + 18 * k, A)
                _add_product(w, at + 3, 12, factor, by + 18 * k, U)
                _add_product(w, at + 3, 12, factor, by + 18 * k + 9, A)


@fused_subroutine
def _node(w: FloatArray, end: int, cv: float, cw: float) -> Triple:
    """Add the changes of acceleration and moment of a node; returns the centre's acceleration."""
    c, J, T = _vector(w, _INERTIA + 1), _INERTIA + 4, _MAPS + 9 * end
    v, o = _vector(w, _VELOCITY + 6 * end), _vector(w, _VELOCITY + 6 * end + 3)
    dv, do = _vector(w, _ACCELERATION + 6 * end), _vector(w, _ACCELERATION + 6 * end + 3)
    moved, moment = _MOVED + 27 * end, _MOMENTS + 27 * end
    spun, speed = cross(o, v), cross(o, c)
    A = dv[0] + spun[0], dv[1] + spun[1], dv[2] + spun[2]
    _add_skew(w, _MORE, 3, -cv, speed)
    _add_outer(w, _MORE, -cv, c, o)
    _add_unit(w, _MORE, cv * dot(o, c))
    _add_product(w, moved, 3, 1.0, _MORE, T)
    _add_cross(w, moved + 9, -cw, c, T)
    _clear(w, _MORE, 9)
    _add_skew(w, _MORE, 3, -cv, _times(w, J, o))
    _add_cross(w, _MORE, cv, o, J)
    _add_product(w, moment, 3, 1.0, _MORE, T)
    _add_product(w, moment + 9, 3, cw, J, T)
    _clear(w, _MORE, 9)
    _add_skew(w, moved + 18, 3, 1.0, A)
    for matrix in (_BY_VELOCITY, _BY_ACCELERATION):
        _add_block(w, moved + 18, 3, 1.0, moved + 9 * matrix)
        _add_block(w, moment + 18, 3, 1.0, moment + 9 * matrix)
    p, q = cross(do, c), cross(o, speed)
    return A[0] + p[0] + q[0], A[1] + p[1] + q[1], A[2] + p[2] + q[2]


@fused_subroutine
def _clear(w: FloatArray, at: int, count: int) -> None:
    zero = 0.0 * load(w, _LENGTH)
    for k in range(count):
        store(w, at + k, zero)


@inlined_fused
def _weight(w: FloatArray, turn: int, gravity: FloatArray) -> Triple:
    """The gravity along the axes of an end."""
    x, y, z = _vector(w, turn), _vector(w, turn + 3), _vector(w, turn + 6)
    return (
        gravity[0] * x[0] + gravity[1] * y[0] + gravity[2] * z[0],
        gravity[0] * x[1] + gravity[1] * y[1] + gravity[2] * z[1],
        gravity[0] * x[2] + gravity[1] * y[2] + gravity[2] * z[2],
    )


@inlined_fused
def _inertial(w: FloatArray, cv: float, cw: float, gravity: FloatArray) -> None:
    """Add the changes of inertia forces and weight."""
    _add_transposed(w, _ACROSS, 1.0, _TURNS, _TURNS + 9)
    _add_transposed(w, _ACROSS + 9, 1.0, _TURNS + 9, _TURNS)
    length, c = load(w, _LENGTH), _vector(w, _INERTIA + 1)
    sixth = length * load(w, _INERTIA) / 6.0
    b = _node(w, 0, cv, cw), _node(w, 1, cv, cw)
    for end in range(2):
        other, R = 1 - end, _ACROSS + 9 * end
        other_b = b[1] if end == 0 else b[0]
        g = _weight(w, _TURNS + 9 * end, gravity)
        for matrix in range(3):
            _clear(w, _FORCE, 36)
            own, far = _FORCE + 18 * end, _FORCE + 18 * other
            if matrix != _BY_VELOCITY:
                _add_unit(w, own, 2.0 * cw * sixth)
                _add_block(w, far, 3, cw * sixth, R)
            _add_block(w, own + 9, 3, 2.0 * sixth, _MOVED + 27 * end + 9 * matrix)
            _add_product(w, far + 9, 3, sixth, R, _MOVED + 27 * other + 9 * matrix)
            if matrix == _STEP:
                _add_skew(w, own + 9, 3, sixth, _times(w, R, other_b))
                _add_skew(w, own + 9, 3, -3.0 * sixth, g)
                _clear(w, _MORE, 9)
                _add_skew(w, _MORE, 3, -sixth, other_b)
                _add_product(w, far + 9, 3, 1.0, R, _MORE)
                _clear(w, _MORE, 9)
            row = _MATRICES + 144 * matrix + 72 * end
            for block in range(4):
                _add_block(w, row + 3 * block, 12, 1.0, _FORCE + 9 * block)
                _clear(w, _MORE, 9)
                _add_cross(w, _MORE, 1.0, c, _FORCE + 9 * block)
                _add_block(w, row + 36 + 3 * block, 12, 1.0, _MORE)
            _clear(w, _MORE, 9)
            _add_block(
                w, row + 36 + 6 * end + 3, 12, 0.5 * length, _MOMENTS + 27 * end + 9 * matrix
            )


@inlined
def _put(data: FloatArray, lane: int, at: int, values: FloatArray, count: int) -> None:
    """Write numbers of a cell."""
    for k in range(count):
        data[np.uintp(at + k), np.uintp(lane)] = values[np.uintp(k)]


@inlined
def _put_map(
    data: FloatArray, lane: int, at: int, T: FloatArray, turned: bool, Q: FloatArray
) -> None:
    """Write a map of the rotations of a node in the axes of a cell, ``Q^T T Q``."""
    for i in range(3):
        for j in range(3):
            if turned:
                total = 0.0
                for k in range(3):
                    own = T[3 * k] * Q[j] + T[3 * k + 1] * Q[3 + j] + T[3 * k + 2] * Q[6 + j]
                    total += Q[3 * k + i] * own
                data[at + 3 * i + j, lane] = total
            else:
                data[at + 3 * i + j, lane] = T[3 * i + j]


@inlined
def _gather(
    cells: Cells, sections: LinearSections, nodes: Nodes, given: tuple[FloatArray, FloatArray],
    c: int, lane: int, data: FloatArray,
) -> None:  # fmt: skip
    """Write the data of a cell; ``given``: twists of all cells and maps of all nodes."""
    section, turned, turn = cells.section[c], cells.turned[c], c * cells.turned[c]
    _put(data, lane, _TWIST, given[0][c], 6)
    _put(data, lane, _REST, cells.own[c], 6)
    data[_LENGTH, lane] = cells.own[c, 6]
    _put(data, lane, _STIFFNESS, sections.stiffness[section], 36)
    _put(data, lane, _INERTIA, sections.inertia[section], 13)
    for end in range(2):
        n, Q = cells.nodes[c, end], cells.turns[turn, end]
        put_rotation(data, _TURNS + 9 * end, lane, nodes.frames[n], turned, Q)
        put_twist(data, _VELOCITY + 6 * end, lane, nodes.velocity[n], turned, Q)
        put_twist(data, _ACCELERATION + 6 * end, lane, nodes.acceleration[n], turned, Q)
        _put_map(data, lane, _MAPS + 9 * end, given[1][n], turned, Q)


@fused
def linear_matrices(
    cells: Memory, sections: Memory, memory: Memory, twists: FloatArray, gravity: FloatArray,
    law: FloatArray, values: FloatArray,
) -> None:  # fmt: skip
    """Write the matrices of all cells.

    Args:
        cells: ``Cells`` of a ``BeamGroup``.
        sections: ``LinearSections``.
        memory: ``Nodes`` of the block, with inertial translations.
        twists: (m, 6) relative twists.
        gravity: (3,) m/s^2.
        law: (3,) dv/dn, dw/dn and the factor of all.
        values: (3, m, 144) by velocity, by acceleration, and all in all.
    """
    own, nodes = unpack(Cells, cells), unpack(Nodes, memory)
    table, count = unpack(LinearSections, sections), own.nodes.shape[0]
    maps, work = np.empty((nodes.increment.shape[0], 9)), np.empty(3)
    for n in range(maps.shape[0]):
        so3.inverse_tangent_into(nodes.increment[n, 3:], maps[n])
    data = np.empty((_SIZE, LANES))
    flat = data.reshape(-1)
    for first in range(0, count, LANES):
        for lane in range(LANES):
            c = min(first + lane, count - 1)
            _gather(own, table, nodes, (twists, maps), c, lane, data)
        _clear(flat, _A, _SIZE - _A)
        _inner(flat)
        _inertial(flat, law[0], law[1], gravity)
        for r in range(3):
            for lane in range(min(LANES, count - first)):
                c = first + lane
                for k in range(144):
                    value = data[np.uintp(_MATRICES + 144 * r + k), np.uintp(lane)]
                    values[r, c, k] = law[2] * value
                if own.turned[c]:
                    turn_matrix(own, c, values[r, c], work)
