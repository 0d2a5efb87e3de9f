# SPDX-License-Identifier: LGPL-3.0-or-later
"""Frames at points of beam elements against 70-digit differences, the circle and rigid motions.

The 70-digit reference shares no formula with the package but the definition of the interpolation:
all its derivatives are difference quotients with a step of 1e-14.
"""

from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass
from math import comb
from typing import Any

import mpmath as mp
import numpy as np
import pytest

from flexfem._types import FloatArray
from flexfem.core.places import line_points
from flexfem.core.places.line_points import NURBS, NURBS_VECTORS, SE3
from flexfem.lie import se3, so3
from tests.called import called

pytestmark = pytest.mark.serial

STEP = mp.mpf(10) ** -14
#: degree of each element; 0 stands for the helix between two frames, negative numbers for NURBS
#: elements that interpolate relative rotation vectors
DEGREES = [0, 1, 2, 3, 4, -1, -3]
#: degree, xi and bend; without bend all rotation vectors vanish
PLACES = [
    *((degree, xi, 2.5) for degree in (0, 2) for xi in (-0.2, 0.37, 1.3)),
    (1, 0.37, 2.5),
    (3, 0.6, 2.5),
    (4, 1.2, 2.5),
    (0, 0.37, 0.0),
    (3, 1.1, 0.0),
    (-1, 0.37, 2.5),
    (-2, 0.37, 2.5),
    (-3, 0.6, 2.5),
    (-3, 1.1, 0.0),
]
#: uniform B-splines: rows are the functions, columns powers of xi
UNIFORM = {
    1: np.array([[1.0, -1.0], [0.0, 1.0]]),
    2: np.array([[1.0, -2.0, 1.0], [1.0, 2.0, -2.0], [0.0, 0.0, 1.0]]) / 2.0,
    3: np.array(
        [[1.0, -3.0, 3.0, -1.0], [4.0, 0.0, -6.0, 3.0], [1.0, 3.0, 3.0, -3.0], [0.0, 0.0, 0.0, 1.0]]
    )
    / 6.0,
}


@dataclass(frozen=True)
class Element:
    """Frames of the nodes (k, 12), rotations of the sections (k, 9), shape (k, k)."""

    kind: int
    nodes: FloatArray
    turns: FloatArray
    shape: FloatArray

    @property
    def columns(self) -> int:
        return 6 * len(self.nodes) + 1

    def at(self, xi: float) -> tuple[FloatArray, FloatArray]:
        """Frame and Jacobian with respect to the nodes."""
        frames, H, J = np.empty_like(self.nodes), np.empty(12), np.empty((6, self.columns))
        line_points.turn_frames(self.nodes, self.turns, frames)
        line_points.find_jacobian(self.kind, frames, self.shape, xi, H, J)
        line_points.turn_columns(self.turns, J)
        return H, J

    def second(self, xi: float, g: FloatArray) -> FloatArray:
        """Derivative of ``J^T g`` with respect to the nodes."""
        frames, out = np.empty_like(self.nodes), np.zeros((self.columns, self.columns))
        line_points.turn_frames(self.nodes, self.turns, frames)
        called(line_points.add_line_second)(self.kind, frames, self.shape, xi, g, out)
        line_points.turn_second(self.turns, out)
        return out

    def moved(self, G: FloatArray) -> "Element":
        """The element after a motion of the whole space."""
        return Element(self.kind, se3.compose(G, self.nodes), self.turns, self.shape)


def bernstein(degree: int) -> FloatArray:
    """Bernstein polynomials in powers of xi."""
    return np.array(
        [
            [
                comb(degree, i) * comb(degree - i, j - i) * (-1.0) ** (j - i) if j >= i else 0.0
                for j in range(degree + 1)
            ]
            for i in range(degree + 1)
        ]
    )


