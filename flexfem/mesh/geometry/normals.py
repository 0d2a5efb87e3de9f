# SPDX-License-Identifier: LGPL-3.0-or-later
"""Vectors normal to tangents; all functions work on the rows of arrays (..., 3)."""

import numpy as np

from flexfem import _checks
from flexfem._types import FloatArray

# Sine of the smallest angle between an orientation vector and the tangent
_PARALLEL = 1e-6


def dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the dot products of the rows, shape (..., 1)."""
    result: FloatArray = np.einsum("...i,...i->...", a, b)[..., None]
    return result


def projected(vectors: FloatArray, e1: FloatArray, places: FloatArray) -> FloatArray:
    """Return the unit vectors of the parts of `vectors` normal to `e1`."""
    normal = vectors - dot(vectors, e1) * e1
    size = np.linalg.norm(normal, axis=-1, keepdims=True)
    parallel = size <= _PARALLEL * np.linalg.norm(vectors, axis=-1, keepdims=True)
    if parallel.any():
        where = np.unravel_index(int(np.argmax(parallel)), parallel.shape)[:-1]
        raise ValueError(
            f"orientation {_checks.show(vectors[where].tolist())} is parallel to the tangent at "
            f"{_checks.show(places[where].tolist())}"
        )
    # Once more: near the tangent the first projection leaves a rounding error
    normal /= size
    normal -= dot(normal, e1) * e1
    result: FloatArray = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
    return result


def any_normal(tangents: FloatArray) -> FloatArray:
    """Return unit vectors normal to unit tangents: horizontal, near ey for vertical tangents."""
    vertical = np.abs(tangents[..., 2:]) > 0.99
    normal = np.where(
        vertical, np.array([0.0, 1.0, 0.0]), np.cross(np.array([0.0, 0.0, 1.0]), tangents)
    )
    normal = normal - dot(normal, tangents) * tangents
    return np.asarray(normal / np.linalg.norm(normal, axis=-1, keepdims=True))


def reflect(vectors: FloatArray, mirror: FloatArray) -> FloatArray:
    """Reflect vectors in the planes normal to `mirror`; zero mirrors leave them as they are."""
    square = dot(mirror, mirror)
    return vectors - 2.0 * dot(mirror, vectors) / np.where(square > 0.0, square, 1.0) * mirror


def turn(vectors: FloatArray, old: FloatArray, new: FloatArray) -> FloatArray:
    """Turn vectors normal to `old` by the smallest rotation from `old` to `new`."""
    cosine = np.maximum(1.0 + dot(old, new), 1e-15)  # a fold by 180 degrees keeps normals
    return vectors - dot(new, vectors) / cosine * (old + new)


def angle_about(vectors: FloatArray, normals: FloatArray, tangents: FloatArray) -> FloatArray:
    """Return the angles about the tangents from `normals` to `vectors`."""
    sine = dot(vectors, np.cross(tangents, normals))[..., 0]
    return np.arctan2(sine, dot(vectors, normals)[..., 0])
