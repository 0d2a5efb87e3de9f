# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loop over NURBS elements for energies and momenta; see ``inertia``."""

import numpy as np

from flexfem._types import BoolArray, FloatArray
from flexfem.core.nodes.frame_kernels import Nodes
from flexfem.core.nodes.motion import ANGULAR, KINETIC, add_motion, centre_into
from flexfem.kernels.compiled import kernel
from flexfem.kernels.records import Float2D, Float3D, Int1D, Int2D, Memory, Record, unpack

__all__ = ["MassiveElements", "add_element_motion"]


class MassiveElements(Record):
    """Masses of m elements with k nodes each.

    Attributes:
        nodes: (m, k) control points.
        products, weights: (m, k, k) and (m, k) integrals, see ``tables.Masses``.
        section: (m,) number of the section.
        inertias: (s, 6, 6) of the sections per length.
    """

    nodes: Int2D
    products: Float3D
    weights: Float2D
    section: Int1D
    inertias: Float3D


@kernel
def add_element_motion(
    elements: Memory, chosen: BoolArray, nodes: Memory, motion: FloatArray
) -> None:
    """Add energy and momenta of the chosen elements to ``motion``.

    See ``flexfem.core.nodes.motion``.
    """
    own, state = unpack(MassiveElements, elements), unpack(Nodes, nodes)
    cells, frames, velocity = own.nodes, state.frames, state.velocity
    count, k = cells.shape
    p, way, speed, x, u = np.empty(6), np.empty(3), np.empty(3), np.empty((k, 3)), np.empty((k, 3))
    for c in range(count):
        if not chosen[c]:
            continue
        M = own.inertias[own.section[c]]
        for I in range(k):  # noqa: E741
            H, v = frames[cells[c, I]], velocity[cells[c, I]]
            add_motion(H, v, M, own.weights[c, I], p, motion)
            centre_into(H, v, M, x[I], u[I])
        # from masses at the nodes to masses along the line
        for I in range(k):  # noqa: E741
            for J in range(I):
                mass = M[0, 0] * own.products[c, I, J]
                for i in range(3):
                    way[i] = x[I, i] - x[J, i]
                    speed[i] = u[I, i] - u[J, i]
                    motion[KINETIC] -= 0.5 * mass * speed[i] * speed[i]
                for i in range(3):
                    i1, i2 = (i + 1) % 3, (i + 2) % 3
                    motion[ANGULAR + i] -= mass * (way[i1] * speed[i2] - way[i2] * speed[i1])
