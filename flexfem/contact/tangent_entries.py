# SPDX-License-Identifier: LGPL-3.0-or-later
"""The tangents of contacts as entries of the blocks of the iteration matrix."""

from collections import defaultdict

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.contact.carriers import Carriers
from flexfem.contact.frames import SurfaceFrames
from flexfem.contact.points import GROUND
from flexfem.la.nest import block_indices
from flexfem.lie import so3

__all__ = ["ContactEntries", "Triplets"]

#: Rows, columns and values.
Triplets = tuple[IntArray, IntArray, FloatArray]


class ContactEntries:
    """Collection of tangents in inertial axes of points, converted to entries of blocks."""

    def __init__(self, carriers: Carriers, frames: SurfaceFrames | None = None) -> None:
        """Receive the axes of the carriers of points nearby (collective).

        ``frames`` are those of rigid surfaces of simple shapes, if there are any.
        """
        self._carriers, self._frames = carriers, frames
        self._turns = np.zeros((len(carriers.serial.start), 9))
        for one in carriers.by_kind.values():
            self._turns[one.rows] = one.block.frames[one.local, 3:]
        carriers.bring(self._turns)
        kinds = {**{kind: one.block.width for kind, one in carriers.by_kind.items()}, GROUND: 0}
        self._width = {kind: width for kind, width in kinds.items() if width}
        self._narrow = (
            set(self._width.values()) == {3} and not (carriers.serial.kind == GROUND).any()
        )
        self._found: dict[tuple[int, int], list[Triplets]] = defaultdict(list)

    def add(self, nodes: IntArray, blocks: FloatArray) -> None:
        """Add tangents (c, 3 w, 3 w) of contacts between points (c, w)."""
        nodes, blocks = self._between_carriers(nodes, blocks)
        count, width = nodes.shape
        J = self._maps(nodes)
        size = J.shape[-1]
        K = blocks.reshape(count, width, 3, width, 3)
        K = np.einsum("cpia,cpiqj,cqjb->cpaqb", J, K, J, optimize=True)
        held = self._carriers.serial.held[nodes][:, :, :size]
        K[np.broadcast_to(held[:, :, :, np.newaxis, np.newaxis], K.shape)] = 0.0
        K[np.broadcast_to(held[:, np.newaxis, np.newaxis], K.shape)] = 0.0
        if self._narrow:
            places = self._carriers.numbers[nodes]
            (kind,) = self._width
            self._put(kind, kind, places, places, K.reshape(count, 3 * width, 3 * width))
            return
        first = np.repeat(nodes, width, axis=1).ravel()
        second = np.tile(nodes, (1, width)).ravel()
        self._put_pairs(first, second, K.swapaxes(2, 3).reshape(-1, size, size))

    def add_surface(self, nodes: IntArray, blocks: FloatArray, surface: int) -> None:
        """Add tangents (c, 9, 9) of points (c,) and the twist of a surface."""
        assert self._frames is not None
        self.add(nodes[:, np.newaxis], np.ascontiguousarray(blocks[:, :3, :3]))
        kind = int(self._frames.kind[surface])
        if kind < 0 or not len(nodes):
            return
        T, number = self._frames.maps[surface], self._frames.numbers[surface]
        aside = blocks[:, :3, 3:] @ T, np.swapaxes(blocks[:, 3:, :3], 1, 2) @ T
        whole = (T.T @ blocks[:, 3:, 3:].sum(axis=0) @ T)[np.newaxis]
        one = np.array([[number]])
        self._put(kind, kind, one, one, whole)
        _, weights, parents = self._parents(nodes)
        J = self._maps(parents)
        held = self._carriers.serial.held[parents][:, :, : J.shape[-1]]
        for K, transposed in zip(aside, (False, True), strict=True):
            values = np.einsum("cp,cpia,cib->cpab", weights, J, K)
            values[held] = 0.0
            values = values.reshape(-1, *values.shape[2:])
            self._put_aside(parents.ravel(), values, number, kind, transposed=transposed)

    def add_turning(self, scale: float) -> None:
        """Add the change of the loads at the last evaluation with the rotation of their nodes."""
        for kind, one in self._carriers.by_kind.items():
            loaded = np.flatnonzero(one.loads.any(axis=1)) if one.turns else np.zeros(0, np.int64)
            if not len(loaded):
                continue
            K = np.zeros((len(loaded), 6, 6))
            K[:, :3, 3:] = scale * so3.skew(one.loads[loaded])
            K[:, 3:, 3:] = so3.skew(one.arms[loaded]) @ K[:, :3, 3:]
            held = self._carriers.serial.held[one.rows[loaded]]
            K[held[:, :, np.newaxis] | held[:, np.newaxis]] = 0.0
            places = self._carriers.numbers[one.rows[loaded]][:, np.newaxis]
            self._put(kind, kind, places, places, K)

    def entries(self) -> dict[tuple[int, int], Triplets]:
        """Rows, columns and values in the blocks of all pairs of kinds."""
        none = np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0)
        frames = self._frames
        moving = [] if frames is None else frames.kind[frames.moving].tolist()
        kinds = sorted({*self._width, *moving})
        result = {}
        for pair in ((i, j) for i in kinds for j in kinds):
            rows, columns, values = zip(none, *self._found[pair], strict=True)
            result[pair] = np.concatenate(rows), np.concatenate(columns), np.concatenate(values)
        return result

    def _parents(self, nodes: IntArray) -> tuple[bool, FloatArray, IntArray]:
        """Carriers (c, ..., q) of points (c, ...) with their weights."""
        serial = self._carriers.serial
        inner = nodes >= serial.carried
        if not inner.any():
            return False, np.ones((*nodes.shape, 1)), nodes[..., np.newaxis]
        width = serial.parents.shape[1]
        parents = np.repeat(nodes[..., np.newaxis], width, axis=-1)
        weights = np.zeros(parents.shape)
        weights[..., 0] = 1.0
        parents[inner] = serial.parents[nodes[inner] - serial.carried]
        weights[inner] = serial.weights[nodes[inner] - serial.carried]
        return True, weights, parents

    def _between_carriers(self, nodes: IntArray, blocks: FloatArray) -> tuple[IntArray, FloatArray]:
        """Contacts of carriers, from contacts whose points may be means of several carriers."""
        between, weights, parents = self._parents(nodes)
        if not between:
            return nodes, blocks
        count, width = nodes.shape
        K = blocks.reshape(count, width, 3, width, 3)
        K = np.einsum("cpk,cpiqj,cql->cpkiqlj", weights, K, weights, optimize=True)
        size = width * weights.shape[2]
        return parents.reshape(count, size), K.reshape(count, 3 * size, 3 * size)

    def _maps(self, nodes: IntArray) -> FloatArray:
        """Inertial steps of points (c, w) for the steps of their nodes, (c, w, 3, 3 or 6)."""
        R = self._turns[nodes].reshape(*nodes.shape, 3, 3)
        if self._narrow:
            return R
        arms = so3.skew(self._carriers.serial.arms[nodes])
        return np.concatenate([R, -R @ arms], axis=-1)

    def _put_pairs(self, first: IntArray, second: IntArray, values: FloatArray) -> None:
        """Add matrices (k, 6, 6) of pairs of points."""
        kind, numbers = self._carriers.serial.kind, self._carriers.numbers
        for i in self._width:
            for j in self._width:
                chosen = np.flatnonzero((kind[first] == i) & (kind[second] == j))
                if len(chosen):
                    K = values[chosen][:, : self._width[i], : self._width[j]]
                    row, column = numbers[first[chosen]], numbers[second[chosen]]
                    self._put(i, j, row[:, np.newaxis], column[:, np.newaxis], K)

    def _put_aside(
        self, nodes: IntArray, values: FloatArray, number: int, kind: int, *, transposed: bool
    ) -> None:
        """Add matrices (k, 3 or 6, 6) of points and one node, or their transposes."""
        serial, numbers = self._carriers.serial, self._carriers.numbers
        for i, width in self._width.items():
            chosen = np.flatnonzero(serial.kind[nodes] == i)
            if not len(chosen):
                continue
            K = values[chosen][:, :width]
            places = numbers[nodes[chosen]][:, np.newaxis]
            other = np.full_like(places, number)
            if transposed:
                self._put(kind, i, other, places, np.swapaxes(K, 1, 2))
            else:
                self._put(i, kind, places, other, K)

    def _put(self, i: int, j: int, rows: IntArray, columns: IntArray, values: FloatArray) -> None:
        """Add matrices of nodes (k, p) in the rows and (k, q) in the columns."""
        widths = self._width.get(i, 6), self._width.get(j, 6)
        row, column = (k.astype(np.int64) for k in block_indices(rows, columns, widths))
        self._found[i, j].append((row, column, np.ascontiguousarray(values).ravel()))
