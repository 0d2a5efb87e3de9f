# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loops over bodies in a floating frame: forces, matrices and momenta at their nodes.

``nodes`` (m, N) hold frame, interfaces and amplitudes of each body, without the frame if it is a
mean-axis frame. See ``core.places.floating_frames`` and ``inertia`` for the notation.

These are not loops of ``kernels.driver``: it would copy the data of bodies in every call, 1888
numbers of a bar with two interfaces and six modes, which takes 2.9 microseconds beside the 3.3 of
:func:`add_residual`, twice in a step of 62; nodal data alone take 0.9, and 7 beside 157 for 64
bodies.
"""

import numpy as np

from flexfem._types import BoolArray, FloatArray, IndexArray
from flexfem.core.nodes.frame_kernels import Nodes, step_rates_into
from flexfem.core.nodes.motion import ANGULAR, FIRST, KINETIC, LINEAR, MASS
from flexfem.core.places.floating_frames import (
    act,
    first,
    linear_into,
    row_of,
    second,
    third,
    write_columns,
    write_linear_columns,
    write_linear_second,
    write_second,
)
from flexfem.families.floating.elastic import add_elastic, add_elastic_tangent, strain_energy
from flexfem.families.floating.inertia import (
    BodyData,
    Room,
    body_acceleration,
    extend,
    fields_into,
    fold,
    forces_into,
    moment,
    put_skew,
)
from flexfem.families.floating.mean_axes import carry, condense, locate, relative_motion, respond
from flexfem.families.floating.tangent import damping_into, fold_matrices, mass_into, stiffness_into
from flexfem.kernels.compiled import kernel, subroutine
from flexfem.kernels.records import Memory, unpack

__all__ = ["add_motion", "add_residual", "coordinates_into", "energies_into", "tangents_into"]


@subroutine
def _state_into(
    data: BodyData, room: Room, nodes: IndexArray, frames: FloatArray, velocity: FloatArray,
    acceleration: FloatArray,
) -> IndexArray:  # fmt: skip
    """Write the state of frame and coordinates of one body; its nodes without that of the frame."""
    if len(data.conditions):
        locate(data, room, nodes, frames, velocity, acceleration)
        return nodes
    at, base = nodes[0], room.base
    base[:12], base[12:18], base[18:] = frames[at], velocity[at], acceleration[at]
    relative_motion(data, room, nodes[1:], frames, velocity, acceleration)
    return nodes[1:]


@kernel
def coordinates_into(
    data: Memory, room: Memory, nodes: IndexArray, frames: FloatArray, velocity: FloatArray,
    acceleration: FloatArray, base: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    """Write frames with twists and their rates (m, 24), coordinates with derivatives (m, n, 3).

    Args:
        data: ``BodyData``.
        room: ``Room``.
        nodes: (m, N) of each body, see the module.
        frames: (n, 12) of all nodes.
        velocity: (n, 6) their local twists.
        acceleration: (n, 6) the rates of these.
        base: gets the frames.
        out: gets the coordinates.
    """
    of, own = unpack(BodyData, data), unpack(Room, room)
    for b in range(len(nodes)):
        _state_into(of, own, nodes[b], frames, velocity, acceleration)
        base[b], out[b] = own.base, own.eta


@subroutine
def _add_to_nodes(
    nodes: IndexArray, columns: FloatArray, force: FloatArray, scale: float, residual: FloatArray
) -> None:
    """Add forces on frame and elastic coordinates to the nodes of one body."""
    k, width = columns.shape[0], columns.shape[1]
    last = len(force) - (width - 6) * k  # products of rotations follow
    own = len(nodes) - (k + (last - 4 - 6 * k) // 3)  # 1 if the frame has a node
    if own:
        for i in range(6):
            residual[nodes[0], i] += scale * force[i]
    for c in range(k):
        for j in range(0 if own else 6, 12):
            total = 0.0
            for i in range(width):
                total += columns[c, i, j] * force[6 + row_of(c, i, k, len(force) - 6)]
            residual[nodes[0 if j < 6 else own + c], j % 6] += scale * total
    for j in range(last - 6 - 6 * k):
        residual[nodes[own + k + j // 3], j % 3] += scale * force[6 + 6 * k + j]


@kernel
def add_residual(
    data: Memory, room: Memory, nodes: IndexArray, state: Memory, gravity: FloatArray, scale: float
) -> None:
    """Add ``scale`` times inertia, elastic and damping forces less weights to the residual.

    Args:
        data: ``BodyData``.
        room: ``Room``.
        nodes: (m, N) of each body, see the module.
        state: ``Nodes`` of the block.
        gravity: acceleration in inertial axes.
        scale: see above.
    """
    of, own, all_of = unpack(BodyData, data), unpack(Room, room), unpack(Nodes, state)
    k, force, every = (
        len(of.rest),
        np.empty(6 + len(of.stiffness)),
        np.empty(5 + of.moments.shape[1]),
    )
    frames, velocity, acceleration = all_of.frames, all_of.velocity, all_of.acceleration
    for b in range(len(nodes)):
        _state_into(of, own, nodes[b], frames, velocity, acceleration)
        fields_into(of, extend(of, own), own)
        body_acceleration(own, gravity)
        forces_into(of, own, every)
        fold(of, own.G, every, force)
        add_elastic(of, own.eta, force[6:])
        for c in range(k):
            _put_columns(own, c)
        if len(of.conditions):
            carry(of, own.columns, force)
        _add_to_nodes(nodes[b], own.columns, force, scale, all_of.residual)


@subroutine
def _put_columns(room: Room, c: int) -> None:
    """Write the derivatives of an interface's coordinates by the twists of frame and interface."""
    if room.columns.shape[1] == 12:
        write_linear_columns(room.X[c, 0], room.units[c], room.columns[c])
    else:
        write_columns(room.X[c, 0], room.g[c], room.units[c], room.columns[c])


