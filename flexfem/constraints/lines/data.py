# SPDX-License-Identifier: LGPL-3.0-or-later
"""Record of joints with markers on lines for their compiled loops."""

from flexfem.kernels.records import Bool1D, Float1D, Float2D, Float3D, Float4D, Int1D, Int2D, Record

__all__ = ["ON_LINE", "JointsOnLines"]

#: Interface number of a marker that is not fixed to a single node.
ON_LINE = -2


class JointsOnLines(Record):
    """Lines, the markers on them, and rows of the joints that have such markers.

    k is the largest number of nodes of an element, n that of a joint, m its markers; z are the
    twists of a joint's nodes and the coordinate of its slider.

    Attributes:
        element: (lines,) kind of interpolation of frames.
        count: (lines,) nodes of an element.
        size: (lines, 2) rows and columns of coefficients of an element.
        turned: (lines,) True if a section is rotated relative to its node.
        first_element: (lines + 1,) first element of each line; elements follow one another.
        nodes: (elements, k) numbers at the interface of the nodes.
        shape: (elements, p q) coefficients row by row, see ``lines.Line``.
        turns: (elements, 2, 9) rotations from nodes to sections.
        start: (elements,) arc length (m) at the start.
        arc: (elements, q) polynomial of the arc length (m).
        first_marker: (joints + 1,) first marker of each joint.
        marker: (markers,) its number among all markers.
        interface_node: (markers,) interface number of the node that carries it, -1 on the ground,
            -2 on a line.
        offset: (markers, 12) frame relative to its node or section.
        line: (markers,) number of its line.
        slides: (markers,) True if it slides.
        column: (markers,) first of its nodes among those of the joint.
        accepted: (markers, 2) element and coordinate at the accepted state, from which sliders are
            tracked.
        places: (markers, 2) the same at the trial state.
        width: (joints,) nodes of each joint, a node of two markers counted twice.
        first_pair: (joints,) first pair of nodes of each joint; any two of its nodes are a pair.
        first_row: (joints + 1,) first row of each joint here.
        row: (rows,) number among all rows.
        entry: (rows,) first term among all terms for the gradient, two nodes a term.
        first_term: (rows + 1,) first term here.
        kinds: (terms,) values of ``RowKind``, or addresses of functions.
        directions: (terms, 3, 3) see ``Term.data``.
        factors: (terms,) coefficients.
        angles: (terms,) continuous angles (rad) at the accepted state.
        ends: (terms, 2) numbers of its markers within the joint.
        sums: (all rows,) sums of the terms of these rows, zero for others.
        sections: (k, 12) work space: frames of the sections at an element's nodes.
        section: (6 (6 k + 1),) derivatives of a section's frame.
        block: ((6 k + 1)^2,) second derivatives of a section.
        point: (joints, m, 6, 6 n + 1) derivatives of the markers by z.
        forces: (6 m,) gradient with respect to the markers' twists.
        hessian: (6 m, 6 m) second derivatives with respect to these.
        slide: (joints, 6 n + 1) derivatives of the coordinate of the slider by the nodes' twists;
            the last one used is that of its equation G by the coordinate. Zero without a slider.
        gradient: (6 n + 1,) derivative of a row by z.
        second: (6 n + 1, 6 n + 1) second derivatives by z.
        space: (36 n^2,) second derivatives by the nodes' twists.
        term: (12,) gradient of a term, term_second: (12, 12) its second derivative.
        scratch: (5, 3) work space of a term.
    """

    element: Int1D
    count: Int1D
    size: Int2D
    turned: Bool1D
    first_element: Int1D
    nodes: Int2D
    shape: Float2D
    turns: Float3D
    start: Float1D
    arc: Float2D
    first_marker: Int1D
    marker: Int1D
    interface_node: Int1D
    offset: Float2D
    line: Int1D
    slides: Bool1D
    column: Int1D
    accepted: Float2D
    places: Float2D
    width: Int1D
    first_pair: Int1D
    first_row: Int1D
    row: Int1D
    entry: Int1D
    first_term: Int1D
    kinds: Int1D
    directions: Float3D
    factors: Float1D
    angles: Float1D
    ends: Int2D
    sums: Float1D
    sections: Float2D
    section: Float1D
    block: Float1D
    point: Float4D
    forces: Float1D
    hessian: Float2D
    slide: Float2D
    gradient: Float1D
    second: Float2D
    space: Float1D
    term: Float1D
    term_second: Float2D
    scratch: Float2D