def element(degree: int, bend: float = 2.5) -> Element:
    """Random points; sections rotated against their nodes and by ``bend`` against the middle."""
    rng = np.random.default_rng(7 + abs(degree))
    k = max(abs(degree), 1) + 1
    axes = rng.normal(size=(k, 3))
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    angles = bend * (np.arange(k) - k // 2) / (k // 2)
    rotations = so3.exp(rng.normal(size=3)) @ so3.exp(angles[:, None] * axes)
    turns = so3.exp(rng.normal(size=(k, 3)))
    nodes = se3.frame(rng.normal(size=(k, 3)), rotations @ turns.swapaxes(1, 2))
    shape = rng.uniform(0.5, 2.0, size=k)[:, None] * bernstein(k - 1)
    kind = SE3 if degree == 0 else NURBS if degree > 0 else NURBS_VECTORS
    return Element(kind, nodes, turns.reshape(k, 9), shape)


def largest(values: FloatArray) -> float:
    return float(np.abs(values).max())


def exact(values: FloatArray) -> Any:
    """The numbers as they are, with many digits."""
    return np.array([mp.mpf(float(x)) for x in values.ravel()], dtype=object).reshape(values.shape)


def hat(t: Any) -> Any:
    return np.array([[0, -t[2], t[1]], [t[2], 0, -t[0]], [-t[1], t[0], 0]], dtype=object)


def turn(t: Any) -> tuple[Any, Any]:
    """Rotation matrix, and what takes the translation of a twist to that of its frame."""
    x, S, unit = mp.sqrt(t @ t), hat(t), exact(np.eye(3))
    if x == 0:
        return unit, unit
    b = (1 - mp.cos(x)) / x**2
    return unit + mp.sin(x) / x * S + b * S @ S, unit + b * S + (x - mp.sin(x)) / x**3 * S @ S


def angle(R: Any) -> Any:
    """Rotation vector of a matrix."""
    v = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]], dtype=object) / 2
    s = mp.sqrt(v @ v)
    return v if s == 0 else mp.atan2(s, (R[0, 0] + R[1, 1] + R[2, 2] - 1) / 2) / s * v


def length(t: Any) -> Any:
    return mp.sqrt(t @ t)


def unit(t: Any) -> Any:
    """The vector with the length 1, zero as it is."""
    return t if length(t) == 0 else t / length(t)


class Reference:
    """An element and a point of it, with many digits."""

    def __init__(self, e: Element, xi: float) -> None:
        self.kind, self.shape, self.xi = e.kind, exact(e.shape), mp.mpf(xi)
        self.nodes = [(node[:3], node[3:].reshape(3, 3)) for node in exact(e.nodes)]
        self.turns = exact(e.turns).reshape(-1, 3, 3)

    def moved(self, q: Any) -> "Reference":
        """After the local twists and the change of xi in ``q`` (6k + 1,)."""
        other = copy(self)
        other.xi = self.xi + q[-1]
        twists = q[:-1].reshape(-1, 6)
        other.nodes = [
            (x + R @ w[:3], R @ turn(w[3:])[0])
            for (x, R), w in zip(self.nodes, twists, strict=True)
        ]
        return other

    def frame(self) -> tuple[Any, Any]:
        """Position and rotation of the point."""
        x = [node[0] for node in self.nodes]
        R = [node[1] @ Q for node, Q in zip(self.nodes, self.turns, strict=True)]
        if self.kind == SE3:
            t = angle(R[0].T @ R[1])
            V = mp.matrix(turn(t)[1].tolist())
            u = np.array(
                list(mp.lu_solve(V, mp.matrix(list(R[0].T @ (x[1] - x[0]))))), dtype=object
            )
            rotation, V = turn(self.xi * t)
            return x[0] + R[0] @ V @ (self.xi * u), R[0] @ rotation
        N = self.shape @ np.array([self.xi**j for j in range(len(x))], dtype=object)
        N, r = N / sum(N), len(x) // 2
        if self.kind == NURBS_VECTORS:
            theta = sum(N[i] * angle(R[r].T @ R[i]) for i in range(len(x)))
            return sum(N[i] * x[i] for i in range(len(x))), R[r] @ turn(theta)[0]
        halves = [angle(R[r].T @ R[i]) / 2 for i in range(len(x))]
        scalar = sum(N[i] * mp.cos(length(t)) for i, t in enumerate(halves))
        vector = sum(N[i] * mp.sinc(length(t)) * t for i, t in enumerate(halves))
        theta = 2 * mp.atan2(length(vector), scalar) * unit(vector)
        return sum(N[i] * x[i] for i in range(len(x))), R[r] @ turn(theta)[0]

    def twist(self, a: Any) -> Any:
        """Local twist of the point along ``a`` (6k + 1,)."""
        R = self.frame()[1]
        (x_1, R_1), (x_2, R_2) = (self.moved(s * STEP * a).frame() for s in (1, -1))
        v, W = R.T @ (x_1 - x_2), R.T @ (R_1 - R_2)
        return np.array([*v, W[2, 1], W[0, 2], W[1, 0]], dtype=object) / (2 * STEP)


