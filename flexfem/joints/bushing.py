# SPDX-License-Identifier: LGPL-3.0-or-later
"""Bushing: elastic and viscous in all six relative degrees of freedom."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._types import FloatArray
from flexfem.core.curves.curve import Curve
from flexfem.core.joint import Joint, turn_angles
from flexfem.core.laws import Law, curve, spring
from flexfem.core.pose import Pose
from flexfem.core.row import Row, RowKind, Term

__all__ = ["Bushing"]

#: Eigenvalues of a scaled matrix below this are zero.
_ROUNDING = 1e-12


@dataclass(frozen=True, eq=False)
class Bushing(Joint):
    """Elastic and viscous connection, ``w = K q + C dq/dt``, and functions of single coordinates.

    The six coordinates q are the displacements of b from its place at the start (m, in the axes of
    marker a) and the angles about the axes of marker a by which b has rotated since (rad), each
    measured between projections of an axis of either marker: exact for rotations of any size about
    the third axis of marker a, and below a right angle about one of the others; otherwise the
    rotation vector to first order. The forces w are conjugate to them: marker a is where the
    moments of the displacements' forces balance.

    Attributes:
        stiffness: K; six numbers of the diagonal or a symmetric matrix, shape (6, 6), positive
            semidefinite; N/m, N m/rad.
        damping: C; the same in N s/m, N m s/rad.
        forces: functions of coordinates besides, by their numbers 0 to 5: ``force(q)`` or
            ``force(q, v)`` of a coordinate and its rate, or a `Curve`, as the force of a
            ``SpringDamper``; N, N m.
    """

    stiffness: npt.ArrayLike = (0.0,) * 6
    damping: npt.ArrayLike = (0.0,) * 6
    forces: Mapping[int, Callable[..., float] | Curve] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check both matrices.

        Raises:
            TypeError: they do not consist of numbers.
            ValueError: wrong shape, not symmetric, not positive semidefinite, or both zero without
                functions; a function with other arguments, or of an unknown coordinate.
        """
        super().__post_init__()
        K = _matrix(self.owner, "stiffness", self.stiffness)
        C = _matrix(self.owner, "damping", self.damping)
        _checks.instance(self.owner, "forces", self.forces, Mapping)
        for number in self.forces:
            if number not in range(6):
                raise ValueError(
                    f"{self.owner}: forces must be given for coordinates 0 to 5, got "
                    f"{_checks.show(number)}"
                )
        _ = self._laws
        if not (K.any() or C.any() or self.forces):
            raise ValueError(f"{self.owner}: stiffness and damping must not both be zero")

    @property
    def _laws(self) -> dict[int, Law]:
        return {
            number: curve(self.owner, f"forces[{number}]", force)
            for number, force in sorted(self.forces.items())
        }

    def rows(self, poses: Sequence[Pose], t: float) -> tuple[Row, ...]:
        """See :meth:`Joint.rows`."""
        a, b = poses
        start = a.rotation.T @ (b.position - a.position)
        along = [Term(RowKind.ALONG, u=e) for e in np.eye(3)]
        about = turn_angles(a, b)
        zero = np.concatenate([start, np.zeros(3)])
        K = _matrix(self.owner, "stiffness", self.stiffness)
        C = _matrix(self.owner, "damping", self.damping)
        terms = (*along, *about)
        nonlinear = [Row((terms[i],), float(zero[i]), law) for i, law in self._laws.items()]
        if _diagonal(K) and _diagonal(C):
            linear = [
                Row((term,), float(zero[i]), spring(float(K[i, i]), float(C[i, i])))
                for i, term in enumerate(terms)
                if K[i, i] or C[i, i]
            ]
            return (*linear, *nonlinear)
        parts = [(vector, spring(1.0, 0.0)) for vector in _parts(K)]
        parts += [(vector, spring(0.0, 1.0)) for vector in _parts(C)]
        return (*(_combined(terms, zero, *part) for part in parts), *nonlinear)


def _combined(terms: Sequence[Term], zero: FloatArray, vector: FloatArray, law: Law) -> Row:
    """Row with a law for the combination ``vector . q`` of the coordinates."""
    used = tuple(
        replace(term, factor=float(c)) for term, c in zip(terms, vector, strict=True) if c != 0.0
    )
    return Row(used, float(vector @ zero), law)


def _matrix(owner: str, what: str, value: npt.ArrayLike) -> FloatArray:
    """The full matrix of six numbers or of a matrix, checked."""
    rows = value if isinstance(value, (list, tuple, np.ndarray)) else ()
    full = any(isinstance(row, (list, tuple, np.ndarray)) for row in rows)
    matrix = _checks.array(owner, what, value, (6, 6) if full else (6,))
    if not full:
        matrix = np.diag(matrix)
    if np.abs(matrix - matrix.T).max() > 1e-9 * np.abs(matrix).max():
        raise ValueError(f"{owner}: {what} must be symmetric, got {_checks.show(value)}")
    scaled, _ = _scaled(matrix)
    smallest = float(np.linalg.eigvalsh(scaled)[0])
    if np.diag(matrix).min() < 0.0 or smallest < -_ROUNDING:
        shown = _checks.show(value)
        raise ValueError(f"{owner}: {what} must be positive semidefinite, got {shown}")
    return matrix


def _scaled(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The matrix with ones on its diagonal, and the roots of the diagonal: units cancel."""
    root = np.sqrt(np.abs(np.diag(matrix)))
    inverse = np.where(root > 0.0, 1.0 / np.where(root > 0.0, root, 1.0), 1.0)
    return matrix * np.outer(inverse, inverse), root


def _parts(matrix: FloatArray) -> list[FloatArray]:
    """Vectors l with ``matrix = sum l l^T``."""
    scaled, root = _scaled(matrix)
    values, vectors = np.linalg.eigh(scaled)
    kept = np.flatnonzero(values > _ROUNDING)
    return [np.sqrt(values[k]) * root * vectors[:, k] for k in kept]


def _diagonal(matrix: FloatArray) -> bool:
    return not np.any(matrix - np.diag(np.diag(matrix)))
