# SPDX-License-Identifier: LGPL-3.0-or-later
"""Derivatives of functions of few nodes each by the motion of these nodes.

Values that depend on some nodes each, as the strains of elements do, are differentiated by central
differences of fourth order. Nodes that no value has in common are moved together (Curtis, Powell,
Reid, J. Inst. Math. Appl. 13 (1974) 117-119), so that the number of evaluations does not grow with
the number of elements.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import inf

from mpi4py import MPI

import numpy as np

from flexfem._checks import InputError
from flexfem._types import FloatArray, IntArray
from flexfem.core.differences import ENOUGH, STENCIL, STEPS, SUITS
from flexfem.core.nodes.frame_block import FrameBlock
from flexfem.gradients.equations.node_maps import moved

__all__ = ["NodeFunctions"]

#: Difference from a shorter step with which no better one is sought: where nodes move together,
#: as in rotations, their derivatives cancel.
_PRECISE = 1e-11
#: Changes relative to the largest values that are rounding.
_ROUNDING = 1e-13


@dataclass(frozen=True)
class _Weighted:
    """What is differentiated.

    Attributes:
        values: computes the (m, c) values at the trial state.
        still: (m, c) those of the state itself.
        weights: (m, c).
        what: array of the block that is changed.
    """

    values: Callable[[], FloatArray]
    still: FloatArray
    weights: FloatArray
    what: str


class NodeFunctions:
    """Values that depend on some nodes of a block each."""

    def __init__(self, owner: str, block: FrameBlock, nodes: IntArray) -> None:
        """Choose the nodes that move together.

        Args:
            owner: name in messages.
            block: of the nodes.
            nodes: (m, k) local nodes on which each value depends, -1 where there are fewer.
        """
        self._owner, self._block, self._count = owner, block, len(nodes)
        there = nodes >= 0
        self._at, own = np.unique(nodes[there].astype(np.int64), return_inverse=True)
        self._pairs = np.unique(np.stack([np.nonzero(there)[0], own]), axis=1)
        self._groups = _apart(*self._pairs)
        self._scale = np.ones((len(self._at), 6))
        self._scale[:, :3] = self._lengths()[:, np.newaxis]
        self._best = 0

    def _lengths(self) -> FloatArray:
        """(n,) least size of what depends on a node, m; 1 where it depends on this node alone."""
        (values, own), x = self._pairs, self._block.start_frames[self._at, :3]
        low, high = np.full((self._count, 3), inf), np.full((self._count, 3), -inf)
        np.minimum.at(low, values, x[own])
        np.maximum.at(high, values, x[own])
        found = np.full(len(x), inf)
        size = np.linalg.norm(high - low, axis=1)[values]
        np.minimum.at(found, own, np.where(size > 0.0, size, inf))
        return np.where(np.isfinite(found), found, 1.0)

    def derivatives(
        self, values: Callable[[], FloatArray], weights: FloatArray, what: str
    ) -> FloatArray:
        """Derivatives (n_owned, 6) of weighted sums by the nodes' motion (collective).

        Args:
            values: computes the (m, c) values of this rank at the trial state.
            weights: (m, c).
            what: "frames", by local twists, "velocity" or "acceleration", by local components.

        Raises:
            InputError: there are none.
        """
        block, best, least, rounding = self._block, np.zeros((len(self._at), 6)), inf, True
        weighted = _Weighted(values, values(), weights, what)
        for k in range(self._best, len(STEPS)):
            own, changes, off = self._slopes(weighted, STEPS[k])
            # of the weighted values, of all of them, and what differs
            sizes = np.array([changes[0], changes[1], off])
            block.comm.Allreduce(MPI.IN_PLACE, sizes, op=MPI.MAX)
            # what is zero whatever the nodes do, as a moment at a free edge
            rounding = rounding and sizes[0] <= _ROUNDING * sizes[1]
            if sizes[0] == 0.0:
                break
            if (missed := sizes[2] / sizes[0]) < least:
                best, least, self._best = own, missed, k
            if least <= _PRECISE or (least <= SUITS and missed > least):
                break
        if not rounding and not least <= ENOUGH:
            raise InputError(
                f"gradient: {self._owner} has a kink or jumps at a state, and has no derivative "
                "there"
            )
        block.residual[:] = 0.0
        block.residual[self._at] = 0.0 if rounding else best
        block.add_ghosts()
        found: FloatArray = block.residual[: block.owned].copy()
        return found

    def _slopes(self, one: _Weighted, step: float) -> tuple[FloatArray, tuple[float, float], float]:
        """Derivatives (u, 6) by the nodes, and their check along a direction at random.

        The second result are the changes along it of weighted values, and the largest of all
        values times the largest weight; the third one is the difference of the derivative along it.
        """
        scale = self._scale if one.what == "frames" else np.ones_like(self._scale)
        found, largest = np.zeros((2, *scale.shape))
        for own, places in self._groups:
            for i in range(self._block.width):
                along = np.zeros_like(scale)
                along[places, i] = 1.0
                slopes, changes, _ = self._along(one, scale * along, step)
                np.add.at(found[:, i], places, slopes[own])
                np.add.at(largest[:, i], places, changes[own])
        along = np.random.default_rng(3).standard_normal(scale.shape)
        along[:, self._block.width :] = 0.0
        slopes, _, most = self._along(one, scale * along, 0.1 * step)
        off = abs(float(slopes.sum() - (found * along).sum()))
        most *= float(np.abs(one.weights).max(initial=0.0))
        return found / scale, (float((largest * np.abs(along)).sum()), most), off

    def _along(
        self, one: _Weighted, direction: FloatArray, step: float
    ) -> tuple[FloatArray, FloatArray, float]:
        """Derivatives (m,) of weighted values along a direction with its step, and changes.

        The last result is the largest change of all values without weights.
        """
        block, at = self._block, self._at
        own: FloatArray = getattr(block, one.what)
        before = own[at].copy()
        total, largest, most = np.zeros(self._count), np.zeros(self._count), 0.0
        for part, weight in STENCIL:
            way = part * step * direction
            if one.what == "frames":
                own[at] = moved(before, way, inertial=block.inertial)
            else:
                own[at] = before + way
            every = one.values() - one.still
            most = max(most, float(np.abs(every).max(initial=0.0)) / step)
            difference = (every * one.weights).sum(axis=1)
            total += weight / step * difference
            np.maximum(largest, np.abs(difference) / step, out=largest)
        own[at] = before
        return total, largest, most


def _apart(values: IntArray, nodes: IntArray) -> list[tuple[IntArray, IntArray]]:
    """Groups of values (k,) with a node (k,) of each, so that no value has two nodes in a group."""
    of_value: dict[int, list[int]] = {}
    of_node: dict[int, list[int]] = {}
    for value, node in zip(values.tolist(), nodes.tolist(), strict=True):
        of_value.setdefault(value, []).append(node)
        of_node.setdefault(node, []).append(value)
    color: dict[int, int] = {}
    for node, around in of_node.items():
        used = {color[other] for value in around for other in of_value[value] if other in color}
        color[node] = next(c for c in range(len(used) + 1) if c not in used)
    colors = np.array([color[node] for node in nodes.tolist()], dtype=np.int64)
    return [(values[colors == c], nodes[colors == c]) for c in range(colors.max(initial=-1) + 1)]
