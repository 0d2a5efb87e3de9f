# SPDX-License-Identifier: LGPL-3.0-or-later
"""Energy, forces and tangents of contacts between nodes and triangles.

A contact with the gap g < 0 stores ``k g^2 / 2``, or more where it stiffens (``stiffening``): then
k g is its force, and the slope takes the place of k before dg. With ``r = p - sum w_i x_i`` at
fixed area coordinates, the normal n and an orthonormal basis e_c of the plane across it,

    dg = n . dr,   d2g = sum_c (-2 A_c B_c - s B_c^2 + kappa_c A_c^2),
    A_c = e_c . dr,   B_c = sum_i D_ci n . dx_i,

s the distance. B_c is the rotation of the normal about the other direction as the nodes move. Along
a face or an edge kappa = 0; across an edge and at a node, where the distance is that to a line or a
point, B = 0 and kappa = 1 / s. These are the second derivatives of the distance of a point to the
closest point that slides: the tangent is exact and symmetric.
"""

import numpy as np

from flexfem._types import FloatArray, IntArray
from flexfem.contact.law.data import (
    AREAS,
    BEND,
    DISTANCE,
    FIRST,
    FORCE,
    NORMAL,
    POTENTIAL,
    SECOND,
    SLOPE,
    TURN,
    Found,
    Masters,
    Slaves,
)
from flexfem.kernels.compiled import inlined, kernel
from flexfem.kernels.records import Memory, unpack

__all__ = ["add_actions", "add_forces", "blocks_into", "energy"]


@kernel
def energy(slaves: Memory, found: Memory) -> float:
    """Energy stored by all contacts, J."""
    stiffness, own = unpack(Slaves, slaves).stiffness, unpack(Found, found)
    total = 0.0
    for c in range(own.closed[0]):
        total += stiffness[own.ends[c, 0]] * own.numbers[c, POTENTIAL]
    return total


@kernel
def add_forces(
    slaves: Memory, masters: Memory, found: Memory, scale: float, residual: FloatArray
) -> None:
    """Add ``scale`` times the derivative of the energy to the residual of all nodes (n, 3)."""
    touching, triangles = unpack(Slaves, slaves), unpack(Masters, masters).triangles
    own = unpack(Found, found)
    nodes, stiffness, ends, contacts = touching.nodes, touching.stiffness, own.ends, own.numbers
    for c in range(own.closed[0]):
        i, t = ends[c]
        force = scale * stiffness[i] * contacts[c, FORCE]
        for a in range(3):
            f = force * contacts[c, NORMAL + a]
            residual[nodes[i], a] += f
            for k in range(3):
                residual[triangles[t, k], a] -= contacts[c, AREAS + k] * f


@inlined
def _changes(
    contact: FloatArray, slave: int, triangle: IntArray, steps: FloatArray, change: FloatArray
) -> None:
    """Write n . dr, A_1, A_2, B_1, B_2 (5,)."""
    change[:] = 0.0
    for a in range(3):
        dr = steps[slave, a]
        for k in range(3):
            dx = steps[triangle[k], a]
            dr -= contact[AREAS + k] * dx
            change[3] += contact[TURN + k] * contact[NORMAL + a] * dx
            change[4] += contact[TURN + 3 + k] * contact[NORMAL + a] * dx
        change[0] += contact[NORMAL + a] * dr
        change[1] += contact[FIRST + a] * dr
        change[2] += contact[SECOND + a] * dr


@kernel
def add_actions(
    slaves: Memory, masters: Memory, found: Memory, scale: float, steps: FloatArray,
    residual: FloatArray,
) -> None:  # fmt: skip
    """Add ``scale`` times the tangent applied to steps of all nodes (n, 3) to the residual."""
    touching, triangles = unpack(Slaves, slaves), unpack(Masters, masters).triangles
    own = unpack(Found, found)
    nodes, stiffness, ends, contacts = touching.nodes, touching.stiffness, own.ends, own.numbers
    change = np.empty(5)
    for c in range(own.closed[0]):
        i, t = ends[c]
        contact, slave, triangle = contacts[c], nodes[i], triangles[t]
        _changes(contact, slave, triangle, steps, change)
        k, g, s = scale * stiffness[i], contact[FORCE], contact[DISTANCE]
        # forces conjugate to n . dr, A_c (along e_c) and B_c
        a0 = k * contact[SLOPE] * change[0]
        a1 = k * g * (contact[BEND] * change[1] - change[3])
        a2 = k * g * (contact[BEND + 1] * change[2] - change[4])
        b1, b2 = -k * g * (change[1] + s * change[3]), -k * g * (change[2] + s * change[4])
        for a in range(3):
            f = a0 * contact[NORMAL + a] + a1 * contact[FIRST + a] + a2 * contact[SECOND + a]
            residual[slave, a] += f
            for j in range(3):
                turn = contact[TURN + j] * b1 + contact[TURN + 3 + j] * b2
                residual[triangle[j], a] += turn * contact[NORMAL + a] - contact[AREAS + j] * f


@kernel
def blocks_into(
    slaves: Memory, masters: Memory, found: Memory, scale: float, nodes: IntArray,
    blocks: FloatArray,
) -> None:  # fmt: skip
    """Write the nodes (c, 4), slave first, and ``scale`` times the tangents (c, 12, 12)."""
    touching, triangles = unpack(Slaves, slaves), unpack(Masters, masters).triangles
    own, stiffness, u = unpack(Found, found), touching.stiffness, np.empty(4)
    u[0] = 1.0
    for c in range(own.closed[0]):
        i, t = own.ends[c]
        contact = own.numbers[c]
        n, s = contact[NORMAL : NORMAL + 3], contact[DISTANCE]
        nodes[c, 0], nodes[c, 1:], u[1:] = touching.nodes[i], triangles[t], -contact[AREAS:][:3]
        k, kg = scale * stiffness[i] * contact[SLOPE], scale * stiffness[i] * contact[FORCE]
        for p in range(4):
            for q in range(4):
                for a in range(3):
                    for b in range(3):
                        value = k * u[p] * u[q] * n[a] * n[b]
                        for d in range(2):
                            e = contact[FIRST + 3 * d : FIRST + 3 + 3 * d]
                            dp = contact[TURN - 1 + 3 * d + p] if p > 0 else 0.0
                            dq = contact[TURN - 1 + 3 * d + q] if q > 0 else 0.0
                            mixed = u[p] * dq * e[a] * n[b] + dp * u[q] * n[a] * e[b]
                            bent = contact[BEND + d] * u[p] * u[q] * e[a] * e[b]
                            value += kg * (bent - mixed - s * dp * dq * n[a] * n[b])
                        blocks[c, 3 * p + a, 3 * q + b] = value
