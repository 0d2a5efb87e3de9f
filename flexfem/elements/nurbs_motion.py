# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled loop over NURBS elements for energies and momenta; see ``nurbs_inertia``."""

import numpy as np

from flexfem._types import BoolArray, FloatArray, IndexArray, IntArray
from flexfem.core.motion import ANGULAR, KINETIC, add_motion, centre_into
from flexfem.lie.compiled import kernel

__all__ = ["add_element_motion"]


@kernel
def add_element_motion(
    cells: IndexArray, chosen: BoolArray, products: FloatArray, weights: FloatArray,
    sections: IntArray, inertias: FloatArray, frames: FloatArray, velocity: FloatArray,
    motion: FloatArray,
) -> None:  # fmt: skip
    """Add energy and momenta of the chosen elements to ``motion``, see ``flexfem.core.motion``.

    ``products`` (m, k, k) and ``weights`` (m, k) are those of ``nurbs_tables.Masses``.
    """
    count, k = cells.shape
    p, way, speed, x, u = np.empty(6), np.empty(3), np.empty(3), np.empty((k, 3)), np.empty((k, 3))
    for c in range(count):
        if not chosen[c]:
            continue
        M = inertias[sections[c]]
        for I in range(k):  # noqa: E741
            H, v = frames[cells[c, I]], velocity[cells[c, I]]
            add_motion(H, v, M, weights[c, I], p, motion)
            centre_into(H, v, M, x[I], u[I])
        # from masses at the nodes to masses along the line
        for I in range(k):  # noqa: E741
            for J in range(I):
                mass = M[0, 0] * products[c, I, J]
                for i in range(3):
                    way[i] = x[I, i] - x[J, i]
                    speed[i] = u[I, i] - u[J, i]
                    motion[KINETIC] -= 0.5 * mass * speed[i] * speed[i]
                for i in range(3):
                    i1, i2 = (i + 1) % 3, (i + 2) % 3
                    motion[ANGULAR + i] -= mass * (way[i1] * speed[i2] - way[i2] * speed[i1])
