# SPDX-License-Identifier: LGPL-3.0-or-later
"""Places of markers on beams and shells."""

import numpy as np

from flexfem import _checks
from flexfem._types import IntArray
from flexfem.core.marker import LINE_ENDS, Marker, ShellLine
from flexfem.core.node_row import NodeRow
from flexfem.mesh.geometry.topology import arc_length
from flexfem.mesh.line_mesh import LineMesh
from flexfem.mesh.nurbs.curve import NurbsCurve
from flexfem.mesh.surface_mesh import SurfaceMesh
from flexfem.mesh.triangles.topology import sides_along
from flexfem.model.bodies.basic import Beam
from flexfem.model.bodies.shell import Shell
from flexfem.model.structure.line_bending import line_slopes, line_stiffness
from flexfem.model.structure.place import Place, place_at_fraction, place_in

#: A fraction so near to a node, as a part of an element, means it: one written with few digits.
_AT_NODE = 1e-4


def beam_place(mesh: LineMesh, beam: Beam, marker: Marker) -> Place:
    """Return the place of a marker on a beam of two-node elements.

    Raises:
        ValueError: No point, a point group that is not on the beam, or an end or fraction of a
            line that has none because it is closed or branches.
    """
    owner, point = f'Marker on "{beam.name}"', _point(beam, marker)
    if isinstance(point, str):
        return Place(_named_node(mesh, beam, owner, point))
    nodes = _ordered(mesh, beam, owner, point)
    length = arc_length(mesh.points[nodes])
    at = point * length[-1]
    e = min(int(np.searchsorted(length, at, side="right")), len(nodes) - 1) - 1
    xi = float((at - length[e]) / (length[e + 1] - length[e]))
    if min(xi, 1.0 - xi) <= _AT_NODE:
        return Place(int(nodes[e if xi < 0.5 else e + 1]))
    return Place(None, e, xi)


def _named_node(mesh: LineMesh, beam: Beam, owner: str, point: str) -> int:
    """Return the mesh node of a point group or of an end of a line."""
    if point not in LINE_ENDS:
        return _group_node(mesh, beam, point)
    nodes = _ordered(mesh, beam, owner, point)
    if nodes[0] == nodes[-1]:
        raise ValueError(f'{owner}: point "{point}": the line is closed and has no ends')
    return int(nodes[0 if point == "start" else -1])


def shell_node(mesh: SurfaceMesh, shell: Shell, marker: Marker) -> int:
    """Return the mesh node of a marker on a shell.

    Raises:
        ValueError: No point or a fraction, a name that is no node of the shell, or an offset.
    """
    owner, point = f'Marker on "{shell.name}"', marker.point
    if marker.offset.any():
        raise ValueError(f"{owner}: a shell has no offsets, got {marker.offset.tolist()}")
    if isinstance(point, tuple):
        return _near_node(mesh, shell, owner, point)
    nodes = mesh.body_nodes(shell.body)
    if not isinstance(point, str) or mesh.nodes.get(point, -1) not in nodes:
        own = set(nodes.tolist())
        known = ", ".join(name for name, node in mesh.nodes.items() if node in own) or "none"
        raise ValueError(
            f"{owner}: a shell needs a named node or a position (x, y, z), got point "
            f"{_checks.show(point)}; its nodes are {_checks.show(known, 200)}"
        )
    return mesh.nodes[point]


def _near_node(
    mesh: SurfaceMesh, shell: Shell, owner: str, point: tuple[float, float, float]
) -> int:
    """Return the node of a shell closest to a position, no farther than a neighbour of it is."""
    node = mesh.closest_node(point, shell.body)
    triangles = mesh.triangles[mesh.body_rows(shell.body)]
    around = mesh.points[triangles[(triangles == node).any(axis=1)]]
    reach = float(np.linalg.norm(around - mesh.points[node], axis=2).max())
    gap = float(np.linalg.norm(mesh.points[node] - np.array(point)))
    if gap > reach:
        raise ValueError(
            f"{owner}: the nearest node to {_checks.show(list(point))} is {gap:.4g} m away, more "
            f"than its own neighbours are, {reach:.4g} m"
        )
    return node


def curve_place(mesh: LineMesh | None, curve: NurbsCurve, beam: Beam, marker: Marker) -> Place:
    """Return the place of a marker on a beam along a curve.

    Raises:
        ValueError: No point, a point group that is not on the beam, or one on a beam without mesh.
    """
    owner, point = f'Marker on "{beam.name}"', _point(beam, marker)
    if not isinstance(point, str):
        return place_at_fraction(curve, point)
    parts = curve.elements
    last = len(parts.nodes) - 1
    if point in LINE_ENDS:
        return place_in(parts, 0, 0.0) if point == "start" else place_in(parts, last, 1.0)
    if beam.group is None or mesh is None:
        raise ValueError(
            f'{owner}: a beam along a curve has "start", "end" and fractions, got point "{point}"'
        )
    node = _group_node(mesh, beam, point)
    order = _ordered(mesh, beam, owner, point)
    at = int(np.flatnonzero(order == node)[0])
    return place_in(parts, at, 0.0) if at <= last else place_in(parts, last, 1.0)