@subroutine
def _put_changes(
    room: Room, c: int, v: FloatArray, w: FloatArray, by: FloatArray, stiffness: float,
    changes: FloatArray,
) -> None:  # fmt: skip
    """Changes (3, w, 12) of an interface's w coordinates, rates and their rates along both twists.

    Args:
        room: with the state of the body.
        c: the interface.
        v: (6,) its local twist.
        w: (6,) the rate of that.
        by: (2, 2, 36) changes of the twists of frame and interface along their own steps, and those
            of their rates.
        stiffness: factor of the changes of position.
        changes: result, see above.
    """
    X, g, units = room.X[c], room.g[c], room.units[c]
    v_frame, w_frame = room.base[12:18], room.base[18:]
    x, dx, ddx, linear = np.empty(12), np.empty(12), np.empty(12), changes.shape[1] == 12
    values = np.empty(12)
    dv, dw, none = np.empty(6), np.empty(6), np.zeros(6)
    for j in range(12):
        own, at = j // 6, j % 6
        for i in range(6):
            dv[i], dw[i] = by[0, own, 6 * i + at], by[1, own, 6 * i + at]
        left, right = (dv, none) if own == 0 else (none, dv)
        left_rate, right_rate = (dw, none) if own == 0 else (none, dw)
        for i in range(12):
            x[i] = stiffness * units[j, i]
            dx[i], ddx[i] = 0.0, 0.0
        act(x, v, v_frame, 0.0, 1.0, dx)
        act(X[0], right, left, 1.0, 1.0, dx)
        act(dx, v, v_frame, 0.0, 1.0, ddx)
        act(X[1], right, left, 0.0, 1.0, ddx)
        act(x, w, w_frame, 0.0, 1.0, ddx)
        act(X[0], right_rate, left_rate, 1.0, 1.0, ddx)
        if linear:
            for t, change in enumerate((x, dx, ddx)):
                linear_into(change, 0.0, values)
                for i in range(12):
                    changes[t, i, j] = values[i]
            continue
        for i in range(3):
            changes[0, i, j], changes[1, i, j], changes[2, i, j] = x[i], dx[i], ddx[i]
            changes[0, 3 + i, j] = first(X[0], g, x, i)
            changes[1, 3 + i, j] = first(X[0], g, dx, i) + second(X[0], g, X[1], x, i)
            changes[2, 3 + i, j] = (
                first(X[0], g, ddx, i)
                + second(X[0], g, X[2], x, i)
                + 2.0 * second(X[0], g, X[1], dx, i)
                + third(X[0], g, X[1], x, i)
            )


@subroutine
def _put_interface(room: Room, c: int, changes: FloatArray, own_frame: bool) -> None:
    """Put derivatives and changes of an interface's coordinates among those of the body."""
    columns, to_nodes, places = room.columns[c], room.to_nodes, room.places
    rates, jerks, k, n = room.rates, room.jerks, len(room.columns), len(places)
    for j in range(0 if own_frame else 6, 12):
        at = j if j < 6 else 6 * c + j
        for i in range(len(columns)):
            row = row_of(c, i, k, n)
            to_nodes[6 + row, at] = columns[i, j]
            places[row, at] = changes[0, i, j]
            rates[6 + row, at], jerks[6 + row, at] = changes[1, i, j], changes[2, i, j]


