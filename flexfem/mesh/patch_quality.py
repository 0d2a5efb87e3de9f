# SPDX-License-Identifier: LGPL-3.0-or-later
"""How much a mesh softens curvatures that are fitted to patches.

The patch of a triangle is itself and the nodes opposite to its three edges; a quadratic function
through the six nodes gives one curvature tensor. A field of constant curvature is met exactly,
but on most meshes it is not in equilibrium: the nodes move out of it, by as much on fine meshes as
on coarse ones, and the limit is too soft. On regular meshes of one diagonal the nodes stay.
"""

import numpy as np
import numpy.typing as npt

from flexfem._types import FloatArray, IntArray

__all__ = ["patch_softening"]

_ComplexArray = npt.NDArray[np.complex128]

# Determinant of the fit in units of the triangle's size below which six nodes lie on a conic
_SINGULAR = 1e-10


def patch_softening(points: FloatArray, triangles: IntArray, opposite: IntArray) -> float:
    """Estimate the loss of bending stiffness by a mesh, relative to the material's.

    For fields of constant curvature, |k|^2 / 2 being the energy per area, it is the energy that
    the inner nodes would give off if each alone moved to its equilibrium, averaged over an
    orthonormal basis of the curvature tensors. Neighbours are unfolded into the triangle's plane,
    so that surfaces may be curved. The true loss, where all nodes move, was 0.7 to 3.2 times as
    large (bending along the axes of flat meshes, Poisson's ratio 0.3):

    ======================================  ========  =====
    mesh                                    estimate  loss
    ======================================  ========  =====
    one diagonal; one in each row           0         0
    one diagonal, nodes moved by 0.2 cells  0.010     0.009
    gmsh, frontal-Delaunay (algorithm 6)    0.001     0.002
    gmsh, Delaunay (algorithm 5)            0.031     0.054
    diagonals at random                     0.10      0.13
    union jack                              0.56      0.42
    ======================================  ========  =====

    Args:
        points: Node positions, shape (n, 3), metres.
        triangles: Node indices, shape (m, 3).
        opposite: Node over each edge, -1 without, shape (m, 3).

    Returns:
        The estimate; 0 where no node has whole patches all round, infinite when the six nodes of
        a patch lie on a conic, so that no curvature fits.
    """
    whole = (opposite >= 0).all(axis=1)
    patches = np.column_stack([triangles, opposite])
    inner = np.ones(len(points), dtype=bool)
    torn = patches[~whole]
    inner[torn[torn >= 0]] = False
    used, patches = triangles[whole], patches[whole]
    if len(used) == 0 or not inner[used].any():
        return 0.0
    frames, flat = _unfold(points, used, patches)
    areas = 0.5 * flat[:, 1, 0] * flat[:, 2, 1]
    mean, deviation = _fit(flat, areas)
    if not np.isfinite(mean).all():
        return float("inf")
    stiffness = areas[:, np.newaxis] * (mean**2 + np.abs(deviation) ** 2)
    turned = areas[:, np.newaxis] * deviation * _turns(frames, used, patches, len(points))
    nodes, count = patches.ravel(), len(points)

    def gather(values: FloatArray) -> FloatArray:
        return np.bincount(nodes, values.ravel(), count)[inner]

    force = gather(areas[:, np.newaxis] * mean) ** 2 + gather(turned.real) ** 2
    force += gather(turned.imag) ** 2
    shares = np.bincount(used.ravel(), np.repeat(areas / 3.0, 3), count)[inner]
    return float((force / gather(stiffness)).sum() / (3.0 * shares.sum()))


def _unfold(
    points: FloatArray, triangles: IntArray, patches: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Return axes in rows, shape (m, 3, 3), and the patch's nodes in the plane, shape (m, 6, 2).

    The first axis runs from node 0 to node 1, the third is the normal, node 0 is the origin.
    """
    x = points[patches]
    e1, side = x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]
    e3 = np.cross(e1, side)
    e1 = e1 / np.linalg.norm(e1, axis=1, keepdims=True)
    e3 = e3 / np.linalg.norm(e3, axis=1, keepdims=True)
    frames = np.stack([e1, np.cross(e3, e1), e3], axis=1)
    flat = np.einsum("mab,mib->mia", frames[:, :2], x - x[:, :1])
    for k in range(3):
        a, b, far = (k + 1) % 3, (k + 2) % 3, 3 + k
        edge = x[:, b] - x[:, a]
        length = np.linalg.norm(edge, axis=1)
        along = ((x[:, far] - x[:, a]) * edge).sum(axis=1) / length
        height = np.linalg.norm(np.cross(edge, x[:, far] - x[:, a]), axis=1) / length
        t = (flat[:, b] - flat[:, a]) / length[:, np.newaxis]
        outward = np.column_stack([t[:, 1], -t[:, 0]])
        flat[:, far] = flat[:, a] + along[:, np.newaxis] * t + height[:, np.newaxis] * outward
    return frames, flat


def _fit(flat: FloatArray, areas: FloatArray) -> tuple[FloatArray, _ComplexArray]:
    """Return the curvature tensors of the six nodes' unit deflections, 1/m^2, NaN when singular.

    Returns:
        Mean part (k11 + k22) / sqrt(2), shape (m, 6), and deviation
        (k11 - k22) / sqrt(2) + i sqrt(2) k12, shape (m, 6): the norm of both is the tensor's.
    """
    size = np.sqrt(areas)[:, np.newaxis, np.newaxis]
    scaled = (flat - flat[:, :3].mean(axis=1, keepdims=True)) / size
    x, y = scaled[..., 0], scaled[..., 1]
    terms = np.stack([np.ones_like(x), x, y, 0.5 * x * x, 0.5 * y * y, x * y], axis=-1)
    regular = np.abs(np.linalg.det(terms)) > _SINGULAR
    terms[~regular] = np.eye(6)
    k11, k22, k12 = np.moveaxis(np.linalg.inv(terms)[:, 3:] / size**2, 1, 0)
    k11[~regular] = np.nan
    root = np.sqrt(2.0)
    return (k11 + k22) / root, (k11 - k22) / root + 1j * root * k12


def _turns(frames: FloatArray, triangles: IntArray, patches: IntArray, count: int) -> _ComplexArray:
    """Return the factors that turn each deviation into one axis of the node, shape (m, 6)."""
    axis = np.zeros((count, 3))
    axis[triangles] = frames[:, np.newaxis, 0]
    seen = axis[patches]
    cosine = np.einsum("mib,mb->mi", seen, frames[:, 0])
    sine = np.einsum("mib,mb->mi", seen, frames[:, 1])
    axes = cosine - 1j * sine
    # An axis at right angles to the triangle, across a sharp fold, turns nothing
    length = np.abs(axes)
    axes = np.where(length > 1e-6, axes / np.maximum(length, 1e-6), 1.0)
    return axes**2
