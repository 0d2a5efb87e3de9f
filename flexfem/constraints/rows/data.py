# SPDX-License-Identifier: LGPL-3.0-or-later
"""Records of rows of joints and of their nodes for compiled loops."""

from flexfem.kernels.records import Bool1D, Float1D, Float2D, Float3D, Int1D, Int2D, Record

__all__ = ["InterfaceNodes", "RowArrays"]


class RowArrays(Record):
    """Markers, terms and rows of ``Constraints``, whose arrays these are.

    Attributes:
        marker_node: (m,) interface number of the node that carries a marker, -1 for ground, -2 for
            a line.
        marker_offset: (m, 12) frame of each marker relative to its node, absolute for ground.
        poses: (m, 12) frames of the markers at the last evaluation.
        term_marker: (t, 2) markers a and b of each term.
        term_nodes: (t, 2) interface numbers of their nodes.
        row_of_term: (t,) its row.
        pair_of_term: (t,) its pair of markers for second derivatives.
        kinds: (t,) values of ``RowKind``, or addresses of functions, see ``dispatch.term``.
        directions: (t, 3, 3) u, v and p, see ``Term.data``.
        factors: (t,) coefficients of the terms.
        angles: (t,) continuous angles (rad) at the accepted state.
        force_jacobian: (t, 2, 6) gradients with respect to the nodes' local twists.
        step_jacobian: (t, 2, 6) derivatives of ``values`` along them.
        term_start: (r + 1,) first term of each row.
        targets: (r,) prescribed values of the sums.
        target_rates: (r,) their rates for dampers, see ``Row``.
        active: (r,) rows that are not released.
        elastic: (r, 5) law, stiffness, damping and two parameters, see ``Law``.
        functions: (r,) addresses of the user-defined functions of laws, 0 for none.
        function_data: (r, 9) time (s) and parameters of these functions.
        multipliers: (r,) trial values, scaled by ``beta h^2``.
        values: (r,) residual of each row.
        compliance: (r,) derivative of the residual by the row's own multiplier.
        slopes: (r, 2) derivatives of ``values`` by the row's sum and its rate.
        line_sums: (r,) sums of the rows on lines, whose gradients are known.
        relaxation: compliance of rigid rows, 1/kg.
        coupled: (k, 2) rows with friction, and rows whose resultant is the normal force.
        wrapped_rows: (w,) rows with friction of cables around guides.
        wrap_terms: (w, 2) terms that give the angle around the guide, see ``Wrap``.
        wraps: (w, 2) coefficient of friction, and angle at the start, -1 for an eyelet.
        coupling: (k,) derivatives of the residuals of the former by the multipliers of the latter.
        excess: (r,) by which multipliers are larger than normal forces, see ``integrators.split``.
    """

    marker_node: Int1D
    marker_offset: Float2D
    poses: Float2D
    term_marker: Int2D
    term_nodes: Int2D
    row_of_term: Int1D
    pair_of_term: Int1D
    kinds: Int1D
    directions: Float3D
    factors: Float1D
    angles: Float1D
    force_jacobian: Float3D
    step_jacobian: Float3D
    term_start: Int1D
    targets: Float1D
    target_rates: Float1D
    active: Bool1D
    elastic: Float2D
    functions: Int1D
    function_data: Float2D
    multipliers: Float1D
    values: Float1D
    compliance: Float1D
    slopes: Float2D
    line_sums: Float1D
    relaxation: float
    coupled: Int2D
    wrapped_rows: Int1D
    wrap_terms: Int2D
    wraps: Float2D
    coupling: Float1D
    excess: Float1D


class InterfaceNodes(Record):
    """State of the nodes of an ``Interface``, whose arrays these are.

    Attributes:
        frames: (n, 12) current values.
        increments, velocities: (n, 6) current values, local.
        inertial: (n,) True where translations are integrated in inertial axes.
    """

    frames: Float2D
    increments: Float2D
    velocities: Float2D
    inertial: Bool1D
