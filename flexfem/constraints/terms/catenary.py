# SPDX-License-Identifier: LGPL-3.0-or-later
"""Energy of an elastic cable that hangs from marker a to marker b under its weight.

With the weight w per unstretched length, the unstretched length L and the stiffness EA, the forces
(H, V) that hold its end b satisfy (Irvine 1981, "Cable Structures", chapter 2), with
``u = V - w L`` at a,

``l = H L/EA + H/w (asinh(V/H) - asinh(u/H))``,
``h = L (V - w L/2)/EA + 1/w (sqrt(H^2 + V^2) - sqrt(H^2 + u^2))``

for the horizontal and vertical distance from a to b. They are solved by Newton's method from the
start of Jayaraman and Knudson (1981, Computers and Structures 14, 165-174). The energy is that of
strain and weight, whose derivatives by (l, h) are (H, V).

``u = w k`` has the direction k upwards, inertial axes, and ``v = (L, EA, 0)``.
"""

from math import asinh, log1p, sqrt, tanh

import numpy as np

from flexfem._types import FloatArray
from flexfem.constraints.terms.vectors import (
    add_block,
    dot,
    product,
    rotate_back_into,
    skew_into,
)
from flexfem.core.row import RowKind
from flexfem.kernels.compiled import on_demand, subroutine

__all__ = ["KIND", "evaluate", "hessian"]

KIND = int(RowKind.CATENARY)

#: Newton steps for the end forces, and their change relative to all forces at convergence.
_STEPS, _SMALL = 100, 1e-14
#: Error of the distances relative to all lengths that is round-off.
_EXACT = 2e-15
#: Horizontal distance over length (epsilon / L) below which the cable hangs straight down.
_STRAIGHT = 1e-7


@subroutine
def _turning(H: float, V: float, u: float, T: float, S: float) -> float:
    """``asinh(V/H) - asinh(u/H)`` without cancellation where both are nearly the same."""
    more = (V - u) * (1.0 + abs(V + u) / (T + S))
    if V >= 0.0 and u >= 0.0:
        return log1p(more / (u + S))
    if V <= 0.0 and u <= 0.0:
        return log1p(more / (T - V))
    return asinh(V / H) - asinh(u / H)


@subroutine
def _reach(
    H: float, V: float, w: float, L: float, EA: float, out: FloatArray, slope: FloatArray
) -> None:
    """Distances (l, h) in ``out`` for end forces; their derivatives ``slope``: ll, lh, hh."""
    u = V - w * L
    T, S = sqrt(H * H + V * V), sqrt(H * H + u * u)
    part, longer = _turning(H, V, u, T, S), L * (V + u) / (T + S)  # (T - S) / w
    out[0] = H * (L / EA + part / w)
    out[1] = 0.5 * L * (V + u) / EA + longer
    across = V / T - u / S
    slope[0] = L / EA + (part - across) / w
    slope[1] = -H * longer / (T * S)
    slope[2] = L / EA + across / w


@subroutine
def _solve(
    span: float, h: float, w: float, L: float, EA: float, force: FloatArray, slope: FloatArray
) -> None:
    """End forces (H, V), not numbers where they are not found; derivatives of the distances."""
    found = np.empty(2)
    square = (L * L - h * h) / (span * span) - 1.0
    sag = sqrt(3.0 * square) if square > 0.0133 else 0.2
    sag = min(sag, 200.0)
    H = 0.5 * w * span / sag
    V = 0.5 * w * (h / tanh(sag) + L)
    for _ in range(_STEPS):
        _reach(H, V, w, L, EA, found, slope)
        dl, dh = found[0] - span, found[1] - h
        determinant = slope[0] * slope[2] - slope[1] * slope[1]
        dH = (slope[2] * dl - slope[1] * dh) / determinant
        dV = (slope[0] * dh - slope[1] * dl) / determinant
        if dH >= H:  # the horizontal force stays positive
            dH = 0.9 * H
        H -= dH
        V -= dV
        exact = abs(dl) + abs(dh) <= _EXACT * (span + abs(h) + L)
        if exact or abs(dH) + abs(dV) <= _SMALL * (H + abs(V) + w * L):
            force[0], force[1] = H, V
            return
    force[0] = force[1] = np.nan


