# SPDX-License-Identifier: LGPL-3.0-or-later
"""Where bodies, joints and their nodes live: computed alike on every rank from the serial model."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexfem._types import IntArray
from flexfem.core.joint import Joint
from flexfem.core.marker import Marker
from flexfem.mesh.partition import partition_bodies, partition_surface
from flexfem.mesh.surface_mesh import SurfaceMesh
from flexfem.model.bodies import Beam
from flexfem.model.model import Model

__all__ = [
    "BEAMS", "FLOATING", "KINDS", "NURBS", "RIGID", "SHELLS", "NodeKey", "Placement", "place",
]  # fmt: skip

#: Kinds of blocks in the order of the nest: SE(3) beams, NURBS beams, shells, rigid bodies, bodies
#: in floating frames.
BEAMS, NURBS, SHELLS, RIGID, FLOATING = KINDS = range(5)

#: kind of block and index of a node in the block's input order
NodeKey = tuple[int, int]


@dataclass(frozen=True)
class Placement:
    """Distribution of a model.

    Attributes:
        cells: rank of each element of every beam, beams in the model's order.
        numbers: place of a beam in that order, by its name.
        triangles: rank of each triangle of the surface mesh.
        rigid: rank of each rigid body.
        floating: rank of each body in a floating frame.
        body_ranks: ranks that hold a part of a body, by body name, ascending.
    """

    cells: list[IntArray]
    numbers: dict[str, int]
    triangles: IntArray
    rigid: IntArray
    floating: IntArray
    body_ranks: dict[str, tuple[int, ...]]

    def cells_of(self, beams: Sequence[Beam]) -> list[IntArray]:
        """Ranks of the elements of some beams."""
        return [self.cells[self.numbers[beam.name]] for beam in beams]

    def joint_ranks(self, joint: Joint) -> tuple[int, ...]:
        """Ranks that evaluate a joint, ascending; its multipliers belong to the first of them."""
        ranks: set[int] = set()
        for marker in joint.markers:
            if isinstance(marker, Marker):
                ranks.update(self.body_ranks[marker.body])
        return tuple(sorted(ranks))


def place(model: Model, ranks: int, split_above: int) -> Placement:
    """Distribute a model over ranks: bodies whole unless larger than ``split_above`` cells."""
    cells = partition_bodies(model.weights(), ranks, split_above)
    body_ranks = {
        beam.name: tuple(int(r) for r in np.unique(destination))
        for beam, destination in zip(model.beams, cells, strict=True)
    }
    triangles = np.empty(0, dtype=np.int64)
    if model.surface is not None:
        triangles = partition_surface(model.surface, ranks, split_above)
        for shell in model.shells:
            rows = model.surface.bodies[shell.body]
            body_ranks[shell.name] = _node_ranks(model.surface, rows, triangles)
    floating = _shared_out([body.reduced.size for body in model.floating_bodies], ranks)
    for body, rank in zip(model.floating_bodies, floating.tolist(), strict=True):
        body_ranks[body.name] = (rank,)
    partner: dict[str, int] = {}
    for joint in model.joints:
        names = [m.body for m in joint.markers if isinstance(m, Marker)]
        flexible = [name for name in names if name in body_ranks]
        for name in names:
            if flexible and name not in body_ranks:
                partner.setdefault(name, body_ranks[flexible[0]][0])
    count = len(model.rigid_bodies)
    rigid = np.array(
        [partner.get(b.name, i * ranks // count) for i, b in enumerate(model.rigid_bodies)],
        dtype=np.int64,
    )
    for rigid_body, rank in zip(model.rigid_bodies, rigid.tolist(), strict=True):
        body_ranks[rigid_body.name] = (rank,)
    numbers = {beam.name: i for i, beam in enumerate(model.beams)}
    return Placement(cells, numbers, triangles, rigid, floating, body_ranks)


def _shared_out(sizes: Sequence[int], ranks: int) -> IntArray:
    """Rank of each body: neighbours in number together, the same total of squares on each.

    The cost of a body in a floating frame grows with the square of its coordinates.
    """
    weight = np.array(sizes, dtype=np.float64) ** 2
    middle = np.cumsum(weight) - 0.5 * weight
    return np.minimum(middle * ranks / max(weight.sum(), 1.0), ranks - 1).astype(np.int64)


def _node_ranks(mesh: SurfaceMesh, rows: IntArray, triangles: IntArray) -> tuple[int, ...]:
    """Ranks that may own nodes of some triangles: those of all triangles at these nodes."""
    touched = np.zeros(len(mesh.points), dtype=np.bool_)
    touched[mesh.triangles[rows]] = True
    near = touched[mesh.triangles].any(axis=1)
    return tuple(int(rank) for rank in np.unique(triangles[near]))
