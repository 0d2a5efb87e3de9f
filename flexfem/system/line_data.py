# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joints with markers on lines as arrays, as the compiled loops read them."""

from typing import NamedTuple

from flexfem._types import BoolArray, FloatArray, IntArray

__all__ = ["ON_LINE", "LineData", "PointData", "RowData", "Work"]

#: Slot of a marker that no single node carries.
ON_LINE = -2


class LineData(NamedTuple):
    """Elements of all lines, one line after the other; k is the largest number of nodes.

    Attributes:
        element: (n_lines,) how frames are interpolated; width: (n_lines,) nodes of an element.
        size: (n_lines, 2) rows and columns of coefficients of an element.
        first: (n_lines + 1,) first element of each line.
        nodes: (e, k) slots of the nodes.
        shape: (e, p q) coefficients row by row; turns: (e, 2, 9), start: (e,), arc: (e, q), see
            ``lines.Line``.
        turned: (n_lines,) whether any section is turned against its node.
    """

    element: IntArray
    width: IntArray
    size: IntArray
    first: IntArray
    nodes: IntArray
    shape: FloatArray
    turns: FloatArray
    start: FloatArray
    arc: FloatArray
    turned: BoolArray


class PointData(NamedTuple):
    """Markers of these joints.

    Attributes:
        first: (n_joints + 1,) first marker of each joint.
        marker: (m,) its number among all markers.
        slot: (m,) slot of the node that carries it, -1 on the ground, -2 on a line.
        offset: (m, 12) relative to its node or section.
        line: (m,) number of its line; slides: (m,) whether it slides.
        column: (m,) where its nodes begin among those of the joint.
        width: (n_joints,) nodes of each joint, a node of two markers counted twice.
    """

    first: IntArray
    marker: IntArray
    slot: IntArray
    offset: FloatArray
    line: IntArray
    slides: BoolArray
    column: IntArray
    width: IntArray


class RowData(NamedTuple):
    """Rows of these joints and their terms.

    Attributes:
        first: (n_joints + 1,) first row of each joint here.
        row: (r,) number among all rows.
        entry: (r,) first term among all terms, which holds the gradient, two nodes a term.
        term: (r + 1,) first term here.
        kinds, directions, factors, memory: (t,), (t, 3, 3), (t,) and (t,) of the terms.
        ends: (t, 2) markers within the joint.
    """

    first: IntArray
    row: IntArray
    entry: IntArray
    term: IntArray
    kinds: IntArray
    directions: FloatArray
    factors: FloatArray
    memory: FloatArray
    ends: IntArray


class Work(NamedTuple):
    """Work space; n is the largest number of nodes of a joint, m that of its markers.

    Attributes:
        frames: (k, 12) frames of an element's nodes.
        section: (6 (6 k + 1),) derivatives of a section's frame; block: ((6 k + 1)^2,).
        point: (m, 6, 6 n + 1) derivatives of the markers along z = (twists of nodes, xi).
        forces: (6 m,) gradient with respect to the markers' twists, hessian: (6 m, 6 m).
        slide: (6 n + 1,) derivative of the slider's equation G by z.
        gradient: (6 n + 1,) derivative of a row by z.
        second: (6 n + 1, 6 n + 1) second derivatives.
    """

    frames: FloatArray
    section: FloatArray
    block: FloatArray
    point: FloatArray
    forces: FloatArray
    hessian: FloatArray
    slide: FloatArray
    gradient: FloatArray
    second: FloatArray
