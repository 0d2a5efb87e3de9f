# SPDX-License-Identifier: LGPL-3.0-or-later
"""Beams as lines: their elements one after the other, for points anywhere on them."""

from dataclasses import dataclass

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.core.line_points import SE3
from flexfem.lie import se3

__all__ = ["LineCells", "LinePoint", "line_cells"]


@dataclass(frozen=True)
class LineCells:
    """Elements of one beam in the order of its line.

    Attributes:
        body: name of the beam.
        kind: kind of the block that holds the nodes, see ``placement``.
        element: how frames are interpolated, see ``flexfem.core.line_points``.
        nodes: (m, k) nodes of each element in the input order of their block; slots of the
            interface in a line whose joints a rank evaluates.
        shape: (m, k, k) shape functions, see ``mesh.nurbs_elements``; unused on SE(3) elements.
        turns: (m, k, 9) rotation of the section's axes against the node's.
        start: (m + 1,) arc length in the undeformed state where each element begins, m.
        arc: (m, q) arc length from the element's start in powers of its coordinate, m.
    """

    body: str
    kind: int
    element: int
    nodes: IntArray
    shape: FloatArray
    turns: FloatArray
    start: FloatArray
    arc: FloatArray


@dataclass(frozen=True)
class LinePoint:
    """A point on a line.

    Attributes:
        line: where it is.
        element: number of the element along the line.
        xi: coordinate in the element, 0 to 1.
        slides: it goes along the line with the other marker of its joint; ``element`` and ``xi``
            say where it starts.
    """

    line: LineCells
    element: int
    xi: float
    slides: bool = False


def line_cells(
    body: str, kind: int, nodes: IntArray, frames: FloatArray, ends: FloatArray
) -> LineCells:
    """Two-node elements on SE(3).

    Args:
        body: name of the beam.
        kind: kind of its block.
        nodes: (m, 2) nodes.
        frames: (m, 2, 12) frames of these nodes at the start.
        ends: (m, 2, 12) section frames there.
    """
    relative = se3.compose(se3.inverse(ends[:, 0]), ends[:, 1])
    lengths = np.linalg.norm(se3.log(relative)[:, :3], axis=1)
    turns = np.swapaxes(se3.rotation(frames), -1, -2) @ se3.rotation(ends)
    return LineCells(
        body=body,
        kind=kind,
        element=SE3,
        nodes=nodes,
        shape=np.zeros((len(nodes), 2, 2)),
        turns=turns.reshape(len(nodes), 2, 9),
        start=np.concatenate([[0.0], np.cumsum(lengths)]),
        arc=np.stack([np.zeros_like(lengths), lengths], axis=1),
    )