@subroutine
def _put_frame(room: Room, c: int, changes: FloatArray, by_twist: FloatArray) -> None:
    """Put derivatives of an interface's coordinates by place and twist of a frame without node."""
    columns, to_nodes, places = room.columns[c], room.to_nodes, room.places
    rates, jerks, turned = room.rates, room.jerks, room.turned
    for j in range(6):
        for i in range(6):
            row = 6 * c + i
            to_nodes[6 + row, j] = columns[i, j]
            places[row, j] = changes[0, i, j]
            rates[6 + row, j], jerks[6 + row, j] = changes[1, i, j], changes[2, i, j]
            turned[row, j] = by_twist[2, i, j]


@kernel
def tangents_into(
    data: Memory, room: Memory, nodes: IndexArray, state: Memory, gravity: FloatArray,
    shifts: FloatArray, inertial: bool, out: FloatArray,
) -> None:  # fmt: skip
    """Write the matrices (m, 6 N, 6 N) ``k K + C dv + M dw`` of all bodies.

    ``shifts`` holds dv/dn, dw/dn and k; ``inertial``: see
    ``core.nodes.frame_kernels.step_rates_into``.
    """
    of, own, all_of = unpack(BodyData, data), unpack(Room, room), unpack(Nodes, state)
    frames, velocity, acceleration = all_of.frames, all_of.velocity, all_of.acceleration
    k, n, free = len(of.rest), len(of.stiffness), len(of.conditions) > 0
    eta, base, weight, force = own.eta, own.base, own.weight, np.empty(6 + n)
    to_nodes, places, moved = own.to_nodes, own.places, own.moved
    rates, jerks, size = own.rates, own.jerks, own.moved.shape[1]
    count, width = of.moments.shape[1] - 1, own.columns.shape[1]
    last, pull = n - (width - 6) * k, np.empty(width)
    M_all, D_all = np.empty((6 + count, 6 + count)), np.empty((6 + count, 6 + count))
    K_all, every = np.empty((6 + count, count)), np.empty(6 + count)
    changes, bent, directions = np.empty((3, width, 12)), np.empty((12, 12)), np.empty((size, size))
    by, still, unit = np.zeros((2, 2, 36)), np.zeros((2, 2, 36)), np.eye(6).ravel()
    moved[:], own.turned[:] = 0.0, 0.0
    for b in range(len(nodes)):
        others = _state_into(of, own, nodes[b], frames, velocity, acceleration)
        fields_into(of, extend(of, own), own)
        body_acceleration(own, gravity)
        forces_into(of, own, every)
        mass_into(of, own, M_all)
        damping_into(of, own, M_all, D_all)
        stiffness_into(of, own, K_all)
        M, D, K = fold_matrices(of, own.G, every, M_all, D_all, K_all)
        fold(of, own.G, every, force)
        add_elastic(of, eta, force[6:])
        D[6:, 6:] += of.damping
        add_elastic_tangent(of, eta, K[6:])
        to_nodes[:], places[:], rates[:], jerks[:] = 0.0, 0.0, 0.0, 0.0
        directions[:] = 0.0
        for i in range(6):
            to_nodes[i, i] = 1.0
        if not free:
            n_frame = all_of.increment[nodes[b, 0]]
            step_rates_into(inertial, n_frame, base[12:18], base[18:], shifts, by[0, 0], by[1, 0])
            for i in range(6):
                moved[i, i] = shifts[2]
                for j in range(6):
                    rates[i, j], jerks[i, j] = by[0, 0, 6 * i + j], by[1, 0, 6 * i + j]
        for c in range(k):
            _put_columns(own, c)
        if free:
            carry(of, own.columns, force)
        for c in range(k):
            node, column = others[c], 6 + 6 * c
            v, w = velocity[node], acceleration[node]
            if free:
                still[0, 0] = unit
                _put_changes(own, c, v, w, still, 0.0, changes)
                by_twist = changes.copy()
                still[0, 0] = 0.0
                _put_changes(own, c, v, w, still, 1.0, changes)
                _put_frame(own, c, changes, by_twist)
            n_node = all_of.increment[node]
            step_rates_into(inertial, n_node, v, w, shifts, by[0, 1], by[1, 1])
            _put_changes(own, c, v, w, by, shifts[2], changes)
            _put_interface(own, c, changes, not free)
            for i in range(width):
                pull[i] = force[6 + row_of(c, i, k, n)]
            if width == 12:
                write_linear_second(own.units[c], pull, bent)
            else:
                write_second(own.X[c, 0], own.g[c], own.units[c], pull, bent)
            for j in range(12):
                for i in range(12):
                    row, at = i if i < 6 else column + i - 6, j if j < 6 else column + j - 6
                    directions[row, at] += bent[i, j]
        for j in range(6 * k, last):
            column = 6 * (1 + k + (j - 6 * k) // 3) + (j - 6 * k) % 3
            to_nodes[6 + j, column] = 1.0
            places[j, column] = shifts[2]
            rates[6 + j, column], jerks[6 + j, column] = shifts[0], shifts[1]
        if free:
            respond(of, own)
        total = np.dot(K, places) + np.dot(D, rates) + np.dot(M, jerks)
        for i in range(6 + n):  # gravity rotates relative to the axes of the frame
            for j in range(3):
                p, q = (j + 1) % 3, (j + 2) % 3
                change = M[i, q] * weight[p] - M[i, p] * weight[q]
                for m in range(size):
                    total[i, m] += change * moved[3 + j, m]
        full = np.dot(to_nodes.T.copy(), total)
        if free:
            directions[:, 6:] *= shifts[2]
            out[b] = condense(of, own, directions, full)
        else:
            out[b] = full + shifts[2] * directions


@kernel
def energies_into(
    data: Memory, room: Memory, nodes: IndexArray, frames: FloatArray, out: FloatArray
) -> None:
    """Write the strain energies (m,) of all bodies."""
    of, own, still = unpack(BodyData, data), unpack(Room, room), np.zeros((len(frames), 6))
    for b in range(len(nodes)):
        _state_into(of, own, nodes[b], frames, still, still)
        out[b] = strain_energy(of, own.eta[:, 0].copy())


@kernel
def add_motion(
    data: Memory, room: Memory, nodes: IndexArray, chosen: BoolArray, frames: FloatArray,
    velocity: FloatArray, motion: FloatArray,
) -> None:  # fmt: skip
    """Add energy and momenta of the chosen bodies (m,), see ``flexfem.core.nodes.motion``."""
    of, f = unpack(BodyData, data), unpack(Room, room)
    p, h, spin, Z, base = np.empty(3), np.empty(3), np.empty(9), np.empty(9), f.base
    for b in range(len(nodes)):
        if not chosen[b]:
            continue
        _state_into(of, f, nodes[b], frames, velocity, velocity)
        H, v, every = base[:12], base[12:18], extend(of, f)
        fields_into(of, every, f)
        put_skew(v[3:], spin)
        for i in range(3):
            p[i] = of.mass * v[i] + f.S[i, 1]
            for j in range(3):
                p[i] += spin[3 * i + j] * f.S[j, 0]
                Z[3 * i + j] = f.L[3 * i + j]
                for m in range(3):
                    Z[3 * i + j] += spin[3 * j + m] * f.D[3 * i + m]
        energy = 0.0
        for i in range(3):
            a, c = (i + 1) % 3, (i + 2) % 3
            h[i] = f.S[a, 0] * v[c] - f.S[c, 0] * v[a] + moment(Z, i)
            energy += 0.5 * (v[i] * p[i] + v[3 + i] * h[i])
        for i in range(len(every)):
            total = f.U[0, i] + f.U[4, i] + f.U[8, i]
            for a in range(3):
                total += f.P[a, i] * v[a]
            for ab in range(9):
                total += spin[ab] * f.Y[ab, i]
            energy += 0.5 * every[i, 1] * total
        motion[KINETIC] += energy
        motion[MASS] += of.mass
        for i in range(3):
            q, r = (i + 1) % 3, (i + 2) % 3
            row = 3 + 3 * i
            force = H[row] * p[0] + H[row + 1] * p[1] + H[row + 2] * p[2]
            arm = H[row] * f.S[0, 0] + H[row + 1] * f.S[1, 0] + H[row + 2] * f.S[2, 0]
            motion[FIRST + i] += of.mass * H[i] + arm
            motion[LINEAR + i] += force
            motion[ANGULAR + i] += H[row] * h[0] + H[row + 1] * h[1] + H[row + 2] * h[2]
            motion[ANGULAR + q] += H[r] * force
            motion[ANGULAR + r] -= H[q] * force