@pytest.fixture(autouse=True)
def digits() -> Iterator[None]:
    """70 digits in this file only."""
    with mp.workdps(70):
        yield


def directions(e: Element) -> Iterator[Any]:
    """Unit vectors of all columns."""
    for row in np.eye(e.columns):
        yield exact(row)


@pytest.mark.parametrize(("degree", "xi", "bend"), PLACES)
def test_frame_and_twist(degree: int, xi: float, bend: float) -> None:
    e = element(degree, bend)
    reference = Reference(e, xi)
    H, J = e.at(xi)
    x, R = reference.frame()
    columns = np.array([reference.twist(a) for a in directions(e)]).T
    # Rounding is below 2e-15 of the largest entry. Mixed rotations of points or a missing tangent
    # map are wrong in the first digits; a series cut off too early from the 9th digit on.
    assert largest(H - np.array([*x, *R.ravel()], dtype=float)) < 1e-13
    assert largest(J - columns.astype(float)) < 1e-12 * largest(J)
    pose = np.empty(12)
    frames = np.empty_like(e.nodes)
    line_points.turn_frames(e.nodes, e.turns, frames)
    line_points.line_pose(e.kind, frames, e.shape, xi, pose)
    # the same operations: another frame for the same point would leave rows inconsistent
    assert largest(pose - H) < 1e-15


@pytest.mark.parametrize(("degree", "xi", "bend"), PLACES)
def test_second_derivatives(degree: int, xi: float, bend: float) -> None:
    e = element(degree, bend)
    rng = np.random.default_rng(abs(degree))
    a, g = exact(rng.normal(size=e.columns)), rng.normal(size=6)
    second = e.second(xi, g)
    # a . (J^T g) = g . (J a); every wrong entry shows in random combinations of rows and columns
    columns, expected = rng.normal(size=(4, e.columns)), []
    for b in map(exact, columns):
        ends = [Reference(e, xi).moved(s * STEP * b).twist(a) @ exact(g) for s in (1, -1)]
        expected.append((ends[0] - ends[1]) / (2 * STEP))
    # Rounding is below 1e-14 of the largest entry. A symmetrised derivative, a force turned with
    # the wrong frame or a missing second derivative by xi is wrong in the first digits.
    error = largest(a.astype(float) @ second @ columns.T - np.array(expected, dtype=float))
    assert error < 1e-12 * largest(second)


@pytest.mark.parametrize("degree", DEGREES)
def test_second_derivatives_are_added(degree: int) -> None:
    e, g = element(degree), np.arange(1.0, 7.0)
    out = np.full((e.columns, e.columns), 3.0)
    called(line_points.add_line_second)(e.kind, e.nodes, e.shape, 0.4, g, out)
    alone = np.zeros_like(out)
    called(line_points.add_line_second)(e.kind, e.nodes, e.shape, 0.4, g, alone)
    # rounding of the sum; a kernel that overwrites is off by 3
    assert largest(out - alone - 3.0) < 1e-12


@pytest.mark.parametrize("degree", DEGREES)
def test_motions_of_the_whole_space(degree: int) -> None:
    """The frame moves along, its derivatives in local axes stay."""
    e, xi, g = element(degree), 0.6, np.array([0.3, -1.0, 0.4, 0.8, 0.2, -0.5])
    G = se3.frame(np.array([3.0, -2.0, 5.0]), so3.exp(np.array([2.0, 1.0, -1.5])))
    (H, J), (H_moved, J_moved) = e.at(xi), e.moved(G).at(xi)
    # rounding at coordinates of 5 m; inertial axes in place of local ones are off by the rotation
    assert largest(H_moved - se3.compose(G, H)) < 1e-12
    assert largest(J_moved - J) < 1e-12 * largest(J)
    second = e.second(xi, g)
    assert largest(e.moved(G).second(xi, g) - second) < 1e-12 * largest(second)
    # local twists of one motion of the space
    motion = np.array([0.5, 1.0, -0.7, 0.3, -0.4, 0.9])
    twists = [se3.adjoint(se3.inverse(node)) @ motion for node in e.nodes]
    at_point = se3.adjoint(se3.inverse(H)) @ motion
    # rounding; columns that are not consistent with a rigid motion would strain a moving beam
    assert largest(J[:, :-1] @ np.concatenate(twists) - at_point) < 1e-12 * largest(J)


