# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loops over straight cables between two nodes.

A cable of the strain ``e = l / L - 1``, whose taut part is ``g = max(e, 0)`` (of bars e itself),
pulls with EA times a stress s:

- at a state ``s = g (1 + tanh(tau e' / g)) + t e'``, of bars ``s = e + tau e'``, see
  ``model.CableNet``;
- in the mean over a step from a to b, with D for changes over it,
  ``s = r [m (1 + tanh(tau Dg / (h m))) + c (Dg - Dg_last)] + t De / h`` with
  ``m = (g_a + g_b)/2`` and ``r = Dg / De``, in the direction of ``(d_a + d_b) / (l_a + l_b)``, d
  being the vectors between both nodes. ``d_b - d_a`` has the component ``l_b - l_a`` along it, so
  the work on a cable is ``EA L s De``, in which ``r m De = (g_b^2 - g_a^2)/2`` is the change of the
  energy (a discrete gradient, Gonzalez 1996), the dampers' parts are positive, and that of c, half
  the numerical dissipation, is the one of ``integrators.energy_momentum.scheme`` in g. It is smooth
  where the cable becomes taut;
- where a cable is slack at a and taut at b, and its catch dissipates, ``s = g_b + t De / h``, whose
  work on the cable is ``EA L g_b (g_b/2 - e_a)`` more than the change of the energy.

Each row of numbers has :data:`REST` L, m, :data:`STIFFNESS` EA, N, :data:`DAMPING` tau, s,
:data:`SLACK`, 1 of cables and 0 of bars, :data:`ALWAYS` t, s, of cables, and :data:`CATCH`, 1 of
cables whose catch dissipates. The driver of cells would call a kernel by address for forty
operations. Loops add forces in inertial axes, (n, 3), and matrices of pairs of nodes.
"""

import math

import numpy as np

from flexfem._types import FloatArray, IndexArray
from flexfem.kernels.compiled import inlined, kernel

__all__ = [
    "ALWAYS",
    "CATCH",
    "DAMPING",
    "REST",
    "SLACK",
    "STIFFNESS",
    "add_forces",
    "add_last_blocks",
    "add_products",
    "add_rotations",
    "add_step_forces",
    "add_step_products",
    "energies",
    "step_losses",
    "step_tangents",
    "strains",
    "tangents",
    "taut_parts",
    "viscosity",
]  # fmt: skip

#: Columns of the numbers of a cable.
REST, STIFFNESS, DAMPING, SLACK, ALWAYS, CATCH = 0, 1, 2, 3, 4, 5
#: Squared sine up to which a cable has turned by half a turn, and its axes stay.
_OPPOSITE = 1e-6

type _Pair = tuple[float, float, float, float]


@inlined
def _between(x: FloatArray, i: int, j: int) -> _Pair:
    """Vector from a node to another one, and its length."""
    d0, d1, d2 = x[j, 0] - x[i, 0], x[j, 1] - x[i, 1], x[j, 2] - x[i, 2]
    return d0, d1, d2, math.sqrt(d0 * d0 + d1 * d1 + d2 * d2)


@inlined
def _taut(e: float, slack: float) -> float:
    """Taut part of a strain."""
    return max(e, 0.0) if slack > 0.0 else e


@inlined
def _stress(e: float, rate: float, row: FloatArray) -> tuple[float, float, float]:
    """Stress over the modulus, and its derivatives by strain and rate."""
    tau = row[DAMPING]
    if row[SLACK] == 0.0:
        return e + tau * rate, 1.0, tau
    always = row[ALWAYS]
    if e <= 0.0:
        return always * rate, 0.0, always
    quick = math.tanh(tau * rate / e)
    steep = 1.0 - quick * quick
    return (
        e * (1.0 + quick) + always * rate, 1.0 + quick - steep * tau * rate / e,
        steep * tau + always,
    )  # fmt: skip


@inlined
def _mean_stress(
    start: float, end: float, last: float, per_step: float, half: float, row: FloatArray
) -> tuple[float, float, float, float]:
    """Mean stress over a step, its derivatives by the strain at the end and the last change.

    Args:
        start: strain at the start.
        end: strain at the end.
        last: change of the taut part over the last step.
        per_step: 1/h, 1/s.
        half: half of the numerical dissipation.
        row: numbers of the cable.

    Returns:
        Stress, both derivatives, and the power of its damper over EA, times the size of the step.
    """
    tau = row[DAMPING]
    if row[SLACK] == 0.0:
        change = end - start
        stress = 0.5 * (start + end) + tau * per_step * change + half * (change - last)
        return stress, 0.5 + tau * per_step + half, -half, tau * per_step * change * change
    a, b = max(start, 0.0), max(end, 0.0)
    whole, slope_always = end - start, row[ALWAYS] * per_step
    always = slope_always * whole
    if a == 0.0 and b == 0.0:
        return always, slope_always, 0.0, always * whole
    if row[CATCH] > 0.0 and (a == 0.0 if per_step > 0.0 else b == 0.0):
        # the end of the step is taut; of one that is looked at from its end it comes first
        taut, slack, by_taut = (b, start, 1.0) if per_step > 0.0 else (a, end, 0.0)
        lost = math.copysign(taut * (0.5 * taut - slack), per_step)
        return taut + always, by_taut + slope_always, 0.0, lost + always * whole
    mean, change, by_end = 0.5 * (a + b), b - a, 1.0 if end > 0.0 else 0.0
    pull = tau * per_step * change / mean
    quick = math.tanh(pull)
    steep = 1.0 - quick * quick
    stress = mean * (1.0 + quick) + half * (change - last)
    slope = by_end * (0.5 * (1.0 + quick) + steep * (tau * per_step - 0.5 * pull) + half)
    share, by_share = 1.0, 0.0
    if start <= 0.0 or end <= 0.0:  # it is slack over a part of the step
        share = change / whole
        by_share = (by_end - share) / whole
    return (
        share * stress + always, share * slope + by_share * stress + slope_always, -share * half,
        mean * quick * change + always * whole,
    )  # fmt: skip


@inlined
def _strain(x: FloatArray, i: int, j: int, row: FloatArray) -> float:
    """Strain of a cable."""
    e: float = _between(x, i, j)[3] / row[REST] - 1.0
    return e


@kernel
def strains(nodes: IndexArray, numbers: FloatArray, x: FloatArray, out: FloatArray) -> None:
    """Strains (m,) of all cables."""
    for m in range(len(nodes)):
        out[m] = _strain(x, nodes[m, 0], nodes[m, 1], numbers[m])


@kernel
def taut_parts(nodes: IndexArray, numbers: FloatArray, x: FloatArray, out: FloatArray) -> None:
    """Taut parts (m,) of the strains."""
    for m in range(len(nodes)):
        out[m] = _taut(_strain(x, nodes[m, 0], nodes[m, 1], numbers[m]), numbers[m, SLACK])


@kernel
def energies(nodes: IndexArray, numbers: FloatArray, x: FloatArray, out: FloatArray) -> None:
    """Strain energies (m,), J."""
    for m in range(len(nodes)):
        g = _taut(_strain(x, nodes[m, 0], nodes[m, 1], numbers[m]), numbers[m, SLACK])
        out[m] = 0.5 * numbers[m, STIFFNESS] * numbers[m, REST] * g * g


@inlined
def _rate(d: _Pair, v: FloatArray, i: int, j: int, row: FloatArray) -> float:
    """Rate of the strain; zero where both nodes are at the same place."""
    if d[3] == 0.0:
        return 0.0
    along = d[0] * (v[j, 0] - v[i, 0]) + d[1] * (v[j, 1] - v[i, 1]) + d[2] * (v[j, 2] - v[i, 2])
    rate: float = along / (d[3] * row[REST])
    return rate


@kernel
def viscosity(
    nodes: IndexArray, numbers: FloatArray, x: FloatArray, v: FloatArray, forces: FloatArray,
    strains: FloatArray,
) -> None:  # fmt: skip
    """Forces of the dampers, N, and strains: the first of six numbers (m, 6) each."""
    for m in range(len(nodes)):
        i, j, row = nodes[m, 0], nodes[m, 1], numbers[m]
        d = _between(x, i, j)
        e, rate = d[3] / row[REST] - 1.0, _rate(d, v, i, j, row)
        forces[m, 0] = row[STIFFNESS] * (_stress(e, rate, row)[0] - _taut(e, row[SLACK]))
        strains[m, 0] = e


@kernel
def add_forces(
    nodes: IndexArray, numbers: FloatArray, x: FloatArray, v: FloatArray, out: FloatArray
) -> None:
    """Add forces at positions and velocities (n, 3)."""
    for m in range(len(nodes)):
        i, j, row = nodes[m, 0], nodes[m, 1], numbers[m]
        d = _between(x, i, j)
        rate = _rate(d, v, i, j, row) if row[DAMPING] > 0.0 or row[ALWAYS] > 0.0 else 0.0
        stress = _stress(d[3] / row[REST] - 1.0, rate, row)[0]
        if stress == 0.0:  # the nodes of a slack cable may meet
            continue
        pull = row[STIFFNESS] * stress / d[3]
        for a in range(3):
            out[i, a] -= pull * d[a]
            out[j, a] += pull * d[a]


@inlined
def _tangent(
    x: FloatArray, v: FloatArray, i: int, j: int, row: FloatArray, factors: FloatArray,
    K: FloatArray,
) -> None:  # fmt: skip
    """Derivative (3, 3) of the force on the second node by its place, see :func:`tangents`."""
    d = _between(x, i, j)
    e, rate = d[3] / row[REST] - 1.0, _rate(d, v, i, j, row)
    stress, by_strain, by_rate = _stress(e, rate, row)
    if (by_strain == 0.0 and by_rate == 0.0) or d[3] == 0.0:
        K[:] = 0.0
        return
    EA, L, l = row[STIFFNESS], row[REST], d[3]  # noqa: E741
    across = factors[0] * EA * stress / l
    along = EA / L * (factors[0] * by_strain + factors[1] * by_rate) / (l * l) - across / (l * l)
    turning = factors[0] * EA / L * by_rate  # the rate changes as the cable turns
    for a in range(3):
        for b in range(3):
            swing = (v[j, b] - v[i, b]) / l - rate * L * d[b] / (l * l)
            K[a, b] = along * d[a] * d[b] + turning * d[a] / l * swing
        K[a, a] += across


@kernel
def tangents(
    nodes: IndexArray, numbers: FloatArray, x: FloatArray, v: FloatArray, factors: FloatArray,
    index: IndexArray, blocks: FloatArray,
) -> None:  # fmt: skip
    """Add derivatives of the forces to blocks (k, 3, 3) of pairs of nodes.

    Args:
        nodes: (m, 2) of the cables.
        numbers: (m, 6) of the cables.
        x: (n, 3) positions, m.
        v: (n, 3) velocities, m/s.
        factors: of derivatives by positions and by velocities.
        index: (m, 2, 2) numbers of the pairs.
        blocks: see above.
    """
    K = np.empty((3, 3))
    for m in range(len(nodes)):
        _tangent(x, v, nodes[m, 0], nodes[m, 1], numbers[m], factors, K)
        _scatter(K, index[m], blocks)


@inlined
def _scatter(K: FloatArray, index: IndexArray, blocks: FloatArray) -> None:
    """Add a derivative to the blocks of both nodes."""
    for a in range(3):
        for b in range(3):
            blocks[index[0, 0], a, b] += K[a, b]
            blocks[index[1, 1], a, b] += K[a, b]
            blocks[index[0, 1], a, b] -= K[a, b]
            blocks[index[1, 0], a, b] -= K[a, b]


@inlined
def _multiply(K: FloatArray, u: FloatArray, i: int, j: int, out: FloatArray) -> None:
    """Add the product of a derivative with steps of both nodes to their forces."""
    for a in range(3):
        f = 0.0
        for b in range(3):
            f += K[a, b] * (u[j, b] - u[i, b])
        out[i, a] -= f
        out[j, a] += f


@kernel
def add_products(
    nodes: IndexArray, numbers: FloatArray, x: FloatArray, v: FloatArray, factors: FloatArray,
    u: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    """Add products of the derivatives of :func:`tangents` with steps u (n, 3) to forces (n, 3)."""
    K = np.empty((3, 3))
    for m in range(len(nodes)):
        _tangent(x, v, nodes[m, 0], nodes[m, 1], numbers[m], factors, K)
        _multiply(K, u, nodes[m, 0], nodes[m, 1], out)


@inlined
def _mean(
    x0: FloatArray, x: FloatArray, i: int, j: int, last: float, law: FloatArray, row: FloatArray
) -> tuple[_Pair, _Pair, tuple[float, float, float, float]]:
    """Vectors at both ends of a step, and the mean stress, see :func:`_mean_stress`."""
    before, d = _between(x0, i, j), _between(x, i, j)
    ends = before[3] / row[REST] - 1.0, d[3] / row[REST] - 1.0
    return before, d, _mean_stress(ends[0], ends[1], last, law[1], law[0], row)


@kernel
def add_step_forces(
    nodes: IndexArray, numbers: FloatArray, x0: FloatArray, x: FloatArray, last: FloatArray,
    law: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    """Add mean forces over a step.

    Args:
        nodes: (m, 2) of the cables.
        numbers: (m, 6) of the cables.
        x0: (n, 3) positions at the start, m.
        x: (n, 3) positions at the end.
        last: (m,) change of the taut parts over the last step.
        law: half of the numerical dissipation, and 1/h, 1/s.
        out: (n, 3) forces.
    """
    for m in range(len(nodes)):
        i, j, row = nodes[m, 0], nodes[m, 1], numbers[m]
        before, d, stress = _mean(x0, x, i, j, last[m], law, row)
        if stress[0] == 0.0:
            continue
        pull = row[STIFFNESS] * stress[0] / (before[3] + d[3])
        for a in range(3):
            f = pull * (before[a] + d[a])
            out[i, a] -= f
            out[j, a] += f


@inlined
def _step_tangent(
    x0: FloatArray, x: FloatArray, i: int, j: int, last: float, law: FloatArray, row: FloatArray,
    scale: float, K: FloatArray,
) -> None:  # fmt: skip
    """``scale`` times the derivative (3, 3) of the mean force on the second node by its end."""
    before, d, stress = _mean(x0, x, i, j, last, law, row)
    if (stress[0] == 0.0 and stress[1] == 0.0) or d[3] == 0.0:
        K[:] = 0.0
        return
    EA, whole = scale * row[STIFFNESS], before[3] + d[3]
    pull = EA * stress[0] / whole
    along = EA * stress[1] / row[REST] - pull
    for a in range(3):
        for b in range(3):
            K[a, b] = along * (before[a] + d[a]) / whole * d[b] / d[3]
        K[a, a] += pull


@kernel
def step_tangents(
    nodes: IndexArray, numbers: FloatArray, x0: FloatArray, x: FloatArray, last: FloatArray,
    law: FloatArray, scale: float, index: IndexArray, blocks: FloatArray,
) -> None:  # fmt: skip
    """Add ``scale`` times the derivatives of mean forces to blocks (k, 3, 3) of pairs."""
    K = np.empty((3, 3))
    for m in range(len(nodes)):
        i, j = nodes[m, 0], nodes[m, 1]
        _step_tangent(x0, x, i, j, last[m], law, numbers[m], scale, K)
        _scatter(K, index[m], blocks)


@kernel
def add_step_products(
    nodes: IndexArray, numbers: FloatArray, x0: FloatArray, x: FloatArray, last: FloatArray,
    law: FloatArray, u: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    """Add products of these derivatives with steps u (n, 3) to forces (n, 3)."""
    K = np.empty((3, 3))
    for m in range(len(nodes)):
        i, j = nodes[m, 0], nodes[m, 1]
        _step_tangent(x0, x, i, j, last[m], law, numbers[m], 1.0, K)
        _multiply(K, u, i, j, out)


@kernel
def add_last_blocks(
    nodes: IndexArray, numbers: FloatArray, x0: FloatArray, x: FloatArray, last: FloatArray,
    law: FloatArray, then: FloatArray, scale: float, index: IndexArray, blocks: FloatArray,
) -> None:  # fmt: skip
    """Add ``scale`` times derivatives of mean forces by positions ``then`` (n, 3) of the last step.

    They are those by the taut part there, which enters the change over the last step.
    """
    K = np.empty((3, 3))
    for m in range(len(nodes)):
        i, j, row = nodes[m, 0], nodes[m, 1], numbers[m]
        before, d, stress = _mean(x0, x, i, j, last[m], law, row)
        own = _between(then, i, j)
        known = row[SLACK] == 0.0 or own[3] > row[REST]
        if not known or stress[2] == 0.0:
            continue
        factor = scale * row[STIFFNESS] * stress[2] / row[REST]
        for a in range(3):
            for b in range(3):
                K[a, b] = factor * (before[a] + d[a]) / (before[3] + d[3]) * own[b] / own[3]
        _scatter(K, index[m], blocks)


@kernel
def step_losses(
    nodes: IndexArray, numbers: FloatArray, x0: FloatArray, x: FloatArray, per_step: float,
    out: FloatArray,
) -> None:  # fmt: skip
    """Energies (m,) that dampers take in a step, J."""
    for m in range(len(nodes)):
        i, j, row = nodes[m, 0], nodes[m, 1], numbers[m]
        ends = _strain(x0, i, j, row), _strain(x, i, j, row)
        lost = _mean_stress(ends[0], ends[1], 0.0, per_step, 0.0, row)[3]
        out[m] = row[STIFFNESS] * row[REST] * lost


@kernel
def add_rotations(
    nodes: IndexArray, numbers: FloatArray, start: FloatArray, x: FloatArray, sums: FloatArray
) -> None:
    """Add the smallest rotations of the cables since the start, times L, to both nodes (n, 9)."""
    for m in range(len(nodes)):
        i, j = nodes[m, 0], nodes[m, 1]
        p, q = _between(start, i, j), _between(x, i, j)
        u = p[0] / p[3], p[1] / p[3], p[2] / p[3]
        w = q[0] / q[3], q[1] / q[3], q[2] / q[3]
        c = u[0] * w[0] + u[1] * w[1] + u[2] * w[2]
        if c < -1.0 + _OPPOSITE:
            continue
        n = u[1] * w[2] - u[2] * w[1], u[2] * w[0] - u[0] * w[2], u[0] * w[1] - u[1] * w[0]
        for a in range(3):
            b, k = (a + 1) % 3, (a + 2) % 3
            for node in (i, j):
                row, size = sums[node], numbers[m, REST]
                row[4 * a] += size * (c + n[a] * n[a] / (1.0 + c))
                row[3 * a + b] += size * (n[a] * n[b] / (1.0 + c) - n[k])
                row[3 * b + a] += size * (n[a] * n[b] / (1.0 + c) + n[k])
