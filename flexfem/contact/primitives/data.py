# SPDX-License-Identifier: LGPL-3.0-or-later
"""Records of pairs of primitives and of their contact forces."""

from enum import IntEnum

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.kernels.compiled import inlined
from flexfem.kernels.records import Float1D, Float2D, Int1D, Int2D, Record

__all__ = [
    "BEND",
    "COMMON",
    "CROSSING_EDGE_VERTEX",
    "CROSSING_VERTICES",
    "DERIVATIVE",
    "EDGE_EDGE",
    "FIELDS",
    "FORM",
    "GAP",
    "LINE",
    "MIXED",
    "NORMAL",
    "POTENTIAL",
    "SLOPE",
    "TURN",
    "VERTEX_EDGE",
    "VERTEX_TRIANGLE",
    "VERTEX_VERTEX",
    "WEIGHTS",
    "Kind",
    "Pairs",
    "Response",
    "regularisation",
]


class Kind(IntEnum):
    """Kinds of pairs of cells, with their points."""

    #: p; x, and x twice more
    VERTEX_VERTEX = 0
    #: p; x, y, and y once more
    VERTEX_EDGE = 1
    #: p; x, y, z
    VERTEX_TRIANGLE = 2
    #: a, b; x, y: an edge crosses another one
    EDGE_EDGE = 3
    #: a, b; x, x: an edge crosses a polyline at one of its vertices
    CROSSING_EDGE_VERTEX = 4
    #: a, a; x, x: two polylines cross at vertices of both
    CROSSING_VERTICES = 5


# plain numbers for compiled loops
VERTEX_VERTEX = int(Kind.VERTEX_VERTEX)
VERTEX_EDGE = int(Kind.VERTEX_EDGE)
VERTEX_TRIANGLE = int(Kind.VERTEX_TRIANGLE)
EDGE_EDGE = int(Kind.EDGE_EDGE)
CROSSING_EDGE_VERTEX = int(Kind.CROSSING_EDGE_VERTEX)
CROSSING_VERTICES = int(Kind.CROSSING_VERTICES)

#: Regularisation of crossing edges. It moves the closest points of edges that are parallel within
#: some degrees towards the middle of where they overlap: with less they move so fast as edges turn
#: that Newton's method fails in steps of an impact. Distances change by less than a hundredth.
_REGULAR = 1e-2

#: Signed weights of the four points: their sum is the vector from the second primitive to the
#: first, 4 numbers.
WEIGHTS = 0
#: That vector over the distance, 3 numbers.
NORMAL = 4
#: Distance less the touch distance at the end, m.
GAP = 7
#: Potential at the end, J.
POTENTIAL = 8
#: Stiffness along the normal, N/m: that of the tangent.
SLOPE = 9
#: For equilibria: force over distance, N/m, negative where it repels, the factor of the geometric
#: tangent; 0 for steps.
BEND = 10
#: Where that is not 0: how the closest points move, twice 4 weights and 3 components, see
#: ``turning``.
TURN = 11
#: For steps: 4 weights and 3 components of the mean line.
LINE = 11
#: For steps, of mixed forces: share of the middle's forces; lacking work over the sum of squares,
#: m^2/J, that sum, J^2/m^2, change of the barrier, J/m^2; derivatives of the share by the lacking
#: work, the sum, the change, and the way along the primitives over the distance, the last two 0 for
#: those of other pairs than the one on which it depends.
MIXED = 18
#: Numbers of a pair that acts.
FIELDS = 26

# Numbers of the derivative of a pair's forces over a step, after its block of 144:
#: how they change with two factors that the pairs of a group have in common, twice 12 numbers, N
COMMON = 144
#: minus the derivatives of these factors by the points of the pair, twice 12 numbers, 1/m
FORM = 168
#: all of them
DERIVATIVE = 192


class Pairs(Record):
    """Pairs of primitives, sorted by group.

    The sum of a group's potentials is that of one contact, as of a vertex with a surface, whose
    triangles, edges and vertices are its pairs (see ``complexes`` and ``steps``).

    Attributes:
        kind: See :class:`Kind`, negative with obstacles, shape (m,).
        points: Rows of the positions, shape (m, q): 4 of cells, 5 with obstacles.
        weight: Area with the sign and multiplicity of the pair, shape (m,), square metres.
        touch: Distance at which they touch, shape (m,), metres.
        dhat: Gap below which they repel, shape (m,), metres.
        kappa: Stiffness of the barrier, shape (m,), N/m^3.
        starts: First pair of each group, shape (g + 1,).
        keys: Number of each group that it has in every search, shape (g,).
    """

    kind: Int1D
    points: Int2D
    weight: Float1D
    touch: Float1D
    dhat: Float1D
    kappa: Float1D
    starts: Int1D
    keys: Int1D

    @property
    def count(self) -> int:
        """Number of pairs."""
        return len(self.kind)


class Response(Record):
    """What pairs do at a trial state.

    Attributes:
        count: Number of pairs that act, shape (1,); they are the first rows of what follows.
        pairs: Their numbers, shape (m,).
        numbers: Weights, normal, gap, potential and tangent, shape (m, FIELDS).
        forces: Forces on the points, shape (m, 3 q), newtons.
        whole: For steps of cells: 2 where the force is along a mean line, 3 where it is mixed with
            others of its group, and 1 where its whole derivative is in ``blocks``, shape (m,).
        shared: Number of pairs of a group of mixed forces, at the first of them, and 0 elsewhere,
            shape (m,).
        blocks: Minus these derivatives by the points at the end, N/m, then those of what the group
            has in common, shape (m, DERIVATIVE).
    """

    count: Int1D
    pairs: Int1D
    numbers: Float2D
    forces: Float2D
    whole: Int1D
    shared: Int1D
    blocks: Float2D

    @classmethod
    def of(cls, pairs: Pairs, numbers: int = FIELDS) -> "Response":
        """Memory for the response of all pairs, with some ``numbers`` of each."""
        return cls(
            count=np.zeros(1, np.int64), pairs=np.empty(pairs.count, np.int64),
            numbers=np.empty((pairs.count, numbers)), forces=np.empty((pairs.count,
            3 * pairs.points.shape[1])), whole=np.zeros(pairs.count, np.int64),
            shared=np.zeros(pairs.count, np.int64),
            blocks=np.empty((pairs.count if pairs.points.shape[1] == 4 else 0, DERIVATIVE)),
        )  # fmt: skip

    def rows(self) -> tuple[IntArray, FloatArray, FloatArray]:
        """Numbers of the pairs that act (k,), their data (k, FIELDS) and forces (k, q, 3)."""
        k = int(self.count[0])
        return (
            self.pairs[:k],
            self.numbers[:k],
            self.forces[:k].reshape(k, self.forces.shape[1] // 3, 3),
        )


@inlined
def regularisation(kind: int, touch: float, dhat: float) -> float:
    """Square of the length that regularises crossing edges, 0 for other pairs, m^2."""
    return _REGULAR * (touch + dhat) ** 2 if kind >= EDGE_EDGE else 0.0
