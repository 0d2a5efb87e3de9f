# SPDX-License-Identifier: LGPL-3.0-or-later
"""Masses along the cells of the beam mesh over a step that conserves energy.

The masses move with the linear field of the velocities ``u_i`` of the mass centres of a cell's
ends, ``1/2 sum_ij M_ij u_i . u_j`` (see ``forms.beam``). A node's rates are those of its own centre
c; where the section of a cell is turned against the node, its centre lies at the further arm s, and
``u = r + R (Omega x s)``. The mean forces ``f_i = sum_j M_ij Du_j / h`` at the ends and the moments
``(R_0 + R_1)/2 (c + s + h/4 DOmega x s) x f_i`` do the work by which this energy changes; without
arms they are the balance of angular momentum, too.
"""

from flexfem._types import FloatArray, IndexArray
from flexfem.core.step_kernels import add, increment_rate, mean_turn, turn, turn_back, unit
from flexfem.lie._blocks import cross, dot, triple
from flexfem.lie._coefficients import Triple
from flexfem.lie.compiled import inlined, subroutine

__all__ = ["add_mass_tangent", "mass_force"]


@inlined
def _speed_change(
    H0: FloatArray, H1: FloatArray, r0: FloatArray, r1: FloatArray, arm: Triple
) -> Triple:
    """Change of the inertial velocity of the mass centre at one end of a cell."""
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
    side: int, nodes: IndexArray, mass: float, arms: FloatArray, centres: FloatArray,
    frames0: FloatArray, frames: FloatArray, rates0: FloatArray, rates: FloatArray,
    gravity: FloatArray, h: float, total: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    """Mean inertia force minus weight at one end of a cell over the step.

    Args:
        side: the end.
        nodes: (2,) of the cell.
        mass: of the cell.
        arms: (2, 3) or longer rows: arms at both ends in node axes.
        centres: (n, 3) of the nodes in their axes.
        frames0: (n, 12) at the start of the step.
        frames: (n, 12) at its end.
        rates0: (n, 6) inertial velocity of the centre and local angular velocity at the start.
        rates: (n, 6) the same at the end.
        gravity: acceleration in inertial axes.
        h: step size.
        total: (6,) becomes the force, without and with the weight, in inertial axes.
        out: (6,) becomes force and moment about the node in its axes at the end.
    """
    node, other = nodes[side], nodes[1 - side]
    H0, H1, arm = frames0[node], frames[node], triple(arms[side], 0)
    own = _speed_change(H0, H1, rates0[node], rates[node], arm)
    far = _speed_change(
        frames0[other], frames[other], rates0[other], rates[other], triple(arms[1 - side], 0)
    )
    f, per = add(far, 2.0, own), mass / (6.0 * h)
    f = (per * f[0], per * f[1], per * f[2])
    loaded = add(f, -0.5 * mass, triple(gravity, 0))
    m = cross(mean_turn(H0, H1, add(triple(centres[node], 0), 1.0, arm)), loaded)
    m = add(m, 1.0, cross(mean_turn(H0, H1, _spin(rates0[node], rates[node], arm, h)), f))
    local_f, local_m = turn_back(H1, loaded), turn_back(H1, m)
    for k in range(3):
        total[k], total[3 + k] = f[k], loaded[k]
        out[k], out[3 + k] = local_f[k], local_m[k]


@inlined
def _own_change(
    t: Triple, do: Triple, lever: Triple, arm: Triple, H0: FloatArray, H1: FloatArray,
    r0: FloatArray, r1: FloatArray, h: float, total: FloatArray,
) -> Triple:  # fmt: skip
    """Change of the moment at fixed force as the node turns by ``t``, inertial axes."""
    turned = turn(H1, cross(t, lever))
    m = cross((0.5 * turned[0], 0.5 * turned[1], 0.5 * turned[2]), triple(total, 3))
    swing = mean_turn(H0, H1, cross(do, arm))
    turned = turn(H1, cross(t, _spin(r0, r1, arm, h)))
    q = 0.25 * h
    swing = add((q * swing[0], q * swing[1], q * swing[2]), 0.5, turned)
    return add(m, 1.0, cross(swing, triple(total, 0)))


@subroutine
def add_mass_tangent(
    a: int, b: int, nodes: IndexArray, mass: float, arms: FloatArray, centres: FloatArray,
    frames0: FloatArray, frames: FloatArray, increments: FloatArray, rates0: FloatArray,
    rates: FloatArray, h: float, rate: float, total: FloatArray, force: FloatArray,
    out: FloatArray,
) -> None:  # fmt: skip
    """Add the derivative of :func:`mass_force` at end ``a`` along the twist of end ``b``.

    ``total`` and ``force`` (6,) are what it wrote for end ``a``, ``increments`` (n, 6) those of the
    step, ``rate`` is the change of rates with them; ``out`` (12, 12) the matrix of the cell.
    """
    node, other = nodes[a], nodes[b]
    H0, H1, arm = frames0[node], frames[node], triple(arms[a], 0)
    r0, r1, far_arm, c = rates0[node], rates[node], triple(arms[b], 0), triple(centres[other], 0)
    lever = add(triple(centres[node], 0), 1.0, arm)
    mean = mean_turn(H0, H1, add(lever, 1.0, _spin(r0, r1, arm, h)))
    share = mass / (6.0 * h) * (2.0 if a == b else 1.0)
    still = dot(c, c) + dot(far_arm, far_arm) == 0.0
    for k in range(6):
        if still and a != b and k > 2:
            continue  # the far end's centre stays as its node turns
        u, t = unit(k), unit(k - 3)
        do = increment_rate(triple(increments[other], 3), t)
        do = (rate * do[0], rate * do[1], rate * do[2])
        du = add(u, 1.0, cross(t, c))
        du = (rate * du[0], rate * du[1], rate * du[2])
        du = add(du, 1.0, cross(do, far_arm))
        du = add(du, 1.0, cross(t, cross(triple(rates[other], 3), far_arm)))
        df = turn(frames[other], du)
        df = (share * df[0], share * df[1], share * df[2])
        dm = cross(mean, df)
        if a == b and k > 2:
            dm = add(dm, 1.0, _own_change(t, do, lever, arm, H0, H1, r0, r1, h, total))
        df, dm = turn_back(H1, df), turn_back(H1, dm)
        if a == b and k > 2:
            df = add(df, -1.0, cross(t, triple(force, 0)))
            dm = add(dm, -1.0, cross(t, triple(force, 3)))
        for i in range(3):
            out[6 * a + i, 6 * b + k] += df[i]
            out[6 * a + 3 + i, 6 * b + k] += dm[i]
