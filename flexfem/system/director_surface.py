# SPDX-License-Identifier: LGPL-3.0-or-later
"""Serial data of director shells: nodes amid the edges, what is held there; cells on a rank."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from flexfem._types import BoolArray, FloatArray, IndexArray, IntArray
from flexfem.elements.director_shell import DirectorTriangles
from flexfem.elements.director_shells import DirectorCells
from flexfem.lie import se3
from flexfem.mesh.director_nodes import DirectorNodes, director_nodes
from flexfem.mesh.patches import EdgeRule
from flexfem.mesh.topology import edge_keys
from flexfem.model.model import Model
from flexfem.system.shell_surface import ShellSurface

__all__ = ["director_cells", "shell_surface"]


def shell_surface(model: Model) -> ShellSurface:
    """All shells of a model; with directors, the nodes of the mesh and then those of its edges.

    Raises:
        ValueError: as ``ShellSurface.of``; middles of edges that turn a triangle inside out; a line
            with directors that is held along some axes only.
    """
    surface = ShellSurface.of(model)
    if surface.shells[0].element != "director":
        return surface
    made = director_nodes(surface.mesh, np.arange(len(surface.body)), surface.normals)
    corners = len(surface.mesh.points)
    frames, held = made.frames.copy(), made.held.copy()
    frames[:corners], held[:corners, :3] = surface.frames, surface.held
    _hold_edges(surface, made, frames, held)
    _hold_lines(surface, made, held)
    body = np.full(len(frames), len(surface.shells))
    np.minimum.at(body, made.nodes.ravel(), np.repeat(surface.body, 6))
    cluster = np.empty(len(frames), dtype=np.int64)
    cluster[made.nodes] = surface.cluster_of_node[made.nodes[:, :1]]
    return replace(
        surface, frames=frames, held=held, velocities=_velocities(surface, made, frames, held),
        body_of_node=body, cluster_of_node=cluster, directors=made,
    )  # fmt: skip


def _hold_edges(
    surface: ShellSurface, made: DirectorNodes, frames: FloatArray, held: BoolArray
) -> None:
    """Enter what holds along the boundaries of shells.

    In a plane of symmetry directors turn about its normal, which becomes the first axis.
    """
    middles = made.nodes[:, 3:]
    held[middles[surface.rules == EdgeRule.HINGED], :3] = True
    mirrored = surface.rules == EdgeRule.SYMMETRIC
    nodes, e1, e3 = middles[mirrored], surface.normals[mirrored], made.directors[mirrored]
    turns = np.stack([e1, np.cross(e3, e1), e3], axis=2)
    frames[nodes, 3:] = turns.reshape(-1, 9)
    held[nodes] = np.array([True, False, False, False, True, True])
    held[middles[surface.rules == EdgeRule.CLAMPED]] = True


def _hold_lines(surface: ShellSurface, made: DirectorNodes, held: BoolArray) -> None:
    """Enter what holds along other lines."""
    mesh, count = surface.mesh, len(surface.mesh.points)
    keys = edge_keys(made.edges, count)
    for shell in surface.shells:
        for name, axes in shell.fixed.items():
            if name in mesh.nodes:
                continue
            if len(axes) < 3:
                raise ValueError(
                    f'Shell "{shell.name}": fixed["{name}"]: a line of a shell with directors is '
                    f'held along all of "xyz" or not at all, got "{axes}"'
                )
            at = np.searchsorted(keys, edge_keys(mesh.lines[name], count))
            held[count + at, :3] = True


def _velocities(
    surface: ShellSurface, made: DirectorNodes, frames: FloatArray, held: BoolArray
) -> FloatArray:
    """Velocities (n, 6) of all nodes at the start in their axes."""
    velocities = np.zeros((len(frames), 6))
    for number, shell in enumerate(surface.shells):
        nodes = np.unique(made.nodes[surface.body == number])
        turns = se3.rotation(frames[nodes])
        inertial = shell.velocity + np.cross(shell.angular_velocity, frames[nodes, :3])
        velocities[nodes, :3] = np.einsum("nji,nj->ni", turns, inertial)
        velocities[nodes, 3:] = np.einsum("nji,j->ni", turns, shell.angular_velocity)
    velocities[held] = 0.0
    return velocities


def director_cells(
    surface: ShellSurface, own: IntArray, local: Callable[[IntArray], IndexArray]
) -> DirectorCells:
    """Triangles of a rank.

    Args:
        surface: all shells.
        own: numbers of the triangles.
        local: numbers of nodes on this rank for those of the surface.
    """
    made, shells = surface.directors, surface.shells
    assert made is not None
    nodes, section, body = made.nodes[own], surface.section[own], surface.body[own]
    directions = surface.directions[own]
    unset = ~directions.any(axis=1)
    along = surface.frames[nodes[:, 1], :3] - surface.frames[nodes[:, 0], :3]
    directions[unset] = along[unset]
    triangles = DirectorTriangles.build(
        nodes, surface.frames, made.directors[own],
        np.array([one.stiffness for one in surface.sections]),
        np.array([one.shear for one in surface.sections]),
        section, directions, np.array([shell.damping for shell in shells])[body],
    )  # fmt: skip
    density = np.array([one.mass for one in surface.sections])
    thickness = np.array([one.thickness for one in surface.sections])
    consistent = np.array([shell.mass == "consistent" for shell in shells])[body]
    masses = np.where(
        consistent[:, np.newaxis, np.newaxis],
        triangles.masses(density[section]),
        triangles.lumped_masses(density[section]),
    )
    rods = triangles.rods((density * thickness**2 / 12.0)[section])
    return DirectorCells(replace(triangles, nodes=local(nodes)), body, masses, rods)
