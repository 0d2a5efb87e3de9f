# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled mean forces at points fixed to nodes over a step.

Dead forces do the work of their potential exactly. Follower forces and moments are the averages of
both ends of the step.
"""

from flexfem._types import FloatArray, IntArray
from flexfem.bodies.node_forces import Wrenches
from flexfem.core.nodes.step_kernels import StepNodes, add, mean_turn, turn, turn_back, unit
from flexfem.kernels.compiled import inlined, kernel
from flexfem.kernels.records import Memory, unpack
from flexfem.lie._blocks import cross, triple
from flexfem.lie._coefficients import Triple

__all__ = ["add_step_forces", "step_force_tangent"]


@inlined
def _wrench(
    wrenches: Wrenches, k: int, H0: FloatArray, H1: FloatArray, factor: float
) -> tuple[Triple, Triple, Triple, Triple]:
    """Mean force and moment on the node in inertial axes; both in node axes where they follow."""
    offset = wrenches.offsets[k]
    f = add((0.0, 0.0, 0.0), factor, triple(wrenches.forces[k], 0))
    m = add((0.0, 0.0, 0.0), factor, triple(wrenches.moments[k], 0))
    fixed_f, fixed_m = turn(offset, f), turn(offset, m)
    if wrenches.follower[k]:
        f, m = mean_turn(H0, H1, fixed_f), mean_turn(H0, H1, fixed_m)
    return f, add(m, 1.0, cross(mean_turn(H0, H1, triple(offset, 0)), f)), fixed_f, fixed_m


@kernel
def add_step_forces(
    at: IntArray, wrenches: Memory, nodes: Memory, factors: FloatArray, scale: float
) -> None:
    """Subtract ``scale * factors[load]`` times every mean wrench from the residual of its node.

    Args:
        at: (k,) node of each wrench.
        wrenches: ``Wrenches``.
        nodes: ``StepNodes``.
        factors: amplitudes of the loads.
        scale: see above.
    """
    own, state = unpack(Wrenches, wrenches), unpack(StepNodes, nodes)
    residual = state.residual
    for k in range(at.size):
        node = at[k]
        H1 = state.frames[node]
        f, m, _, _ = _wrench(own, k, state.frames0[node], H1, factors[own.load[k]])
        f, m = turn_back(H1, f), turn_back(H1, m)
        for i in range(3):
            residual[node, i] -= scale * f[i]
            residual[node, 3 + i] -= scale * m[i]


@kernel
def step_force_tangent(
    at: IntArray, wrenches: Memory, nodes: Memory, factors: FloatArray, scale: float,
    out: FloatArray,
) -> None:  # fmt: skip
    """Write the derivatives of :func:`add_step_forces` along local twists to ``out`` (k, 6, 6)."""
    own, state = unpack(Wrenches, wrenches), unpack(StepNodes, nodes)
    for k in range(at.size):
        H0, H1 = state.frames0[at[k]], state.frames[at[k]]
        out[k] = 0.0
        f, m, fixed_f, fixed_m = _wrench(own, k, H0, H1, factors[own.load[k]])
        o = triple(own.offsets[k], 0)
        local_f, local_m = turn_back(H1, f), turn_back(H1, m)
        for j in range(3):
            t = unit(j)
            dm = add((0.0, 0.0, 0.0), 0.5, cross(turn(H1, cross(t, o)), f))
            df = (0.0, 0.0, 0.0)
            if own.follower[k]:
                df = add(df, 0.5, turn(H1, cross(t, fixed_f)))
                dm = add(dm, 0.5, turn(H1, cross(t, fixed_m)))
                dm = add(dm, 1.0, cross(mean_turn(H0, H1, o), df))
            df = add(turn_back(H1, df), -1.0, cross(t, local_f))
            dm = add(turn_back(H1, dm), -1.0, cross(t, local_m))
            for i in range(3):
                out[k, i, 3 + j] = -scale * df[i]
                out[k, 3 + i, 3 + j] = -scale * dm[i]
