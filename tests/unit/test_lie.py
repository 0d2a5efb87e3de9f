# SPDX-License-Identifier: LGPL-3.0-or-later
"""Rotations and frames against 60-digit arithmetic, from zero to pi, and the group axioms.

The references share no formula with the package: power series of matrices, their inverses and
difference quotients with a step of 1e-20.
"""

from collections.abc import Callable
from functools import cache
from typing import Any

import mpmath as mp
import numpy as np
import pytest

from flexfem._types import FloatArray
from flexfem.lie import _coefficients, se3, so3
from tests.called import called

pytestmark = pytest.mark.serial

EPS = np.finfo(np.float64).eps
SMALL = [0.0, *(10.0**-k for k in range(12, 0, -1))]
#: around 2 and sqrt(10), where the coefficients change from series to closed forms
MIDDLE = [0.5, 1.0, 2.0 - 1e-9, 2.0 + 1e-9, 10.0**0.5 - 1e-9, 10.0**0.5 + 1e-9, 5.0]
NEAR_PI = [*(np.pi - 10.0**-k for k in range(1, 9)), np.pi]
AXIS = np.array([0.48, -0.6, 0.64])
SHIFT = np.array([0.7, 0.4, -1.1])
DIRECTION = np.array([-0.3, 0.9, 0.5, 0.8, 0.1, -0.6])


def twist(angle: float) -> FloatArray:
    return np.concatenate([SHIFT, angle * AXIS])


def error(values: FloatArray, reference: Any) -> float:
    """Largest deviation from a matrix of many digits."""
    exact = [mp.mpf(float(x)) for x in np.ravel(values)]
    return float(max(abs(x - y) for x, y in zip(exact, reference, strict=True)))


def hat(t: Any) -> list[list[Any]]:
    return [[0, -t[2], t[1]], [t[2], 0, -t[0]], [-t[1], t[0], 0]]


def series(matrix: Any, factor: Callable[[int], Any]) -> Any:
    """``sum_k factor(k) matrix^k``."""
    power, total = mp.eye(matrix.rows), mp.zeros(matrix.rows)
    for k in range(200):
        total += factor(k) * power
        power = power * matrix / (k + 1)
        if mp.mnorm(power, 1) < mp.mpf(10) ** -60:
            break
    return total


def tangent_reference(w: Any) -> Any:
    """``sum_k (-1)^k / (k + 1)! ad_w^k``."""
    ad = mp.zeros(6)
    upper, diagonal = hat(w[:3]), hat(w[3:])
    for i in range(3):
        for j in range(3):
            ad[i, j] = ad[3 + i, 3 + j] = diagonal[i][j]
            ad[i, 3 + j] = upper[i][j]
    return series(ad, lambda k: mp.mpf(-1) ** k / (k + 1))


@cache
def reference(angle: float) -> dict[str, Any]:
    """Frame, tangent maps and their derivatives along DIRECTION at ``twist(angle)``."""
    with mp.workdps(70):
        w = [mp.mpf(float(x)) for x in twist(angle)]
        step = [mp.mpf(float(x)) * mp.mpf(10) ** -20 for x in DIRECTION]
        matrix = mp.zeros(4)
        for i, row in enumerate(hat(w[3:])):
            matrix[i, :3] = mp.matrix([row])
            matrix[i, 3] = w[i]
        frame = series(matrix, lambda k: 1)
        tangent = tangent_reference(w)
        ahead = tangent_reference([x + h for x, h in zip(w, step, strict=True)])
        behind = tangent_reference([x - h for x, h in zip(w, step, strict=True)])
        slope = (ahead - behind) * mp.mpf(10) ** 20 / 2
        inverse = tangent**-1
        return {
            "frame": [frame[i, 3] for i in range(3)] + list(frame[:3, :3]),
            "tangent": tangent,
            "inverse": inverse,
            "slope": slope,
            "inverse_slope": -inverse * slope * inverse,
        }


@pytest.mark.parametrize("angle", SMALL + MIDDLE + NEAR_PI)
def test_exponential(angle: float) -> None:
    # 4 eps: catches a linear series of sin(t)/t (t^2/6) from t = 1e-7 on, and V taken for R (t/2)
    frame = se3.exp(twist(angle))
    assert error(frame, reference(angle)["frame"]) <= 4 * EPS
    assert np.array_equal(se3.rotation(frame), so3.exp(angle * AXIS))


