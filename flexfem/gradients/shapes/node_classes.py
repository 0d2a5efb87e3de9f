# SPDX-License-Identifier: LGPL-3.0-or-later
"""Nodes of a mesh that are moved together, since no equation depends on two of them.

Moving a node changes the equations of the nodes around it, those of rows of joints that are tied to
these, and columns that are measured there. Nodes far enough apart may be moved together, in one
model, whose changes then belong to one of them each (Curtis, Powell, Reid, J. Inst. Math. Appl. 13
(1974) 117-119). A greedy colouring in the order of the nodes makes classes of them, whose number
depends on how many elements meet, not on the number of nodes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mpi4py import MPI

import numpy as np
from scipy.sparse import csr_array, eye_array, hstack

from flexfem._checks import InputError
from flexfem._types import FloatArray, IntArray
from flexfem.gradients.equations.values import Equations
from flexfem.gradients.motion.parameters import NodePath
from flexfem.model.model import Model
from flexfem.model.probes.base import Probe
from flexfem.system.measure.probes import ProbeRecorder
from flexfem.system.system import System

__all__ = ["NodeClasses", "Owners"]

#: Message, by the path.
_FAR = (
    'gradient: "{}" changes equations or columns far from its nodes, as the frames along curved '
    "beams without orientation do, and means over regions; it has no derivatives there yet"
)

#: Most elements between a moved node and equations that depend on it: frames of sections and
#: directors of shells have mean directions of the elements around.
_REACH = 4
#: Distance of nodes of bodies from those of the mesh that they are, over the size of the mesh.
_SAME = 1e-9
#: Part of the largest change of an equation below which it does not depend on a node.
_NOTHING = 1e-9
#: Largest deviation of changes that are put together from those of all nodes at once.
_WHOLE = 1e-5
#: Errors of differences over the sizes of what is added up.
_LEFT = 1e-7


@dataclass(frozen=True)
class Owners:
    """Which moved node of a class each equation of this rank depends on, -1 for none.

    Attributes:
        nodes: (n,) moved nodes, by their places in the group.
        blocks: for each block, (n_local,) of the equations of its nodes.
        rows: (r,) of the rows.
        probes: (p,) of the probes that are functions of markers; those of others are -1.
    """

    nodes: IntArray
    blocks: list[IntArray]
    rows: IntArray
    probes: IntArray

    @classmethod
    def everything(cls, system: System, model: Model) -> Owners:
        """All nodes and columns as those of one node."""
        blocks = [np.zeros(len(part.block.frames), dtype=np.int64) for part in system.parts]
        rows = np.zeros(system.constraints.size, dtype=np.int64)
        probes = np.zeros(len(model.probes), dtype=np.int64)
        return cls(np.zeros(1, dtype=np.int64), blocks, rows, probes)

    def of_elements(self, block: int, support: IntArray) -> IntArray:
        """Owners (m,) of elements with these nodes (m, k), -1 for fewer: of all their nodes."""
        there = support >= 0
        own = np.where(there, self.blocks[block][support], -2)
        first = own.max(axis=1, initial=-2)
        alike = ((own == first[:, np.newaxis]) | ~there).all(axis=1)
        return np.where(alike & (first >= 0), first, -1)


class NodeClasses:
    """Classes of the nodes of a group.

    Attributes:
        nodes: the path.
        places: (n, 3) of the nodes, m.
        lengths: (n,) distances to their nearest neighbours, m.
        axes: numbers of the axes along which they may move, of plane figures only two.
    """

    def __init__(
        self, nodes: NodePath, model: Model, system: System, recorder: ProbeRecorder
    ) -> None:
        """Find what the nodes are tied to (collective).

        Raises:
            InputError: there are no elements at the nodes, or joints with markers on lines.
        """
        self.nodes, self._system = nodes, system
        mesh, chosen = nodes.mesh(model), nodes.nodes(model)
        self.places = mesh.points[chosen]
        self.axes = (0, 1, 2) if getattr(mesh, "dimension", 3) == 3 else (0, 1)
        if any(system.comm.allgather(bool(system.constraints.lines.joints))):
            raise InputError(
                f'gradient: "{nodes.path}": there are no derivatives by nodes with joints on lines '
                "yet"
            )
        families = [part.family for part in system.parts]
        self._first = np.cumsum([0, *(len(family.frames) for family in families)])
        patches, found = [], np.zeros((len(chosen), 0))
        self._same = _SAME * float(np.ptp(mesh.points, axis=0).max())
        every = []
        for family, first in zip(families, self._first, strict=False):
            own = family.patches()
            elastic = own.shape[1] > 1
            patches += [row[row >= 0] + first for row in own] if elastic else []
            x = family.frames[:, :3]
            same = np.linalg.norm(x - self.places[:, np.newaxis], axis=2) <= self._same
            every.append(same & elastic)
        found = np.hstack(every)
        if not found.any(axis=1).all():
            at = int(np.argmin(found.any(axis=1)))
            raise InputError(
                f'gradient: "{nodes.path}": no element of a body is at its node {chosen[at]}'
            )
        self._rows, self._row = self._tied()
        self._probes = self._measured(model, recorder)
        total = int(self._first[-1])
        incidence = _incidence([*patches, *self._rows], total)
        self._near = csr_array((incidence.T @ incidence + eye_array(total)) > 0)
        self._start = csr_array(found)
        self.lengths = self._lengths(np.concatenate([f.frames[:, :3] for f in families]))

    @property
    def count(self) -> int:
        """Number of coordinates of all nodes."""
        return self.places.size

    def _lengths(self, x: FloatArray) -> FloatArray:
        """See the class."""
        found = np.empty(len(self.places))
        for k, place in enumerate(self.places):
            around = (self._start[[k]] @ self._near).indices
            away = np.linalg.norm(x[around] - place, axis=1)
            found[k] = away[away > self._same].min(initial=np.inf)
        return found

    def _tied(self) -> tuple[list[IntArray], IntArray]:
        """Nodes of the rows of joints on all ranks, and which of these each row here has."""
        rows = self._system.constraints
        first = {part.kind: own for part, own in zip(self._system.parts, self._first, strict=False)}
        own = np.array([first[kind] + node for kind, node in rows.interface.keys], dtype=np.int64)
        sets: list[tuple[int, ...]] = []
        for row in range(rows.size):
            sets.append(tuple(np.unique(own[rows.nodes_of(np.array([row]))]).tolist()))
        gathered = self._system.comm.allgather(sorted(set(sets)))
        every = sorted({one for part in gathered for one in part})
        number = {one: k for k, one in enumerate(every)}
        found = [np.array(one, dtype=np.int64) for one in every]
        return found, np.array([number[one] for one in sets], dtype=np.int64)

    def _measured(self, model: Model, recorder: ProbeRecorder) -> list[IntArray]:
        """Nodes of the markers of each probe, none of probes without."""
        count, first = 0, []
        for probe in model.probes:
            first.append(count)
            count += len(probe.markers)
        own: list[set[int]] = [set() for _ in range(count)]
        for k, (block, nodes, _, places) in enumerate(recorder.sources):
            for node, place in zip(nodes, places, strict=True):
                own[place].add(int(self._first[k] + block.node_ids[node]))
        blocks = [part.block for part in self._system.parts]
        for one in recorder.inside:
            k = next(k for k, block in enumerate(blocks) if block is one.block)
            for nodes, place in zip(one.points.nodes, one.places, strict=True):
                own[place].update((self._first[k] + one.block.node_ids[nodes]).tolist())
        parts = self._system.comm.allgather(own)
        every = [set[int]().union(*(part[k] for part in parts)) for k in range(count)]
        found = []
        for probe, at in zip(model.probes, first, strict=True):
            markers = len(probe.markers) if isinstance(probe, Probe) else 0
            nodes_of = set[int]().union(*every[at : at + markers])
            found.append(np.array(sorted(nodes_of), dtype=np.int64))
        return found

    def at_random(self, nodes: IntArray) -> FloatArray:
        """Displacements (n, 3) at random, zero of others than some nodes."""
        by, axes = np.zeros(self.places.shape), np.array(self.axes)
        random = np.random.default_rng(4)
        by[np.ix_(nodes, axes)] = random.standard_normal((len(nodes), len(axes)))
        return by

    def apart(self) -> IntArray:
        """Some nodes that are so far apart that what one of them changes is no other's."""
        near, chosen = self._start, list[int]()
        for _ in range(2 * _REACH + 1):
            near = _spread(near, self._near)
        taken = np.zeros(near.shape[1], dtype=np.bool_)
        for k in range(len(self.places)):
            if not taken[self._start[[k]].indices].any():
                chosen.append(k)
                taken[near[[k]].indices] = True
        return np.array(chosen)

    def reach(self, moved: IntArray, changes: Equations) -> int:
        """Elements between moved nodes and equations that they change (collective).

        Args:
            moved: places of the moved nodes in the group.
            changes: of equations.

        Raises:
            InputError: there are too many.
        """
        comm, parts = self._system.comm, self._system.parts
        sizes = [np.abs(own).max(axis=1, initial=0.0) for own in changes[0]]
        rows = np.abs(changes[1])
        own = [max((float(one.max(initial=0.0)) for one in sizes), default=0.0),
               float(rows.max(initial=0.0))]  # fmt: skip
        most = _NOTHING * np.max(comm.allgather(own), axis=0)
        seen = np.zeros(self._near.shape[0], dtype=np.bool_)
        for first, part, one in zip(self._first, parts, sizes, strict=False):
            seen[first + part.block.node_ids[np.flatnonzero(one > most[0])]] = True
        for row in np.flatnonzero(rows > most[1]):
            seen[self._rows[self._row[row]]] = True
        everywhere = np.any(comm.allgather(seen), axis=0)
        near = csr_array(self._start[moved].sum(axis=0).reshape(1, -1) > 0)
        for reach in range(_REACH + 1):
            inside = np.zeros(len(seen), dtype=np.bool_)
            inside[near.indices] = True
            if not (everywhere & ~inside).any():
                return reach
            near = _spread(near, self._near)
        raise InputError(_FAR.format(self.nodes.path))

    def check(self, together: FloatArray, whole: FloatArray, size: FloatArray) -> None:
        """Compare changes (k,) by each node with those by all at once (collective).

        Args:
            together: this rank's part of the sums of those by each, along displacements of all.
            whole: of those by all, along the same displacements.
            size: of sizes of what is added up in them, of which rounding is left.

        Raises:
            InputError: they differ.
        """
        sums = np.array([together, whole, size])
        self._system.comm.Allreduce(MPI.IN_PLACE, sums)
        if (np.abs(sums[0] - sums[1]) > _WHOLE * np.abs(sums[1]) + _LEFT * sums[2]).any():
            raise InputError(_FAR.format(self.nodes.path))

    def classes(self, reach: int) -> list[Owners]:
        """Classes of nodes, with what each changes."""
        support = self._start
        for _ in range(reach):
            support = _spread(support, self._near)
        total = support.shape[1]
        ties = [csr_array(support @ _incidence(own, total).T > 0) if own else None
                for own in (self._rows, self._probes)]  # fmt: skip
        every = csr_array(hstack([support, *(one for one in ties if one is not None)]))
        class_of = _coloured(csr_array(every @ every.T > 0))
        rows = total + np.arange(len(self._rows))
        probes = total + len(rows) + np.arange(len(self._probes))
        found = []
        for k in range(class_of.max() + 1):
            nodes = np.flatnonzero(class_of == k)
            owner = np.full(every.shape[1], -1)
            own = every[nodes].tocoo()
            owner[own.col] = nodes[own.row]
            found.append(
                Owners(nodes, self._of_blocks(owner), owner[rows[self._row]], owner[probes])
            )
        return found

    def _of_blocks(self, owner: IntArray) -> list[IntArray]:
        """Owners of the equations of the nodes of each block here."""
        return [
            owner[first + part.block.node_ids]
            for first, part in zip(self._first, self._system.parts, strict=False)
        ]


def _incidence(sets: Sequence[IntArray], count: int) -> csr_array:
    """(sets, count) True for members."""
    at = np.repeat(np.arange(len(sets)), [len(one) for one in sets])
    members = np.concatenate([np.empty(0, np.int64), *sets])
    return csr_array((np.ones(len(at)), (at, members)), shape=(len(sets), count))


def _spread(support: csr_array, near: csr_array) -> csr_array:
    """Nodes one element farther."""
    return csr_array(support @ near > 0)


def _coloured(conflicts: csr_array) -> IntArray:
    """(n,) class of each, greedily in their order, so that no two in conflict share one."""
    found = np.full(conflicts.shape[0], -1)
    for k in range(len(found)):
        around = found[conflicts.indices[conflicts.indptr[k] : conflicts.indptr[k + 1]]]
        taken = np.unique(around[around >= 0])
        free = np.flatnonzero(taken != np.arange(len(taken)))
        found[k] = free[0] if len(free) else len(taken)
    return found
