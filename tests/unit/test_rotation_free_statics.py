# SPDX-License-Identifier: LGPL-3.0-or-later
"""Shells with large rotations: Sze, Liu, Lo, Finite Elem. Anal. Des. 40 (2004) 1551-1569."""

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

from flexfem.families.shell_rotation_free.triangles import RotationFreeTriangles
from flexfem.mesh.shells.patches import EdgeRule, curvature_patches
from tests.unit.triangles import adjacency, isotropic, rectangle, sparse_tangent

pytestmark = pytest.mark.serial
MESHES = pytest.mark.parametrize(
    ("pattern", "averaged"), [("parallel", False), ("perturbed", True), ("union_jack", True)]
)


def equilibrium(made, start, load, free, steps):
    """Positions under the whole load, by Newton's method in equal steps."""
    points = start.copy()
    for step in range(1, steps + 1):
        for _ in range(25):
            residual = -step / steps * load
            made.add_forces(points, residual)
            K = sparse_tangent(made, points)[free][:, free]
            change = spsolve(K.tocsc(), -residual.ravel()[free])
            points.ravel()[free] += change
            if abs(change).max() < 1e-7:
                break
        else:
            pytest.fail(f"no equilibrium in step {step}")
    return points


def middles_of(points, triangles):
    return (points[np.roll(triangles, -1, 1)] + points[np.roll(triangles, -2, 1)]) / 2


def edge_loads(points, nodes, along, total):
    """Forces of a uniform load along z on a row of nodes."""
    row = nodes[np.argsort(points[nodes, along])]
    lengths = np.diff(points[row, along])
    load = np.zeros_like(points)
    load[row[:-1], 2] += lengths / 2
    load[row[1:], 2] += lengths / 2
    return load * total / lengths.sum()


@MESHES
def test_cantilever_under_end_shear(pattern, averaged):
    points, triangles = rectangle((32, 4), pattern, (10.0, 1.0))
    stiffness = isotropic(0.1, 1.2e6, 0.0)
    clamped = middles_of(points, triangles)[:, :, 0] < 1e-9
    opposites, neighbours = adjacency(triangles)
    patches = curvature_patches(
        points, triangles, opposites, stiffness[3:, 3:],
        neighbours=neighbours if averaged else None,
        rules=np.where(clamped, EdgeRule.CLAMPED, EdgeRule.FREE),
    )  # fmt: skip
    made = RotationFreeTriangles.build(patches, points, stiffness)
    tip = np.flatnonzero(points[:, 0] > 10 - 1e-9)
    free = np.flatnonzero(np.repeat(points[:, 0] > 1e-9, 3))
    moved = equilibrium(made, points, edge_loads(points, tip, 1, 4.0), free, 4)
    change = (moved - points)[tip].mean(0)
    # measured 0.33 % and 0.16 %; a clamp of first order is off by 3 %
    np.testing.assert_allclose(change[[0, 2]], [-3.286, 6.698], rtol=0.005)


@pytest.mark.parametrize(("pattern", "averaged"), [("parallel", False), ("perturbed", True)])
def test_hemisphere_with_a_hole(pattern, averaged):
    """A quarter of it, between planes of symmetry, free at the equator and the hole."""
    angles, triangles = rectangle((16, 16), pattern, (np.pi / 2, np.pi * 0.4))
    f, t = angles[:, 0], angles[:, 1]
    points = 10 * np.stack([np.cos(t) * np.cos(f), np.cos(t) * np.sin(f), np.sin(t)], 1)
    stiffness = isotropic(0.04, 6.825e7, 0.3)
    middle = middles_of(angles, triangles)[:, :, 0]
    first, last = middle < 1e-9, middle > np.pi / 2 - 1e-9
    opposites, neighbours = adjacency(triangles)
    patches = curvature_patches(
        points, triangles, opposites, stiffness[3:, 3:],
        neighbours=neighbours if averaged else None,
        rules=np.where(first | last, EdgeRule.SYMMETRIC, EdgeRule.FREE),
        tangents=np.stack([last, first, np.zeros_like(first)], 2).astype(float),
    )  # fmt: skip
    made = RotationFreeTriangles.build(patches, points, stiffness)
    fixed = np.zeros(points.shape, dtype=bool)
    fixed[f < 1e-9, 1] = fixed[f > np.pi / 2 - 1e-9, 0] = True
    outwards, inwards = (
        np.argmin(np.linalg.norm(points - at, axis=1)) for at in np.eye(3)[:2] * 10
    )
    fixed[outwards, 2] = True
    load = np.zeros_like(points)
    load[outwards, 0], load[inwards, 1] = 50, -50
    moved = equilibrium(made, points, load, np.flatnonzero(~fixed.ravel()), 3) - points
    # at a quarter of the load. Measured: 0.2 and 2.3 % below; planes of symmetry taken as free
    # edges give 27 % more
    np.testing.assert_allclose([moved[outwards, 0], -moved[inwards, 1]], [2.596, 3.833], rtol=0.03)
