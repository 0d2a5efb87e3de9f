# SPDX-License-Identifier: LGPL-3.0-or-later
"""Masses along the cells of the beam mesh over a step that conserves energy.

The masses move with the linear field of the velocities ``u_i`` of the mass centres of a cell's
ends, ``1/2 sum_ij M_ij u_i . u_j`` (see ``forms.beam``). A node's rates are those of its own centre
c; where the section of a cell is turned against the node, its centre lies at the further arm s, and
``u = r + R (Omega x s)``. The mean forces ``f_i = sum_j M_ij Du_j / h`` at the ends and the moments
``(R_0 + R_1)/2 (c + s + h/4 DOmega x s) x f_i`` do the work by which this energy changes; without
arms they are the balance of angular momentum, too.
"""

import numpy as np

from flexfem._types import FloatArray
from flexfem.core.nodes.step_kernels import (
    StepNodes,
    add,
    increment_rate,
    mean_turn,
    momentum_force,
    momentum_tangent,
    turn,
    turn_back,
    unit,
)
from flexfem.kernels.compiled import inlined, kernel, subroutine
from flexfem.kernels.records import Float1D, Float3D, Index2D, Memory, Record, unpack
from flexfem.lie._blocks import cross, dot, triple
from flexfem.lie._coefficients import Triple

__all__ = ["StepMasses", "add_mass_forces", "add_mass_tangents"]


class StepMasses(Record):
    """Masses of the cells of beams.

    Attributes:
        nodes: (m, 2).
        masses: (m,) kg.
        ends: (m, 2, 16) arm from the centre of the node to that of the end in node axes (m), and
            the lump of half the cell that has rotary inertia alone, see
            ``core.nodes.step_kernels.momentum_force``.
    """

    nodes: Index2D
    masses: Float1D
    ends: Float3D


@inlined
def _speed_change(nodes: StepNodes, node: int, arm: Triple) -> Triple:
    """Change of the inertial velocity of the mass centre at one end of a cell."""
    H0, H1, r0, r1 = nodes.frames0[node], nodes.frames[node], nodes.rates0[node], nodes.rates[node]
    change = add(triple(r1, 0), -1.0, triple(r0, 0))
    change = add(change, 1.0, turn(H1, cross(triple(r1, 3), arm)))
    return add(change, -1.0, turn(H0, cross(triple(r0, 3), arm)))


@inlined
def _spin(r0: FloatArray, r1: FloatArray, arm: Triple, h: float) -> Triple:
    """``h/4 DOmega x s``."""
    s = cross(add(triple(r1, 3), -1.0, triple(r0, 3)), arm)
    return 0.25 * h * s[0], 0.25 * h * s[1], 0.25 * h * s[2]


@subroutine
def _mass_force(
    cells: StepMasses, c: int, side: int, nodes: StepNodes, h: float, out: FloatArray
) -> None:
    """Mean inertia force minus weight at one end of a cell over the step.

    Args:
        cells: of the beams.
        c: the cell.
        side: the end.
        nodes: over the step.
        h: step size, s.
        out: (12,) becomes the force, without and with the weight, in inertial axes, then force and
            moment about the node in its axes at the end.
    """
    node, other, mass = cells.nodes[c, side], cells.nodes[c, 1 - side], cells.masses[c]
    H0, H1, arm = nodes.frames0[node], nodes.frames[node], triple(cells.ends[c, side], 0)
    own = _speed_change(nodes, node, arm)
    far = _speed_change(nodes, other, triple(cells.ends[c, 1 - side], 0))
    f, per = add(far, 2.0, own), mass / (6.0 * h)
    f = (per * f[0], per * f[1], per * f[2])
    loaded = add(f, -0.5 * mass, triple(nodes.gravity, 0))
    m = cross(mean_turn(H0, H1, add(triple(nodes.centres[node], 0), 1.0, arm)), loaded)
    swing = _spin(nodes.rates0[node], nodes.rates[node], arm, h)
    m = add(m, 1.0, cross(mean_turn(H0, H1, swing), f))
    local_f, local_m = turn_back(H1, loaded), turn_back(H1, m)
    for k in range(3):
        out[k], out[3 + k] = f[k], loaded[k]
        out[6 + k], out[9 + k] = local_f[k], local_m[k]


