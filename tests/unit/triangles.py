# SPDX-License-Identifier: LGPL-3.0-or-later
"""Plane meshes of triangles for the tests of shells, and plates on them."""

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import spsolve
from scipy.spatial import Delaunay

from flexfem.families.shell_rotation_free.triangles import RotationFreeTriangles
from flexfem.mesh.shells.clamp_weights import clamp_weights
from flexfem.mesh.shells.patches import curvature_patches
from flexfem.mesh.triangles.topology import match_sides, surface_topology

PATTERNS = ("parallel", "perturbed", "union_jack", "crossed")


def isotropic(thickness, modulus=1.0, ratio=0.3):
    """Stiffness [D_m 0; 0 D_b] of a plate."""
    plane = np.array([[1, ratio, 0], [ratio, 1, 0], [0, 0, (1 - ratio) / 2]]) / (1 - ratio**2)
    stiffness = np.zeros((6, 6))
    stiffness[:3, :3] = modulus * thickness * plane
    stiffness[3:, 3:] = modulus * thickness**3 / 12 * plane
    return stiffness


def rectangle(counts, pattern, sides=(1.0, 1.0), seed=1):
    """Points and triangles of a rectangle at z = 0 of ``counts`` cells along x and y."""
    (a, b), size = counts, np.divide(sides, counts)
    x, y = np.meshgrid(np.arange(a + 1) * size[0], np.arange(b + 1) * size[1], indexing="ij")
    points = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], 1)
    if pattern == "perturbed":
        inner = ((points > 1e-9) & (points < np.array([*sides, 1.0]) - 1e-9))[:, :2].all(1)
        shift = np.random.default_rng(seed).uniform(-0.25, 0.25, (inner.sum(), 2))
        points[inner, :2] += shift * size
        triangles = Delaunay(points[:, :2]).simplices.astype(np.int64)
        edges = points[triangles[:, 1:]] - points[triangles[:, :1]]
        doubled = np.cross(edges[:, 0], edges[:, 1])[:, 2]
        triangles[doubled < 0] = triangles[doubled < 0][:, ::-1]
        return points, triangles[abs(doubled) > 1e-9]
    if pattern == "crossed":
        cell = np.indices((a, b)).reshape(2, -1).T + 0.5
        points = np.concatenate([points, np.column_stack([cell * size, np.zeros(a * b)])])
    triangles = []
    for i in range(a):
        for j in range(b):
            p, q = i * (b + 1) + j, (i + 1) * (b + 1) + j
            corners = [p, q, q + 1, p + 1]
            if pattern == "crossed":
                centre = (a + 1) * (b + 1) + i * b + j
                triangles += [[corners[k], corners[(k + 1) % 4], centre] for k in range(4)]
            elif pattern == "parallel" or (i + j) % 2 == 0:
                triangles += [[p, q, q + 1], [p, q + 1, p + 1]]
            else:
                triangles += [[p, q, p + 1], [q, q + 1, p + 1]]
    return points, np.array(triangles)


def adjacency(triangles):
    """Opposite nodes and neighbours (m, 3) over the edges, -1 if there are none."""
    body = np.zeros(len(triangles), dtype=np.int64)
    sides = match_sides(triangles, body, int(triangles.max()) + 1)
    topology = surface_topology(triangles, sides)
    return topology.opposite, topology.neighbours


def patches_of(points, triangles, bending, averaged, **options):
    """Patches with e1 along x."""
    opposites, neighbours = adjacency(triangles)
    directions = np.tile([1.0, 0.0, 0.0], (len(triangles), 1))
    return curvature_patches(
        points, triangles, opposites, bending, directions=directions,
        neighbours=neighbours if averaged else None, **options,
    )  # fmt: skip


def sparse_tangent(triangles: RotationFreeTriangles, points):
    """Tangent (3 n, 3 n) of the fast path."""
    nodes = triangles.patches.nodes
    matrices = triangles.tangents(points)
    places = np.where(nodes[:, :, None] < 0, -1, 3 * nodes[:, :, None] + np.arange(3))
    places = places.reshape(len(nodes), -1)
    rows, columns = np.broadcast_arrays(places[:, :, None], places[:, None, :])
    there = (rows >= 0) & (columns >= 0)
    assert not matrices[~there].any()
    shape = (points.size, points.size)
    return sp.csr_matrix((matrices[there], (rows[there], columns[there])), shape=shape)


def sparse_maps(patches, count):
    """B as a matrix (3 m, n)."""
    there = np.broadcast_to(patches.nodes[:, None] >= 0, patches.curvatures.shape)
    rows = np.broadcast_to(
        np.arange(3 * len(patches.areas)).reshape(-1, 3, 1), patches.curvatures.shape
    )
    columns = np.broadcast_to(patches.nodes[:, None], patches.curvatures.shape)
    data = (patches.curvatures[there], (rows[there], columns[there]))
    return sp.csr_matrix(data, shape=(3 * len(patches.areas), count))


def plate_deflections(counts, pattern, averaged, rule_of, held_at, ratio=0.3):
    """Points and deflections of a unit square under unit pressure with D = 1.

    Args:
        counts: cells along one side.
        pattern: one of ``PATTERNS``.
        averaged: patches of twelve nodes.
        rule_of: rules of the edges at their midpoints (k, 3).
        held_at: whether nodes at points (k, 3) are fixed.
        ratio: Poisson's ratio.
    """
    points, triangles = rectangle((counts, counts), pattern)
    bending = isotropic(1.0, ratio=ratio)[3:, 3:]
    bending /= bending[0, 0]
    middles = (points[np.roll(triangles, -1, 1)] + points[np.roll(triangles, -2, 1)]) / 2
    rules = rule_of(middles.reshape(-1, 3)).reshape(triangles.shape)
    areas = np.linalg.norm(np.cross(*np.diff(points[triangles], axis=1).swapaxes(0, 1)), axis=1) / 2
    weights = clamp_weights(areas, adjacency(triangles)[1], rules)
    patches = patches_of(points, triangles, bending, averaged, rules=rules, weights=weights)
    maps = sparse_maps(patches, len(points))
    K = maps.T @ sp.kron(sp.diags(patches.areas), bending).tocsr() @ maps
    load = np.bincount(triangles.ravel(), np.repeat(patches.areas / 3, 3), len(points))
    free = np.flatnonzero(~held_at(points))
    deflections = np.zeros(len(points))
    deflections[free] = spsolve(K[free][:, free].tocsc(), load[free])
    return points, deflections
