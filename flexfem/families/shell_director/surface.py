# SPDX-License-Identifier: LGPL-3.0-or-later
"""Serial data of director shells: midside nodes and their Dirichlet conditions; cells on a rank."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from flexfem._types import BoolArray, FloatArray, IndexArray, IntArray
from flexfem.families.common.dirichlet_nodes import DirichletNodes
from flexfem.families.common.shell_rest import RestStrains
from flexfem.families.common.shell_surface import ShellSurface, rest_state
from flexfem.families.shell_director.elements import DirectorCells
from flexfem.families.shell_director.law import DirectorLaw
from flexfem.families.shell_director.triangles import DirectorTriangles
from flexfem.families.shell_rotation_free.cells import ShellLaws
from flexfem.lie import se3
from flexfem.mesh.geometry.topology import edge_keys
from flexfem.mesh.shells.director_nodes import DirectorNodes, director_nodes
from flexfem.mesh.shells.patches import EdgeRule
from flexfem.model.model import Model

__all__ = ["director_cells", "shell_surface"]


def shell_surface(model: Model) -> ShellSurface:
    """All shells of a model; with directors, the nodes of the mesh and then those of its edges.

    Last come nodes that carry the directors of midside nodes which are fixed along some axes only:
        the frames of these midside nodes keep the axes and do not rotate.

    Raises:
        ValueError: as ``ShellSurface.of``; midside nodes that invert a triangle.
    """
    surface = ShellSurface.of(model)
    if surface.shells[0].element != "director":
        return surface
    made = director_nodes(surface.mesh, np.arange(len(surface.body)), surface.normals)
    corners = len(surface.mesh.points)
    made.frames[:corners], made.held[:corners, :3] = surface.frames, surface.held
    _hold_edges(surface, made)
    made = _hold_lines(surface, made)
    body = np.full(len(made.frames), len(surface.shells))
    np.minimum.at(body, made.all.ravel(), np.repeat(surface.body, 9))
    cluster = np.empty(len(made.frames), dtype=np.int64)
    cluster[made.all] = surface.cluster_of_node[made.nodes[:, :1]]
    return replace(
        surface, frames=made.frames, held=made.held, velocities=_velocities(surface, made),
        body_of_node=body, cluster_of_node=cluster, directors=made,
    )  # fmt: skip


def _hold_edges(surface: ShellSurface, made: DirectorNodes) -> None:
    """Enter the conditions along the boundaries of shells.

    In a plane of symmetry directors rotate about its normal, which becomes the first axis.
    """
    midside = made.nodes[:, 3:]
    made.held[midside[surface.rules == EdgeRule.HINGED], :3] = True
    mirrored = surface.rules == EdgeRule.SYMMETRIC
    nodes, e1, e3 = midside[mirrored], surface.normals[mirrored], made.directors[mirrored]
    turns = np.stack([e1, np.cross(e3, e1), e3], axis=2)
    made.frames[nodes, 3:] = turns.reshape(-1, 9)
    made.held[nodes] = np.array([True, False, False, False, True, True])
    made.held[midside[surface.rules == EdgeRule.CLAMPED]] = True


def _hold_lines(surface: ShellSurface, made: DirectorNodes) -> DirectorNodes:
    """Enter the conditions along other lines."""
    mesh, count = surface.mesh, len(surface.mesh.points)
    keys = edge_keys(made.edges, count)
    held, partly = DirichletNodes(made.frames[:, :3]), np.zeros(len(made.frames), dtype=np.bool_)
    for shell in surface.shells:
        for name, axes in shell.fixed.items():
            if name in mesh.nodes:
                continue
            at = count + np.searchsorted(keys, edge_keys(mesh.lines[name], count))
            if len(axes) == 3:
                made.held[at, :3] = True
            partly[at] = True
            for letter in axes:
                held.add(f'Shell "{shell.name}"', at, np.eye(3)["xyz".index(letter)])
    partly &= ~made.held[:, :3].all(axis=1)
    if not partly.any():
        return made
    mirrored = surface.rules == EdgeRule.SYMMETRIC
    for node, normal in zip(made.nodes[:, 3:][mirrored], surface.normals[mirrored], strict=True):
        held.add("Shell", np.array([node]), normal)
    return _split(made, np.flatnonzero(partly), *held.frames())


def _split(
    made: DirectorNodes, midside: IntArray, frames: FloatArray, held: BoolArray
) -> DirectorNodes:
    """Give some midside nodes axes of Dirichlet conditions, and their directors to other nodes.

    Args:
        made: all nodes.
        midside: numbers of the midside nodes.
        frames: of all nodes, (n, 12), with the axes of these nodes.
        held: True for the axes along which nodes are fixed, (n, 3).
    """
    count = len(made.frames)
    number = np.arange(count)
    number[midside] = count + np.arange(len(midside))
    turning = made.held[midside]
    turning[:, :3] = True
    fixed = made.held.copy()
    fixed[midside, :3], fixed[midside, 3:] = held[midside], True
    places = made.frames.copy()
    places[midside] = frames[midside]
    return replace(
        made,
        frames=np.concatenate([places, made.frames[midside]]),
        turning=number[made.turning],
        held=np.concatenate([fixed, turning]),
    )


def _velocities(surface: ShellSurface, made: DirectorNodes) -> FloatArray:
    """Velocities (n, 6) of all nodes at the start in their axes."""
    velocities = np.zeros((len(made.frames), 6))
    for number, shell in enumerate(surface.shells):
        nodes = np.unique(made.all[surface.body == number])
        turns, places = se3.rotation(made.frames[nodes]), made.frames[nodes, :3]
        inertial = shell.velocity + np.cross(shell.angular_velocity, places)
        velocities[nodes, :3] = np.einsum("nji,nj->ni", turns, inertial)
        velocities[nodes, 3:] = np.einsum("nji,j->ni", turns, shell.angular_velocity)
    velocities[made.held] = 0.0
    return velocities


def director_cells(
    surface: ShellSurface, own: IntArray, laws: ShellLaws, local: Callable[[IntArray], IndexArray]
) -> DirectorCells:
    """Triangles of a rank.

    Args:
        surface: all shells.
        own: numbers of the triangles.
        laws: result of ``shell_laws``.
        local: numbers of nodes on this rank for those of the surface.
    """
    made, shells = surface.directors, surface.shells
    assert made is not None
    nodes, section, body = made.all[own], surface.section[own], surface.body[own]
    directions = surface.directions[own]
    unset = ~directions.any(axis=1)
    along = surface.frames[nodes[:, 1], :3] - surface.frames[nodes[:, 0], :3]
    directions[unset] = along[unset]
    triangles = DirectorTriangles.build(
        nodes, surface.frames, made.directors[own],
        np.array([one.stiffness for one in surface.sections]),
        np.array([one.shear for one in surface.sections]),
        section, directions, np.array([shell.damping for shell in shells])[body],
        _laws(laws, section),
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
    rest = RestStrains(
        [rest_state(shell) for shell in shells], body, triangles.places, triangles.starts,
        triangles.rest_maps,
    )  # fmt: skip
    return DirectorCells(triangles.renumbered(local(nodes)), body, masses, rods, rest)


def _laws(laws: ShellLaws, section: IntArray) -> list[DirectorLaw]:
    """User-defined laws of triangles with sections (m,)."""
    found = []
    for numbers, values in laws:
        rows = np.flatnonzero(np.isin(section, numbers))
        if values is not None and len(rows):
            found.append(DirectorLaw(rows, np.searchsorted(numbers, section[rows]), values))
    return found
