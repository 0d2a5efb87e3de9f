# SPDX-License-Identifier: LGPL-3.0-or-later
"""UFL expressions of the Lie maps and their ``ufl.diff`` against the NumPy maps.

The references of the derivatives are exact maps as well (``test_lie.py`` checks those against
60-digit arithmetic), so that the comparison needs no difference quotient and holds at zero.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

dolfinx = pytest.importorskip("dolfinx")

from mpi4py import MPI  # noqa: E402

import ufl  # noqa: E402

from flexfem._types import FloatArray  # noqa: E402
from flexfem.forms import lie as forms  # noqa: E402
from flexfem.lie import se3, so3  # noqa: E402
from tests.unit.references import QUICKLY  # noqa: E402

pytestmark = pytest.mark.serial

EPS = np.finfo(np.float64).eps
SMALL = [0.0, *(10.0**-k for k in (12, 10, 8, 7, 6, 5, 4, 3, 2, 1))]
ANGLES = [*SMALL, 0.5, 1.0 - 1e-9, 1.0 + 1e-9, 2.0, 3.0, np.pi - 0.1]
AXIS = np.array([0.48, -0.6, 0.64])
SHIFT = np.array([0.7, 0.4, -1.1])
V_1 = np.array([-0.3, 0.9, 0.5, 0.8, 0.1, -0.6])
V_2 = np.array([0.2, -0.7, 0.6, 0.3, -1.2, 0.4])
UNITS = np.eye(6)


def twist(angle: float) -> FloatArray:
    return np.concatenate([SHIFT, angle * AXIS])


@dataclass(frozen=True)
class Maps:
    """Values of all expressions, and derivatives along each component of their argument."""

    values: Callable[[FloatArray], dict[str, FloatArray]]
    slopes: Callable[[FloatArray], dict[str, FloatArray]]


def evaluator(
    mesh: Any, parts: dict[str, Any], twist_: Any, frame: Any
) -> Callable[[FloatArray], dict[str, FloatArray]]:
    """One compiled expression for all parts, which are split again by name."""
    flat = {k: [e[i] for i in np.ndindex(*e.ufl_shape)] for k, e in parts.items()}
    everything = ufl.as_vector([entry for entries in flat.values() for entry in entries])
    expression = dolfinx.fem.Expression(everything, np.array([[0.5]]), jit_options=QUICKLY)

    def evaluate(w: FloatArray) -> dict[str, FloatArray]:
        twist_.value[:] = w
        frame.value[:] = se3.exp(w)
        numbers = expression.eval(mesh, np.zeros(1, dtype=np.int32)).ravel()
        pieces = np.split(numbers, np.cumsum([len(entries) for entries in flat.values()])[:-1])
        shapes = (e.ufl_shape for e in parts.values())
        return {k: p.reshape(s) for k, p, s in zip(parts, pieces, shapes, strict=True)}

    return evaluate


@pytest.fixture(scope="module")
def maps() -> Maps:
    mesh = dolfinx.mesh.create_unit_interval(MPI.COMM_SELF, 1)
    constants = [dolfinx.fem.Constant(mesh, np.zeros(n)) for n in (6, 12, 6, 6)]
    twist_, frame, v_1, v_2 = constants
    v_1.value[:], v_2.value[:] = V_1, V_2
    w, H = ufl.variable(twist_), ufl.variable(frame)
    theta = ufl.as_vector([w[i] for i in range(3, 6)])
    x = ufl.as_vector([H[i] for i in range(3)])
    R = ufl.as_matrix([[H[3 + 3 * i + j] for j in range(3)] for i in range(3)])
    of_twist = {
        "so3_exp": forms.so3_exp(theta),
        "so3_tangent": forms.so3_tangent(theta),
        "so3_inverse_tangent": forms.so3_inverse_tangent(theta),
        "apply": forms.se3_inverse_tangent_apply(w, v_1),
        "rate": forms.se3_relative_rate(w, v_1, v_2),
    }
    others = {
        "skew": forms.skew(theta),
        "right": forms.se3_inverse_tangent_right(w),
        "left": forms.se3_inverse_tangent_left(w),
        "so3_log": forms.so3_log(R),
        "se3_log": forms.se3_log(x, R),
    }
    slopes = {k: ufl.diff(e, w) for k, e in of_twist.items()}
    slopes["se3_log"] = ufl.diff(others["se3_log"], H)
    return Maps(
        evaluator(mesh, of_twist | others, twist_, frame), evaluator(mesh, slopes, twist_, frame)
    )


@pytest.mark.parametrize("angle", ANGLES)
def test_values(maps: Maps, angle: float) -> None:
    # 16 eps of numbers of size 3: catches a branch or a fit that ends too early, and a wrong sign
    w = twist(angle)
    values = maps.values(w)
    right, left = se3.inverse_tangent(w), se3.inverse_tangent(-w)
    expected = {
        "so3_exp": so3.exp(w[3:]),
        "so3_tangent": so3.tangent(w[3:]),
        "so3_inverse_tangent": so3.inverse_tangent(w[3:]),
        "apply": right @ V_1,
        "rate": right @ V_2 - left @ V_1,
        "skew": so3.skew(w[3:]),
        "right": right,
        "left": left,
    }
    for name, exact in expected.items():
        assert np.abs(values[name] - exact).max() <= 16 * EPS, name


@pytest.mark.parametrize("angle", ANGLES)
def test_logarithm(maps: Maps, angle: float) -> None:
    # rounding of the trace is divided by (pi - t)^2; catches an arctangent fit that ends too early
    w = twist(angle)
    values = maps.values(w)
    bound = 8 * EPS * max(1.0, 1.0 / (np.pi - angle) ** 2)
    assert np.abs(values["se3_log"] - w).max() <= bound
    assert np.abs(values["so3_log"] - w[3:]).max() <= bound * min(1.0, angle)


@pytest.mark.parametrize("angle", [3.5, 5.0, 6.4])
def test_large_angles(maps: Maps, angle: float) -> None:
    # 16 eps: exponential and tangent map hold beyond pi
    theta = angle * AXIS
    values = maps.values(twist(angle))
    assert np.abs(values["so3_exp"] - so3.exp(theta)).max() <= 16 * EPS
    assert np.abs(values["so3_tangent"] - so3.tangent(theta)).max() <= 16 * EPS


def rate_slope(w: FloatArray, unit: FloatArray) -> FloatArray:
    right: FloatArray = se3.inverse_tangent_derivative(w, unit) @ V_2
    left: FloatArray = se3.inverse_tangent_derivative(-w, -unit) @ V_1
    return right - left


@pytest.mark.parametrize("angle", ANGLES)
def test_derivatives(maps: Maps, angle: float) -> None:
    # 32 eps: catches a nan from the branch not taken, sqrt at zero, a coefficient kept constant
    w = twist(angle)
    slopes = maps.slopes(w)
    theta, d = w[3:], UNITS[:, 3:]
    R, T = so3.exp(theta), so3.tangent(theta)
    expected = {
        "so3_exp": R @ so3.skew(d @ T.T),
        "so3_tangent": so3.tangent_derivative(theta, d),
        "so3_inverse_tangent": so3.inverse_tangent_derivative(theta, d),
        "apply": se3.inverse_tangent_derivative(w, UNITS) @ V_1,
        "rate": np.array([rate_slope(w, unit) for unit in UNITS]),
    }
    for name, exact in expected.items():
        found = np.moveaxis(slopes[name], -1, 0)
        assert np.abs(found - exact).max() <= 32 * EPS, name


@pytest.mark.parametrize("angle", ANGLES)
def test_derivative_of_the_logarithm(maps: Maps, angle: float) -> None:
    # along a local twist it is the inverse tangent map; rounding grows like that of the trace
    w = twist(angle)
    H = se3.exp(w)
    R = se3.rotation(H)
    directions = se3.frame(UNITS[:, :3] @ R.T, R @ so3.skew(UNITS[:, 3:]))
    found = maps.slopes(w)["se3_log"] @ directions.T
    bound = 32 * EPS * max(1.0, 1.0 / (np.pi - angle) ** 3)
    assert np.abs(found - se3.inverse_tangent(w)).max() <= bound


@pytest.mark.parametrize("angle", [0.0, 1e-6, 0.3, 2.0])
def test_derivatives_by_difference_quotients(maps: Maps, angle: float) -> None:
    # 1e-8: independent of the NumPy maps; error of a central difference with a step of 1e-5
    w, step = twist(angle), 1e-5
    slopes = maps.slopes(w)
    for j, unit in enumerate(UNITS):
        ahead, behind = maps.values(w + step * unit), maps.values(w - step * unit)
        for name in ("so3_exp", "so3_tangent", "so3_inverse_tangent", "apply", "rate"):
            quotient = (ahead[name] - behind[name]) / (2 * step)
            assert np.abs(slopes[name][..., j] - quotient).max() <= 1e-8, name
