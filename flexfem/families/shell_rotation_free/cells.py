# SPDX-License-Identifier: LGPL-3.0-or-later
"""Triangles of rotation-free shells on a rank."""

from collections.abc import Callable

from mpi4py import MPI

import numpy as np

from flexfem._types import IndexArray, IntArray
from flexfem.families.common.law_values import LawValues
from flexfem.families.common.section_groups import grouped
from flexfem.families.common.shell_rest import RestStrains
from flexfem.families.common.shell_surface import ShellSurface, rest_state
from flexfem.families.shell_rotation_free.elements import ShellCells
from flexfem.families.shell_rotation_free.triangles import RotationFreeTriangles
from flexfem.mesh.shells.patches import curvature_patches

__all__ = ["ShellLaws", "shell_cells", "shell_laws"]

#: Numbers of the sections that share a law, and the law, None for the linear one.
type ShellLaws = list[tuple[list[int], LawValues | None]]


def shell_laws(comm: MPI.Intracomm, surface: ShellSurface) -> ShellLaws:
    """Numbers of the sections that share a law, and the law, None for the linear one (collective).

    Raises:
        ValueError: a law is not usable; on all ranks.
    """
    first = {id(shell.section): f'Shell "{shell.name}"' for shell in reversed(surface.shells)}
    found: ShellLaws = []
    for law, numbers in grouped(surface.sections).items():
        sections = [surface.sections[i] for i in numbers]
        laws = [section.law for section in sections if section.law is not None]
        owners = [first[id(section)] for section in sections]
        found.append((numbers, None if law is None else LawValues(comm, law, laws, owners)))
    return found


def shell_cells(
    surface: ShellSurface, own: IntArray, averaged: bool, smoothed: bool, numbers: list[int],
    law: LawValues | None, local: Callable[[IntArray], IndexArray],
) -> ShellCells:  # fmt: skip
    """Triangles with patches of one kind and one law.

    Args:
        surface: all shells.
        own: numbers of the triangles.
        averaged: True if their slopes are averaged with those of their neighbours.
        smoothed: True if their membrane strains are smoothed.
        numbers: of their sections, in the order of the law's parameters.
        law: of these sections, None for the linear one.
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
        weights=surface.weights[rows],
        smoothed=smoothed,
    ).first(len(own))
    damping = np.array([shell.damping for shell in surface.shells])[surface.body[own]]
    triangles = RotationFreeTriangles.build(
        patches,
        points,
        stiffness[numbers],
        np.searchsorted(numbers, surface.section[own]),
        damping,
        law,
    )
    rest = RestStrains(
        [rest_state(shell) for shell in surface.shells], surface.body[own],
        corners[: len(own)].mean(axis=1, keepdims=True), triangles.starts, triangles.rest_maps,
    )  # fmt: skip
    there = patches.nodes >= 0
    nodes = np.full(patches.nodes.shape, -1, dtype=np.int32)
    nodes[there] = local(patches.nodes[there].astype(np.int64))
    consistent = np.array([shell.mass == "consistent" for shell in surface.shells])
    density = np.array([section.mass for section in surface.sections])
    return ShellCells(
        triangles=triangles.renumbered(nodes),
        body=surface.body[own],
        mass=density[surface.section[own]] * patches.areas,
        consistent=consistent[surface.body[own]],
        rest=rest,
    )