@pytest.mark.parametrize("degree", DEGREES)
def test_ends(degree: int) -> None:
    """At its ends an element has the frames and the twists of its end nodes."""
    e = element(degree)
    for xi, node in ((0.0, 0), (1.0, len(e.nodes) - 1)):
        H, J = e.at(xi)
        turned = se3.compose(e.nodes[node], se3.frame(np.zeros(3), e.turns[node].reshape(3, 3)))
        at_end = np.zeros((6, e.columns - 1))
        at_end[:, 6 * node : 6 * node + 6] = se3.adjoint(
            se3.inverse(se3.frame(np.zeros(3), e.turns[node].reshape(3, 3)))
        )
        # rounding; a joint at a control point and one at the same place of the line would differ
        assert largest(H - turned) < 1e-12
        assert largest(J[:, :-1] - at_end) < 1e-12


def test_circle() -> None:
    """A quarter circle of degree 2 with weights stays on the circle outside [0, 1] as well."""
    frames = se3.frame(
        np.array([[1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]), np.eye(3)[None]
    )
    shape = np.array([1.0, np.sqrt(0.5), 1.0])[:, None] * bernstein(2)
    H, N = np.empty(12), np.empty((4, 3))
    for xi in (-0.5, 0.0, 0.3, 1.0, 1.7):
        line_points.line_pose(NURBS, frames, shape, xi, H)
        # polynomials instead of rational functions miss the circle by 0.06
        assert np.hypot(H[0], H[1]) == pytest.approx(1.0, abs=1e-13)
        called(line_points.shape_functions)(shape, xi, N)
        # derivatives of |x|^2 = 1
        x, v, a, b = N @ frames[:, :3]
        size = 1.0 + largest(N)
        # rounding; a wrong quotient rule is wrong in the first digits
        assert x @ v == pytest.approx(0.0, abs=1e-12 * size)
        assert x @ a + v @ v == pytest.approx(0.0, abs=1e-12 * size**2)
        assert x @ b + 3.0 * v @ a == pytest.approx(0.0, abs=1e-12 * size**2)
        assert largest(N.sum(axis=1) - [1.0, 0.0, 0.0, 0.0]) < 1e-12 * size


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_neighbouring_elements(degree: int) -> None:
    """Frames and their first degree - 1 derivatives continue from element to element."""
    rng = np.random.default_rng(degree)
    points, weights = rng.normal(size=(degree + 2, 3)), rng.uniform(0.5, 2.0, degree + 2)
    frames = se3.frame(points, so3.exp(0.3 * rng.normal(size=(degree + 2, 3))))
    sides = []
    for first, xi in ((0, 1.0), (1, 0.0)):
        some = slice(first, first + degree + 1)
        shape = weights[some, None] * UNIFORM[degree]
        e = Element(NURBS, frames[some], np.tile(np.eye(3).ravel(), (degree + 1, 1)), shape)
        H, J = e.at(xi)
        R, k = H[3:].reshape(3, 3), e.columns - 1
        # the change of J^T g along xi is g . (R^T x'' - omega x R^T x')
        rates = np.array([e.second(xi, g)[k, k] for g in np.eye(6)])
        second = R @ (rates[:3] + np.cross(J[3:, k], J[:3, k]))
        sides.append([[H[:3], R @ J[:3, k], second], [H[3:], J[3:, k], rates[3:]]])
    # rounding; weights that do not belong to the curve's points break the curve, and rotation
    # vectors from another node in each element would jump by 1e-3
    for one, other in zip(*sides, strict=True):
        for m in range(degree):
            assert largest(one[m] - other[m]) < (1e-14 if m == 0 else 1e-12)
        if degree < 3:  # what the test measures does differ where it may
            assert largest(one[degree] - other[degree]) > 0.1


def test_arc_length() -> None:
    # 1 + 2 xi - 3 xi^2 + 4 xi^3 at 2; exact in binary
    assert line_points.arc_length(np.array([1.0, 2.0, -3.0, 4.0]), 2.0) == (25.0, 38.0, 42.0)


def test_offset() -> None:
    rng = np.random.default_rng(3)
    offset = se3.frame(rng.normal(size=3), so3.exp(rng.normal(size=3)))
    J = rng.normal(size=(6, 13))
    expected = se3.adjoint(se3.inverse(offset)) @ J
    line_points.offset_jacobian(offset, J)
    # rounding; a lever arm on the wrong side is wrong in the first digits
    assert largest(J - expected) < 1e-13
