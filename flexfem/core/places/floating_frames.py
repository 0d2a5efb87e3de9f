# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled kinematics of bodies in a floating frame: nodes seen from the frame, and their changes.

The frame F and an interface I have frames ``H = (x, R)`` and local twists ``v = (V, Omega)``. The
relative frame ``X = H_F^-1 H_I = (p, R)`` is kept as 12 numbers; it and its derivatives follow from
``dX = X xi_I - xi_F X``. The elastic coordinates of an interface are its displacement ``p - r`` and
the rotation vector of R, ``theta = g(c) s`` with ``s = vee(R - R^T)/2 = sin(theta) e``,
``c = (tr R - 1)/2 = cos(theta)`` and ``g = theta/sin(theta)``. As c and s are linear in R, all
derivatives of theta are products of those of g with c and s of the derivatives of R.

A nonlinear body has twelve coordinates of an interface instead, all linear in X: the displacement,
s, and the six products ``b t_p t_q = R_pq + R_qp - 2 c delta_pq`` of its rotation vector t,
``b = 2 (1 - cos|t|)/|t|^2``, as xx, xy, xz, yy, yz, zz.
"""

import numpy as np

from flexfem._types import FloatArray
from flexfem.kernels.compiled import inlined, subroutine

__all__ = [
    "act",
    "first",
    "interface_motion",
    "linear_into",
    "relative_frame",
    "relative_motion_into",
    "rotation_into",
    "row_of",
    "second",
    "third",
    "write_columns",
    "write_linear_columns",
    "write_linear_second",
    "write_second",
]

#: Argument below which closed forms of the derivatives of g lose digits, and the number of series
#: terms used there.
_NEAR, _TERMS = 0.2, 24


@subroutine
def act(
    X: FloatArray, right: FloatArray, left: FloatArray, affine: float, factor: float,
    out: FloatArray,
) -> None:  # fmt: skip
    """Add ``factor (X right - left X)`` for local twists of interface and frame.

    ``affine`` is 1 for a frame X, and 0 for a derivative of one.
    """
    for i in range(3):
        p, q = (i + 1) % 3, (i + 2) % 3
        k = 3 + 3 * i
        moved = X[k] * right[0] + X[k + 1] * right[1] + X[k + 2] * right[2]
        carried = left[3 + p] * X[q] - left[3 + q] * X[p]
        out[i] += factor * (moved - carried - affine * left[i])
        for j in range(3):
            a, b = (j + 1) % 3, (j + 2) % 3
            turned = X[k + a] * right[3 + b] - X[k + b] * right[3 + a]
            carried = left[3 + p] * X[3 + 3 * q + j] - left[3 + q] * X[3 + 3 * p + j]
            out[k + j] += factor * (turned - carried)


@subroutine
def _act_along(
    X: FloatArray, i: int, none: FloatArray, unit: FloatArray, affine: float, out: FloatArray
) -> None:
    """Add the derivative of X by local twist i: six of the frame, then six of the interface.

    ``none`` (6,) is zero, ``unit`` (6,) one at ``i % 6``; ``affine`` as in :func:`act`.
    """
    if i < 6:
        act(X, none, unit, affine, 1.0, out)
    else:
        act(X, unit, none, affine, 1.0, out)


@subroutine
def relative_frame(F: FloatArray, H: FloatArray, X: FloatArray) -> None:
    """``H_F^-1 H_I``."""
    for i in range(3):
        X[i] = 0.0
        for m in range(3):
            X[i] += F[3 + 3 * m + i] * (H[m] - F[m])
        for j in range(3):
            total = 0.0
            for m in range(3):
                total += F[3 + 3 * m + i] * H[3 + 3 * m + j]
            X[3 + 3 * i + j] = total


@inlined
def _cosine(X: FloatArray) -> float:
    """Half the trace."""
    half: float = 0.5 * (X[3] + X[7] + X[11])
    return half


@inlined
def _sine(X: FloatArray, i: int) -> float:
    """Component i of half the axial vector."""
    a, b = (i + 1) % 3, (i + 2) % 3
    half: float = 0.5 * (X[3 + 3 * b + a] - X[3 + 3 * a + b])
    return half


@subroutine
def _factors(c: float, g: FloatArray) -> None:
    """``g = theta/sin(theta)`` and its first three derivatives by ``c = cos(theta)``.

    From ``(1 - c^2) g' = c g - 1`` and its derivatives; near 1 from the series in ``1 - c``, the
    hypergeometric function F(1, 1; 3/2; (1 - c)/2).
    """
    e = 1.0 - c
    if e < _NEAR:
        term = 1.0
        g[:] = 0.0
        power0, power1, power2, power3 = 1.0, 0.0, 0.0, 0.0
        for k in range(_TERMS):
            g[0] += term * power0
            g[1] -= term * k * power1
            g[2] += term * k * (k - 1) * power2
            g[3] -= term * k * (k - 1) * (k - 2) * power3
            power3, power2, power1, power0 = power2, power1, power0, power0 * e
            term *= (k + 1.0) / (2.0 * k + 3.0)
        return
    square = 1.0 - c * c
    g[0] = np.arccos(max(c, -1.0)) / np.sqrt(square)
    g[1] = (c * g[0] - 1.0) / square
    g[2] = (3.0 * c * g[1] + g[0]) / square
    g[3] = (5.0 * c * g[2] + 4.0 * g[1]) / square


@subroutine
def rotation_into(X: FloatArray, g: FloatArray, theta: FloatArray) -> None:
    """Write g and its derivatives (4,) and the rotation vector of a relative frame."""
    _factors(_cosine(X) - 0.5, g)
    for i in range(3):
        theta[i] = g[0] * _sine(X, i)


@inlined
def first(X: FloatArray, g: FloatArray, A: FloatArray, i: int) -> float:
    """Component of the derivative of the rotation vector along A."""
    change: float = g[1] * _cosine(A) * _sine(X, i) + g[0] * _sine(A, i)
    return change


@inlined
def second(X: FloatArray, g: FloatArray, A: FloatArray, B: FloatArray, i: int) -> float:
    """Component of its second derivative along A and B."""
    a, b = _cosine(A), _cosine(B)
    change: float = g[2] * a * b * _sine(X, i) + g[1] * (b * _sine(A, i) + a * _sine(B, i))
    return change


@inlined
def third(X: FloatArray, g: FloatArray, A: FloatArray, B: FloatArray, i: int) -> float:
    """Component of its third derivative along A, A and B."""
    a, b = _cosine(A), _cosine(B)
    twice = 2.0 * a * b * _sine(A, i) + a * a * _sine(B, i)
    change: float = g[3] * a * a * b * _sine(X, i) + g[2] * twice
    return change


@inlined
def row_of(c: int, i: int, k: int, n: int) -> int:
    """Number of coordinate i of interface c of k among n: products of rotations stand last."""
    row: int = 6 * c + i if i < 6 else n - 6 * (k - c) + i - 6
    return row


@subroutine
def linear_into(A: FloatArray, affine: float, out: FloatArray) -> None:
    """Write the twelve coordinates (12,) of a nonlinear body's interface, rest position included.

    ``affine`` is 1 for a relative frame A, and 0 for a derivative of one.
    """
    trace, at = A[3] + A[7] + A[11], 6
    for i in range(3):
        out[i], out[3 + i] = A[i], _sine(A, i)
        for j in range(i, 3):
            out[at] = A[3 + 3 * i + j] + A[3 + 3 * j + i]
            if i == j:
                out[at] += affine - trace
            at += 1


@subroutine
def relative_motion_into(
    base: FloatArray, H: FloatArray, v: FloatArray, w: FloatArray, X: FloatArray
) -> None:
    """Write a relative frame with its first two derivatives in time, see `interface_motion`."""
    frame, twist, rate = base[:12], base[12:18], base[18:]
    X[1:] = 0.0
    relative_frame(frame, H, X[0])
    act(X[0], v, twist, 1.0, 1.0, X[1])
    act(X[1], v, twist, 0.0, 1.0, X[2])
    act(X[0], w, rate, 1.0, 1.0, X[2])


@subroutine
def interface_motion(
    rest: FloatArray, base: FloatArray, H: FloatArray, v: FloatArray, w: FloatArray,
    X: FloatArray, g: FloatArray, eta: FloatArray,
) -> None:  # fmt: skip
    """Elastic coordinates of one interface with their first two derivatives in time.

    Args:
        rest: (3,) the interface at rest in the axes of the frame, from its origin.
        base: (24,) frame, its local twist and the rate of that.
        H: (12,) the interface.
        v: (6,) its local twist.
        w: (6,) the rate of that.
        X: (3, 12) gets the relative frame and its derivatives.
        g: (4,) see above.
        eta: (6, 3) gets coordinates, rates and their rates.
    """
    relative_motion_into(base, H, v, w, X)
    rotation_into(X[0], g, eta[3:, 0])
    for i in range(3):
        eta[i, 0] = X[0, i] - rest[i]
        eta[i, 1], eta[i, 2] = X[1, i], X[2, i]
        eta[3 + i, 1] = first(X[0], g, X[1], i)
        eta[3 + i, 2] = first(X[0], g, X[2], i) + second(X[0], g, X[1], X[1], i)


@subroutine
def _write_units(X: FloatArray, units: FloatArray) -> None:
    """Write the derivatives (12, 12) of a relative frame by the local twists, see below."""
    nothing, twist = np.zeros(6), np.zeros(6)
    units[:] = 0.0
    for j in range(12):
        twist[j % 6] = 1.0
        _act_along(X, j, nothing, twist, 1.0, units[j])
        twist[j % 6] = 0.0


@subroutine
def write_linear_columns(X: FloatArray, units: FloatArray, columns: FloatArray) -> None:
    """As :func:`write_columns`, (12, 12) of a nonlinear body."""
    own = np.empty(12)
    _write_units(X, units)
    for j in range(12):
        linear_into(units[j], 0.0, own)
        for i in range(12):
            columns[i, j] = own[i]


@subroutine
def write_columns(X: FloatArray, g: FloatArray, units: FloatArray, columns: FloatArray) -> None:
    """Derivatives of an interface's coordinates by the local twists of the frame and its own.

    Args:
        X: (12,) relative frame.
        g: (4,) factors of its rotation.
        units: (12, 12) gets the derivatives of X, the frame's six first.
        columns: (6, 12) gets those of the coordinates.
    """
    _write_units(X, units)
    for j in range(12):
        for i in range(3):
            columns[i, j] = units[j, i]
            columns[3 + i, j] = first(X, g, units[j], i)


@subroutine
def write_second(
    X: FloatArray, g: FloatArray, units: FloatArray, force: FloatArray, out: FloatArray
) -> None:
    """Second derivatives of an interface's coordinates, times forces on them.

    Args:
        X: (12,) relative frame.
        g: (4,) factors of its rotation.
        units: (12, 12) derivatives of X, see :func:`write_columns`.
        force: (6,) on the coordinates.
        out: (12, 12) gets the change of the forces on frame and interface as these move.
    """
    none, twist, x = np.zeros(6), np.zeros(6), np.empty(12)
    for i in range(12):
        twist[i % 6] = 1.0
        for j in range(12):
            x[:] = 0.0
            _act_along(units[j], i, none, twist, 0.0, x)
            total = 0.0
            for m in range(3):
                total += force[m] * x[m]
                turned = first(X, g, x, m) + second(X, g, units[i], units[j], m)
                total += force[3 + m] * turned
            out[i, j] = total
        twist[i % 6] = 0.0


@subroutine
def write_linear_second(units: FloatArray, force: FloatArray, out: FloatArray) -> None:
    """As :func:`write_second`, by forces (12,) on the coordinates of a nonlinear body."""
    none, twist, x, own = np.zeros(6), np.zeros(6), np.empty(12), np.empty(12)
    for i in range(12):
        twist[i % 6] = 1.0
        for j in range(12):
            x[:] = 0.0
            _act_along(units[j], i, none, twist, 0.0, x)
            linear_into(x, 0.0, own)
            out[i, j] = np.dot(force, own)
        twist[i % 6] = 0.0
