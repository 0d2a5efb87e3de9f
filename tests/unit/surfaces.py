# SPDX-License-Identifier: LGPL-3.0-or-later
"""Grids that touch, for tests of contact."""

import numpy as np

from flexfem.contact.law.data import Masters, Slaves
from flexfem.contact.obstacles.surface_data import mean_edge, node_areas, rim_bits
from flexfem.contact.obstacles.triangles import TriangleContact
from flexfem.mesh.triangles.grid import grid_triangles
from flexfem.mesh.triangles.topology import match_sides, surface_topology


def grid(columns, rows, size=(1.0, 1.0), height=lambda x, y: 0 * x):
    """Points (n, 3) and triangles (m, 3) of a surface over a rectangle."""
    x, y = np.meshgrid(np.linspace(0, size[0], columns), np.linspace(0, size[1], rows))
    points = np.column_stack([x.ravel(), y.ravel(), height(x, y).ravel()])
    return points, grid_triangles(columns, rows, closed=False, diagonal="right")


def masters(points, triangles, thickness, side=0):
    """Triangles of one part, with half of the thickness."""
    body = np.zeros(len(triangles), dtype=np.int64)
    topology = surface_topology(triangles, match_sides(triangles, body, len(points)))
    rims = rim_bits(triangles, topology.neighbours, len(points))
    return Masters(
        triangles=triangles, thickness=np.full(len(triangles), thickness / 2), rims=rims,
        parts=body, sides=body + side,
    )  # fmt: skip


def slaves(nodes, offset, stiffness):
    """Nodes that touch at one distance."""
    return Slaves(nodes=nodes, offsets=np.full(len(nodes), offset), stiffness=stiffness)


def points_on_surface(points, triangles, others, thickness, **options):
    """Contact of further points with triangles, and all positions, those of the points last."""
    every = np.concatenate([points, others])
    nodes = np.arange(len(points), len(every))
    options.setdefault("skin", 0.4 * mean_edge(points, triangles))
    stiffness = options.pop("stiffness", np.linspace(1.0, 2.0, len(nodes)))
    touching = slaves(nodes, thickness / 2, stiffness)
    made = TriangleContact(touching, masters(points, triangles, thickness), **options)
    made.update(every)
    return made, every


def two_sheets(thickness=0.01, shift=(0.03, 0.07), overlap=0.1):
    """Two passes between flat sheets of different meshes; positions and areas of the nodes."""
    lower, first = grid(7, 6)
    upper, second = grid(5, 8)
    upper += [*shift, (1 - overlap) * thickness]
    points = np.concatenate([lower, upper])
    second = second + len(lower)
    areas = node_areas(points, np.concatenate([first, second]))
    passes = []
    for slave, master in ((second, first), (first, second)):
        nodes = np.unique(slave)
        touching = slaves(nodes, thickness / 2, 0.5e3 * areas[nodes])
        passes.append(TriangleContact(touching, masters(points, master, thickness), skin=0.05))
        passes[-1].update(points)
    return passes, points, areas, len(lower)
