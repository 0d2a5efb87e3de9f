# SPDX-License-Identifier: LGPL-3.0-or-later
"""Stiffness of contacts that are closed or may soon close."""

from collections.abc import Sequence

import numpy as np

from flexfem._types import FloatArray
from flexfem.contact.carriers import Carriers
from flexfem.contact.frames import SurfaceFrames
from flexfem.contact.group import ContactGroup
from flexfem.lie import se3

__all__ = ["stiffness_nearby"]


def stiffness_nearby(
    groups: Sequence[ContactGroup], points: FloatArray, carriers: Carriers, frames: SurfaceFrames,
    kind: int,
) -> FloatArray:  # fmt: skip
    """Return bounds of the sums of rows that contacts add at the nodes of a block (collective).

    Args:
        groups: all contacts.
        points: positions of the points here and nearby, m, (n, 3).
        carriers: carriers of these points.
        frames: frames of the rigid surfaces of simple shapes.
        kind: kind of the block.

    Returns:
        Bounds for translations, N/m, and for rotations, N m, shape (n_owned, 6).
    """
    total = np.zeros((len(points), 3))
    wrenches = np.zeros((len(frames.frames), 6))
    number = 0
    for group in groups:
        for rigid in group.rigid:
            frame, slaves = frames.frames[number], rigid.slaves
            close = rigid.distances(points, frame) < group.surfaces.skin
            nodes, k = slaves.nodes[close], slaves.stiffness[close]
            np.add.at(total[:, 0], nodes, k)
            arms = np.linalg.norm(points[nodes] - se3.position(frame), axis=1)
            wrenches[number] += np.repeat(
                [(k * (1 + arms)).sum(), (k * arms * (1 + arms)).sum()], 3
            )
            number += 1
        for made in group.triangles:
            candidates, slaves = made.candidates, made.slaves
            row = np.repeat(np.arange(len(slaves.nodes)), np.diff(candidates.starts))
            most = np.zeros(len(total))
            most[slaves.nodes[row]] = slaves.stiffness[row]
            corners = made.masters.triangles[candidates.triangles]
            np.maximum.at(most, corners, slaves.stiffness[row][:, np.newaxis])
            # slaves of several ranks are near a corner: the stiffest counts once, not on each rank
            total[:, 0] += carriers.largest(most)
    carriers.gather(total)
    return _at_nodes(total[:, 0], carriers, frames, wrenches, kind)


def _at_nodes(
    total: FloatArray, carriers: Carriers, frames: SurfaceFrames, wrenches: FloatArray, kind: int
) -> FloatArray:
    """Sums over the points and surfaces of each node of a block (collective)."""
    frames.wrenches[:] = wrenches
    frames.gather()
    block = frames.block(kind)
    carried = kind in carriers.by_kind
    found = carriers.at_nodes(kind, total) if carried else np.zeros((block.owned, 6))
    for node, wrench in frames.sums(kind):
        found[node] += wrench
    return found