@pytest.mark.parametrize("angle", SMALL)
def test_small_rotations_keep_relative_accuracy(angle: float) -> None:
    # 4 eps of the angle: catches a logarithm by the arccosine of the trace (eps / t, nan at zero)
    theta = angle * AXIS
    assert np.abs(so3.log(so3.exp(theta)) - theta).max() <= 4 * EPS * angle


@pytest.mark.parametrize("angle", [*SMALL, *MIDDLE[:4], *NEAR_PI[:-1]])
@pytest.mark.parametrize("axis", [AXIS, -AXIS, *np.eye(3), AXIS[[1, 0, 2]], AXIS[[2, 1, 0]]])
def test_logarithm_returns_the_twist(angle: float, axis: FloatArray) -> None:
    # 8 eps: catches t / sin(t) near pi, whose error at pi - 1e-8 is eps * 1e8
    w = np.concatenate([SHIFT, angle * axis])
    assert np.abs(se3.log(se3.exp(w)) - w).max() <= 8 * EPS
    assert np.abs(so3.log(so3.exp(w[3:])) - w[3:]).max() <= 8 * EPS


@pytest.mark.parametrize("axis", [AXIS, *np.eye(3), -np.eye(3)[1]])
def test_logarithm_at_pi(axis: FloatArray) -> None:
    # 8 eps: catches an axis from the vanishing skew part of the matrix
    theta = so3.log(2.0 * np.outer(axis, axis) - np.eye(3))
    assert min(np.abs(theta - s * np.pi * axis).max() for s in (-1, 1)) <= 8 * EPS


@pytest.mark.parametrize("angle", SMALL + MIDDLE + NEAR_PI)
def test_tangent_maps(angle: float) -> None:
    # 8 eps: catches (t - sin(t)) / t^3 as written (eps / t^2 t^2 ... 0.4 at 1e-8 in the coupling)
    w, exact = twist(angle), reference(angle)
    assert error(se3.tangent(w), exact["tangent"]) <= 8 * EPS
    assert error(so3.tangent(w[3:]), exact["tangent"][3:, 3:]) <= 8 * EPS


@pytest.mark.parametrize("angle", SMALL + MIDDLE + NEAR_PI)
def test_inverse_tangent_maps(angle: float) -> None:
    # at 5 rad the pole at 2 pi is near and the map is 8 times larger; else as above
    w, exact = twist(angle), reference(angle)
    bound = 8 * EPS * max(1.0, float(mp.mnorm(exact["inverse"], mp.inf)))
    assert error(se3.inverse_tangent(w), exact["inverse"]) <= bound
    assert error(so3.inverse_tangent(w[3:]), exact["inverse"][3:, 3:]) <= bound


@pytest.mark.parametrize("angle", SMALL + MIDDLE + NEAR_PI)
def test_derivatives_of_tangent_maps(angle: float) -> None:
    # 16 eps: catches closed forms without a series (3.8e-5 at t = 1e-6 in a published code) and a
    # coefficient kept constant in its derivative
    w, exact, d = twist(angle), reference(angle), DIRECTION
    assert error(se3.tangent_derivative(w, d), exact["slope"]) <= 16 * EPS
    assert error(so3.tangent_derivative(w[3:], d[3:]), exact["slope"][3:, 3:]) <= 16 * EPS
    slope = exact["inverse_slope"]
    bound = 16 * EPS * max(1.0, float(mp.mnorm(slope, mp.inf)))
    assert error(se3.inverse_tangent_derivative(w, d), slope) <= bound
    assert error(so3.inverse_tangent_derivative(w[3:], d[3:]), slope[3:, 3:]) <= bound


def exact_coefficients(t: Any) -> dict[str, Any]:
    """Closed forms and difference quotients, in enough digits to lose a hundred."""
    forms = {
        "b": lambda s: (1 - mp.cos(s)) / s**2,
        "c": lambda s: (s - mp.sin(s)) / s**3,
        "e": lambda s: 1 / s**2 - (1 + mp.cos(s)) / (2 * s * mp.sin(s)),
    }
    values = {"a": mp.sin(t) / t}
    for name, form in forms.items():
        first, second = mp.diff(form, t), mp.diff(form, t, 2)
        values[name] = form(t)
        values[name + "1"] = first / t
        values[name + "2"] = (second - first / t) / t**2
    return values


