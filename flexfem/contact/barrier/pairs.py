# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pairs of cells of one contact on this rank, and their response."""

from dataclasses import dataclass, field

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.contact.barrier.surface import ContactSurface
from flexfem.contact.primitives.candidates import Motion
from flexfem.contact.primitives.ccd import safe_part
from flexfem.contact.primitives.complexes import Surface
from flexfem.contact.primitives.data import GAP, NORMAL, POTENTIAL, SLOPE, WEIGHTS, Pairs, Response
from flexfem.contact.primitives.neighbourhoods import Neighbourhoods
from flexfem.contact.primitives.search import find_pairs
from flexfem.contact.primitives.statics import forces_at_rest
from flexfem.contact.primitives.steps import forces_of_step
from flexfem.contact.primitives.tangents import add_actions, add_forces, blocks_into, potential
from flexfem.kernels.compiled import kernel
from flexfem.kernels.records import Memory, unpack

__all__ = ["KEEP", "ContactPairs"]

#: Part of its gap that every pair keeps in a correction of the trial state, and from the accepted
#: state to the next one.
KEEP = 0.1


@dataclass
class ContactPairs:
    """Pairs of one contact whose groups belong to this rank.

    Attributes:
        own: the contact's surface.
        near: its pairs that are left out.
        here: points of this rank, (n,).
        surface: with the stiffness of the barrier.
        pairs: those that may touch near the present motion.
        response: at the last evaluation.
    """

    own: ContactSurface
    near: Neighbourhoods
    here: BoolArray
    surface: Surface = field(init=False)
    pairs: Pairs = field(init=False)
    response: Response = field(init=False)

    def __post_init__(self) -> None:
        """Begin without pairs."""
        self.surface = self.own.surface
        nothing = np.zeros(0, np.int64)
        self._use(Pairs(
            kind=nothing, points=np.zeros((0, 4), np.int64), weight=np.zeros(0), touch=np.zeros(0),
            dhat=np.zeros(0), kappa=np.zeros(0), starts=np.zeros(1, np.int64),
        ))  # fmt: skip

    @property
    def name(self) -> str:
        """Name of the contact."""
        return self.own.contact.name

    def _use(self, pairs: Pairs) -> None:
        self.pairs, self.response = pairs, Response.of(pairs)
        self.response.count[0] = 0

    def stiffen(self, kappa: FloatArray) -> None:
        """Set the stiffness of the barrier at each point (n,), N/m^3."""
        self.surface = self.own.stiff(kappa)

    def search(self, motion: Motion) -> None:
        """Find the pairs that may touch during a motion."""
        self._use(find_pairs(self.surface, self.near, motion, self.own.touching, self.here))

    def evaluate(self, points: FloatArray, before: FloatArray | None) -> None:
        """Evaluate at positions (n, 3), over a step from ``before`` (n, 3) unless there is none."""
        pairs, response = self.pairs.memory, self.response.memory
        if before is None:
            forces_at_rest(pairs, points, response)
        else:
            forces_of_step(pairs, before, points, response)

    def add_forces(self, scale: float, sums: FloatArray) -> None:
        """Add ``scale`` times the forces on all points to (n, 3)."""
        add_forces(self.pairs.memory, self.response.memory, scale, sums)

    def add_actions(self, scale: float, steps: FloatArray, sums: FloatArray) -> None:
        """Add ``scale`` times the tangent's action on steps (n, 3) to (n, 3)."""
        add_actions(self.pairs.memory, self.response.memory, scale, steps, sums)

    def blocks(self, scale: float) -> tuple[IntArray, FloatArray]:
        """Points (c, 4) of the pairs that act, and ``scale`` times their tangents (c, 12, 12)."""
        count = int(self.response.count[0])
        blocks = np.empty((count, 12, 12))
        blocks_into(self.response.memory, scale, blocks)
        return self.pairs.points[self.response.pairs[:count]], blocks

    def safe_part(self, before: FloatArray, after: FloatArray, keep: float = KEEP) -> float:
        """Part of a motion during which all pairs keep a part of their gap."""
        return float(safe_part(self.pairs.memory, before, after, keep))

    def moves(self, before: FloatArray, after: FloatArray) -> tuple[float, float, float]:
        """Largest change of forces in a motion, largest force, N, and way of points over dhat."""
        if not self.pairs.count:
            return 0.0, 0.0, 0.0
        return _moves(self.pairs.memory, self.response.memory, before, after)

    @property
    def count(self) -> int:
        """Number of pairs that act."""
        return int(self.response.count[0])

    @property
    def energy(self) -> float:
        """Potential of the pairs, J."""
        return float(potential(self.response.memory))

    @property
    def slopes(self) -> FloatArray:
        """Stiffness of the pairs that act along their normals, N/m."""
        return self.response.numbers[: self.count, SLOPE]

    @property
    def groups(self) -> IntArray:
        """Group of each pair that acts."""
        acting = self.response.pairs[: self.count]
        found: IntArray = np.searchsorted(self.pairs.starts, acting, side="right") - 1
        return found

    def gaps(self) -> FloatArray:
        """Gaps of the pairs that act and count, m."""
        acting = self.response.numbers[: self.count]
        return acting[acting[:, POTENTIAL] != 0.0, GAP]


@kernel
def _moves(
    pairs: Memory, response: Memory, before: FloatArray, after: FloatArray
) -> tuple[float, float, float]:
    """See :meth:`ContactPairs.moves`."""
    own, out, change, force, way = unpack(Pairs, pairs), unpack(Response, response), 0.0, 0.0, 0.0
    for p in range(len(own.kind)):
        for i in range(4):
            square = 0.0
            for a in range(3):
                square += (after[own.points[p, i], a] - before[own.points[p, i], a]) ** 2
            way = max(way, np.sqrt(square) / own.dhat[p])
    for k in range(out.count[0]):
        numbers, points, approach = out.numbers[k], own.points[out.pairs[k]], 0.0
        for i in range(4):
            square = 0.0
            for a in range(3):
                step = after[points[i], a] - before[points[i], a]
                approach += numbers[WEIGHTS + i] * numbers[NORMAL + a] * step
                square += out.forces[k, 3 * i + a] ** 2
            force = max(force, np.sqrt(square))
        change = max(change, abs(numbers[SLOPE] * approach))
    return change, force, way