def group_curve(mesh: LineMesh, beam: Beam) -> NurbsCurve:
    """Return the curve through the nodes of a beam's group, with one element per cell.

    Raises:
        ValueError: The group is not in the mesh, branches or falls apart, or has no such curve.
    """
    owner = f'Beam "{beam.name}"'
    assert beam.group is not None
    assert beam.degree is not None
    try:
        return mesh.curve(beam.group, beam.degree)
    except ValueError as error:
        raise ValueError(f"{owner}: {error}") from None


def node_row(mesh: SurfaceMesh, shell: Shell, marker: ShellLine) -> NodeRow:
    """Return the nodes along a line of a shell, and those of its triangles beside them.

    Where the line runs inside the shell, these are those of the first of both triangles.

    Args:
        mesh: The surface mesh.
        shell: The shell.
        marker: Names the line.

    Raises:
        ValueError: There is no such line, it branches or falls apart, or is not on the shell.
    """
    owner = f'ShellLine on "{marker.body}"'
    try:
        nodes = mesh.line_nodes(marker.line)
    except ValueError as error:
        raise ValueError(f"{owner}: {error}") from None
    rows = mesh.body_rows(shell.body)
    triangles = mesh.triangles[rows]
    sides = sides_along(triangles, np.stack([nodes[:-1], nodes[1:]], axis=1), len(mesh.points))
    if (sides < 0).any():
        raise ValueError(f'{owner}: line "{marker.line}" is not on this shell')
    at = 3 * rows[sides // 3] + sides % 3
    beside, slopes = line_slopes(mesh, at)
    reverse = mesh.triangles.ravel()[3 * (at // 3) + (at + 1) % 3] != nodes[:-1]
    return NodeRow(
        name=f'line "{marker.line}" of Shell "{marker.body}"',
        body=marker.body,
        nodes=nodes,
        points=mesh.points[nodes],
        apexes=triangles.ravel()[sides],
        stiffness=line_stiffness(mesh, shell, at),
        damping=shell.damping,
        beside=mesh.triangles[beside],
        slopes=np.where(reverse[:, np.newaxis], 1.0 - slopes, slopes),
    )


def _point(beam: Beam, marker: Marker) -> str | float:
    """Return the point of a marker on a beam."""
    if marker.point is None or isinstance(marker.point, tuple):
        raise ValueError(
            f'Marker on "{beam.name}": a beam needs a point: a point group, "start", "end" or a '
            f"fraction, got {marker.point}"
        )
    return marker.point


def beam_cell(mesh: LineMesh, beam: Beam, fraction: float) -> tuple[int, int]:
    """Return the mesh nodes of the element whose middle is nearest to a fraction of the length.

    Raises:
        ValueError: The line branches or falls apart.
    """
    assert beam.group is not None
    nodes = mesh.order(beam.group)
    if nodes is None:
        raise ValueError(f'fraction {fraction}: group "{beam.group}" branches or falls apart')
    length = arc_length(mesh.points[nodes])
    middle = 0.5 * (length[1:] + length[:-1])
    at = int(np.argmin(np.abs(middle - fraction * length[-1])))
    return int(nodes[at]), int(nodes[at + 1])


def _group_node(mesh: LineMesh, beam: Beam, point: str) -> int:
    """Return the node of a point group on a beam."""
    owner = f'Marker on "{beam.name}"'
    assert beam.group is not None
    cells = mesh.group_cells(beam.group)
    if point not in mesh.point_groups:
        nodes = set(cells.ravel().tolist())
        known = [name for name, node in mesh.point_groups.items() if node in nodes]
        raise ValueError(
            f'{owner}: point group "{point}" is not in the mesh; the beam has '
            f"{_checks.show(', '.join([*known, *LINE_ENDS]), 200)}"
        )
    node = mesh.point_groups[point]
    if not (cells == node).any():
        raise ValueError(f'{owner}: point group "{point}" (node {node}) is not on this beam')
    return node


def _ordered(mesh: LineMesh, beam: Beam, owner: str, point: str | float) -> IntArray:
    """Return the nodes of a beam in order."""
    assert beam.group is not None
    nodes = mesh.order(beam.group)
    if nodes is None:
        what = f'"{point}"' if isinstance(point, str) else str(point)
        raise ValueError(
            f'{owner}: point {what}: group "{beam.group}" branches or falls apart; '
            "name a point group"
        )
    return nodes
