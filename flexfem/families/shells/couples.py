# SPDX-License-Identifier: LGPL-3.0-or-later
"""Moments and follower forces on shells, as wrenches on the triangles of this rank.

The axes of a triangle rotate with its three corners (``core.places.surface_points``), about its
normal as well. A moment is a couple of forces on them, whose sum is zero and whose moment is exact
in any deformation. That at a node acts on the triangles around it, in proportion to their areas at
the start.
"""

from collections.abc import Iterator

import numpy as np

from flexfem._types import FloatArray, IndexArray, IntArray
from flexfem.core.load import NOTHING, Load
from flexfem.core.marker import Marker
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.core.places.line_points import SIDES
from flexfem.layout.line_loads import LineForce
from flexfem.layout.lines import ElementPlace
from flexfem.layout.node_key import NodeKey
from flexfem.layout.numbered_model import NumberedModel
from flexfem.layout.surface_places import TRIANGLE_SIDES
from flexfem.lie import se3
from flexfem.loads.edge_load import EdgeLoad
from flexfem.mesh.surface_mesh import SurfaceMesh
from flexfem.mesh.triangles.topology import sides_along

__all__ = ["shell_couples"]

#: Moment that rotates an edge towards the normal, in axes along the edge, inwards and normal.
_UPWARDS = np.array([-1.0, 0.0, 0.0])


def shell_couples(
    serial: NumberedModel, kind: int, block: FrameBlock, carriers: IndexArray
) -> list[LineForce]:
    """Moments and follower forces on the triangles that this rank owns.

    Args:
        serial: serial data of the model.
        kind: number of the family of shells.
        block: nodes of the shells.
        carriers: (m, 3) local corners of these triangles, or (m, 6) with midside nodes.
    """
    found: list[LineForce] = []
    for number, load in enumerate(serial.model.loads):
        if isinstance(load, EdgeLoad) and load.moment_per_length:
            found += _edge_moments(serial, kind, load, number)
        elif load.follower or load.has_moment:
            for marker in load.markers:
                key = None if serial.place(marker) else serial.key(marker)
                if key is not None and key[0] == kind:
                    found += _at_node(serial, load, marker, key, number)
    if not found:
        return []
    own = {tuple(nodes) for nodes in np.sort(block.node_ids[carriers[:, :3]], axis=1).tolist()}
    return [force for force in found if tuple(sorted(force.place.nodes.tolist())) in own]


def _mesh(serial: NumberedModel) -> SurfaceMesh:
    assert serial.model.surface is not None  # checked by validate()
    return serial.model.surface


def _triangle(kind: int, nodes: IntArray, row: int, weights: FloatArray) -> ElementPlace:
    """Point of the triangle with these corners, with the weights of its position."""
    shape = np.column_stack([weights, TRIANGLE_SIDES])
    return ElementPlace(
        kind=kind, nodes=nodes, cell=row, shape=shape, xi=0.0, element=SIDES,
        turns=np.empty((0, 9)),
    )  # fmt: skip


def _edge_moments(
    serial: NumberedModel, kind: int, load: EdgeLoad, number: int
) -> Iterator[LineForce]:
    """The moment of each edge on the triangle beside it, whose first side it is."""
    mesh = _mesh(serial)
    rows = mesh.bodies[serial.model[load.shell].body]
    triangles = mesh.triangles[rows]
    still = se3.frame(np.zeros(3), np.eye(3))
    for side in sides_along(triangles, mesh.lines[load.line], len(mesh.points)).tolist():
        apex = side % 3
        nodes = np.roll(triangles[side // 3], -apex - 1)
        length = float(np.linalg.norm(mesh.points[nodes[1]] - mesh.points[nodes[0]]))
        place = _triangle(kind, nodes, int(rows[side // 3]), np.array([0.5, 0.5, 0.0]))
        moment = load.moment_per_length * length * _UPWARDS
        yield LineForce(place, still, NOTHING, moment, True, number)


def _at_node(
    serial: NumberedModel, load: Load, marker: Marker, key: NodeKey, number: int
) -> Iterator[LineForce]:
    """Shares of a load at a node, one for each triangle of its shell around it."""
    mesh, (force, moment), (kind, node) = _mesh(serial), load.wrench, key
    rows = mesh.bodies[serial.model[marker.body].body]
    around = rows[(mesh.triangles[rows] == node).any(axis=1)]
    corners = mesh.points[mesh.triangles[around]]
    sides = corners[:, 1:] - corners[:, :1]
    areas = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    for row, share in zip(around.tolist(), (areas / areas.sum()).tolist(), strict=True):
        nodes = mesh.triangles[row]
        place = _triangle(kind, nodes, row, (nodes == node).astype(np.float64))
        axes = se3.rotation(place.frame(serial.node_frames(kind)[nodes]))
        offset = se3.frame(np.zeros(3), axes.T @ marker.rotation)
        yield LineForce(place, offset, share * force, share * moment, load.follower, number)
