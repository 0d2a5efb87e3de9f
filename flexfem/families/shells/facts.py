# SPDX-License-Identifier: LGPL-3.0-or-later
"""Inertia of shells, sizes of their triangles, and the nodes that these couple."""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.core.inertia import inertia_about, point_inertia
from flexfem.families.common.shell_surface import ShellSurface
from flexfem.layout.mesh_facts import MeshFacts
from flexfem.lie import se3
from flexfem.materials.shell_section import ShellSection
from flexfem.model.bodies.shell import Shell

__all__ = ["shell_facts", "shell_inertia", "shell_patches"]

#: Coordinates and weights of seven points in a triangle, exact for degree five (Radon 1948).
_NEAR, _FAR = (6.0 - np.sqrt(15.0)) / 21.0, (6.0 + np.sqrt(15.0)) / 21.0
_TRIANGLE = np.array(
    [(1.0 / 3.0, 1.0 / 3.0, 9.0 / 40.0)]
    + [
        (r, s, (155.0 - sign * np.sqrt(15.0)) / 1200.0)
        for a, sign in ((_NEAR, 1.0), (_FAR, -1.0))
        for r, s in ((a, a), (a, 1.0 - 2.0 * a), (1.0 - 2.0 * a, a))
    ]
)


def shell_facts(surface: ShellSurface, shell: Shell) -> MeshFacts:
    """Sizes and stiffness of the triangles of a shell."""
    mesh, section = surface.mesh, shell.section
    rows = mesh.body_rows(shell.body)
    corners = mesh.points[mesh.triangles[rows]]
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    area = float(mesh.areas[rows].sum())
    axial = float(np.linalg.eigvalsh(section.stiffness[:2, :2])[0])
    return MeshFacts(
        shell, edges.min(axis=1), edges.max(axis=1), float(np.sqrt(area)), area,
        section.thickness, corners.mean(axis=1), axial, section,
    )  # fmt: skip


def shell_patches(surface: ShellSurface) -> IntArray:
    """(m, k) nodes that the triangles of the shells couple, -1 where there is none."""
    if surface.directors is not None:
        return np.asarray(surface.directors.all)
    topology = surface.mesh.topology
    own = np.concatenate([surface.mesh.triangles, topology.opposite], axis=1)
    wide = surface.averaged | surface.smoothed
    # slopes are averaged with the neighbours', which have patches themselves
    more = np.where(topology.neighbours[..., np.newaxis] >= 0, own[topology.neighbours], -1)
    more[~wide] = -1
    return np.concatenate([own, more.reshape(len(own), -1)], axis=1)


def shell_inertia(surface: ShellSurface, shell: Shell, origin: FloatArray) -> FloatArray:
    """Inertia matrix (6, 6) of a shell at the start about a frame (12,).

    That of rotation-free shells is without rotary inertia of the thickness. They are integrated by
    the midpoint rule of the edges, exact for integrands quadratic in a triangle.
    """
    rows = np.flatnonzero(surface.body == surface.shells.index(shell))
    if surface.directors is not None:
        x = surface.frames[surface.directors.nodes[rows], :3]
        return _director_inertia(x, shell.section, origin)
    x = surface.mesh.points[surface.mesh.triangles[rows]]
    midpoints = (0.5 * (x + np.roll(x, 1, axis=1))).reshape(-1, 3)
    masses = np.repeat(shell.section.mass * surface.mesh.areas[rows] / 3.0, 3)
    return point_inertia(origin, midpoints, masses)


def _director_inertia(x: FloatArray, section: ShellSection, origin: FloatArray) -> FloatArray:
    """Curved triangles with corners and midpoints of the opposite edges x (m, 6, 3)."""
    r, s = _TRIANGLE[:, :2].T
    t = 1.0 - r - s
    nothing = np.zeros_like(r)
    shape = [t * (2 * t - 1), r * (2 * r - 1), s * (2 * s - 1), 4 * r * s, 4 * s * t, 4 * t * r]
    by_r = [1 - 4 * t, 4 * r - 1, nothing, 4 * s, -4 * s, 4 * (t - r)]
    by_s = [1 - 4 * t, nothing, 4 * s - 1, 4 * r, 4 * (t - s), -4 * r]
    points, along, other = (
        np.einsum("iq,mia->mqa", np.array(values), x).reshape(-1, 3)
        for values in (shape, by_r, by_s)
    )
    normal = np.cross(along, other)
    size = np.linalg.norm(normal, axis=1)
    e3, e1 = normal / size[:, None], along / np.linalg.norm(along, axis=1)[:, None]
    frames = se3.frame(points, np.stack([e1, np.cross(e3, e1), e3], axis=2))
    rotary = section.mass * section.thickness**2 / 12.0
    inertia = np.diag([section.mass] * 3 + [rotary, rotary, 0.0])
    return inertia_about(origin, frames, inertia, 0.5 * size * np.tile(_TRIANGLE[:, 2], len(x)))
