# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled force laws over a step: mean forces whose work is the change of what they store.

A force F with the energy ``Pi(g)`` is ``(Pi(g_1) - Pi(g_0)) / (g_1 - g_0)`` over a step from g_0 to
g_1 (Gonzalez 1996; Laursen, Chawla 1997). Dampers see the mean rate ``(g_1 - g_0)/h``: what they
add to the force never does work on the model. Where the force acts is a mean as well: the discrete
gradient D of the row's sum x, ``D . n = x_1 - x_0`` with n the increments of its nodes.
"""

from math import sqrt, tan

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.constraints.rows.data import InterfaceNodes, RowArrays
from flexfem.constraints.rows.kernels import ON_LINES
from flexfem.constraints.rows.laws import LIMIT, PRESS, function_beyond, stored
from flexfem.constraints.terms.dispatch import step_gradient, step_vectors, term
from flexfem.constraints.terms.vectors import mean
from flexfem.core.nodes.step_kernels import add, turn, turn_back
from flexfem.core.row import RowKind
from flexfem.kernels.compiled import inlined, kernel, subroutine
from flexfem.kernels.records import Float1D, Float2D, Float3D, Int1D, Int2D, Memory, Record, unpack
from flexfem.lie import so3
from flexfem.lie._blocks import cross, triple
from flexfem.lie._coefficients import Triple

__all__ = [
    "RowsOverStep",
    "any_beyond",
    "begin_step",
    "divide_rows",
    "evaluate_over_step",
    "open_rows",
    "step_force",
    "step_forces",
]

#: Kinds of terms up to here have exact discrete gradients.
_EXACT = int(RowKind.ANGLE)
#: Relative change of a depth below which the force is that in its middle: the quotient would lose
#: eleven digits there, while the force in the middle is off by the square of the change.
_SMALL = 1e-5
#: Part of the motion of a row's nodes that its sum must at least change by for its mean gradient to
#: be scaled to that change, and the largest relative change by scaling. A difference of the last
#: size is round-off, which the quotient would enlarge where the sum hardly changes.
_LEAST, _MOST, _ROUND = 1e-6, 0.5, 1e-10
#: Argument beyond which tanh is constant.
_FLAT = 20.0


class RowsOverStep(Record):
    """Chosen rows from the accepted state to the trial state.

    Attributes:
        chosen: (k,) the rows.
        frames0, poses0: (n, 12) and (m, 12) nodes and markers at the accepted state.
        sums0, values0: (r,) sums of the rows there, and less their targets.
        gradients0, nodes0: (t, 2, 6) and (t, 2) gradients and nodes of the terms there.
        forces: (k,) mean forces of the last evaluation, N or N m.
        values: (k,) values then.
        size: size of the step, s.
        weight: factor with which the forces act in the equations.
    """

    chosen: Int1D
    frames0: Float2D
    poses0: Float2D
    sums0: Float1D
    values0: Float1D
    gradients0: Float3D
    nodes0: Int2D
    forces: Float1D
    values: Float1D
    size: float
    weight: float


@inlined
def _beyond(law: FloatArray, value: float) -> float:
    """Signed distance by which a value is beyond the limits."""
    beyond: float = value - min(max(value, law[3]), law[4])
    return beyond


@inlined
def _spring(k: float, s0: float, s1: float, way: float) -> tuple[float, float]:
    """Mean force of a spring beyond limits by s0, then by s1, and its slope by s1."""
    if s0 * s1 > 0.0 or way == 0.0:
        return 0.5 * k * (s0 + s1), 0.5 * k
    # (s1^2 - s0^2)/2 over the way, without cancellation
    half, part = 0.5 * (s0 + s1), (s1 - s0) / way
    slope = 1.0 if s1 != 0.0 else 0.0
    return k * half * part, k * (0.5 * slope * part + half * (slope - part) / way)


@subroutine
def _limit(law: FloatArray, s0: float, s1: float, way: float, rate: float, h: float,
           out: FloatArray) -> None:  # fmt: skip
    """A spring and damper beyond limits, see :func:`step_force`."""
    out[0], out[1] = _spring(law[1], s0, s1, way)
    size = abs(out[0])
    if law[2] == 0.0 or size == 0.0:
        return
    ratio = law[2] * rate / size
    part = np.tanh(ratio)
    steep = 1.0 - part * part
    turning = ratio * steep if abs(ratio) < _FLAT else 0.0
    sign = 1.0 if out[0] > 0.0 else -1.0
    out[0] += size * part
    out[1] += sign * out[1] * (part - turning) + law[2] * steep / h


@subroutine
def _curve(
    law: FloatArray, function: int, data: FloatArray, value0: float, value1: float, rate: float,
    h: float, out: FloatArray,
) -> None:  # fmt: skip
    """A function beyond limits, see :func:`step_force`."""
    s0, s1, way, found = _beyond(law, value0), _beyond(law, value1), value1 - value0, np.empty(4)
    half = 0.5 * (s0 + s1)
    at = half + (law[4] if half > 0.0 else law[3])
    function_beyond(law, function, data, at, 0.0, found)
    resting, slope, inside = found[0], found[1], 0.5 if s1 != 0.0 else 0.0
    if abs(way) > _SMALL * max(abs(s0), abs(s1)):
        work = stored(law, function, data, value1) - stored(law, function, data, value0)
        function_beyond(law, function, data, value1, 0.0, found)
        out[0] = work / way
        out[1] = (found[0] - out[0]) / way
    else:
        out[0], out[1] = resting, 0.5 * slope
    function_beyond(law, function, data, at, rate, found)
    out[0] += found[0] - resting
    out[1] += found[2] / h + inside * (found[1] - slope)
    if law[0] == PRESS and out[0] * half < 0.0:
        out[0] = out[1] = 0.0


@subroutine
def step_force(
    law: FloatArray, function: int, data: FloatArray, value0: float, value1: float, rate: float,
    h: float, out: FloatArray,
) -> None:  # fmt: skip
    """Mean force over a step and its slope by the value at the end, in ``out`` (2,).

    Args:
        law: (5,) of a row that is slack between limits, see ``Law``.
        function: address of a user-defined function, 0 for none.
        data: (9,) time and parameters of that function.
        value0: value of the row at the start of the step, less its target.
        value1: that at the end.
        rate: mean rate that the damper sees, which grows with ``value1 / h``.
        h: size of the step, s.
        out: force and slope.
    """
    out[0] = out[1] = 0.0
    s0, s1 = _beyond(law, value0), _beyond(law, value1)
    if s0 == 0.0 and s1 == 0.0:
        return
    if law[0] == LIMIT:
        _limit(law, s0, s1, value1 - value0, rate, h, out)
    else:
        _curve(law, function, data, value0, value1, rate, h, out)


@kernel
def step_forces(
    memory: Memory, chosen: IntArray, values0: FloatArray, values: FloatArray, rates: FloatArray,
    h: float, out: FloatArray,
) -> None:  # fmt: skip
    """Mean forces and slopes (k, 2) of chosen (k,) rows, see :func:`step_force`.

    Values at both ends, less targets, and rates are those of all rows (r,); ``memory`` is that of
    ``RowArrays``.
    """
    own = unpack(RowArrays, memory)
    for k in range(chosen.size):
        r = chosen[k]
        step_force(
            own.elastic[r], own.functions[r], own.function_data[r], values0[r], values[r],
            rates[r], h, out[k],
        )  # fmt: skip


@subroutine
def _exact_gradient(
    own: RowArrays, nodes: InterfaceNodes, over: RowsOverStep, t: int, vectors: FloatArray,
    g: FloatArray, T: FloatArray,
) -> None:  # fmt: skip
    """Discrete gradient of a term by the increments of its nodes; the others are work space.

    That of ``dispatch.step_gradient`` is by translations in inertial axes and Cayley vectors, which
    are rotation vectors times ``tan(a/2)/(a/2)``, a the angle. On SE(3) translations are ``R_0``
    times the left tangent map times the first part of the twist.
    """
    a, b = own.term_marker[t, 0], own.term_marker[t, 1]
    kind, d, s0, s1 = own.kinds[t], own.directions[t], vectors[:5], vectors[5:]
    before = step_vectors(kind, over.poses0[a], over.poses0[b], d, own.angles[t], s0)
    after = step_vectors(kind, own.poses[a], own.poses[b], d, before, s1)
    step_gradient(kind, s0, s1, before, after, g)
    for side in range(2):
        m = own.term_marker[t, side]
        node, offset = own.marker_node[m], triple(own.marker_offset[m], 0)
        if node < 0:
            continue
        f = triple(g, 0)
        if side == 0:
            f = (-f[0], -f[1], -f[2])
        H, n = nodes.frames[node], nodes.increments[node]
        arm = mean(turn(over.frames0[node], offset), turn(H, offset))
        moment = turn_back(H, add(triple(g, 3 + 3 * side), 1.0, cross(arm, f)))
        angle = sqrt(n[3] * n[3] + n[4] * n[4] + n[5] * n[5])
        factor = own.factors[t]
        more = factor * (tan(0.5 * angle) / (0.5 * angle) if angle > 1e-4 else 1.0 + angle**2 / 12)
        force, out = turn_back(H, f), own.force_jacobian[t, side]
        if not nodes.inertial[node]:
            so3.tangent_into(n[3:], T)  # the left one is its transpose
            force = (
                T[0] * force[0] + T[3] * force[1] + T[6] * force[2],
                T[1] * force[0] + T[4] * force[1] + T[7] * force[2],
                T[2] * force[0] + T[5] * force[1] + T[8] * force[2],
            )
        for k in range(3):
            out[k], out[3 + k] = factor * force[k], more * moment[k]


@subroutine
def _mean_gradient(own: RowArrays, nodes: InterfaceNodes, over: RowsOverStep, t: int) -> None:
    """Mean of the gradients of a term at both ends, unless its nodes have changed."""
    for side in range(2):
        node, out = own.term_nodes[t, side], own.force_jacobian[t, side]
        if node < 0 or over.nodes0[t, side] != node:
            continue
        before = over.gradients0[t, side]
        f = triple(before, 0)
        if nodes.inertial[node]:
            f = turn_back(nodes.frames[node], turn(over.frames0[node], f))
        for k in range(3):
            out[k] = 0.5 * (f[k] + out[k])
            out[3 + k] = 0.5 * (before[3 + k] + out[3 + k])


@inlined
def _motion(nodes: InterfaceNodes, node: int) -> tuple[Triple, Triple]:
    """Increment of a node in the axes that its gradients have."""
    n = nodes.increments[node]
    u = triple(n, 0)
    if nodes.inertial[node]:
        u = turn_back(nodes.frames[node], u)
    return u, triple(n, 3)


@subroutine
def _scale(own: RowArrays, nodes: InterfaceNodes, r: int, way: float) -> None:
    """Scale the mean gradient of a row so that it gives the change ``way`` of its sum."""
    found, size = 0.0, 0.0
    for t in range(own.term_start[r], own.term_start[r + 1]):
        for side in range(2):
            node = own.term_nodes[t, side]
            if node < 0:
                continue
            u, turned = _motion(nodes, node)
            for k in range(3):
                first = own.force_jacobian[t, side, k] * u[k]
                second = own.force_jacobian[t, side, 3 + k] * turned[k]
                found += first + second
                size += abs(first) + abs(second)
    if abs(found) <= _LEAST * size or abs(way - found) <= _ROUND * size:
        return
    if abs(way / found - 1.0) > _MOST:
        return
    for t in range(own.term_start[r], own.term_start[r + 1]):
        for side in range(2):
            for k in range(6):
                own.force_jacobian[t, side, k] *= way / found


@inlined
def _sum(own: RowArrays, r: int, g: FloatArray, scratch: FloatArray) -> float:
    """Sum of a row at the poses of its markers; gradient and work space are not used."""
    total: float = own.line_sums[r]
    for t in range(own.term_start[r], own.term_start[r + 1]):
        if own.kinds[t] != ON_LINES:
            a, b = own.poses[own.term_marker[t, 0]], own.poses[own.term_marker[t, 1]]
            d, angle = own.directions[t], own.angles[t]
            total += own.factors[t] * term(own.kinds[t], a, b, d, angle, g, scratch)
    return total


@kernel
def begin_step(memory: Memory, interface_nodes: Memory, step: Memory) -> None:
    """Store the accepted state of the chosen rows, whose markers have been placed.

    Memories are those of :func:`evaluate_over_step`.
    """
    own, nodes = unpack(RowArrays, memory), unpack(InterfaceNodes, interface_nodes)
    over, g, scratch = unpack(RowsOverStep, step), np.empty(12), np.empty((5, 3))
    for k in range(over.chosen.size):
        r = over.chosen[k]
        over.sums0[r] = _sum(own, r, g, scratch)
        over.values0[r] = over.sums0[r] - own.targets[r]
        over.forces[k] = 0.0
        for t in range(own.term_start[r], own.term_start[r + 1]):
            for side in range(2):
                m, node = own.term_marker[t, side], own.term_nodes[t, side]
                over.nodes0[t, side] = node
                if own.kinds[t] != ON_LINES:
                    over.poses0[m] = own.poses[m]
                if node >= 0:
                    over.frames0[node] = nodes.frames[node]
                over.gradients0[t, side] = own.force_jacobian[t, side]


@kernel
def open_rows(memory: Memory, which: IntArray, forces: FloatArray, out: BoolArray) -> bool:
    """True if any of the rows (k,) is within its limits, or beyond the other one.

    Those that are so are in ``out`` (k,). Forces (r,) are those at the start of the step; markers
    have been placed.
    """
    own, g, scratch, some = unpack(RowArrays, memory), np.empty(12), np.empty((5, 3)), False
    for k in range(which.size):
        r = which[k]
        beyond = _beyond(own.elastic[r], _sum(own, r, g, scratch) - own.targets[r])
        out[k] = beyond == 0.0 or beyond * forces[r] < 0.0
        some = some or out[k]
    return some


@kernel
def any_beyond(memory: Memory, which: IntArray) -> bool:
    """True if any active one of the rows (k,) is beyond its limits at the last evaluation."""
    own, g, scratch = unpack(RowArrays, memory), np.empty(12), np.empty((5, 3))
    for k in range(which.size):
        r = which[k]
        if own.active[r]:
            value = _sum(own, r, g, scratch) - own.targets[r]
            if _beyond(own.elastic[r], value) != 0.0:
                return True
    return False


@kernel
def divide_rows(
    memory: Memory, which: IntArray, forces: FloatArray, settled: FloatArray, least: float,
    apart: BoolArray, joining: BoolArray,
) -> tuple[bool, bool]:  # fmt: skip
    """Which rows (k,) act by impulses, and which ones have been closed for long enough to join.

    Returns:
        True if the former have changed, and if there are any of the latter.
    """
    own, changed, some = unpack(RowArrays, memory), False, False
    for k in range(which.size):
        r = which[k]
        now = own.active[r] and forces[r] == 0.0
        changed = changed or now != apart[k]
        apart[k], joining[k] = now, now and settled[r] >= least
        some = some or joining[k]
    return changed, some


@kernel
def evaluate_over_step(
    memory: Memory, interface_nodes: Memory, step: Memory, dynamics: FloatArray
) -> None:
    """Replace equations and gradients of rows by those of their mean forces over the step.

    Args:
        memory: ``RowArrays``, evaluated by ``evaluate_rows``.
        interface_nodes: ``InterfaceNodes`` of the markers.
        step: :class:`RowsOverStep`.
        dynamics: (2,) ``gamma/(beta h)`` and ``beta h^2``.
    """
    own, nodes = unpack(RowArrays, memory), unpack(InterfaceNodes, interface_nodes)
    over, found, g, scratch = (
        unpack(RowsOverStep, step),
        np.empty(2),
        np.empty(12),
        np.empty((5, 3)),
    )
    vectors, T = np.empty((10, 3)), np.empty(9)
    for k in range(over.chosen.size):
        r, exact = over.chosen[k], True
        total = _sum(own, r, g, scratch)
        way, value = total - over.sums0[r], total - own.targets[r]
        step_force(
            own.elastic[r], own.functions[r], own.function_data[r], over.values0[r], value,
            way / over.size - own.target_rates[r], over.size, found,
        )  # fmt: skip
        over.forces[k], over.values[k] = found[0], value
        slope = over.weight * found[1]
        scale = 1.0 / (1.0 / dynamics[1] + abs(slope))
        own.values[r] = scale * (over.weight * found[0] - own.multipliers[r] / dynamics[1])
        own.compliance[r] = scale / dynamics[1]
        own.slopes[r, 0], own.slopes[r, 1] = scale * slope, 0.0
        if found[0] == 0.0 and found[1] == 0.0:  # open, as it would be at the end of the step
            for t in range(own.term_start[r], own.term_start[r + 1]):
                own.step_jacobian[t] = 0.0
            continue
        for t in range(own.term_start[r], own.term_start[r + 1]):
            exact = exact and 0 <= own.kinds[t] <= _EXACT
            for side in range(2):
                for i in range(6):
                    gradient = own.force_jacobian[t, side, i]
                    own.step_jacobian[t, side, i] = scale * slope * gradient
            if 0 <= own.kinds[t] <= _EXACT:
                _exact_gradient(own, nodes, over, t, vectors, g, T)
            else:
                _mean_gradient(own, nodes, over, t)
        if not exact:
            _scale(own, nodes, r, way)