@subroutine
def _energy(H: float, V: float, w: float, L: float, EA: float) -> float:
    """Energy of strain, and of the weight above marker a, J."""
    u = V - w * L
    T, S = sqrt(H * H + V * V), sqrt(H * H + u * u)
    strain = 0.5 * L * (H * H + (V * V + V * u + u * u) / 3.0) / EA
    stretched = w * L * L * (0.5 * u + w * L / 6.0) / EA
    bent = 0.5 * (V * T - u * S + H * H * _turning(H, V, u, T, S)) / w - L * S
    return strain + stretched + bent


@subroutine
def _parts(
    Ha: FloatArray, Hb: FloatArray, d: FloatArray, up: FloatArray, e: FloatArray, out: FloatArray
) -> None:
    """Direction upwards, that from a to b across it times ``l' = dl_s/dl``; in ``out`` l_s and h.

    ``l_s = sqrt(l^2 + epsilon^2)`` has a direction at l = 0, too.
    """
    w, h, square = sqrt(dot(d[0], d[0])), 0.0, 0.0
    for i in range(3):
        up[i] = d[0, i] / w
        h += up[i] * (Hb[i] - Ha[i])
    for i in range(3):
        e[i] = Hb[i] - Ha[i] - h * up[i]
        square += e[i] * e[i]
    out[0], out[1] = sqrt(square + (_STRAIGHT * d[1, 0]) ** 2), h
    for i in range(3):
        e[i] /= out[0]


@on_demand
def evaluate(Ha: FloatArray, Hb: FloatArray, d: FloatArray, out: FloatArray, g: FloatArray) -> None:
    """Energy in ``out[0]``; its gradient in ``g``, forces on both ends."""
    up, e, at, force, slope = np.empty(3), np.empty(3), np.empty(2), np.empty(2), np.empty(3)
    pull, push = np.empty(3), np.empty(3)
    w, L, EA = sqrt(dot(d[0], d[0])), d[1, 0], d[1, 1]
    _parts(Ha, Hb, d, up, e, at)
    _solve(at[0], at[1], w, L, EA, force, slope)
    for i in range(3):
        pull[i] = force[0] * e[i] + force[1] * up[i]
        push[i] = w * L * up[i] - pull[i]
    rotate_back_into(Ha, push, g, 0)
    rotate_back_into(Hb, pull, g, 6)
    out[0] = _energy(force[0], force[1], w, L, EA) + w * L * dot(up, Ha[:3])


@on_demand
def hessian(Ha: FloatArray, Hb: FloatArray, d: FloatArray, h: FloatArray) -> None:
    """Derivative (12, 12) of the gradient."""
    up, e, at, force, slope = np.empty(3), np.empty(3), np.empty(2), np.empty(2), np.empty(3)
    pull, push, turned, P = np.empty(3), np.empty(3), np.empty(3), np.empty((3, 3))
    w, L, EA = sqrt(dot(d[0], d[0])), d[1, 0], d[1, 1]
    _parts(Ha, Hb, d, up, e, at)
    _solve(at[0], at[1], w, L, EA, force, slope)
    determinant = slope[0] * slope[2] - slope[1] * slope[1]
    ll, lh, hh = slope[2] / determinant, -slope[1] / determinant, slope[0] / determinant
    across = force[0] / at[0]
    for i in range(3):
        pull[i] = force[0] * e[i] + force[1] * up[i]
        push[i] = w * L * up[i] - pull[i]
        for j in range(3):
            P[i, j] = (ll - across) * e[i] * e[j] + (hh - across) * up[i] * up[j]
            P[i, j] += lh * (e[i] * up[j] + up[i] * e[j]) + (across if i == j else 0.0)
    h[:] = 0.0
    Ra, Rb = Ha[3:].copy().reshape(3, 3), Hb[3:].copy().reshape(3, 3)
    PRa, PRb = product(P, Ra), product(P, Rb)
    RaT, RbT = Ra.T.copy(), Rb.T.copy()
    add_block(h, 0, 0, 1.0, product(RaT, PRa))
    add_block(h, 0, 6, -1.0, product(RaT, PRb))
    add_block(h, 6, 0, -1.0, product(RbT, PRa))
    add_block(h, 6, 6, 1.0, product(RbT, PRb))
    rotate_back_into(Ha, push, turned, 0)
    skew_into(turned, 1.0, h, 0, 3)
    rotate_back_into(Hb, pull, turned, 0)
    skew_into(turned, 1.0, h, 6, 9)
