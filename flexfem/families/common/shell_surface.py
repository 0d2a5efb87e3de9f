# SPDX-License-Identifier: LGPL-3.0-or-later
"""Serial data of all shells of a model: triangles, edges, Dirichlet conditions."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from flexfem import _checks
from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.families.common.dirichlet_nodes import RIGHT, DirichletNodes
from flexfem.families.common.shell_rest import RestState, check_rest
from flexfem.lie import se3
from flexfem.materials.shell_section import ShellSection
from flexfem.mesh.shells.clamp_weights import clamp_weights
from flexfem.mesh.shells.director_nodes import DirectorNodes
from flexfem.mesh.shells.patch_checks import moment_imbalance, moment_sums
from flexfem.mesh.shells.patches import EdgeRule, curvature_patches
from flexfem.mesh.surface_mesh import SurfaceMesh
from flexfem.mesh.triangles.topology import sides_along
from flexfem.model.bodies.shell import Shell
from flexfem.model.model import Model

__all__ = ["ShellSurface", "rest_state"]

_RULES = {
    "clamped": EdgeRule.CLAMPED,
    "hinged": EdgeRule.HINGED,
    "symmetric": EdgeRule.SYMMETRIC,
}
#: Imbalance of constant moments at the nodes (root mean square) above which slopes are averaged.
#: Deflections converge to a limit that is off by less than 0.1 % below it.
_BALANCED = 0.02
#: Mean imbalance above which patches of six nodes converge to deflections that are tens of per
#: cents off: 0.6 and more where diagonals are crossed or alternate, 0.2 with nodes at random.
_WRONG = 0.4
#: Distance of a line from its plane, relative to its size, that counts as none.
_FLAT = 1e-6


@dataclass(frozen=True)
class ShellSurface:
    """All shells of a model, the same on every rank.

    Nodes and triangles are those of the surface mesh. With directors the midside nodes
    follow, see ``families.shell_director.surface``.

    Attributes:
        mesh: the mesh.
        shells: in the order of the model.
        body: (m,) number of each triangle's shell.
        sections: the different sections; section: (m,) number of each triangle's.
        directions: (m, 3) material directions, zero where the first side gives it.
        rules: (m, 3) ``EdgeRule`` of each edge without neighbour.
        normals: (m, 3, 3) normals of planes of symmetry at edges, else zero.
        weights: (m,) factors of curvatures beside clamped edges, else 1.
        averaged: (m,) True where slopes are averaged.
        smoothed: (m,) True where membrane strains are smoothed.
        frames: (n, 12) nodes; axes are inertial save at Dirichlet conditions along other
            directions.
        held: (n, 3) True for the axes along which nodes are fixed; (n, 6) with directors.
        velocities: (n, 6) at the start, in these axes.
        body_of_node: (n,) number of the first shell that contains the node.
        cluster_of_node: (n,) number of its cluster of shells that share nodes.
        directors: nodes and directors, None for shells without.
    """

    mesh: SurfaceMesh
    shells: list[Shell]
    body: IntArray
    sections: list[ShellSection]
    section: IntArray
    directions: FloatArray
    rules: IntArray
    normals: FloatArray
    weights: FloatArray
    averaged: BoolArray
    smoothed: BoolArray
    frames: FloatArray
    held: BoolArray
    velocities: FloatArray
    body_of_node: IntArray
    cluster_of_node: IntArray
    directors: DirectorNodes | None = None

    @classmethod
    def of(cls, model: Model) -> Self:
        """Data of a model with shells.

        Raises:
            TypeError: a function of a rest state does not return numbers.
            ValueError: such a function fails; a line or node that is not on a shell, a line that is
                not in a plane of symmetry, directions that neither agree nor are at right angles;
                one line with names.
        """
        mesh, shells = model.surface, model.shells
        assert mesh is not None  # checked by validate()
        body = np.empty(len(mesh.triangles), dtype=np.int64)
        for number, shell in enumerate(shells):
            body[mesh.bodies[shell.body]] = number
        sections = list({id(s.section): s.section for s in shells}.values())
        numbers = [next(i for i, s in enumerate(sections) if s is h.section) for h in shells]
        directions = np.zeros((len(body), 3))
        rules = np.full((len(body), 3), int(EdgeRule.FREE))
        normals, held = np.zeros((len(body), 3, 3)), DirichletNodes(mesh.points)
        averaged = np.empty(len(body), dtype=np.bool_)
        for shell in shells:
            rows = mesh.bodies[shell.body]
            directions[rows] = _directions(mesh, shell, rows)
            _edges(mesh, shell, rules, normals, held)
            averaged[rows] = _averaged(mesh, shell, rows)
            check_rest(rest_state(shell), mesh.points[mesh.triangles[rows]].mean(axis=1))
        frames, mask = held.frames()
        low = np.full(len(mesh.points), len(shells))
        np.minimum.at(low, mesh.triangles.ravel(), np.repeat(body, 3))
        return cls(
            mesh, shells, body, sections, np.array(numbers)[body], directions, rules, normals,
            clamp_weights(mesh.areas, mesh.topology.neighbours, rules), averaged,
            np.array([shell.membrane == "smoothed" for shell in shells])[body], frames, mask,
            _velocities(mesh, shells, frames, mask), low,
            _clusters(mesh.triangles, body, len(mesh.points))[low],
        )  # fmt: skip


def rest_state(shell: Shell) -> RestState:
    """What a shell has no stress with."""
    owner = f'Shell "{shell.name}"'
    return RestState(owner, shell.rest_curvature, shell.initial_strain, shell.timed)


def _directions(mesh: SurfaceMesh, shell: Shell, rows: IntArray) -> FloatArray:
    """Material directions (m, 3) of a shell's triangles, zero where the first side gives it."""
    owner = f'Shell "{shell.name}"'
    if shell.direction is None:
        return np.zeros((len(rows), 3))
    centres = mesh.points[mesh.triangles[rows]].mean(axis=1)
    given = shell.direction(centres) if callable(shell.direction) else shell.direction
    if not callable(shell.direction):
        given = np.tile(np.asarray(given), (len(rows), 1))
    directions = _checks.array(owner, "direction(x)", given, (len(rows), 3))
    across = np.linalg.norm(np.cross(directions, mesh.normals[rows]), axis=1)
    if (across <= 1e-6 * np.linalg.norm(directions, axis=1)).any():
        at = int(np.argmin(across))
        raise ValueError(
            f"{owner}: direction {_checks.show(directions[at].tolist())} is at right angles to "
            f"triangle {rows[at]} at {_checks.show(centres[at].tolist())}"
        )
    return directions