@pytest.mark.parametrize("t", [*SMALL[1:], *MIDDLE, 3.1])
def test_coefficients(t: float) -> None:
    # relative to each coefficient where it is a series (16 eps: the third power of a pole near pi),
    # relative to the map it stands in above: catches a single missing or mistyped term
    with mp.workdps(250):
        x = t * t
        exact = exact_coefficients(mp.sqrt(mp.mpf(x)))
        a, b, c = called(_coefficients.pose_coefficients)(x)
        (_, b1, b2), (_, c1, c2) = called(_coefficients.tangent_derivatives)(x)
        e, e1, e2 = called(_coefficients.inverse_derivatives)(x)
        found = {"a": a, "b": b, "c": c, "b1": b1, "c1": c1, "b2": b2, "c2": c2}
        inverse = {"e": e, "e1": e1, "e2": e2}
        for name, value in (found | inverse).items():
            by_series = x < (10.0 if name in inverse else 4.0)
            scale = abs(exact[name]) if by_series else t ** -(2 * int((name + "0")[1]))
            assert abs(value - exact[name]) <= 16 * EPS * scale, name


def frames(rng: np.random.Generator, *shape: int) -> FloatArray:
    """Random frames, a third of them next to the identity."""
    w = rng.normal(size=(*shape, 6))
    w[..., 3:] *= np.where(rng.random(shape) < 0.33, 1e-7, 1.0)[..., None]
    return se3.exp(w)


def test_group_axioms(rng: np.random.Generator) -> None:
    # 32 eps of numbers of size 5: catches a wrong order or sign in a product or an inverse
    A, B, C = (frames(rng, 50) for _ in range(3))
    one = se3.frame(np.zeros(3), np.eye(3))
    left, right = se3.compose(se3.compose(A, B), C), se3.compose(A, se3.compose(B, C))
    assert np.abs(left - right).max() <= 32 * EPS
    assert np.abs(se3.compose(A, se3.inverse(A)) - one).max() <= 32 * EPS
    assert np.abs(se3.compose(se3.inverse(A), A) - one).max() <= 32 * EPS
    assert np.array_equal(se3.compose(A, one), A)
    assert np.array_equal(se3.compose(one, A), A)
    homogeneous = se3.position(A) + np.squeeze(se3.rotation(A) @ se3.position(B)[..., None])
    assert np.abs(se3.position(se3.compose(A, B)) - homogeneous).max() <= 32 * EPS


def test_exponential_of_logarithm(rng: np.random.Generator) -> None:
    # 16 eps of numbers of size 5
    H = frames(rng, 50)
    assert np.abs(se3.exp(se3.log(H)) - H).max() <= 16 * EPS * np.abs(H).max()


def test_adjoint(rng: np.random.Generator) -> None:
    # H exp(w) = exp(Ad w) H; 64 eps of numbers of size 5: catches Ad in rotation-first order
    H, w = frames(rng, 50), 0.5 * rng.normal(size=(50, 6))
    carried = np.squeeze(se3.adjoint(H) @ w[..., None])
    assert np.abs(se3.retract(H, w) - se3.compose(se3.exp(carried), H)).max() <= 64 * EPS
    product = se3.adjoint(H[:25]) @ se3.adjoint(H[25:])
    assert np.abs(se3.adjoint(se3.compose(H[:25], H[25:])) - product).max() <= 64 * EPS


def test_coadjoint_product(rng: np.random.Generator) -> None:
    # against -ad_v^T as a matrix, and no power: catches a sign of V x l
    v, p, out = rng.normal(size=6), rng.normal(size=6), np.empty(6)
    V, Omega = so3.skew(v[:3]), so3.skew(v[3:])
    called(se3.coadjoint_product)(v, p, out)
    ad = np.block([[Omega, V], [np.zeros((3, 3)), Omega]])
    assert np.abs(out - ad.T @ p).max() <= 8 * EPS
    expected = np.r_[-np.cross(v[3:], p[:3]), -np.cross(v[3:], p[3:]) - np.cross(v[:3], p[:3])]
    assert np.abs(out - expected).max() <= 8 * EPS
    assert abs(out @ v) <= 16 * EPS


@pytest.mark.parametrize("angle", [0.0, 1e-6, 0.7, 2.5])
def test_matrix_free_products(angle: float, rng: np.random.Generator) -> None:
    # 16 eps: two ways of writing the same sums
    w, v = twist(angle), rng.normal(size=6)
    for apply, matrix in (
        (called(se3.tangent_apply), se3.tangent),
        (called(se3.inverse_tangent_apply), se3.inverse_tangent),
    ):
        out = v.copy()
        apply(w, out, out)
        assert np.abs(out - matrix(w) @ v).max() <= 16 * EPS


