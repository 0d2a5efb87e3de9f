# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sizes of elements and sections, stiffnesses, and the entries of the matrices of a step."""

from dataclasses import dataclass

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.constraints.batch import Constraints
from flexfem.layout.numbered_model import NumberedModel
from flexfem.materials.section import Section
from flexfem.model.bodies.basic import Beam
from flexfem.model.bodies.shell import Shell

__all__ = ["MeshFacts", "matrix_entries", "mesh_facts", "section_depth"]


@dataclass(frozen=True)
class MeshFacts:
    """A beam or shell in numbers.

    Attributes:
        body: the beam or shell.
        lengths: (m,) lengths of a beam's elements, or the shortest edge of each triangle, m.
        longest: (m,) the same of beams; the longest edge of each triangle, m.
        length: length of a beam, m; root of the area of a shell.
        area: of a shell, m^2; 0 for beams.
        depth: of the section or the shell, m; NaN where unknown.
        centroids: (m, 3) of the elements, m.
        axial: stiffness of the softest element against stretching, N/m: EA/l, of shells E h.
    """

    body: Beam | Shell
    lengths: FloatArray
    longest: FloatArray
    length: float
    area: float
    depth: float
    centroids: FloatArray
    axial: float

    @property
    def slenderness(self) -> float:
        """Length by depth; NaN where the depth is not known."""
        return self.length / self.depth


def mesh_facts(serial: NumberedModel) -> list[MeshFacts]:
    """Beams, then shells, of a model."""
    beams = [_beam(serial, beam) for beam in serial.model.beams]
    return beams + [_shell(serial, shell) for shell in serial.model.shells]


def section_depth(section: Section) -> float:
    """Largest distance of two points of a section, m; NaN where unknown.

    Without an outline that of the rectangle with the same radius of gyration.
    """
    if section.outline is not None:
        return float(np.ptp(section.outline, axis=0).max())
    if section.stiffness is not None:
        D = section.stiffness
        return float(np.sqrt(12.0 * max(D[4, 4], D[5, 5]) / D[0, 0]))
    mass = section.mass_per_length
    J = np.diag(section.inertia)[4:]
    return float(np.sqrt(12.0 * J.max() / mass)) if mass > 0.0 and J.max() > 0.0 else np.nan


def _beam(serial: NumberedModel, beam: Beam) -> MeshFacts:
    if beam.formulation == "nurbs":
        curves = serial.curves
        assert curves is not None
        index = curves.index(beam.name)
        lengths = np.asarray(curves.parts[index].lengths)
        centroids = curves.frames[curves.nodes(index), :3].mean(axis=1)
    else:
        cells = serial.cells.cells[serial.cells.body == serial.model.beams.index(beam)]
        ends = serial.points[cells]
        lengths, centroids = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1), ends.mean(axis=1)
    D = beam.section.stiffness
    axial = np.nan if D is None else float(D[0, 0] / lengths.max())
    depth = section_depth(beam.section)
    return MeshFacts(beam, lengths, lengths, float(lengths.sum()), 0.0, depth, centroids, axial)


def _shell(serial: NumberedModel, shell: Shell) -> MeshFacts:
    mesh = serial.model.surface
    assert mesh is not None  # checked by validate()
    rows = mesh.body_rows(shell.body)
    corners = mesh.points[mesh.triangles[rows]]
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    area, section = float(mesh.areas[rows].sum()), shell.section
    axial = float(np.linalg.eigvalsh(section.stiffness[:2, :2])[0])
    return MeshFacts(
        shell, edges.min(axis=1), edges.max(axis=1), float(np.sqrt(area)), area,
        section.thickness, corners.mean(axis=1), axial,
    )  # fmt: skip


def matrix_entries(serial: NumberedModel, rows: Constraints) -> int:
    """Entries that the matrix of a step has room for, joints included, contact left out."""
    count = 36 * len(serial.model.rigid_bodies)
    if len(serial.points):
        count += 36 * _pairs([serial.cells.cells.astype(np.int64)], len(serial.points))
    if serial.curves is not None:
        curves = serial.curves
        elements = [curves.nodes(index) for index in range(len(curves.beams))]
        count += 36 * _pairs(elements, len(curves.frames))
    if serial.surface is not None:
        width = serial.surface.held.shape[1]
        count += width**2 * _pairs([_patches(serial)], len(serial.surface.frames))
    if serial.floating is not None:
        count += int(((6 * np.diff(serial.floating.first)) ** 2).sum())
    # a row has an entry in G and in G^T for each unknown of its nodes
    row = np.repeat(rows.row_of_term, 2)
    nodes = rows.term_nodes.ravel()
    met = np.unique(np.stack([row, nodes])[:, nodes >= 0], axis=1)
    width_of = rows.interface.width
    return int(count + 2 * width_of[met[1]].sum())


def _patches(serial: NumberedModel) -> IntArray:
    """(m, k) nodes that the triangles of the shells couple, -1 where there is none."""
    surface = serial.surface
    assert surface is not None
    if surface.directors is not None:
        return np.asarray(surface.directors.all)
    topology = surface.mesh.topology
    own = np.concatenate([surface.mesh.triangles, topology.opposite], axis=1)
    wide = surface.averaged | surface.smoothed
    # slopes are averaged with the neighbours', which have patches themselves
    more = np.where(topology.neighbours[..., np.newaxis] >= 0, own[topology.neighbours], -1)
    more[~wide] = -1
    return np.concatenate([own, more.reshape(len(own), -1)], axis=1)


def _pairs(elements: list[IntArray], count: int) -> int:
    """Number of pairs of nodes, in both orders and with themselves, that share an element."""
    from scipy.sparse import coo_array

    at, to, first = [], [], 0
    for nodes in elements:
        row = np.repeat(first + np.arange(len(nodes)), nodes.shape[1])
        there = nodes.ravel() >= 0
        at.append(row[there])
        to.append(nodes.ravel()[there])
        first += len(nodes)
    i, j = np.concatenate(at), np.concatenate(to)
    member = coo_array((np.ones(len(i)), (i, j)), shape=(first, count)).tocsr()
    return int((member.T @ member).nnz)