def _edges(
    mesh: SurfaceMesh, shell: Shell, rules: IntArray, normals: FloatArray, held: DirichletNodes
) -> None:
    """Enter the Dirichlet conditions and edge rules along the lines of a shell and at its nodes."""
    owner = f'Shell "{shell.name}"'
    for line, rule in shell.edges.items():
        triangle, side = _sides(mesh, shell, line)
        rules[triangle, side] = _RULES[rule.split()[0]]
        nodes = np.unique(mesh.lines[line])
        if rule.startswith("symmetric"):
            normal = _plane(mesh, owner, line, rule, triangle, side)
            normals[triangle, side] = normal
            held.add(owner, nodes, normal)
        else:
            for axis in np.eye(3):
                held.add(owner, nodes, axis)
    known = set(mesh.body_nodes(shell.body).tolist())
    for name, axes in shell.fixed.items():
        own = [mesh.nodes[name]] if name in mesh.nodes else mesh.lines.get(name, ())
        nodes = np.unique(np.array(own, dtype=np.int64))
        if not len(nodes) or not known.issuperset(nodes.tolist()):
            raise ValueError(f'{owner}: fixed: it has no line or named node "{name}"')
        for letter in axes:
            held.add(owner, nodes, np.eye(3)["xyz".index(letter)])


