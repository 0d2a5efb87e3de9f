# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loops over bodies in a floating frame: forces, matrices and momenta at their nodes.

``nodes`` (m, N) hold frame, interfaces and amplitudes of each body, the frame left out where it
moves with the body on average. See ``core.relative_frames`` and ``floating_inertia`` for the
notation.
"""

import numpy as np

from flexfem._types import BoolArray, FloatArray, IndexArray
from flexfem.core.frame_kernels import step_rates_into
from flexfem.core.motion import ANGULAR, FIRST, KINETIC, LINEAR, MASS
from flexfem.core.relative_frames import (
    act,
    first,
    relative_motion,
    second,
    third,
    write_columns,
    write_second,
)
from flexfem.elements.floating_inertia import (
    BodyData,
    add_elastic,
    add_elastic_tangent,
    body_acceleration,
    extend,
    fields_into,
    fold,
    forces_into,
    interface_strains,
    moment,
    new_fields,
    put_skew,
)
from flexfem.elements.floating_mean_axes import carry, condense, locate, respond
from flexfem.elements.floating_tangent import (
    damping_into,
    fold_matrices,
    mass_into,
    stiffness_into,
)
from flexfem.lie.compiled import kernel, subroutine

__all__ = ["add_motion", "add_residual", "coordinates_into", "energies_into", "tangents_into"]


@subroutine
def _state_into(
    data: BodyData, nodes: IndexArray, frames: FloatArray, velocity: FloatArray,
    acceleration: FloatArray, X: FloatArray, g: FloatArray, eta: FloatArray, base: FloatArray,
) -> IndexArray:  # fmt: skip
    """Write the state of frame and coordinates of one body; its nodes without that of the frame."""
    if len(data.conditions):
        locate(data, nodes, frames, velocity, acceleration, X, g, eta, base)
        return nodes
    at = nodes[0]
    base[:12], base[12:18], base[18:] = frames[at], velocity[at], acceleration[at]
    relative_motion(data.rest, nodes[1:], base, frames, velocity, acceleration, X, g, eta)
    return nodes[1:]


@kernel
def coordinates_into(
    data: BodyData, nodes: IndexArray, frames: FloatArray, velocity: FloatArray,
    acceleration: FloatArray, base: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    """Write frames with twists and their rates (m, 24), coordinates with derivatives (m, n, 3)."""
    k = len(data.rest)
    X, g = np.empty((3, k, 12)), np.empty((k, 4))
    for b in range(len(nodes)):
        _state_into(data, nodes[b], frames, velocity, acceleration, X, g, out[b], base[b])


@subroutine
def _add_to_nodes(
    nodes: IndexArray, columns: FloatArray, force: FloatArray, scale: float, residual: FloatArray
) -> None:
    """Add forces on frame and elastic coordinates to the nodes of one body."""
    k = len(columns)
    own = len(nodes) - (k + (len(force) - 4 - 6 * k) // 3)  # whether the frame has a node
    if own:
        for i in range(6):
            residual[nodes[0], i] += scale * force[i]
    for c in range(k):
        for j in range(0 if own else 6, 12):
            total = 0.0
            for i in range(6):
                total += columns[c, i, j] * force[6 + 6 * c + i]
            residual[nodes[0 if j < 6 else own + c], j % 6] += scale * total
    for j in range(len(force) - 6 - 6 * k):
        residual[nodes[own + k + j // 3], j % 3] += scale * force[6 + 6 * k + j]


@kernel
def add_residual(
    data: BodyData, nodes: IndexArray, frames: FloatArray, velocity: FloatArray,
    acceleration: FloatArray, gravity: FloatArray, scale: float, residual: FloatArray,
) -> None:  # fmt: skip
    """Add ``scale`` times inertia, elastic and damping forces less weights to the residual."""
    k, n = len(data.rest), len(data.stiffness)
    X, g, eta, force = np.empty((3, k, 12)), np.empty((k, 4)), np.empty((n, 3)), np.empty(6 + n)
    A, W, C, weight = np.empty(3), np.empty(9), np.empty(9), np.empty(3)
    units, columns, base = np.empty((12, 12)), np.empty((k, 6, 12)), np.empty(24)
    f, G, every = (
        new_fields(data),
        np.empty((len(data.bending), 3)),
        np.empty(5 + data.moments.shape[1]),
    )
    for b in range(len(nodes)):
        _state_into(data, nodes[b], frames, velocity, acceleration, X, g, eta, base)
        fields_into(data, extend(data, eta, G), f)
        body_acceleration(base, gravity, A, W, C, weight)
        forces_into(data, f, A, W, C, every)
        fold(data, G, every, force)
        add_elastic(data, eta, force[6:])
        for c in range(k):
            write_columns(X[0, c], g[c], units, columns[c])
        if len(data.conditions):
            carry(data, columns, force)
        _add_to_nodes(nodes[b], columns, force, scale, residual)


@subroutine
def _put_changes(
    X: FloatArray, g: FloatArray, units: FloatArray, v: FloatArray, w: FloatArray,
    v_frame: FloatArray, w_frame: FloatArray, by_v: FloatArray, by_w: FloatArray, stiffness: float,
    changes: FloatArray,
) -> None:  # fmt: skip
    """Changes (3, 6, 12) of an interface's coordinates, rates and their rates along both twists.

    Args:
        X: (3, 12) relative frame and its derivatives.
        g: (4,) factors of its rotation.
        units: (12, 12) derivatives of the relative frame.
        v: (6,) twist of the interface; w: its rate; those of the frame alike.
        w: see v.
        v_frame: see v.
        w_frame: see v.
        by_v: (2, 36) changes of the twists of frame and interface along their own steps.
        by_w: (2, 36) those of their rates.
        stiffness: factor of the changes of place.
        changes: what is written.
    """
    x, dx, ddx = np.empty(12), np.empty(12), np.empty(12)
    dv, dw, none = np.empty(6), np.empty(6), np.zeros(6)
    for j in range(12):
        own, at = j // 6, j % 6
        for i in range(6):
            dv[i], dw[i] = by_v[own, 6 * i + at], by_w[own, 6 * i + at]
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
def _put_interface(
    first_row: int, column: int, columns: FloatArray, changes: FloatArray, own_frame: bool,
    to_nodes: FloatArray, places: FloatArray, rates: FloatArray, jerks: FloatArray,
) -> None:  # fmt: skip
    """Put derivatives and changes of an interface's coordinates among those of the body."""
    for j in range(0 if own_frame else 6, 12):
        at = j if j < 6 else column + j - 6
        for i in range(6):
            row = first_row + i
            to_nodes[6 + row, at] = columns[i, j]
            places[row, at] = changes[0, i, j]
            rates[6 + row, at], jerks[6 + row, at] = changes[1, i, j], changes[2, i, j]


