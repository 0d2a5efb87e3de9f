# SPDX-License-Identifier: LGPL-3.0-or-later
"""Triangles of rotation-free shells on a rank."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from flexfem._types import IndexArray, IntArray
from flexfem.elements.rotation_free import RotationFreeTriangles
from flexfem.elements.rotation_free_shells import ShellCells
from flexfem.mesh.patches import curvature_patches
from flexfem.system.shell_surface import ShellSurface

__all__ = ["shell_cells"]


def shell_cells(
    surface: ShellSurface, own: IntArray, averaged: bool, local: Callable[[IntArray], IndexArray]
) -> ShellCells:
    """Triangles with patches of one kind.

    Args:
        surface: all shells.
        own: numbers of the triangles.
        averaged: whether their slopes are averaged, with those of their neighbours.
        local: numbers of nodes on this rank for those in the mesh.
    """
    topology, points = surface.mesh.topology, surface.mesh.points
    rows, neighbours = own, None
    if averaged:
        around = topology.neighbours[own]
        rows = np.concatenate([own, np.setdiff1d(around[around >= 0], own)])
        number = np.full(len(surface.body) + 1, -1)
        number[rows] = np.arange(len(rows))
        neighbours = number[topology.neighbours[rows]]
    directions = surface.directions[rows]
    corners = points[surface.mesh.triangles[rows]]
    unset = ~directions.any(axis=1)
    directions[unset] = (corners[:, 1] - corners[:, 0])[unset]
    stiffness = np.array([section.stiffness for section in surface.sections])
    patches = curvature_patches(
        points,
        surface.mesh.triangles[rows],
        topology.opposite[rows],
        stiffness[surface.section[rows], 3:, 3:],
        neighbours=neighbours,
        rules=surface.rules[rows],
        tangents=surface.normals[rows],
        directions=directions,
    ).first(len(own))
    damping = np.array([shell.damping for shell in surface.shells])[surface.body[own]]
    triangles = RotationFreeTriangles.build(
        patches, points, stiffness, surface.section[own], damping
    )
    there = patches.nodes >= 0
    nodes = np.full(patches.nodes.shape, -1, dtype=np.int32)
    nodes[there] = local(patches.nodes[there].astype(np.int64))
    consistent = np.array([shell.mass == "consistent" for shell in surface.shells])
    density = np.array([section.mass for section in surface.sections])
    return ShellCells(
        triangles=replace(triangles, patches=replace(patches, nodes=nodes)),
        body=surface.body[own],
        mass=density[surface.section[own]] * patches.areas,
        consistent=consistent[surface.body[own]],
    )
