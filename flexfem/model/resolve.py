# SPDX-License-Identifier: LGPL-3.0-or-later
"""Where markers on beams are on the mesh."""

import numpy as np

from flexfem import _checks
from flexfem._types import IntArray
from flexfem.core.marker import LINE_ENDS, Marker
from flexfem.mesh.line_mesh import LineMesh
from flexfem.mesh.topology import arc_length
from flexfem.model.bodies import Beam


def beam_node(mesh: LineMesh, beam: Beam, marker: Marker) -> int:
    """Return the mesh node of a marker on a beam.

    Raises:
        ValueError: No point, a point group that is not on the beam, or an end or fraction of a
            line that has none because it is closed or branches.
    """
    owner = f'Marker on "{beam.name}"'
    point = marker.point
    if point is None:
        raise ValueError(
            f'{owner}: a beam needs a point: a point group, "start", "end" or a fraction, got None'
        )
    if isinstance(point, str) and point not in LINE_ENDS:
        return _group_node(mesh, beam, point)
    nodes = _ordered(mesh, beam, owner, point)
    if isinstance(point, str):
        if nodes[0] == nodes[-1]:
            raise ValueError(f'{owner}: point "{point}": the line is closed and has no ends')
        return int(nodes[0 if point == "start" else -1])
    length = arc_length(mesh.points[nodes])
    return int(nodes[np.argmin(np.abs(length - point * length[-1]))])


def beam_cell(mesh: LineMesh, beam: Beam, fraction: float) -> tuple[int, int]:
    """Return the mesh nodes of the element whose middle is nearest to a fraction of the length.

    Raises:
        ValueError: The line branches or falls apart.
    """
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
    nodes = mesh.order(beam.group)
    if nodes is None:
        what = f'"{point}"' if isinstance(point, str) else str(point)
        raise ValueError(
            f'{owner}: point {what}: group "{beam.group}" branches or falls apart; '
            "name a point group"
        )
    return nodes
