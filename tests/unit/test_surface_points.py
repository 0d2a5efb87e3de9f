# SPDX-License-Identifier: LGPL-3.0-or-later
"""Frames at points of triangles and edges against differences and rigid motions."""

import numpy as np
import pytest
from scipy.linalg import lstsq

from flexfem.core.places import line_points
from flexfem.core.places.line_points import FIXED, SIDES
from flexfem.layout.surface_places import TRIANGLE_SIDES, fitted_sides
from flexfem.lie import se3, so3
from tests.called import called

pytestmark = pytest.mark.serial

NODES = np.array(
    [[0.1, 0.2, -0.3], [1.4, 0.5, 0.1], [0.3, 1.2, 0.6], [-0.6, 0.4, 0.2], [0.5, -0.9, 0.7]]
)
#: kind and weights of the nodes
POINTS = {
    "corner": (SIDES, (1.0, 0.0, 0.0)),
    "inside": (SIDES, (0.2, 0.5, 0.3)),
    "patch": (SIDES, (0.1, 0.3, 0.15, 0.25, 0.2)),
    "edge": (FIXED, (0.3, 0.7)),
    "interior": (FIXED, (0.2, 0.5, 0.3)),
}
EVERY = pytest.mark.parametrize("name", POINTS)


class Point:
    """A point on nodes with axes of their own."""

    def __init__(self, name, rng):
        self.kind, weights = POINTS[name]
        k = len(weights)
        self.shape = np.zeros((k, k))
        self.shape[:, 0] = weights
        if self.kind == SIDES:
            sides = TRIANGLE_SIDES if k == 3 else fitted_sides(NODES, np.array(weights))
            self.shape[:, 1:3] = sides
        self.nodes = se3.frame(NODES[:k], so3.exp(rng.normal(size=(k, 3))))

    def frame(self, nodes):
        H = np.empty(12)
        line_points.line_pose(self.kind, nodes, self.shape, 0.0, H)
        return H

    def at(self, nodes):
        H, J = np.empty(12), np.empty((6, 6 * len(nodes) + 1))
        line_points.find_jacobian(self.kind, nodes, self.shape, 0.0, H, J)
        return H, J

    def difference(self, function, eps=1e-3):
        """Derivative of a function along all twists of the nodes, central, of order six."""
        columns = []
        for row in np.eye(self.nodes.size // 2):
            total = 0.0
            for step, weight in ((1, 3 / 4), (2, -3 / 20), (3, 1 / 60)):
                for sign in (1.0, -1.0):
                    moved = se3.retract(self.nodes, (sign * step * eps * row).reshape(-1, 6))
                    total = total + sign * weight / eps * function(moved)
            columns.append(total)
        return np.array(columns).T


@EVERY
def test_axes(name, rng):
    point = Point(name, rng)
    H, x = point.frame(point.nodes), point.nodes[:, :3]
    np.testing.assert_allclose(H[:3], point.shape[:, 0] @ x, atol=1e-15)
    if point.kind == FIXED:
        np.testing.assert_array_equal(H[3:], np.eye(3).ravel())
        return
    a, b = (x[1] - x[0], x[2] - x[0]) if len(x) == 3 else extents(x, point.shape[:, 0])
    # rounding; another side or normal is off by the triangle's angles
    np.testing.assert_allclose(se3.rotation(H), aligned(a, b), atol=1e-14)


def extents(x, weights):
    """Unit vectors along the two largest extents of nodes, largest component positive."""
    offsets = np.sqrt(weights)[:, np.newaxis] * (x - weights @ x)
    found = np.linalg.svd(offsets)[2][:2]
    return [t * np.sign(t[np.argmax(abs(t))]) for t in found]


def aligned(a, b):
    """Axes of two sides."""
    e1, e3 = a / np.linalg.norm(a), np.cross(a, b)
    e3 /= np.linalg.norm(e3)
    return np.stack([e1, np.cross(e3, e1), e3], axis=1)


def test_a_patch_has_the_axes_of_a_fit(rng):
    """Of nodes that move apart, against SciPy's least squares; equal extents; a line."""
    point = Point("patch", rng)
    weights = point.shape[:, 0]
    point.nodes[:, :3] += 0.3 * rng.normal(size=(5, 3))
    root, x = np.sqrt(weights)[:, np.newaxis], point.nodes[:, :3]
    A = lstsq(root * (NODES - weights @ NODES), root * (x - weights @ x))[0].T
    # rounding; a fit without weights turns them by 0.1
    expected = aligned(*(A @ t for t in extents(NODES, weights)))
    np.testing.assert_allclose(se3.rotation(point.frame(point.nodes)), expected, atol=1e-13)
    grid = np.stack(np.meshgrid([0.0, 1.0, 2.0], [0.0, 1.0, 2.0], [5.0]), axis=-1).reshape(-1, 3)
    equal = np.full(9, 1.0 / 9.0)
    # of equal extents the directions are arbitrary but for the rule: inertial axes, x first
    np.testing.assert_allclose(fitted_sides(grid, equal).T @ grid, np.eye(3)[:2], atol=1e-14)
    with pytest.raises(ValueError, match="on one line"):
        fitted_sides(grid[:3] + 1e6, np.full(3, 1.0 / 3.0))


@EVERY
def test_twist(name, rng):
    point = Point(name, rng)
    H, J = point.at(point.nodes)
    np.testing.assert_array_equal(H, point.frame(point.nodes))

    def local(nodes):
        return se3.log(se3.compose(se3.inverse(H), point.frame(nodes)))

    # differences are good to 1e-12; a turn of its axes left out is of order 1
    np.testing.assert_allclose(J[:, :-1], point.difference(local), atol=1e-10)
    np.testing.assert_array_equal(J[:, -1], 0.0)
    # rotations of a node move nothing
    np.testing.assert_array_equal(J[:, :-1].reshape(6, -1, 2, 3)[:, :, 1], 0.0)


@EVERY
def test_second_derivative(name, rng):
    point, g = Point(name, rng), rng.normal(size=6)
    expected = point.difference(lambda nodes: point.at(nodes)[1].T @ g)
    out = np.full((len(expected), len(expected)), 3.0)
    called(line_points.add_line_second)(point.kind, point.nodes, point.shape, 0.0, g, out)
    # differences are good to 1e-11; symmetrised, or with constant sides, it is off by 0.1
    np.testing.assert_allclose(out[:, :-1] - 3.0, expected, atol=1e-9)
    np.testing.assert_array_equal(out[:, -1], 3.0)


@EVERY
def test_motion_of_the_whole_space(name, rng):
    point = Point(name, rng)
    H, J = point.at(point.nodes)
    G = se3.frame(np.array([3.0, -2.0, 5.0]), so3.exp(np.array([2.0, 1.0, -1.5])))
    moved, J_moved = point.at(se3.compose(G, point.nodes))
    if point.kind == FIXED:  # its axes stay
        np.testing.assert_allclose(moved[:3], se3.compose(G, H)[:3], atol=1e-14)
        return
    np.testing.assert_allclose(moved, se3.compose(G, H), atol=1e-14)
    np.testing.assert_allclose(J_moved, J, atol=1e-13)
    # local twists of one motion: the place moves rigidly with its nodes
    motion = np.array([0.5, 1.0, -0.7, 0.3, -0.4, 0.9])
    twists = [se3.adjoint(se3.inverse(node)) @ motion for node in point.nodes]
    np.testing.assert_allclose(
        J[:, :-1] @ np.concatenate(twists), se3.adjoint(se3.inverse(H)) @ motion, atol=1e-13
    )