def test_outputs_may_be_inputs(rng: np.random.Generator) -> None:
    A, B, w = frames(rng, 2)[0], frames(rng), rng.normal(size=6)
    product, moved, inverse = se3.compose(A, B), se3.retract(A, w), se3.inverse(A)
    first, second, third, fourth = A.copy(), B.copy(), A.copy(), A.copy()
    called(se3.compose_into)(first, B, first)
    called(se3.compose_into)(A, second, second)
    called(se3.retract_into)(third, w, third)
    called(se3.inverse_into)(fourth, fourth)
    assert np.array_equal(first, product)
    assert np.array_equal(second, product)
    assert np.abs(third - moved).max() <= 4 * EPS * np.abs(moved).max()
    assert np.array_equal(fourth, inverse)
    rows = np.stack([A, B])
    se3.retract_rows(rows, np.stack([w, w]), rows)
    assert np.array_equal(rows[0], third)


UNARY = [
    (so3.skew, (3,)),
    (so3.exp, (3,)),
    (so3.log, (3, 3)),
    (so3.tangent, (3,)),
    (so3.inverse_tangent, (3,)),
    (se3.position, (12,)),
    (se3.rotation, (12,)),
    (se3.exp, (6,)),
    (se3.log, (12,)),
    (se3.inverse, (12,)),
    (se3.adjoint, (12,)),
    (se3.tangent, (6,)),
    (se3.inverse_tangent, (6,)),
]
BINARY = [
    (so3.tangent_derivative, (3,), (3,)),
    (so3.inverse_tangent_derivative, (3,), (3,)),
    (se3.frame, (3,), (3, 3)),
    (se3.compose, (12,), (12,)),
    (se3.retract, (12,), (6,)),
    (se3.tangent_derivative, (6,), (6,)),
    (se3.inverse_tangent_derivative, (6,), (6,)),
]


def label(function: Any) -> str | None:
    return f"{function.__module__[-3:]}.{function.__name__}" if callable(function) else None


def sample(rng: np.random.Generator, leading: tuple[int, ...], core: tuple[int, ...]) -> FloatArray:
    """Valid input of either kind: rotation vectors, twists, frames or rotation matrices."""
    if core == (12,):
        return frames(rng, *leading)
    return so3.exp(rng.normal(size=(*leading, 3))) if core == (3, 3) else rng.random(leading + core)


@pytest.mark.parametrize("leading", [(), (1,), (4,), (2, 3), (0,), (2, 0, 3)])
@pytest.mark.parametrize(("function", "core"), UNARY, ids=label)
def test_batches(
    function: Any, core: tuple[int, ...], leading: tuple[int, ...], rng: np.random.Generator
) -> None:
    values = sample(rng, leading, core)
    result = function(values)
    single = function(sample(rng, (), core))
    assert result.shape == leading + single.shape
    for place in np.ndindex(*leading):
        assert np.array_equal(result[place], function(values[place]))
    transposed = np.asfortranarray(values)
    assert np.array_equal(function(transposed), result)


@pytest.mark.parametrize(("function", "first", "second"), BINARY, ids=label)
def test_broadcasting(
    function: Any, first: tuple[int, ...], second: tuple[int, ...], rng: np.random.Generator
) -> None:
    a, b = sample(rng, (2, 1), first), sample(rng, (3,), second)
    result = function(a, b)
    for i, j in np.ndindex(2, 3):
        assert np.array_equal(result[i, j], function(a[i, 0], b[j]))
    empty = function(sample(rng, (0,), first), sample(rng, (), second))
    assert empty.shape == (0, *result.shape[2:])


@pytest.mark.parametrize(("function", "core"), UNARY, ids=label)
def test_wrong_last_axes(function: Any, core: tuple[int, ...]) -> None:
    for shape in ((), (5,), (*core[:-1], core[-1] + 1), (core[0], 7)):
        with pytest.raises(ValueError, match=rf"{label(function)}: \w+ must have the shape"):
            function(np.zeros(shape))


@pytest.mark.parametrize(("function", "first", "second"), BINARY, ids=label)
def test_wrong_pairs(function: Any, first: tuple[int, ...], second: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="must have the shape"):
        function(np.zeros(first), np.zeros(second[-1] + 1))
    with pytest.raises(ValueError, match="different leading axes"):
        function(np.zeros((2, *first)), np.zeros((3, *second)))
