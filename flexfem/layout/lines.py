# SPDX-License-Identifier: LGPL-3.0-or-later
"""Lines of beams and points on them, of the whole model and of a rank.

A ``Line`` is that of a beam, the same on every rank, and a ``LinePoint`` a marker on it. Joints
evaluate a ``RailPoint`` of a ``Rail``, the same with the nodes at the interface of a rank. Loads
and probes need no line; they use an ``ElementPlace``, which moves with the nodes of its element.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from flexfem._types import FloatArray, IndexArray, IntArray
from flexfem.core.places.line_points import SE3, arc_length, line_pose, turn_frames
from flexfem.layout.node_key import NodeKey
from flexfem.lie import se3

__all__ = ["ElementPlace", "Line", "LinePoint", "Rail", "RailPoint", "se3_line"]

#: Relative length below which a piece of an element counts as round-off.
_CUT = 1e-9
#: Newton steps for a point of given arc length; the initial guess is near.
_STEPS = 8


@dataclass(frozen=True, eq=False)
class Line:
    """Elements of a beam from the start to the end, the same on every rank.

    A point of a surface that depends on several nodes is a line of one element, without length.

    Attributes:
        kind: block of the nodes, see ``placement``.
        nodes: (m, k) numbers of the nodes in the input order of the block.
        cells: (m,) numbers of the elements among those of their kind in the model.
        shape: (m, k, k) coefficients of the shape functions as in ``core.places.line_points``; None
            for SE(3) elements.
        turns: (m, 2, 9) rotations of the sections at both ends relative to their nodes; None for
            all but SE(3) elements.
        starts: (m,) arc length from the beam's start to each element, m.
        arc: (m, q) arc length from each element's start in powers of xi, m.
        element: interpolation of frames, see ``core.places.line_points``.
    """

    kind: int
    nodes: IntArray
    cells: IntArray
    shape: FloatArray | None
    turns: FloatArray | None
    starts: FloatArray
    arc: FloatArray
    element: int

    @property
    def length(self) -> float:
        """Arc length of the beam at the start, m."""
        return float(self.starts[-1] + self.arc[-1].sum())

    def cuts(self, element: int, lengths: FloatArray) -> list[float]:
        """Coordinates of an element's ends, 0 and 1, and between them of given arc lengths."""
        return arc_cuts(self.arc[element], lengths - self.starts[element])

    def keys(self, element: int) -> list[NodeKey]:
        """Nodes of one element."""
        return [(self.kind, int(node)) for node in self.nodes[element]]


def arc_cuts(arc: FloatArray, lengths: FloatArray) -> list[float]:
    """Coordinates of an element's ends, 0 and 1, and between them of arc lengths from its start.

    ``arc`` are the coefficients of the arc length in powers of the coordinate.
    """
    whole, found = float(arc.sum()), [0.0]
    for s in np.sort(lengths):
        if _CUT * whole < s < (1.0 - _CUT) * whole:
            xi = float(s / whole)
            for _ in range(_STEPS):
                value, slope, _ = arc_length(arc, xi)
                xi -= float((value - s) / slope)
            found.append(xi)
    return [*found, 1.0]


@dataclass(frozen=True, eq=False)
class LinePoint:
    """A marker on a line.

    Attributes:
        line: the line.
        element: number of the element along the line.
        xi: coordinate in the element, 0 to 1.
        slides: True if it moves along the line with the other marker of its joint; ``element`` and
            ``xi`` are its start.
    """

    line: Line
    element: int
    xi: float
    slides: bool = False

    @property
    def keys(self) -> list[NodeKey]:
        """Nodes that it may depend on, those of the whole line if it slides."""
        elements = range(len(self.line.nodes)) if self.slides else [self.element]
        return [key for e in elements for key in self.line.keys(e)]


@dataclass(frozen=True, eq=False)
class Rail:
    """Line of a beam whose nodes are at the interface of a rank.

    Attributes:
        line: its elements.
        interface_nodes: (m, k) interface numbers of their nodes, -1 for those without joints.
    """

    line: Line
    interface_nodes: IntArray


@dataclass(frozen=True, eq=False)
class RailPoint:
    """A marker on a line at the interface of a rank; see :class:`LinePoint`."""

    rail: Rail
    element: int
    xi: float
    slides: bool = False


@dataclass(frozen=True, eq=False)
class ElementPlace:
    """A point inside an element, which moves with all nodes of the element.

    Attributes:
        kind: block of the nodes, see ``placement``.
        nodes: (k,) numbers of the nodes in the input order of the block.
        cell: number of the element among those of its kind in the model.
        shape: (k, k) coefficients of the shape functions as in ``core.places.line_points``.
        xi: coordinate in the element, 0 to 1.
        element: interpolation of frames, see ``core.places.line_points``.
        turns: (2, 9) rotations of the sections relative to their nodes, (0, 9) but on SE(3)
            elements.
    """

    kind: int
    nodes: IntArray
    cell: int
    shape: FloatArray
    xi: float
    element: int
    turns: FloatArray

    @classmethod
    def on(cls, line: Line, number: int, xi: float) -> Self:
        """Point in the element of this number along a line."""
        k = line.nodes.shape[1]
        return cls(
            kind=line.kind,
            nodes=line.nodes[number],
            cell=int(line.cells[number]),
            shape=np.zeros((k, k)) if line.shape is None else line.shape[number],
            xi=xi,
            element=line.element,
            turns=np.empty((0, 9)) if line.turns is None else line.turns[number],
        )

    def sections(self, frames: FloatArray) -> FloatArray:
        """Frames (k, 12) of the sections at the nodes, given those of the nodes."""
        out = np.array(frames)
        if len(self.turns):
            turn_frames(out, self.turns, out)
        return out

    def frame(self, frames: FloatArray) -> FloatArray:
        """Frame (12,) of the point, given those of the nodes (k, 12)."""
        out = np.empty(12)
        line_pose(self.element, self.sections(frames), self.shape, self.xi, out)
        return out


def se3_line(
    kind: int, cells: IntArray, nodes: IndexArray, ends: FloatArray, frames: FloatArray
) -> Line:
    """Line of an SE(3) beam.

    Args:
        kind: number of the block.
        cells: (m,) numbers of the cells in the order of the line, all of them in its direction.
        nodes: (m, 2) their nodes.
        ends: (m, 2, 12) section frames at their ends at the start.
        frames: (n, 12) frames of all nodes at the start.
    """
    relative = se3.log(se3.compose(se3.inverse(ends[:, 0]), ends[:, 1]))
    lengths = np.linalg.norm(relative[:, :3], axis=1)
    turns = np.swapaxes(se3.rotation(frames[nodes]), -1, -2) @ se3.rotation(ends)
    starts = np.cumsum(lengths) - lengths
    arc = np.stack([np.zeros(len(cells)), lengths], axis=1)
    flat = turns.reshape(-1, 2, 9)
    return Line(kind, nodes.astype(np.int64), cells, None, flat, starts, arc, SE3)
