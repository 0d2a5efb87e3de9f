# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled inertia and weight of cables that flow through their guides.

All of a cable has one stretch, ``L / R`` of its length L and rest length R: its material at the arc
length ``sigma`` from the first guide moves along the path at ``sigma' = L' - y (L - sigma)`` with
``y = L'/L - R'/R``, as the last end keeps its material. Between guides the path is straight, with
the tangent t. Beside guide k material has the velocity ``v_k + w t``, where ``w = sigma' - Z_k``
and ``Z_k`` is the sum of ``t . (v_j+1 - v_j)`` of the straight parts before it: over sheaves as
through points. On a straight part velocities are linear in ``sigma``; on a sheave t turns with the
angle. At a point what flows through changes its direction at once, by the limit of an arc: the
guide gives it ``rho w^2`` times the change of t. Accelerations a follow by differentiation at fixed
material, and with the virtual displacements at a fixed rest length d'Alembert's principle, the
integral of ``rho (a - g) . dr``, has the forces. It holds for the mass that is there, whatever
flows in at a winch (Escalona 2017, "An arbitrary Lagrangian-Eulerian discretization method for
modeling and simulation of reeving systems in multibody dynamics", where flows are unknowns of their
own).

The turning of a sheave's axis moves the cable on it, too, which is left out.
"""

from math import atan2, cos, pi, sin, sqrt

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.core.curves.tangent_line import straight_into
from flexfem.kernels.compiled import kernel, subroutine
from flexfem.kernels.records import Float1D, Float2D, Int1D, Memory, Record, unpack
from flexfem.lie._blocks import cross, dot, triple

__all__ = ["Cables", "Motion", "add_flow_motion", "add_forces", "tangent_columns"]

#: Points and weights of Gauss on (0, 1): exact on straight parts; and of each piece of an arc.
_HALF = 0.5 / sqrt(3.0)
_POINTS = 0.5 + 0.5 * np.polynomial.legendre.leggauss(5)[0]
_WEIGHTS = 0.5 * np.polynomial.legendre.leggauss(5)[1]
#: Angle (rad) of a piece.
_PIECE = 0.5 * pi
#: Columns of a straight part: tangent, its rate, length, Z of its first guide with rate, unit
#: vectors from the centres of both sheaves, arc lengths of its ends, speeds at which they roll on
#: the sheaves.
_T, _P, _LENGTH, _Z, _ARMS, _AT, _ROLL, _WIDTH = 0, 3, 6, 7, 9, 15, 17, 19
#: Relative step of differences by positions: the root of round-off, for central differences.
_STEP = 1e-6


class Cables(Record):
    """Cables of a rank.

    Attributes:
        start: (c + 1,) first guide of each cable.
        centre: (g,) local node of each guide.
        tip: (g,) node on its axis, -1 for points.
        radius: (g,) m, zero for points.
        lowest: (g,) of the range of 2 pi in which the angle around a sheave is, rad.
        density: (c,) kg/m of unstretched cable.
        rest: (c, 3) rest length, m, and its first two rates.
    """

    start: Int1D
    centre: Int1D
    tip: Int1D
    radius: Float1D
    lowest: Float1D
    density: Float1D
    rest: Float2D


class Motion(Record):
    """Positions, velocities and accelerations (n, 3) of the nodes in inertial axes."""

    points: Float2D
    velocity: Float2D
    acceleration: Float2D


@subroutine
def _axis_into(own: Memory, at: Memory, guide: int, out: FloatArray) -> None:
    """Axis of a guide times its radius; zero of points."""
    cables, nodes = unpack(Cables, own), unpack(Motion, at)
    out[:] = 0.0
    if cables.tip[guide] >= 0:
        for i in range(3):
            tip = nodes.points[cables.tip[guide], i]
            out[i] = tip - nodes.points[cables.centre[guide], i]
        size = sqrt(dot(triple(out, 0), triple(out, 0)))
        for i in range(3):
            out[i] *= cables.radius[guide] / size


@subroutine
def _angle(before: FloatArray, after: FloatArray, axis: FloatArray, lowest: float) -> float:
    """Angle from one unit vector to another about an axis, in the range from ``lowest``."""
    sine = dot(cross(triple(before, 0), triple(after, 0)), triple(axis, 0))
    radius = sqrt(dot(triple(axis, 0), triple(axis, 0)))
    angle = atan2(sine / radius, dot(triple(before, 0), triple(after, 0)))
    return lowest + (angle - lowest) % (2.0 * pi)


@subroutine
def _course_into(own: Memory, at: Memory, c: int, W: FloatArray, whole: FloatArray) -> None:
    """Straight parts of a cable in rows of ``W``; length with two rates in ``whole``."""
    cables, nodes = unpack(Cables, own), unpack(Motion, at)
    first, count = cables.start[c], cables.start[c + 1] - cables.start[c]
    D, s, ends, sizes = np.empty(3), np.empty(3), np.empty((2, 3)), np.empty(2)
    axes, inverse, rate = np.empty((2, 3)), np.empty((3, 3)), np.empty(3)
    length = Z = dZ = 0.0
    _axis_into(own, at, first, axes[1])
    for j in range(count - 1):
        i0, i1 = cables.centre[first + j], cables.centre[first + j + 1]
        for i in range(3):
            axes[0, i] = axes[1, i]
            D[i] = nodes.points[i1, i] - nodes.points[i0, i]
            rate[i] = nodes.velocity[i1, i] - nodes.velocity[i0, i]
        _axis_into(own, at, first + j + 1, axes[1])
        straight_into(D, axes[0], axes[1], s, ends, sizes, inverse)
        row = W[j]
        row[_LENGTH] = sqrt(dot(triple(s, 0), triple(s, 0)))
        if j > 0 and cables.tip[first + j] >= 0:
            arm, lowest = W[j - 1, _ARMS + 3 : _ARMS + 6], cables.lowest[first + j]
            length += cables.radius[first + j] * _angle(arm, ends[0], axes[0], lowest)
        row[_Z], row[_Z + 1], row[_AT] = Z, dZ, length
        length += row[_LENGTH]
        row[_AT + 1] = length
        along = 0.0
        for i in range(3):
            row[_T + i] = s[i] / row[_LENGTH]
            row[_ARMS + i], row[_ARMS + 3 + i] = ends[0, i], ends[1, i]
            along += row[_T + i] * rate[i]
        for i in range(3):
            row[_P + i] = (rate[i] - along * row[_T + i]) / row[_LENGTH]
            curved = row[_T + i] * (nodes.acceleration[i1, i] - nodes.acceleration[i0, i])
            dZ += curved + row[_LENGTH] * row[_P + i] * row[_P + i]
        Z += along
        turn = cross(triple(row, _T), triple(row, _P))
        for side in range(2):
            row[_ROLL + side] = dot(triple(axes[side], 0), turn)
    W[count - 1, _Z], W[count - 1, _Z + 1] = Z, dZ
    whole[0], whole[1], whole[2] = length, Z, dZ


@subroutine
def _flow_into(
    rest: FloatArray, whole: FloatArray, Z: FloatArray, arc: float, out: FloatArray
) -> None:
    """Speed along the path relative to a guide with ``Z`` (2,), and its rate, at an arc length."""
    length, grows, feeds = whole[0], whole[1] / whole[0], rest[1] / rest[0]
    stretching = grows - feeds
    curved = whole[2] / length - 2.0 * grows * feeds - rest[2] / rest[0] + 2.0 * feeds * feeds
    out[0] = whole[1] - stretching * (length - arc) - Z[0]
    out[1] = whole[2] - curved * (length - arc) - Z[1]


@subroutine
def _straight_ends_into(
    own: Memory, at: Memory, c: int, j: int, W: FloatArray, whole: FloatArray, V: FloatArray,
    A: FloatArray,
) -> None:  # fmt: skip
    """Velocities and accelerations (2, 3) of the material at the ends of a straight part."""
    cables, nodes = unpack(Cables, own), unpack(Motion, at)
    flow, row = np.empty(2), W[j]
    for side in range(2):
        node = cables.centre[cables.start[c] + j + side]
        Z = W[j + side, _Z : _Z + 2]
        _flow_into(cables.rest[c], whole, Z, row[_AT + side], flow)
        turning = 2.0 * flow[0] - row[_ROLL + side]
        for i in range(3):
            V[side, i] = nodes.velocity[node, i] + flow[0] * row[_T + i]
            A[side, i] = nodes.acceleration[node, i] + flow[1] * row[_T + i]
            A[side, i] += turning * row[_P + i]


@subroutine
def _pieces(own: Memory, c: int, k: int, W: FloatArray) -> int:
    """Number of pieces of the arc at an inner guide; zero of points."""
    cables = unpack(Cables, own)
    guide = cables.start[c] + k
    if cables.tip[guide] < 0:
        return 0
    angle = abs(W[k, _AT] - W[k - 1, _AT + 1]) / cables.radius[guide]
    return 1 + int(angle / _PIECE)


@subroutine
def _arc_point_into(
    own: Memory, at: Memory, c: int, k: int, part: float, W: FloatArray, whole: FloatArray,
    out: FloatArray,
) -> float:  # fmt: skip
    """Tangent, place, velocity and acceleration (4, 3) at a part of an arc; its arc length."""
    cables, nodes = unpack(Cables, own), unpack(Motion, at)
    guide, flow, axis = cables.start[c] + k, np.empty(2), np.empty(3)
    begin, radius, node = W[k - 1, _AT + 1], cables.radius[guide], cables.centre[guide]
    arc: float = begin + part * (W[k, _AT] - begin)
    angle = (arc - begin) / radius
    _axis_into(own, at, guide, axis)
    _flow_into(cables.rest[c], whole, W[k, _Z : _Z + 2], arc, flow)
    arm = triple(W[k - 1], _ARMS + 3)
    side = cross(triple(axis, 0), arm)
    ahead = cross(triple(axis, 0), side)
    for i in range(3):
        e = cos(angle) * arm[i] + sin(angle) * side[i] / radius
        out[0, i] = cos(angle) * side[i] / radius + sin(angle) * ahead[i] / (radius * radius)
        out[1, i] = nodes.points[node, i] + radius * e
        out[2, i] = nodes.velocity[node, i] + flow[0] * out[0, i]
        out[3, i] = nodes.acceleration[node, i] + flow[1] * out[0, i]
        out[3, i] -= flow[0] * flow[0] / radius * e
    return arc


@subroutine
def _put(
    t: FloatArray, force: FloatArray, share: float, k: int, node: int, arc: float,
    pulls: FloatArray, sums: FloatArray, f: FloatArray,
) -> None:  # fmt: skip
    """Add a share of a force on the material beside guide k."""
    along = 0.0
    for i in range(3):
        f[node, i] += share * force[i]
        along += share * force[i] * t[i]
    pulls[k] += along
    sums[0] += along
    sums[1] += along * arc


@subroutine
def _forces(
    own: Memory, at: Memory, c: int, gravity: FloatArray, scale: float, f: FloatArray
) -> float:
    """Add ``scale`` times inertia forces less weight of a cable to ``f`` (n, 3).

    Returns the part of the force that pays out rest length at the first end, N.
    """
    cables = unpack(Cables, own)
    first, count = cables.start[c], cables.start[c + 1] - cables.start[c]
    W, whole, pulls, sums = np.empty((count, _WIDTH)), np.empty(3), np.zeros(count), np.zeros(2)
    V, A, point, force = np.empty((2, 3)), np.empty((2, 3)), np.empty((4, 3)), np.empty(3)
    flow = np.empty(2)
    _course_into(own, at, c, W, whole)
    density = scale * cables.density[c] * cables.rest[c, 0] / whole[0]
    for j in range(count - 1):
        _straight_ends_into(own, at, c, j, W, whole, V, A)
        mass = density * W[j, _LENGTH] / 6.0
        for side in range(2):
            for i in range(3):
                force[i] = mass * (2.0 * A[side, i] + A[1 - side, i] - 3.0 * gravity[i])
            node, arc = cables.centre[first + j + side], W[j, _AT + side]
            _put(W[j], force, 1.0, j + side, node, arc, pulls, sums, f)
    for k in range(1, count - 1):
        pieces, span = _pieces(own, c, k, W), W[k, _AT] - W[k - 1, _AT + 1]
        if pieces == 0:  # the limit of an arc of no length, along which nothing pulls
            _flow_into(cables.rest[c], whole, W[k, _Z : _Z + 2], W[k, _AT], flow)
            thrust = density * flow[0] * flow[0]
            for i in range(3):
                f[cables.centre[first + k], i] += thrust * (W[k, _T + i] - W[k - 1, _T + i])
        for n in range(5 * pieces):
            part = (n // 5 + _POINTS[n % 5]) / pieces
            arc = _arc_point_into(own, at, c, k, part, W, whole, point)
            for i in range(3):
                force[i] = point[3, i] - gravity[i]
            mass = density * span * _WEIGHTS[n % 5] / pieces
            _put(point[0], force, mass, k, cables.centre[first + k], arc, pulls, sums, f)
    # sigma grows with the length, and w falls with the straight parts before
    total = sums[1] / whole[0] - sums[0]
    for j in range(count - 1):
        total += pulls[j]
        for i in range(3):
            f[cables.centre[first + j + 1], i] += total * W[j, _T + i]
            f[cables.centre[first + j], i] -= total * W[j, _T + i]
    feed: float = (sums[0] * whole[0] - sums[1]) / cables.rest[c, 0]
    return feed


@kernel
def add_forces(
    own: Memory, at: Memory, gravity: FloatArray, scale: float, f: FloatArray, powers: FloatArray
) -> None:
    """Add ``scale`` times inertia forces less weights to ``f`` (n, 3), N.

    ``powers`` (c,) become what winches add to the energy besides the work of the stretch, W: the
    energy of the material that comes in, and the work along it.
    """
    cables, nodes = unpack(Cables, own), unpack(Motion, at)
    for c in range(len(cables.density)):
        feed, rate = _forces(own, at, c, gravity, scale, f), cables.rest[c, 1]
        powers[c] = 0.0
        if rate != 0.0:
            count = cables.start[c + 1] - cables.start[c]
            W, whole, flow = np.empty((count, _WIDTH)), np.empty(3), np.empty(2)
            _course_into(own, at, c, W, whole)
            _flow_into(cables.rest[c], whole, W[0, _Z : _Z + 2], 0.0, flow)
            node, energy = cables.centre[cables.start[c]], 0.0
            for i in range(3):
                v = nodes.velocity[node, i] + flow[0] * W[0, _T + i]
                energy += 0.5 * v * v - gravity[i] * nodes.points[node, i]
            powers[c] = rate * (feed / scale + cables.density[c] * energy)


@subroutine
def _moved(
    own: Memory, at: Memory, c: int, gravity: FloatArray, node: int, axis: int,
    step: FloatArray, sign: float, f: FloatArray,
) -> None:  # fmt: skip
    """Add signed forces where one coordinate of a node, its rate and second rate are changed."""
    nodes = unpack(Motion, at)
    x, v, a = nodes.points[node, axis], nodes.velocity[node, axis], nodes.acceleration[node, axis]
    nodes.points[node, axis] = x + sign * step[0]
    nodes.velocity[node, axis] = v + sign * step[1]
    nodes.acceleration[node, axis] = a + sign * step[2]
    _forces(own, at, c, gravity, sign, f)
    nodes.points[node, axis], nodes.velocity[node, axis] = x, v
    nodes.acceleration[node, axis] = a


@kernel
def tangent_columns(
    own: Memory, at: Memory, c: int, of_cable: IntArray, gravity: FloatArray,
    shifts: FloatArray, f: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    """Derivatives of the forces of a cable by its nodes, ``k K + C dv + M dw``.

    Forces are linear in accelerations and quadratic in velocities: differences along both at once
    are exact, those along positions have the root of round-off.

    Args:
        own: ``Cables``.
        at: ``Motion``.
        c: number of the cable.
        of_cable: (m,) its nodes.
        gravity: (3,) m/s^2.
        shifts: (dv/dn, dw/dn, k).
        f: (n, 3) work space.
        out: (3 m, 3 m).
    """
    cables = unpack(Cables, own)
    step, size = np.zeros(3), cables.rest[c, 0]
    out[:] = 0.0
    for m in range(len(of_cable)):
        node = of_cable[m]
        for axis in range(3):
            for kind in range(3):
                step[:] = 0.0
                step[kind] = _STEP * size if kind == 0 else 1.0
                factor = shifts[2] if kind == 0 else shifts[kind - 1]
                if factor == 0.0:
                    continue
                for n in of_cable:
                    f[n] = 0.0
                _moved(own, at, c, gravity, node, axis, step, 1.0, f)
                _moved(own, at, c, gravity, node, axis, step, -1.0, f)
                for n in range(len(of_cable)):
                    for i in range(3):
                        change = 0.5 * factor / step[kind] * f[of_cable[n], i]
                        out[3 * n + i, 3 * m + axis] += change


@subroutine
def _add_point(mass: float, x: FloatArray, v: FloatArray, motion: FloatArray) -> None:
    """Add energy and momenta of a mass, see ``core.nodes.motion``."""
    turn = cross(triple(x, 0), triple(v, 0))
    motion[1] += mass
    for i in range(3):
        motion[0] += 0.5 * mass * v[i] * v[i]
        motion[2 + i] += mass * x[i]
        motion[5 + i] += mass * v[i]
        motion[8 + i] += mass * turn[i]


@kernel
def add_flow_motion(own: Memory, at: Memory, c: int, motion: FloatArray) -> None:
    """Add energy and momenta of a cable, see ``core.nodes.motion``."""
    cables, nodes = unpack(Cables, own), unpack(Motion, at)
    first, count = cables.start[c], cables.start[c + 1] - cables.start[c]
    W, whole, point = np.empty((count, _WIDTH)), np.empty(3), np.empty((4, 3))
    V, A, x, v = np.empty((2, 3)), np.empty((2, 3)), np.empty(3), np.empty(3)
    _course_into(own, at, c, W, whole)
    density = cables.density[c] * cables.rest[c, 0] / whole[0]
    for j in range(count - 1):
        _straight_ends_into(own, at, c, j, W, whole, V, A)
        node, radius = cables.centre[first + j], cables.radius[first + j]
        for n in range(2):
            part = 0.5 - _HALF if n == 0 else 0.5 + _HALF
            for i in range(3):
                begin = nodes.points[node, i] + radius * W[j, _ARMS + i]
                x[i] = begin + part * W[j, _LENGTH] * W[j, _T + i]
                v[i] = (1.0 - part) * V[0, i] + part * V[1, i]
            _add_point(0.5 * density * W[j, _LENGTH], x, v, motion)
    for k in range(1, count - 1):
        pieces, span = _pieces(own, c, k, W), W[k, _AT] - W[k - 1, _AT + 1]
        for n in range(5 * pieces):
            part = (n // 5 + _POINTS[n % 5]) / pieces
            _arc_point_into(own, at, c, k, part, W, whole, point)
            mass = density * span * _WEIGHTS[n % 5] / pieces
            _add_point(mass, point[1], point[2], motion)
