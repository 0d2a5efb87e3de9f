# SPDX-License-Identifier: LGPL-3.0-or-later
r"""Number of modes in a range by Sylvester's law of inertia, without eigenvalues.

By Sylvester's law a symmetric matrix has as many negative eigenvalues as pivots, and
``[[P, G^T], [G, 0]]`` with m conditions has m more than P has on the motions that G admits. N is
the number of those of P.

**Without a term in lambda** ``N(K - s M)`` is the number of ``omega^2 < s``.

**With a gyroscopic one**, K symmetric, M positive and C skew, ``P(i omega) = K - omega^2 M + i
omega C`` is Hermitian. Its eigenvalues are analytic in omega (Rellich). One of them passes zero
where ``i omega`` is an eigenvalue of the problem, ``P u = 0``, with the slope ``u^H P' u = c - 2
omega m``, where ``k = u^H K u, m = u^H M u, c = u^H i C u``. As ``u^H P u = k - omega^2 m + omega c
= 0``, the slope is ``-(k + omega^2 m)/omega``: the energy of the mode with the other sign. So for
``0 < a < b``

    ``N(b) - N(a) = n_down - n_up``,

the modes of positive energy between a and b less those of negative energy (Krein's signature).

- K positive: every energy is positive, and the difference is the number of modes.
  ``N(K + a^2 M) = 0`` is enough: then ``k > -a^2 m > -omega^2 m``. That admits rigid motions.
- Otherwise, as in rotors above a critical speed, ``N(a) - N(b)`` with ``b -> infinity``, where P
  has n negative eigenvalues for n degrees of freedom, is ``n_up - n_down``, and there are n modes
  at most: ``n_up <= N(a)/2``. If so many of negative energy have been found, there is no other one,
      and those of positive energy are counted. If fewer have been found, a count that differs
  from the energies of those found still indicates missing modes, and one that agrees is
  inconclusive.

Complex matrices are factorised in their real form, which has every eigenvalue twice.

*Sources:* Lancaster, Linear Algebra Appl. 9 (1974) on signs of real eigenvalues of Hermitian
polynomials; Tisseur, Meerbergen, SIAM Rev. 43 (2001), section 3.
"""

from dataclasses import dataclass

from petsc4py import PETSc

import numpy as np

from flexfem.la.direct import CountingFactors
from flexfem.solvers.modal.mode_errors import STEADY, ZERO, ComplexArray, Solution
from flexfem.solvers.modal.pencil import Pencil
from flexfem.solvers.modal.shifted_inverse import real_form

__all__ = ["count_below", "gyroscopic_count", "missing_modes"]

#: Difference of distances below which eigenvalues are a multiple one.
_EQUAL = 1e-6
#: Start of the count of a gyroscopic problem, relative to the slowest mode found.
_LOW = 1e-3
#: Relative energy of a mode below which its sign is unknown.
_SIGN = 1e-6


@dataclass(frozen=True)
class _Range:
    """Range of the count: eigenvalues up to number ``last`` of those found, within ``reach``."""

    last: int
    reach: float


def missing_modes(
    pencil: Pencil, solution: Solution, count: int, target: float
) -> tuple[int | None, str]:  # fmt: skip
    """Modes nearer than the last of those found that were not found (collective).

    Args:
        pencil: the problem.
        solution: eigenpairs, nearest first, complete as far as is known.
        count: number of the requested ones.
        target: rad/s.

    Returns:
        Their number, and an empty text; or None, and the reason why they cannot be counted.
    """
    if len(solution.values) == 0:
        return None, "no mode was found"
    if pencil.damped and not pencil.gyroscopic:
        return None, "damping"
    if not pencil.symmetric:
        return None, "the stiffness is not symmetric"
    limits = _range(solution, count, target)
    if pencil.damped:
        return _missing_gyroscopic(pencil, solution, limits, target)
    low = limits.reach**2 - target**2  # real eigenvalues are not near the target
    high = count_below(pencil, (target + limits.reach) ** 2)
    more = None if high is None else high - (limits.last + 1)
    if more is not None and more != 0:
        below = count_below(pencil, -low if low > 0.0 else (target - limits.reach) ** 2)
        more = None if below is None else more - below
    return _told(more)


