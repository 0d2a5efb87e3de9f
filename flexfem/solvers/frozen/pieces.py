# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bodies of a part as the frozen solver takes them: columns, and factors of their pieces."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.la.factor import Factor
from flexfem.la.krylov import KrylovFactor
from flexfem.solvers.linear.condensed import CondensedFactor
from flexfem.solvers.linear.schur_kernels import BodyColumns
from flexfem.system.system import BlockPart

__all__ = ["AnyFactor", "Bodies", "KeptFactor", "Piece"]

AnyFactor = Factor | CondensedFactor | KrylovFactor


@dataclass(frozen=True)
class Bodies:
    """Bodies of one part with their interface columns; rigid bodies have one node each.

    Attributes:
        part: the part.
        own: nodes, columns and responses in the format of the compiled loops.
    """

    part: BlockPart
    own: BodyColumns

    @property
    def reads(self) -> int:
        """Number of entries that a response of the interface reads, if these are stored."""
        own = self.own
        per_range = own.ranges[:, 1] - own.ranges[:, 0]
        body = np.repeat(np.arange(len(own.node_start) - 1), np.diff(own.range_start))
        rows = own.width * np.diff(own.node_start)
        return int(rows[body] @ per_range)


@dataclass(frozen=True)
class Piece:
    """Bodies that are factorised together, not coupled to others.

    ``bodies`` are their numbers in the group, ``nodes`` their owned nodes; ``right`` and
    ``solution`` (n, width) are contiguous arrays for the solvers.
    """

    bodies: IntArray
    nodes: IntArray
    right: FloatArray
    solution: FloatArray


@dataclass(frozen=True)
class KeptFactor:
    """Factors of the flexible bodies of a part for one step size, one for each piece.

    ``solvers`` solve with them for the steps, ``halves`` in two parts, with shared factors for
    several pieces at once: the first makes the steps of the interface right, the second all of them
    after forces were added there; ``nodes`` are the arrays of ``Mechanics.origin`` from which they
    were computed; ``products`` multiply with the matrices, where these are kept, from steps to
    right-hand sides; ``direct`` is True if there are no responses, see :class:`Bodies`; ``near``
    has the compliances of nodes once they are found, and ``transposed`` the solvers with the
    transposed matrices once they are used.
    """

    factors: list[AnyFactor]
    solvers: list[Callable[[], None]]
    halves: list[tuple[Callable[[], None], Callable[[], None]]]
    products: list[Callable[[], None] | None]
    direct: bool
    responses: FloatArray
    compliances: FloatArray
    nodes: dict[str, FloatArray]
    near: list[FloatArray]
    transposed: list[Callable[[], None]]
