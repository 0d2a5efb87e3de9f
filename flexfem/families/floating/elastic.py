# SPDX-License-Identifier: LGPL-3.0-or-later
"""Compiled elastic and damping forces of bodies in a floating frame, in their coordinates.

Those of nonlinear bodies are polynomials in E coordinates: the n elastic ones, with the rotation
vector t of each interface replaced by ``a t``, and the products ``b t_p t_q``, see
``reduction.elastic_polynomial``.
"""

import numpy as np

from flexfem._types import FloatArray
from flexfem.families.floating.inertia import BodyData
from flexfem.kernels.compiled import kernel, subroutine
from flexfem.kernels.records import Memory, unpack

__all__ = [
    "add_elastic", "add_elastic_tangent", "find_strains", "strain_energy", "turned_coordinates",
]  # fmt: skip


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
def _factors(square: float) -> tuple[FloatArray, FloatArray]:
    """Factors a and b with two derivatives by the square of the angle.

    Series that are good to 3e-6 at one radian.
    """
    s = square
    a = np.array([
        1.0 - s / 6.0 + s * s / 120.0 - s**3 / 5040.0,
        -1.0 / 6.0 + s / 60.0 - s * s / 1680.0,
        1.0 / 60.0 - s / 840.0,
    ])  # fmt: skip
    b = np.array([
        1.0 - s / 12.0 + s * s / 360.0 - s**3 / 20160.0,
        -1.0 / 12.0 + s / 180.0 - s * s / 6720.0,
        1.0 / 180.0 - s / 3360.0,
    ])  # fmt: skip
    return a, b


@subroutine
def _turned(data: BodyData, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """All coordinates (E,) of a polynomial, and their derivatives (E, n) by the elastic ones."""
    n, every = len(x), len(data.linear)
    full, slopes = np.zeros(every), np.zeros((every, n))
    full[:n] = x
    for i in range(n):
        slopes[i, i] = 1.0
    for c in range((every - n) // 6):
        first, at = 6 * c + 3, n + 6 * c
        t = x[first : first + 3]
        a, b = _factors(t[0] * t[0] + t[1] * t[1] + t[2] * t[2])
        for p in range(3):
            full[first + p] = a[0] * t[p]
            slopes[first + p, first + p] = a[0]
            for j in range(3):
                slopes[first + p, first + j] += 2.0 * a[1] * t[p] * t[j]
            for q in range(p, 3):
                full[at] = b[0] * t[p] * t[q]
                slopes[at, first + p] += b[0] * t[q]
                slopes[at, first + q] += b[0] * t[p]
                for j in range(3):
                    slopes[at, first + j] += 2.0 * b[1] * t[p] * t[q] * t[j]
                at += 1
    return full, slopes


@subroutine
def _add_turning(x: FloatArray, force: FloatArray, K: FloatArray) -> None:
    """Add second derivatives of all coordinates, times the forces (E,) on them."""
    n = len(x)
    for c in range((len(force) - n) // 6):
        first, at = 6 * c + 3, n + 6 * c
        t, f = x[first : first + 3], force[first : first + 3]
        a, b = _factors(t[0] * t[0] + t[1] * t[1] + t[2] * t[2])
        M = np.zeros((3, 3))  # symmetric matrix of the forces on the products
        for p in range(3):
            for q in range(p, 3):
                M[p, q] += 0.5 * force[at]
                M[q, p] += 0.5 * force[at]
                at += 1
        along, bent, pull = np.dot(f, t), np.dot(t, np.dot(M, t)), np.dot(M, t)
        for i in range(3):
            for j in range(3):
                added = 2.0 * a[1] * (f[i] * t[j] + t[i] * f[j])
                added += 4.0 * (a[2] * along + b[2] * bent) * t[i] * t[j]
                added += 2.0 * b[0] * M[i, j] + 4.0 * b[1] * (pull[i] * t[j] + t[i] * pull[j])
                if i == j:
                    added += 2.0 * (a[1] * along + b[1] * bent)
                K[first + i, first + j] += added


@subroutine
def _polynomial(data: BodyData, full: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Symmetric matrices (E, E) that times all coordinates are the forces of each order."""
    n, at = len(full), 0
    pairs = np.empty(len(data.quadratic))
    for i in range(n):
        for j in range(i, n):
            pairs[at] = full[i] * full[j] if i == j else 2.0 * full[i] * full[j]
            at += 1
    by_pairs, by_products = np.dot(data.quadratic, full), np.dot(data.cubic, pairs)
    second, third, at = np.empty((n, n)), np.empty((n, n)), 0
    for i in range(n):
        for j in range(i, n):
            second[i, j] = second[j, i] = by_pairs[at]
            third[i, j] = third[j, i] = by_products[at]
            at += 1
    return data.linear, second, third


@kernel
def turned_coordinates(data: Memory, x: FloatArray) -> FloatArray:
    """All coordinates (E,) of the polynomial of a nonlinear body, from the elastic ones (n,)."""
    full, _ = _turned(unpack(BodyData, data), x)
    return full


@subroutine
def strain_energy(data: BodyData, x: FloatArray) -> float:
    """Energy of the elastic forces at the coordinates x, see :func:`add_elastic`."""
    if len(data.linear):
        full, _ = _turned(data, x)
        linear, second, third = _polynomial(data, full)
        stored: float = np.dot(full, np.dot(linear / 2.0 + second / 3.0 + third / 4.0, full))
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
    own = np.dot(data.damping, rates)
    if len(data.linear):
        full, slopes = _turned(data, x)
        linear, second, third = _polynomial(data, full)
        own += np.dot(slopes.T.copy(), np.dot(linear + second + third, full))
    else:
        own += np.dot(data.stiffness, x)
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
    if len(data.linear):
        x = eta[:, 0].copy()
        full, slopes = _turned(data, x)
        linear, second, third = _polynomial(data, full)
        tangent = np.dot(linear + 2.0 * second + 3.0 * third, slopes)
        K += np.dot(slopes.T.copy(), tangent)
        _add_turning(x, np.dot(linear + second + third, full), K)
        return
    K += data.stiffness
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
