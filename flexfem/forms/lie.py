# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rotation and frame maps as UFL expressions, the counterparts of :mod:`flexfem.lie`.

Same conventions: right tangent maps, twists ``w = (u, theta)`` with the translation first. All
expressions are smooth at zero, also under ``ufl.diff``. The maps of relative rotations (logarithm,
inverse tangent) contain no branch at all, because generated code evaluates both sides of a UFL
conditional and pays for both; the exponential and the tangent map branch, since they hold at any
angle.
"""

from collections.abc import Sequence
from math import factorial, pi
from typing import Any

import ufl

__all__ = [
    "Expr",
    "se3_inverse_tangent_apply",
    "se3_inverse_tangent_left",
    "se3_inverse_tangent_right",
    "se3_log",
    "se3_relative_rate",
    "skew",
    "so3_exp",
    "so3_inverse_tangent",
    "so3_log",
    "so3_tangent",
]

#: A UFL expression; the operators between expressions are not typed.
Expr = Any

#: Squared angle up to which the exponential and the tangent map use their series.
_SMALL = 1.0

#: Series of ``(1 - cos(t)) / t^2`` and ``(t - sin(t)) / t^3`` in ``t^2``.
_B = tuple((-1.0) ** k / factorial(2 * k + 2) for k in range(10))
_C = tuple((-1.0) ** k / factorial(2 * k + 3) for k in range(10))

#: ``(1 - t/2 cot(t/2)) / t^2 = sum_n 2 / ((2 pi n)^2 - t^2)``: the first term is kept as it stands.
_POLE = 4.0 * pi**2

#: The other terms and twice their derivative, in powers of ``t^2 <= 10``: Chebyshev fits in
#: 60-digit arithmetic, errors below 3e-18.
_REST = (
    0.032672741512164449731,
    0.00010564110705331266725,
    5.6373702837903096877e-7,
    3.3571418332303662691e-9,
    2.074292065828213842e-11,
    1.2999115722452699698e-13,
    8.2188876578788261579e-16,
    4.9601736820120010625e-18,
    4.3884287661724776611e-20,
)
_REST_1 = (
    0.00021128221410669425692,
    2.254948113146261791e-6,
    2.0142851571855612247e-8,
    1.6594297105562047955e-10,
    1.3000544346435471675e-12,
    9.8334841338449295057e-15,
    7.281841041954502246e-17,
    4.9589696250886256205e-19,
    5.1668514963106554612e-21,
)

#: ``atan(s) / s`` in powers of ``s^2`` for ``s <= tan(pi / 8)``: Chebyshev fit in 60-digit
#: arithmetic, error below 2e-18.
_ARC = (
    0.99999999999999999873,
    -0.33333333333333120823,
    0.19999999999940805859,
    -0.14285714279241901438,
    0.11111110744504494066,
    -0.090908967970609632089,
    0.076920451153294513251,
    -0.066629493351301593788,
    0.058468600441315983776,
    -0.050350191994002929161,
    0.037963116386953387223,
    -0.01780302457037242619,
)


def _horner(series: Sequence[float], x: Expr) -> Expr:
    value = ufl.as_ufl(series[-1])
    for factor in reversed(series[:-1]):
        value = value * x + factor
    return value


def _split(w: Expr) -> tuple[Expr, Expr]:
    return ufl.as_vector([w[i] for i in range(3)]), ufl.as_vector([w[i] for i in range(3, 6)])


def _join(first: Expr, second: Expr) -> Expr:
    return ufl.as_vector([*(first[i] for i in range(3)), *(second[i] for i in range(3))])


def _rotation_coefficients(x: Expr) -> tuple[Expr, Expr, Expr]:
    """``sin(t)/t``, ``(1 - cos(t))/t^2`` and ``(t - sin(t))/t^3`` at ``x = t^2``."""
    small = ufl.lt(x, _SMALL)
    # the closed forms never see a small angle, so that the branch not taken stays differentiable
    y = ufl.conditional(small, _SMALL, x)
    t = ufl.sqrt(y)
    b_series, c_series = _horner(_B, x), _horner(_C, x)
    s, h = ufl.sin(t / 2), ufl.cos(t / 2)
    a = 2 * s * h / t
    return (
        ufl.conditional(small, 1 - x * c_series, a),
        ufl.conditional(small, b_series, 2 * s * s / y),
        ufl.conditional(small, c_series, (1 - a) / y),
    )


def _inverse_coefficient(x: Expr) -> Expr:
    """``(1 - t/2 cot(t/2)) / t^2`` at ``x = t^2 <= pi^2``."""
    return 2 / (_POLE - x) + _horner(_REST, x)


def _inverse_coefficients(x: Expr) -> tuple[Expr, Expr]:
    """The coefficient above and twice its derivative with respect to ``x``."""
    pole = 1 / (_POLE - x)
    return (
        2 * pole + _horner(_REST, x),
        4 * pole * pole + _horner(_REST_1, x),
    )


def skew(v: Expr) -> Expr:
    """Matrix of the cross product, ``skew(v) w = v x w``."""
    return ufl.as_matrix([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def so3_exp(theta: Expr) -> Expr:
    """Rotation matrix of a rotation vector of any length (rad)."""
    a, b, _ = _rotation_coefficients(ufl.dot(theta, theta))
    k = skew(theta)
    return ufl.Identity(3) + a * k + b * (k * k)


def so3_tangent(theta: Expr) -> Expr:
    """Right tangent map of a rotation vector of any length (rad)."""
    _, b, c = _rotation_coefficients(ufl.dot(theta, theta))
    k = skew(theta)
    return ufl.Identity(3) - b * k + c * (k * k)


def so3_inverse_tangent(theta: Expr) -> Expr:
    """Inverse of the right tangent map, for rotation vectors no longer than pi."""
    e = _inverse_coefficient(ufl.dot(theta, theta))
    k = skew(theta)
    return ufl.Identity(3) + 0.5 * k + e * (k * k)


def so3_log(R: Expr) -> Expr:
    """Rotation vector of a rotation matrix, for angles below pi - 0.1.

    The angle is reached from the vector part of the quaternion, ``sin(t/2) n``, through
    ``tan(t/4) n`` and ``tan(t/8) n``, where the arctangent is a short polynomial.
    """
    double_cos = ufl.sqrt(1 + ufl.tr(R))  # 2 cos(t/2)
    axial = ufl.as_vector([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    quarter = axial / (double_cos * (2 + double_cos))
    shrink = 1 / (1 + ufl.sqrt(1 + ufl.dot(quarter, quarter)))
    square = ufl.dot(quarter, quarter) * shrink * shrink
    return (8 * shrink * _horner(_ARC, square)) * quarter


def se3_log(x: Expr, R: Expr) -> Expr:
    """Twist of the frame ``(x, R)``, for rotations below pi - 0.1."""
    theta = so3_log(R)
    e = _inverse_coefficient(ufl.dot(theta, theta))
    p = ufl.cross(theta, x)
    return _join(x - 0.5 * p + e * ufl.cross(theta, p), theta)


def _bracket(w: Expr, v: Expr) -> Expr:
    """``ad_w v``."""
    (u, theta), (a, o) = _split(w), _split(v)
    return _join(ufl.cross(theta, a) + ufl.cross(u, o), ufl.cross(theta, o))


def _even_part(w: Expr, v: Expr) -> Expr:
    """``(Tinv(w) + Tinv(-w)) v / 2 - v``."""
    (u, theta), (a, o) = _split(w), _split(v)
    e, e1 = _inverse_coefficients(ufl.dot(theta, theta))
    y = ufl.cross(theta, o)
    z = ufl.cross(theta, y)
    r = ufl.cross(theta, a) + ufl.cross(u, o)
    coupling = e * (ufl.cross(theta, r) + ufl.cross(u, y)) + (e1 * ufl.dot(theta, u)) * z
    return _join(coupling, e * z)


def se3_inverse_tangent_apply(w: Expr, v: Expr) -> Expr:
    """Inverse of the right tangent map at ``w`` applied to ``v``, for rotations up to pi.

    The left map is the one at ``-w``; :func:`se3_relative_rate` needs fewer operations where both
    occur.
    """
    return v + 0.5 * _bracket(w, v) + _even_part(w, v)


def se3_relative_rate(w: Expr, v_1: Expr, v_2: Expr) -> Expr:
    """Change of ``w = log(H_1^-1 H_2)`` along local twists ``v_1`` of H_1 and ``v_2`` of H_2.

    ``Tinv(w) v_2 - Tinv(-w) v_1`` with its even and odd parts in ``w`` collected.
    """
    change = v_2 - v_1
    return change + 0.5 * _bracket(w, v_1 + v_2) + _even_part(w, change)


def se3_inverse_tangent_right(w: Expr) -> Expr:
    """Inverse of the right tangent map as a 6x6 matrix."""
    units = [[float(i == j) for i in range(6)] for j in range(6)]
    columns = [se3_inverse_tangent_apply(w, ufl.as_vector(unit)) for unit in units]
    return ufl.as_matrix([[column[i] for column in columns] for i in range(6)])


def se3_inverse_tangent_left(w: Expr) -> Expr:
    """Inverse of the left tangent map as a 6x6 matrix."""
    return se3_inverse_tangent_right(-w)