@subroutine
def _put_frame(
    first_row: int, columns: FloatArray, changes: FloatArray, by_twist: FloatArray,
    to_nodes: FloatArray, places: FloatArray, rates: FloatArray, jerks: FloatArray,
    turned: FloatArray,
) -> None:  # fmt: skip
    """Put derivatives of an interface's coordinates by place and twist of a frame without node."""
    for j in range(6):
        for i in range(6):
            row = first_row + i
            to_nodes[6 + row, j] = columns[i, j]
            places[row, j] = changes[0, i, j]
            rates[6 + row, j], jerks[6 + row, j] = changes[1, i, j], changes[2, i, j]
            turned[row, j] = by_twist[2, i, j]


@kernel
def tangents_into(
    data: BodyData, nodes: IndexArray, frames: FloatArray, velocity: FloatArray,
    acceleration: FloatArray, increments: FloatArray, gravity: FloatArray, shifts: FloatArray,
    inertial: bool, scale: float, out: FloatArray,
) -> None:  # fmt: skip
    """Write the matrices (m, 6 N, 6 N) ``scale (k K + C dv + M dw)`` of all bodies.

    ``shifts`` holds dv/dn, dw/dn and k; ``inertial``: see ``frame_kernels.step_rates_into``.
    """
    k, n, free = len(data.rest), len(data.stiffness), len(data.conditions) > 0
    size = 6 * nodes.shape[1] + 6 * free
    X, g, eta, force = np.empty((3, k, 12)), np.empty((k, 4)), np.empty((n, 3)), np.empty(6 + n)
    A, W, C, weight = np.empty(3), np.empty(9), np.empty(9), np.empty(3)
    count = data.moments.shape[1] - 1
    M_all, D_all = np.empty((6 + count, 6 + count)), np.empty((6 + count, 6 + count))
    K_all, every = np.empty((6 + count, count)), np.empty(6 + count)
    units, columns, changes = np.empty((k, 12, 12)), np.empty((k, 6, 12)), np.empty((3, 6, 12))
    by_v, by_w, bent = np.zeros((2, 36)), np.zeros((2, 36)), np.empty((12, 12))
    to_nodes, places = np.empty((6 + n, size)), np.empty((n, size))
    rates, jerks = np.empty((6 + n, size)), np.empty((6 + n, size))
    base, turned, moved = np.empty(24), np.zeros((n, 6)), np.zeros((6, size))
    directions, unit, nothing = np.empty((size, size)), np.eye(6).ravel(), np.zeros((2, 36))
    f, G = new_fields(data), np.empty((len(data.bending), 3))
    for b in range(len(nodes)):
        others = _state_into(data, nodes[b], frames, velocity, acceleration, X, g, eta, base)
        fields_into(data, extend(data, eta, G), f)
        body_acceleration(base, gravity, A, W, C, weight)
        forces_into(data, f, A, W, C, every)
        mass_into(data, f, M_all)
        damping_into(data, f, base[12:18], M_all, C, D_all)
        stiffness_into(data, f, A, W, C, K_all)
        M, D, K = fold_matrices(data, G, every, M_all, D_all, K_all)
        fold(data, G, every, force)
        add_elastic(data, eta, force[6:])
        D[6:, 6:] += data.damping
        add_elastic_tangent(data, eta, K[6:])
        to_nodes[:], places[:], rates[:], jerks[:] = 0.0, 0.0, 0.0, 0.0
        directions[:] = 0.0
        for i in range(6):
            to_nodes[i, i] = 1.0
        if not free:
            step_rates_into(
                inertial, increments[nodes[b, 0]], base[12:18], base[18:], shifts, by_v[0], by_w[0]
            )
            for i in range(6):
                moved[i, i] = shifts[2]
                for j in range(6):
                    rates[i, j], jerks[i, j] = by_v[0, 6 * i + j], by_w[0, 6 * i + j]
        for c in range(k):
            write_columns(X[0, c], g[c], units[c], columns[c])
        if free:
            carry(data, columns, force)
        for c in range(k):
            node, column = others[c], 6 + 6 * c
            v, w = velocity[node], acceleration[node]
            if free:
                nothing[0] = unit
                _put_changes(
                    X[:, c],
                    g[c],
                    units[c],
                    v,
                    w,
                    base[12:18],
                    base[18:],
                    nothing,
                    by_w,
                    0.0,
                    changes,
                )
                by_twist = changes.copy()
                nothing[0] = 0.0
                _put_changes(
                    X[:, c], g[c], units[c], v, w, base[12:18], base[18:], nothing, nothing, 1.0,
                    changes,
                )  # fmt: skip
                _put_frame(
                    6 * c, columns[c], changes, by_twist, to_nodes, places, rates, jerks, turned
                )
            step_rates_into(inertial, increments[node], v, w, shifts, by_v[1], by_w[1])
            _put_changes(
                X[:, c],
                g[c],
                units[c],
                v,
                w,
                base[12:18],
                base[18:],
                by_v,
                by_w,
                shifts[2],
                changes,
            )
            _put_interface(
                6 * c, column, columns[c], changes, not free, to_nodes, places, rates, jerks
            )
            write_second(X[0, c], g[c], units[c], force[6 + 6 * c : 12 + 6 * c], bent)
            for j in range(12):
                for i in range(12):
                    row, at = i if i < 6 else column + i - 6, j if j < 6 else column + j - 6
                    directions[row, at] += bent[i, j]
        for j in range(6 * k, n):
            column = 6 * (1 + k + (j - 6 * k) // 3) + (j - 6 * k) % 3
            to_nodes[6 + j, column] = 1.0
            places[j, column] = shifts[2]
            rates[6 + j, column], jerks[6 + j, column] = shifts[0], shifts[1]
        if free:
            respond(data, places, rates, jerks, turned, moved)
        total = np.dot(K, places) + np.dot(D, rates) + np.dot(M, jerks)
        for i in range(6 + n):  # gravity turns in the axes of the frame
            for j in range(3):
                p, q = (j + 1) % 3, (j + 2) % 3
                change = M[i, q] * weight[p] - M[i, p] * weight[q]
                for m in range(size):
                    total[i, m] += change * moved[3 + j, m]
        full = np.dot(to_nodes.T.copy(), total)
        if free:
            directions[:, 6:] *= shifts[2]
            out[b] = condense(data, to_nodes, moved, directions, full)
        else:
            out[b] = full + shifts[2] * directions
        out[b] *= scale


@kernel
def energies_into(data: BodyData, nodes: IndexArray, frames: FloatArray, out: FloatArray) -> None:
    """Write the strain energies (m,) of all bodies."""
    k, n = len(data.rest), len(data.stiffness)
    X, g, eta = np.empty((3, k, 12)), np.empty((k, 4)), np.empty((n, 3))
    still, base = np.zeros((len(frames), 6)), np.empty(24)
    for b in range(len(nodes)):
        _state_into(data, nodes[b], frames, still, still, X, g, eta, base)
        x = eta[:, 0].copy()
        out[b] = 0.5 * np.dot(x, np.dot(data.stiffness, x))
        if len(data.pulling):
            pulls, strains = interface_strains(data, x)
            both = x[: len(strains)] + strains
            out[b] += 0.25 * np.dot(np.dot(pulls, x), both)


@kernel
def add_motion(
    data: BodyData, nodes: IndexArray, chosen: BoolArray, frames: FloatArray, velocity: FloatArray,
    motion: FloatArray,
) -> None:  # fmt: skip
    """Add energy and momenta of the chosen bodies (m,), see ``flexfem.core.motion``."""
    k, n = len(data.rest), len(data.stiffness)
    X, g, eta = np.empty((3, k, 12)), np.empty((k, 4)), np.empty((n, 3))
    p, h, spin, Z, base = np.empty(3), np.empty(3), np.empty(9), np.empty(9), np.empty(24)
    f, G = new_fields(data), np.empty((len(data.bending), 3))
    for b in range(len(nodes)):
        if not chosen[b]:
            continue
        _state_into(data, nodes[b], frames, velocity, velocity, X, g, eta, base)
        H, v, every = base[:12], base[12:18], extend(data, eta, G)
        fields_into(data, every, f)
        put_skew(v[3:], spin)
        for i in range(3):
            p[i] = data.mass * v[i] + f.S[i, 1]
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
        motion[MASS] += data.mass
        for i in range(3):
            q, r = (i + 1) % 3, (i + 2) % 3
            row = 3 + 3 * i
            force = H[row] * p[0] + H[row + 1] * p[1] + H[row + 2] * p[2]
            arm = H[row] * f.S[0, 0] + H[row + 1] * f.S[1, 0] + H[row + 2] * f.S[2, 0]
            motion[FIRST + i] += data.mass * H[i] + arm
            motion[LINEAR + i] += force
            motion[ANGULAR + i] += H[row] * h[0] + H[row + 1] * h[1] + H[row + 2] * h[2]
            motion[ANGULAR + q] += H[r] * force
            motion[ANGULAR + r] -= H[q] * force
