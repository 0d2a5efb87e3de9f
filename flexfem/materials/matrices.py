# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checks of the matrices of sections."""

import numpy as np

from flexfem import _checks
from flexfem._types import FloatArray

__all__ = ["check_definite", "check_inertia_form"]

# Relative deviation from symmetry that input rounded to a dozen digits may have
_SYMMETRY_TOLERANCE = 1e-10
# Smallest eigenvalue, after scaling the diagonal to one, that still counts as positive
_DEFINITE_TOLERANCE = 1e-12


def check_definite(owner: str, what: str, matrix: FloatArray, *, semidefinite: bool) -> None:
    """Check that a matrix is symmetric and positive (semi)definite.

    Raises:
        ValueError: It is not; the message names the owner, the matrix and the offending value.
    """
    diagonal = matrix.diagonal()
    if np.count_nonzero(matrix) == len(matrix) and diagonal.min() > 0.0:
        return  # diagonal, as most are: sections along a beam are many
    kind = "semidefinite" if semidefinite else "definite"
    bad = diagonal < 0.0 if semidefinite else diagonal <= 0.0
    if bad.any():
        i = int(np.argmax(bad))
        raise ValueError(
            f"{owner}: {what} must be positive {kind}, but entry ({i + 1}, {i + 1}) is "
            f"{diagonal[i]:g}"
        )
    # Scaling makes newtons and newton metres squared comparable
    scale = np.where(diagonal > 0.0, np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0)), 1.0)
    scaled = matrix / np.outer(scale, scale)
    defect = np.abs(scaled - scaled.T)
    if defect.max() > _SYMMETRY_TOLERANCE:
        i, j = divmod(int(defect.argmax()), len(matrix))
        raise ValueError(
            f"{owner}: {what} must be symmetric, but entries ({i + 1}, {j + 1}) and "
            f"({j + 1}, {i + 1}) are {matrix[i, j]:g} and {matrix[j, i]:g}"
        )
    smallest = float(np.linalg.eigvalsh(scaled)[0])
    if smallest < (-_SYMMETRY_TOLERANCE if semidefinite else _DEFINITE_TOLERANCE):
        raise ValueError(
            f"{owner}: {what} must be positive {kind}, but its smallest eigenvalue "
            f"(diagonal scaled to one) is {smallest:.3g}"
        )


def check_inertia_form(owner: str, inertia: FloatArray) -> None:
    """Check that an inertia is that of masses moving as one rigid slice.

    Raises:
        ValueError: It is not.
    """
    mass, coupling = inertia[:3, :3], inertia[3:, :3]
    equal = mass[0, 0] == mass[1, 1] == mass[2, 2]
    if equal and np.count_nonzero(inertia) == np.count_nonzero(inertia.diagonal()):
        return
    size = max(float(np.abs(inertia).max()), np.finfo(float).tiny)
    if (
        np.abs(mass - mass[0, 0] * np.eye(3)).max() > _SYMMETRY_TOLERANCE * size
        or np.abs(coupling + coupling.T).max() > _SYMMETRY_TOLERANCE * size
    ):
        raise ValueError(
            f"{owner}: inertia must have the form [[m I, -S], [S, J]] with S skew-symmetric, got "
            f"{_checks.show(inertia.tolist())}"
        )