def _sides(mesh: SurfaceMesh, shell: Shell, line: str) -> tuple[IntArray, IntArray]:
    """Triangle and side of every edge along a boundary line of a shell."""
    owner = f'Shell "{shell.name}"'
    if line not in mesh.lines:
        known = _checks.show(", ".join(mesh.lines) or "none", 200)
        raise ValueError(f'{owner}: edges: line "{line}" is not in the mesh, which has {known}')
    rows = mesh.bodies[shell.body]
    sides = sides_along(mesh.triangles[rows], mesh.lines[line], len(mesh.points))
    triangle, side = rows[sides // 3], sides % 3
    if (sides < 0).any() or (mesh.topology.neighbours[triangle, side] >= 0).any():
        raise ValueError(f'{owner}: edges: line "{line}" is not on its boundary')
    return triangle, side


def _plane(
    mesh: SurfaceMesh, owner: str, line: str, rule: str, triangle: IntArray, side: IntArray
) -> FloatArray:
    """Unit normal of the plane of symmetry that a line lies in."""
    ends = [mesh.points[mesh.triangles[triangle, (side + k) % 3]] for k in (1, 2)]
    points = np.unique(np.concatenate(ends), axis=0)
    offsets = points - points.mean(axis=0)
    _, sizes, axes = np.linalg.svd(offsets, full_matrices=True)
    if rule != "symmetric":
        normal: FloatArray = np.eye(3)["xyz".index(rule[-1])]
    elif sizes[1:].any() and sizes[1] > _FLAT * sizes[0]:
        normal = axes[2]
    else:
        normal = _across(mesh, owner, line, triangle, np.stack(ends, axis=1), axes[0])
    if np.abs(offsets @ normal).max() > _FLAT * sizes[0]:
        where = f"a plane normal to {rule[-1]}" if rule != "symmetric" else "a plane"
        raise ValueError(f'{owner}: edges: line "{line}" is symmetric but does not lie in {where}')
    return normal


def _across(
    mesh: SurfaceMesh,
    owner: str,
    line: str,
    triangle: IntArray,
    ends: FloatArray,
    along: FloatArray,
) -> FloatArray:
    """Unit normal of the plane through a straight line at right angles to a shell that is flat.

    The triangles beside the line of a curved shell are those of a chord: their plane is not that of
    the shell at the line.
    """
    neighbours = mesh.topology.neighbours
    # the next triangle may be the other half of a flat rectangle
    around = neighbours[neighbours[triangle]].reshape(len(triangle), -1)
    around[np.repeat(neighbours[triangle] < 0, 3, axis=1)] = -1
    beside, other = np.repeat(triangle, 9)[around.ravel() >= 0], around[around >= 0]
    cosines = np.einsum("mi,mi->m", mesh.normals[beside], mesh.normals[other])
    if (cosines < 1.0 - RIGHT).any():
        raise ValueError(
            f'{owner}: edges: line "{line}" is straight and the shell curved there, which leaves '
            'its plane open: give "symmetric x", "symmetric y" or "symmetric z"'
        )
    outwards = np.cross(ends[:, 1] - ends[:, 0], mesh.normals[triangle]).mean(axis=0)
    normal = outwards - (outwards @ along) * along
    result: FloatArray = normal / np.linalg.norm(normal)
    return result


def _averaged(mesh: SurfaceMesh, shell: Shell, rows: IntArray) -> bool:
    """True if a shell's slopes are averaged: by its option, or else as its mesh requires."""
    if shell.element == "director":
        return False
    if shell.averaged:
        return True
    imbalance = _imbalance(mesh, shell, rows)
    if shell.averaged is None:
        return imbalance is None or bool(np.sqrt((imbalance**2).mean()) > _BALANCED)
    if imbalance is not None and _inner_mean(imbalance) > _WRONG:
        raise ValueError(
            f'Shell "{shell.name}": averaged=False on a mesh of alternating or crossed diagonals '
            "converges to wrong deflections, up to 1.7 times the right ones; leave it out"
        )
    return False


def _inner_mean(imbalance: FloatArray) -> float:
    """Root mean square of the values that are not zero, as they are at edges."""
    inner = imbalance[imbalance > 0.0]
    return float(np.sqrt((inner**2).mean())) if len(inner) else 0.0


def _imbalance(mesh: SurfaceMesh, shell: Shell, rows: IntArray) -> FloatArray | None:
    """``moment_imbalance`` (n,) of a shell's patches of six nodes; None if they are singular.

    They are if a conic passes through the six nodes.
    """
    number = np.full(len(mesh.points), -1)
    nodes = np.unique(mesh.triangles[rows])
    number[nodes] = np.arange(len(nodes))
    opposite = mesh.topology.opposite[rows]
    patches = curvature_patches(
        mesh.points[nodes],
        number[mesh.triangles[rows]],
        np.where(opposite >= 0, number[opposite], -1),
        shell.section.stiffness[3:, 3:],
    )
    if not np.isfinite(patches.conditions).all():
        return None
    return moment_imbalance(moment_sums(patches, len(nodes)))


def _velocities(
    mesh: SurfaceMesh, shells: list[Shell], frames: FloatArray, held: BoolArray
) -> FloatArray:
    """Velocities (n, 6) of all nodes at the start in their axes."""
    velocities = np.zeros((len(mesh.points), 6))
    for shell in shells:
        nodes = mesh.body_nodes(shell.body)
        inertial = shell.velocity + np.cross(shell.angular_velocity, mesh.points[nodes])
        velocities[nodes, :3] = np.einsum("nji,nj->ni", se3.rotation(frames[nodes]), inertial)
    velocities[:, :3][held] = 0.0
    return velocities


def _clusters(triangles: IntArray, body: IntArray, count: int) -> IntArray:
    """Cluster of every shell: the lowest number among shells linked by shared nodes."""
    cluster = np.arange(int(body.max()) + 1)
    while True:
        low = np.full(count, len(cluster))
        np.minimum.at(low, triangles.ravel(), np.repeat(cluster[body], 3))
        found = cluster.copy()
        np.minimum.at(found, body, low[triangles].min(axis=1))
        if (found == cluster).all():
            return cluster
        cluster = found
