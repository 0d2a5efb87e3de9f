# SPDX-License-Identifier: LGPL-3.0-or-later
"""Masses along the cells of the beam mesh over a step that conserves energy.

The masses move with the linear field of the velocities ``u_i`` of the mass centres of a cell's
ends, ``1/2 sum_ij M_ij u_i . u_j`` (see ``forms.beam``). A node's rates are those of its own centre
c; where the section of a cell is turned against the node, its centre lies at the further arm s, and
``u = r + R (Omega x s)``. The mean forces ``f_i = sum_j M_ij Du_j / h`` at the ends and the moments
``(R_0 + R_1)/2 (c + s + h/4 DOmega x s) x f_i`` do the work by which this energy changes; without
arms they are the balance of angular momentum, too.
"""

from flexfem._types import FloatArray
from flexfem.core.nodes.step_kernels import (
    StepNodes,
    add,
    increment_rate,
    mean_turn,
    turn,
    turn_back,
    unit,
)
from flexfem.kernels.compiled import inlined, subroutine
from flexfem.kernels.records import Bool1D, Float2D, Float3D, Index2D, Int1D, Record
from flexfem.lie._blocks import cross, dot, triple
from flexfem.lie._coefficients import Triple

__all__ = ["StepCells", "add_mass_tangent", "mass_force"]


class StepCells(Record):
    """Constant data of the cells of beams, and the kernels of ``forms.beam_energy``.

    Attributes:
        force, stiffness: addresses of the kernels.
        offsets: (10,) where each coefficient of these starts, and their number.
        nodes: (m, 2).
        turned: (m,) section axes differ from the axes of the nodes.
        turns: (m, 2, 9) rotations from the sections' axes to those of the nodes; one row where
            none is turned.
        constants: (m, 14) relative twist at the start, its change over the last step, length (m)
            and damping (s).
        section: (m,) number of the section.
        sections: (s, 42) inertia per length and stiffness of each section.
        ends: (m, 2, 16) arm from the centre of the node to that of the end in node axes (m), and
            the lump of half the cell that has rotary inertia alone, see
            ``core.nodes.step_kernels.momentum_force``.
    """

    force: int
    stiffness: int
    offsets: Int1D
    nodes: Index2D
    turned: Bool1D
    turns: Float3D
    constants: Float2D
    section: Int1D
    sections: Float2D
    ends: Float3D


@inlined
def _mass(cells: StepCells, c: int) -> float:
    """Mass of a cell."""
    mass: float = cells.sections[cells.section[c], 0] * cells.constants[c, 12]
    return mass


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
def mass_force(
    cells: StepCells, c: int, side: int, nodes: StepNodes, h: float, out: FloatArray
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
    node, other, mass = cells.nodes[c, side], cells.nodes[c, 1 - side], _mass(cells, c)
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
def add_mass_tangent(
    cells: StepCells, c: int, a: int, b: int, nodes: StepNodes, h: float, force: FloatArray,
    out: FloatArray,
) -> None:  # fmt: skip
    """Add the derivative of :func:`mass_force` at end ``a`` along the twist of end ``b``.

    ``force`` (12,) is what it wrote for end ``a``, ``out`` (12, 12) the matrix of the cell.
    """
    node, other, rate = cells.nodes[c, a], cells.nodes[c, b], nodes.law[2]
    H0, H1, arm = nodes.frames0[node], nodes.frames[node], triple(cells.ends[c, a], 0)
    centre, far_arm = triple(nodes.centres[other], 0), triple(cells.ends[c, b], 0)
    lever = add(triple(nodes.centres[node], 0), 1.0, arm)
    swing = _spin(nodes.rates0[node], nodes.rates[node], arm, h)
    mean = mean_turn(H0, H1, add(lever, 1.0, swing))
    share = _mass(cells, c) / (6.0 * h) * (2.0 if a == b else 1.0)
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
