# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled mean forces at points fixed to nodes over a step.

Dead forces do the work of their potential exactly. Follower forces and moments are the averages of
both ends of the step.
"""

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.core.step_kernels import add, turn, turn_back, unit
from flexfem.lie._blocks import cross, triple
from flexfem.lie._coefficients import Triple
from flexfem.lie.compiled import inlined, kernel

__all__ = ["add_step_forces", "step_force_tangent"]


@inlined
def _mean(H0: FloatArray, H1: FloatArray, v: Triple) -> Triple:
    """``(R_0 + R_1)/2 v``."""
    a, b = turn(H0, v), turn(H1, v)
    return 0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), 0.5 * (a[2] + b[2])


@inlined
def _wrench(
    H0: FloatArray, H1: FloatArray, offset: FloatArray, force: FloatArray, moment: FloatArray,
    follower: bool, factor: float,
) -> tuple[Triple, Triple, Triple, Triple]:  # fmt: skip
    """Mean force and moment on the node in inertial axes; both in node axes where they follow."""
    f, m = add((0.0, 0.0, 0.0), factor, triple(force, 0)), triple(moment, 0)
    m = add((0.0, 0.0, 0.0), factor, m)
    fixed_f, fixed_m = turn(offset, f), turn(offset, m)
    if follower:
        f, m = _mean(H0, H1, fixed_f), _mean(H0, H1, fixed_m)
    return f, add(m, 1.0, cross(_mean(H0, H1, triple(offset, 0)), f)), fixed_f, fixed_m


@kernel
def add_step_forces(
    nodes: IntArray, offsets: FloatArray, forces: FloatArray, moments: FloatArray,
    follower: BoolArray, load: IntArray, factors: FloatArray, frames0: FloatArray,
    frames: FloatArray, scale: float, residual: FloatArray,
) -> None:  # fmt: skip
    """Subtract ``scale * factors[load]`` times every mean wrench from the residual of its node."""
    for k in range(nodes.size):
        node = nodes[k]
        f, m, _, _ = _wrench(
            frames0[node], frames[node], offsets[k], forces[k], moments[k], follower[k],
            factors[load[k]],
        )  # fmt: skip
        f, m = turn_back(frames[node], f), turn_back(frames[node], m)
        for i in range(3):
            residual[node, i] -= scale * f[i]
            residual[node, 3 + i] -= scale * m[i]


@kernel
def step_force_tangent(
    nodes: IntArray, offsets: FloatArray, forces: FloatArray, moments: FloatArray,
    follower: BoolArray, load: IntArray, factors: FloatArray, frames0: FloatArray,
    frames: FloatArray, scale: float, out: FloatArray,
) -> None:  # fmt: skip
    """Write the derivatives of :func:`add_step_forces` along local twists to ``out`` (k, 6, 6)."""
    for k in range(nodes.size):
        H0, H1 = frames0[nodes[k]], frames[nodes[k]]
        out[k] = 0.0
        f, m, fixed_f, fixed_m = _wrench(
            H0, H1, offsets[k], forces[k], moments[k], follower[k], factors[load[k]]
        )
        o = triple(offsets[k], 0)
        local_f, local_m = turn_back(H1, f), turn_back(H1, m)
        for j in range(3):
            t = unit(j)
            dm = add((0.0, 0.0, 0.0), 0.5, cross(turn(H1, cross(t, o)), f))
            df = (0.0, 0.0, 0.0)
            if follower[k]:
                df = add(df, 0.5, turn(H1, cross(t, fixed_f)))
                dm = add(dm, 0.5, turn(H1, cross(t, fixed_m)))
                dm = add(dm, 1.0, cross(_mean(H0, H1, o), df))
            df = add(turn_back(H1, df), -1.0, cross(t, local_f))
            dm = add(turn_back(H1, dm), -1.0, cross(t, local_m))
            for i in range(3):
                out[k, i, 3 + j] = -scale * df[i]
                out[k, 3 + i, 3 + j] = -scale * dm[i]