@inlined
def _own_change(
    t: Triple, do: Triple, arm: Triple, nodes: StepNodes, node: int, h: float, force: FloatArray
) -> Triple:
    """Change of the moment at fixed force as the node turns by ``t``, inertial axes."""
    H0, H1 = nodes.frames0[node], nodes.frames[node]
    lever = add(triple(nodes.centres[node], 0), 1.0, arm)
    turned = turn(H1, cross(t, lever))
    m = cross((0.5 * turned[0], 0.5 * turned[1], 0.5 * turned[2]), triple(force, 3))
    swing = mean_turn(H0, H1, cross(do, arm))
    turned = turn(H1, cross(t, _spin(nodes.rates0[node], nodes.rates[node], arm, h)))
    q = 0.25 * h
    swing = add((q * swing[0], q * swing[1], q * swing[2]), 0.5, turned)
    return add(m, 1.0, cross(swing, triple(force, 0)))


@subroutine
def _add_mass_tangent(
    cells: StepMasses, c: int, a: int, b: int, nodes: StepNodes, h: float, force: FloatArray,
    out: FloatArray,
) -> None:  # fmt: skip
    """Add the derivative of :func:`_mass_force` at end ``a`` along the twist of end ``b``.

    ``force`` (12,) is what it wrote for end ``a``, ``out`` (12, 12) the matrix of the cell.
    """
    node, other, rate = cells.nodes[c, a], cells.nodes[c, b], nodes.law[2]
    H0, H1, arm = nodes.frames0[node], nodes.frames[node], triple(cells.ends[c, a], 0)
    centre, far_arm = triple(nodes.centres[other], 0), triple(cells.ends[c, b], 0)
    lever = add(triple(nodes.centres[node], 0), 1.0, arm)
    swing = _spin(nodes.rates0[node], nodes.rates[node], arm, h)
    mean = mean_turn(H0, H1, add(lever, 1.0, swing))
    share = cells.masses[c] / (6.0 * h) * (2.0 if a == b else 1.0)
    still = dot(centre, centre) + dot(far_arm, far_arm) == 0.0
    for k in range(6):
        if still and a != b and k > 2:
            continue  # the far end's centre stays as its node turns
        u, t = unit(k), unit(k - 3)
        do = increment_rate(triple(nodes.increments[other], 3), t)
        do = (rate * do[0], rate * do[1], rate * do[2])
        du = add(u, 1.0, cross(t, centre))
        du = (rate * du[0], rate * du[1], rate * du[2])
        du = add(du, 1.0, cross(do, far_arm))
        du = add(du, 1.0, cross(t, cross(triple(nodes.rates[other], 3), far_arm)))
        df = turn(nodes.frames[other], du)
        df = (share * df[0], share * df[1], share * df[2])
        dm = cross(mean, df)
        if a == b and k > 2:
            dm = add(dm, 1.0, _own_change(t, do, arm, nodes, node, h, force))
        df, dm = turn_back(H1, df), turn_back(H1, dm)
        if a == b and k > 2:
            df = add(df, -1.0, cross(t, triple(force, 6)))
            dm = add(dm, -1.0, cross(t, triple(force, 9)))
        for i in range(3):
            out[6 * a + i, 6 * b + k] += df[i]
            out[6 * a + 3 + i, 6 * b + k] += dm[i]


@kernel
def add_mass_forces(cells: Memory, nodes: Memory, scale: float) -> None:
    """Add ``scale`` times the mean inertia forces minus weights to the residual of the nodes.

    Args:
        cells: ``StepMasses``.
        nodes: ``StepNodes``.
        scale: see above.
    """
    own, state = unpack(StepMasses, cells), unpack(StepNodes, nodes)
    residual, h, out = state.residual, 1.0 / state.law[1], np.empty(12)
    for c in range(own.nodes.shape[0]):
        for side in range(2):
            node = own.nodes[c, side]
            _mass_force(own, c, side, state, h, out)
            for i in range(6):
                residual[node, i] += scale * out[6 + i]
            momentum_force(own.ends[c, side, 3:], state, node, h, out)
            for i in range(6):
                residual[node, i] += scale * out[6 + i]


@kernel
def add_mass_tangents(cells: Memory, nodes: Memory, values: FloatArray) -> None:
    """Add the derivatives of :func:`add_mass_forces` along local twists to ``values`` (m, 144)."""
    own, state = unpack(StepMasses, cells), unpack(StepNodes, nodes)
    h, out, lump = 1.0 / state.law[1], np.empty(12), np.empty((6, 6))
    for c in range(own.nodes.shape[0]):
        result = values[c].reshape(12, 12)
        for a in range(2):
            _mass_force(own, c, a, state, h, out)
            for b in range(2):
                _add_mass_tangent(own, c, a, b, state, h, out, result)
            momentum_tangent(own.ends[c, a, 3:], state, own.nodes[c, a], h, lump)
            for i in range(6):
                for j in range(6):
                    result[6 * a + i, 6 * a + j] += lump[i, j]