def _told(more: int | None) -> tuple[int | None, str]:
    if more is None:
        return None, "the count meets a singular matrix"
    return (None, "the count is less than what was found") if more < 0 else (more, "")


def _range(solution: Solution, count: int, target: float) -> _Range:
    """A range that ends in a gap between eigenvalues, behind the first ``count``."""
    distance = np.abs(solution.values - 1j * target)
    gaps = distance[1:] - distance[:-1] > _EQUAL * distance[1:]
    last = next((k for k in range(count - 1, len(gaps)) if gaps[k]), len(distance) - 1)
    noise = float((ZERO * solution.noise + solution.errors)[: last + 1].max()) ** 0.5
    reach = distance[last] * (1.0 + _EQUAL) + (noise if solution.zero[last] else 0.0)
    if last < len(gaps):
        reach = max(min(reach, distance[last + 1]), 0.5 * (distance[last] + distance[last + 1]))
    return _Range(last, float(reach))


def _missing_gyroscopic(
    pencil: Pencil, solution: Solution, limits: _Range, target: float
) -> tuple[int | None, str]:  # fmt: skip
    """Missing modes of a problem with a skew term in lambda, without zeros (collective)."""
    found = np.flatnonzero(~solution.zero[: limits.last + 1])
    values = solution.values[found]
    omega = np.abs(values.imag)
    if len(found) == 0 or np.any(np.abs(values.real) > STEADY * omega):
        return None, "not all modes found oscillate steadily"
    low, high = target - limits.reach, target + limits.reach
    if low <= 0.0:
        errors = ZERO * solution.noise + solution.errors
        zeros = float(errors.max(initial=0.0, where=solution.zero)) ** 0.5
        low = float(min(max(_LOW * omega.min(), zeros), 0.5 * omega.min()))
    negative = count_below(pencil, -(low**2))
    ends = [gyroscopic_count(pencil, omega) for omega in (low, high)]
    if negative is None or ends[0] is None or ends[1] is None:
        return _told(None)
    energy = _energies(pencil, solution.vectors[found], omega)
    lost = ends[1] - ends[0] - int(np.sign(energy).sum())
    if not negative:
        return _told(lost)
    if np.any(np.abs(energy) <= _SIGN):
        return None, "a mode without energy"
    complete = 2 * int(np.sum(energy < 0.0)) >= ends[0]
    return (abs(lost), "") if complete or lost else (None, "the stiffness is not positive")


def _energies(pencil: Pencil, vectors: ComplexArray, omega: np.ndarray) -> np.ndarray:
    """(k,) ``k + omega^2 m`` of modes, relative to the sum of the sizes (collective)."""
    lin, K, M = pencil.linearization, pencil.matrices.stiffness, pencil.matrices.mass
    k, m = (
        lin.total(np.einsum("ki,ki->k", vectors.conj(), lin.multiply(*given))).real
        for given in ((K, vectors, K), (M, vectors))
    )
    kinetic = omega**2 * m
    return np.asarray((k + kinetic) / (np.abs(k) + kinetic))


def count_below(pencil: Pencil, square: float) -> int | None:
    """Negative eigenvalues of ``K - square M`` on free motions; None if singular (collective)."""
    matrix = pencil.matrices.stiffness.copy()
    matrix.axpy(-square, pencil.matrices.mass)
    return _negative(pencil, matrix, 1)


def gyroscopic_count(pencil: Pencil, omega: float) -> int | None:
    """Negative eigenvalues of ``P(i omega)`` on free motions; None if singular (collective)."""
    real = pencil.matrices.stiffness.copy()
    real.axpy(-(omega**2), pencil.matrices.mass)
    return _negative(pencil, real_form(real, pencil.matrices.damping, omega), 2)


def _negative(pencil: Pencil, matrix: PETSc.Mat, times: int) -> int | None:
    """Negative pivots of a matrix that has every eigenvalue some times, less the conditions."""
    factors = CountingFactors(matrix, symmetric=True)
    if not factors.factor(matrix):
        return None
    pairs, odd = divmod(factors.negative_pivots, times)
    return None if odd else pairs - pencil.linearization.system.constraints.size_global
