# SPDX-License-Identifier: LGPL-3.0-or-later
"""Check of contact at the start: surfaces that intersect or penetrate too deeply."""

from collections.abc import Sequence

import numpy as np

from flexfem._types import IntArray
from flexfem.contact.detection.neighbours import rings
from flexfem.contact.obstacles.overlaps import (
    contact_at_start,
    deepest_start,
    first_crossing,
    winding_numbers,
)
from flexfem.contact.obstacles.rigid_surface import RigidContact
from flexfem.contact.pairs import ContactPass, ContactSurfaces
from flexfem.contact.points import RINGS, ContactPoints
from flexfem.model.rigid_surface import RigidMesh

__all__ = ["check_start"]

#: Advice for all of these errors.
_APART = "move them apart, or make the contact thinner"


def check_start(points: ContactPoints, described: Sequence[ContactSurfaces]) -> None:
    """Check all contacts of a model.

    Raises:
        ValueError: surfaces that intersect or penetrate too deeply.
    """
    for one in described:
        owner = f'Contact "{one.contact.name}"'
        for each in one.passes:
            _check_crossing(points, owner, each)
            _check_depth(points, owner, one, each)
        _check_inside(points, owner, one)
        _check_rigid(points, owner, one)


def _check_depth(
    points: ContactPoints, owner: str, one: ContactSurfaces, each: ContactPass
) -> None:
    """Raise if slaves of a pass penetrate too deeply."""
    made = contact_at_start(
        points.start, each.slaves, each.masters, each.chosen, each.excluded, one.skin
    )
    part, node, triangle = deepest_start(made)
    if part > each.deep:
        raise ValueError(
            f"{owner}: at the start {_body(points, node)} penetrates "
            f"{points.names[points.body[triangle]]} by {made.deepest:g} m at "
            f"{_place(points, node)}, more than half of the distance at which they touch; {_APART}"
        )


def _check_crossing(points: ContactPoints, owner: str, each: ContactPass) -> None:
    """Raise if an edge of the slaves intersects a master triangle."""
    slave = np.zeros(len(points.start), dtype=np.bool_)
    slave[each.slaves.nodes] = True
    edges = np.concatenate([points.edges, points.parents])
    own = edges[slave[edges].all(axis=1)]
    near = rings(points.masters.triangles, own[:, 0], RINGS, points.joined)
    edge, triangle = first_crossing(points.start, own, points.masters.triangles[each.chosen], near)
    if edge >= 0:
        a, b = own[edge].tolist()
        other = points.names[points.body[each.chosen[triangle]]]
        raise ValueError(
            f"{owner}: at the start {_body(points, a)} intersects {other} between nodes "
            f"{_number(points, a)} and {_number(points, b)}; {_APART}"
        )


def _check_inside(points: ContactPoints, owner: str, one: ContactSurfaces) -> None:
    """Raise if slaves are on the wrong side of a closed mesh.

    No edge crosses it, so that one node of each part suffices.
    """
    triangles = points.masters.triangles
    for surface in one.contact.surfaces:
        if not isinstance(surface, RigidMesh) or surface.two_sided:
            continue
        rows = points.triangles_of[id(surface)]
        nodes = _one_of_each(points, one.slaves.nodes)
        turns = winding_numbers(points.start[nodes], points.start[triangles[rows]])
        wrong = (np.abs(turns) < 0.5) if surface.inside else (turns > 0.5)
        # within half of a thickness of the surface the side is not checked
        if wrong.any():
            node = int(nodes[np.argmax(wrong)])
            where = "outside" if surface.inside else "inside"
            raise ValueError(
                f"{owner}: at the start {_body(points, node)} is {where} of "
                f"{points.names[points.body[rows[0]]]} at {_place(points, node)}; {_APART}"
            )


def _one_of_each(points: ContactPoints, slaves: IntArray) -> IntArray:
    """One of the slaves of each connected part and of each beam."""
    part = np.full(len(points.start), -1)
    part[points.masters.triangles] = points.masters.parts[:, np.newaxis]
    part[part < 0] = len(points.masters.parts) + points.owner[part < 0]
    return slaves[np.unique(part[slaves], return_index=True)[1]]


def _check_rigid(points: ContactPoints, owner: str, one: ContactSurfaces) -> None:
    """Raise if slaves penetrate rigid surfaces of simple shapes too deeply."""
    for place in one.rigid:
        if not len(one.slaves.nodes):
            continue
        gaps = RigidContact(one.slaves, place.shape).distances(points.start, place.start)
        parts = gaps / np.maximum(one.slaves.offsets, 1e-300)
        worst = int(np.argmin(parts))
        if parts[worst] < -1.0:
            node = int(one.slaves.nodes[worst])
            raise ValueError(
                f"{owner}: at the start {_body(points, node)} penetrates a rigid "
                f"{place.shape.kind.name.lower()} by {-gaps[worst]:g} m at "
                f"{_place(points, node)}, more than half of its thickness; {_APART}"
            )


def _body(points: ContactPoints, node: int) -> str:
    return points.names[int(points.owner[node])]


def _place(points: ContactPoints, node: int) -> str:
    """Number and position of a point, for messages."""
    x, y, z = points.start[node].tolist()
    return f"node {_number(points, node)} at ({x:.6g}, {y:.6g}, {z:.6g}) m"


def _number(points: ContactPoints, node: int) -> int:
    """Number of a point in its mesh; that of the next node for points between nodes."""
    if node >= points.carried:
        node = int(points.parents[node - points.carried, 0])
    if points.names[points.owner[node]].startswith("RigidMesh"):
        return node - int(np.argmax(points.owner == points.owner[node]))
    return int(points.node[node])
