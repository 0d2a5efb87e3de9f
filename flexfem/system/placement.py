# SPDX-License-Identifier: LGPL-3.0-or-later
"""Where bodies, joints and their nodes live: computed alike on every rank from the serial model."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from flexfem._types import IntArray
from flexfem.core.joint import Joint
from flexfem.core.marker import Marker
from flexfem.mesh.partition import partition_bodies, strips
from flexfem.mesh.surface_mesh import SurfaceMesh
from flexfem.model.bodies import Beam
from flexfem.model.model import Model

__all__ = [
    "BEAMS", "FLOATING", "KINDS", "NURBS", "RIGID", "SHELLS", "NodeKey", "Placement", "place",
]  # fmt: skip

#: Kinds of blocks in the order of the nest: SE(3) beams, NURBS beams, shells, rigid bodies, bodies
#: in floating frames.
BEAMS, NURBS, SHELLS, RIGID, FLOATING = KINDS = range(5)

#: What costs as much as an element of a beam in a step, measured on chains, sheets and reduced
#: bars: the third of a triangle of a shell, so many products of coordinates in a floating frame.
_TRIANGLE, _PRODUCTS = 3, 12
#: Rows that one common node of two shells counts: on two ranks both have one matrix.
_SEAM = 12

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


def place(
    model: Model, joints: Sequence[tuple[Joint, int]], ranks: int, split_above: int
) -> Placement:
    """Distribute a model over ranks: bodies whole unless larger than ``split_above`` elements.

    Args:
        model: the model.
        joints: its joints, each with its number of rows.
        ranks: number of ranks.
        split_above: a body may be split if it has more elements than this, and is larger than a
            rank's share.
    """
    sizes = _sizes(model)
    hosts = _hosts(model, [joint for joint, _ in joints])
    own = [name for name in sizes if name not in hosts]
    numbers = {name: number for number, name in enumerate(own)}
    numbers |= {name: numbers[host] for name, host in hosts.items()}
    elements, weights = [sizes[name][0] for name in own], [sizes[name][1] for name in own]
    found = partition_bodies(elements, weights, _links(model, numbers, joints), ranks, split_above)
    rank = {name: found[numbers[name]] for name in sizes}
    triangles = np.empty(0, dtype=np.int64)
    body_ranks = {
        name: tuple(np.unique(on[: 1 if name in hosts else None]).tolist())
        for name, on in rank.items()
    }
    if model.surface is not None:
        triangles = np.empty(len(model.surface.triangles), dtype=np.int64)
        for shell in model.shells:
            rows = model.surface.bodies[shell.body]
            triangles[rows] = strips(model.surface, rows, rank[shell.name])
        for shell in model.shells:
            rows = model.surface.bodies[shell.body]
            body_ranks[shell.name] = _node_ranks(model.surface, rows, triangles)
    return Placement(
        cells=[rank[beam.name] for beam in model.beams],
        numbers={beam.name: i for i, beam in enumerate(model.beams)},
        triangles=triangles,
        rigid=_single(rank, [body.name for body in model.rigid_bodies]),
        floating=_single(rank, [body.name for body in model.floating_bodies]),
        body_ranks=body_ranks,
    )


def _single(rank: Mapping[str, IntArray], names: Sequence[str]) -> IntArray:
    """Ranks of bodies of one element."""
    return np.array([rank[name][0] for name in names], dtype=np.int64)


def _sizes(model: Model) -> dict[str, tuple[int, int]]:
    """Elements of every body, and what one of them costs in elements of a beam."""
    sizes = dict[str, tuple[int, int]]()
    for beam, cells in zip(model.beams, model.weights().tolist(), strict=True):
        sizes[beam.name] = cells, 1
    for shell in model.shells:
        assert model.surface is not None  # checked by validate()
        sizes[shell.name] = len(model.surface.bodies[shell.body]), _TRIANGLE
    for rigid in model.rigid_bodies:
        sizes[rigid.name] = 1, 1
    for floating in model.floating_bodies:
        sizes[floating.name] = 1, max(floating.reduced.size**2 // _PRODUCTS, 1)
    return sizes


def _hosts(model: Model, joints: Sequence[Joint]) -> dict[str, str]:
    """Rigid bodies with the first flexible body that each is joined to, and costs nothing beside.

    They stay together: of a small body not even its joint is worth an exchange.
    """
    rigid = {body.name for body in model.rigid_bodies}
    hosts = dict[str, str]()
    for joint in joints:
        names = [marker.body for marker in joint.markers if isinstance(marker, Marker)]
        flexible = [name for name in names if name not in rigid]
        for name in names:
            if flexible and name in rigid:
                hosts.setdefault(name, flexible[0])
    return hosts


def _links(
    model: Model, numbers: Mapping[str, int], joints: Sequence[tuple[Joint, int]]
) -> dict[tuple[int, int], int]:
    """Rows between two bodies: those of their joints, and unknowns at nodes that shells share."""
    links = dict[tuple[int, int], int]()
    for joint, rows in joints:
        bodies = {numbers[marker.body] for marker in joint.markers if isinstance(marker, Marker)}
        for pair in combinations(sorted(bodies), 2):
            links[pair] = links.get(pair, 0) + rows
    for shells, nodes in _common_nodes(model).items():
        first, second = sorted(numbers[name] for name in shells)
        links[first, second] = links.get((first, second), 0) + _SEAM * nodes
    return links


def _common_nodes(model: Model) -> dict[tuple[str, str], int]:
    """How many nodes two shells share."""
    found = dict[tuple[str, str], int]()
    if model.surface is None:
        return found
    shells = dict[int, list[str]]()
    for shell in model.shells:
        rows = model.surface.bodies[shell.body]
        for node in np.unique(model.surface.triangles[rows]).tolist():
            shells.setdefault(node, []).append(shell.name)
    for names in shells.values():
        for pair in combinations(names, 2):
            found[pair] = found.get(pair, 0) + 1
    return found


def _node_ranks(mesh: SurfaceMesh, rows: IntArray, triangles: IntArray) -> tuple[int, ...]:
    """Ranks that may own nodes of some triangles: those of all triangles at these nodes."""
    touched = np.zeros(len(mesh.points), dtype=np.bool_)
    touched[mesh.triangles[rows]] = True
    near = touched[mesh.triangles].any(axis=1)
    return tuple(int(rank) for rank in np.unique(triangles[near]))
