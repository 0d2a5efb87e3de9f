# SPDX-License-Identifier: LGPL-3.0-or-later
"""Friction and damping of contacts that were closed at the last accepted state.

Through a step, normal, area coordinates and normal force are those of its start, so that both have
a potential and symmetric tangents (lagged friction; Li et al., Incremental Potential Contact, ACM
Trans. Graph. 39, 2020). The relative displacement d since the start of the step gives

    tau = tau_0 + k_t (d - n n.d),   cut down to |tau| <= mu N,

Coulomb's law with an elastic stick, and a viscous normal force ``c n.d / h``, whose tension does
not exceed N. The error of a step is of first order in its size.
"""

import numpy as np

from flexfem._types import FloatArray
from flexfem.kernels.compiled import kernel

__all__ = ["friction_forces", "friction_losses"]


@kernel
def friction_forces(
    slips: FloatArray, normals: FloatArray, pushes: FloatArray, pulls: FloatArray,
    stiffness: FloatArray, law: FloatArray, forces: FloatArray, tangents: FloatArray,
) -> None:  # fmt: skip
    """Write forces against the relative displacements (c, 3) and their derivatives (c, 3, 3).

    Args:
        slips: Displacements of the nodes relative to the surface since the start of the step, m.
        normals: Normals of the surface, shape (c, 3).
        pushes: Normal forces at the start of the step, shape (c,), newtons.
        pulls: Tangential forces at the start of the step, shape (c, 3), newtons.
        stiffness: Normal stiffness, shape (c,), N/m.
        law: Coefficient of friction, and over the normal stiffness the tangential one and the
            damping divided by the step, shape (3,).
        forces: Added to the residual of the node; the opposite to that of the surface.
        tangents: Derivatives of the forces by the slips.
    """
    t = np.empty(3)
    for c in range(len(slips)):
        n, d, limit = normals[c], slips[c], law[0] * pushes[c]
        sticking, viscous = law[1] * stiffness[c], law[2] * stiffness[c]
        along = n[0] * d[0] + n[1] * d[1] + n[2] * d[2]
        size = 0.0
        for a in range(3):
            t[a] = pulls[c, a] + sticking * (d[a] - along * n[a])
            size += t[a] * t[a]
        size = np.sqrt(size)
        stuck = size <= limit
        factor = 1.0 if stuck else limit / size
        damped = viscous * along < pushes[c]
        normal, k = (viscous * along if damped else pushes[c]), factor * sticking
        for a in range(3):
            forces[c, a] = factor * t[a] + normal * n[a]
            for b in range(3):
                K = k * ((1.0 if a == b else 0.0) - n[a] * n[b])
                if not stuck and size > 0.0:
                    K -= k * t[a] * t[b] / (size * size)
                tangents[c, a, b] = K + (viscous * n[a] * n[b] if damped else 0.0)


@kernel
def friction_losses(
    slips: FloatArray, normals: FloatArray, pulls: FloatArray, sticking: FloatArray,
    forces: FloatArray,
) -> float:  # fmt: skip
    """Energy dissipated in a step, J: work of the ``forces`` in sliding and approach."""
    lost = 0.0
    for c in range(len(slips)):
        n, along, way = normals[c], 0.0, 0.0
        for a in range(3):
            along += n[a] * forces[c, a]
            way += n[a] * slips[c, a]
        lost += along * way
        for a in range(3):
            tangential, slip = forces[c, a] - along * n[a], slips[c, a] - way * n[a]
            if sticking[c] > 0.0:
                slip -= (tangential - pulls[c, a]) / sticking[c]
            lost += tangential * slip
    return lost
