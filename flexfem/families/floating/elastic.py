# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled elastic and damping forces of bodies in a floating frame, in their coordinates.

Those of nonlinear bodies are polynomials of third order, see ``reduction.elastic_polynomial``.
"""

import numpy as np

from flexfem._types import FloatArray
from flexfem.families.floating.inertia import BodyData
from flexfem.kernels.compiled import kernel, subroutine
from flexfem.kernels.records import Memory, unpack

__all__ = ["add_elastic", "add_elastic_tangent", "find_strains", "strain_energy"]


@subroutine
def interface_strains(data: BodyData, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Write ``T_k eta`` (6k, n) and the strains (6k,) of the interfaces' coordinates from it.

    Only for bodies that stiffen geometrically.
    """
    count, n = len(data.compliance), len(x)
    pulls = np.dot(data.pulling, x).reshape(count, n)
    strains = x[:count] + np.dot(data.compliance, 0.5 * np.dot(pulls, x))
    return pulls, strains


@kernel
def find_strains(data: Memory, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """:func:`interface_strains`, for Python."""
    return interface_strains(unpack(BodyData, data), x)


@subroutine
def _polynomial(data: BodyData, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Symmetric matrices (n, n) that times the coordinates are forces of second and third order."""
    n, at = len(x), 0
    pairs = np.empty(len(data.quadratic))
    for i in range(n):
        for j in range(i, n):
            pairs[at] = x[i] * x[j] if i == j else 2.0 * x[i] * x[j]
            at += 1
    by_pairs, by_products = np.dot(data.quadratic, x), np.dot(data.cubic, pairs)
    second, third, at = np.empty((n, n)), np.empty((n, n)), 0
    for i in range(n):
        for j in range(i, n):
            second[i, j] = second[j, i] = by_pairs[at]
            third[i, j] = third[j, i] = by_products[at]
            at += 1
    return second, third


@subroutine
def strain_energy(data: BodyData, x: FloatArray) -> float:
    """Energy of the elastic forces at the coordinates x, see :func:`add_elastic`."""
    if len(data.quadratic):
        second, third = _polynomial(data, x)
        stored: float = np.dot(x, np.dot(data.stiffness / 2.0 + second / 3.0 + third / 4.0, x))
        return stored
    energy = 0.5 * np.dot(x, np.dot(data.stiffness, x))
    if len(data.pulling):
        pulls, strains = interface_strains(data, x)
        both = x[: len(strains)] + strains
        energy += 0.25 * np.dot(np.dot(pulls, x), both)
    total: float = energy
    return total


@subroutine
def add_elastic(data: BodyData, eta: FloatArray, force: FloatArray) -> None:
    """Add elastic and damping forces (n,).

    With geometric stiffening the potential is ``1/2 eta K eta + eta_c tau + 1/2 tau F tau``,
    ``tau_k = 1/2 eta T_k eta`` and F the compliance of the interfaces' coordinates eta_c: the
    energy of their strains, including the stretch by bending.
    """
    x, rates = eta[:, 0].copy(), eta[:, 1].copy()
    own = np.dot(data.damping, rates) + np.dot(data.stiffness, x)
    if len(data.quadratic):
        second, third = _polynomial(data, x)
        own += np.dot(second + third, x)
    for i in range(len(x)):
        force[i] += own[i]
    if len(data.pulling):
        pulls, strains = interface_strains(data, x)
        for k in range(len(strains)):
            force[k] += 0.5 * np.dot(pulls[k], x)
            for i in range(len(x)):
                force[i] += strains[k] * pulls[k, i]


@subroutine
def add_elastic_tangent(data: BodyData, eta: FloatArray, K: FloatArray) -> None:
    """Add the derivatives (n, n) of the elastic forces by the coordinates."""
    n = len(eta)
    K += data.stiffness
    if len(data.quadratic):
        second, third = _polynomial(data, eta[:, 0].copy())
        K += 2.0 * second + 3.0 * third
    if not len(data.pulling):
        return
    pulls, strains = interface_strains(data, eta[:, 0].copy())
    for k in range(len(strains)):
        for i in range(n):
            K[k, i] += pulls[k, i]
            K[i, k] += pulls[k, i]
            for j in range(n):
                K[i, j] += strains[k] * data.pulling[k * n + i, j]
    K += np.dot(pulls.T.copy(), np.dot(data.compliance, pulls))
