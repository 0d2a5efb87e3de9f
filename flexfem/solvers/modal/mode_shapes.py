# SPDX-License-Identifier: LGPL-3.0-or-later
"""Modes from eigenpairs: zero frequencies, a unique basis, effective masses, comparison."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from mpi4py import MPI

import numpy as np

from flexfem._types import BoolArray, FloatArray, IntArray
from flexfem.lie import se3
from flexfem.solvers.modal.linearization import Linearization
from flexfem.solvers.modal.mode_errors import (
    STEADY,
    ZERO,
    ComplexArray,
    Solution,
    independent,
    square_errors,
)
from flexfem.solvers.modal.modes import solve_pencil
from flexfem.solvers.modal.pencil import Pencil
from flexfem.solvers.modal.shifted_inverse import ShiftedInverse, SingularShiftError

__all__ = ["Modes", "find"]

#: Relative difference below which eigenvalues are one with several vectors.
_EQUAL = 1e-7
#: Polynomial weights of the motions that order the vectors of one eigenvalue.
_POWERS = 4
#: The first motion with at least this share of the largest projection is taken.
_LEADING = 0.5
#: Distance from the target, relative to that of the last mode found, within which others crowd.
_FAR = 10.0
#: Factor by which errors of modes may exceed their estimates.
_SURE = 10.0
#: Eigenvalues computed beyond those requested, so that the last one is complete.
_MORE = 3


@dataclass(frozen=True)
class Modes:
    """Modes of a system about one state.

    Attributes:
        linearization: numbering of the unknowns.
        eigenvalues: (k,) lambda in 1/s, Im >= 0; zero for rigid motions; by modulus.
        shapes: (k, n) complex local twists of this rank's nodes (rigid bodies and beams in the
            order of the parts; n counts numbers), ``u^H M u = 1``.
        momenta: (k, n) M times the shapes.
        masses: (k, 3) effective masses along the inertial axes, kg.
        residuals: (k,) of the eigenvalues, relative, to first order their errors; those of rigid
            motions relative to the largest eigenvalue.
        doubtful: (k,) True for residuals that are neither below the tolerance nor round-off.
        doubts_of_growth: (k,) rates below which growth may be an error, 1/s.
        missing: number of modes nearer than the last that were not found, of rotating models
            without those that are zero; None where they cannot be counted.
        uncounted: reason why they cannot: damping, or a stiffness that is not symmetric or, under
            rotation, not positive; empty where they are counted.
        zero_below: angular frequency below which modes count as zero, rad/s.
        state_error: largest residual, of those that are neither zero nor doubtful, where the
            equilibrium is one step of Newton's method more accurate; None unless it was checked.
        unsettled: True if it is neither below the tolerance nor round-off.
        failure: reason why there are no modes at all, else empty.
        crowd: rate at which more motions decay than can be told apart, 1/s, where fewer modes were
            found than requested and it is not far beyond them; else infinite.
    """

    linearization: Linearization
    eigenvalues: ComplexArray
    shapes: ComplexArray
    momenta: ComplexArray
    masses: FloatArray
    residuals: FloatArray
    doubtful: BoolArray
    doubts_of_growth: FloatArray
    missing: int | None
    uncounted: str
    zero_below: float
    state_error: float | None = None
    unsettled: bool = False
    failure: str = ""
    crowd: float = np.inf

    @property
    def frequencies(self) -> FloatArray:
        """(k,) damped natural frequencies, Hz; zero where nothing oscillates."""
        found: FloatArray = np.abs(self.eigenvalues.imag) / (2.0 * np.pi)
        return found

    @property
    def damping(self) -> FloatArray:
        """(k,) damping ratios ``-Re lambda / |lambda|``; zero for rigid motions."""
        size = np.abs(self.eigenvalues)
        ratio: FloatArray = 0.0 - self.eigenvalues.real / np.where(size > 0.0, size, 1.0)
        return ratio

    @property
    def growth(self) -> FloatArray:
        """(k,) rates at which modes grow, 1/s; zero for all others, and where it is round-off."""
        rates = self.eigenvalues.real
        found: FloatArray = np.where(rates > self.doubts_of_growth, rates, 0.0)
        return found

    def __len__(self) -> int:
        """Number of modes."""
        return len(self.eigenvalues)

    def first(self, count: int) -> "Modes":
        """The first modes."""
        return self.some(slice(count))

    def some(self, chosen: slice | IntArray) -> "Modes":
        """The modes of these numbers."""
        return replace(
            self, eigenvalues=self.eigenvalues[chosen], shapes=self.shapes[chosen],
            momenta=self.momenta[chosen], masses=self.masses[chosen],
            residuals=self.residuals[chosen], doubtful=self.doubtful[chosen],
            doubts_of_growth=self.doubts_of_growth[chosen],
        )  # fmt: skip

    def conjugate(self) -> "Modes":
        """The conjugate solutions."""
        return replace(
            self, eigenvalues=self.eigenvalues.conj(), shapes=self.shapes.conj(),
            momenta=self.momenta.conj(),
        )  # fmt: skip

    def correlation(self, other: "Modes") -> FloatArray:
        """Mass-weighted modal assurance criterion (k, m) with modes of another state (collective).

        ``|u^H M w|^2`` of normalised shapes (Allemang, Brown 1982): 1 where they are the same.
        """
        product = self.linearization.total(self.shapes.conj() @ other.momenta.T)
        value: FloatArray = np.abs(product) ** 2
        return value


def find(
    linearization: Linearization, count: int, target: float, accuracy: float,
    improve: Callable[[], bool] | None = None,
) -> Modes:  # fmt: skip
    """Modes nearest to a frequency about the state of the last evaluation (collective).

    Args:
        linearization: evaluated at the state.
        count: number of modes.
        target: rad/s.
        accuracy: relative residual of the eigenvalues.
        improve: moves the system to a state nearer to its equilibrium, False if it cannot; None to
            check no other state.

    Returns:
        At most ``count`` modes; fewer if the iteration has found fewer.
    """
    pencil = Pencil.of(linearization)
    solution = solve_pencil(pencil, count, _MORE, target, accuracy)
    motions = _motions(linearization)
    moved = _times(pencil, motions)
    found: list[complex] = []
    sources: list[int] = []
    shapes: list[ComplexArray] = []
    doubts: list[float] = []
    for value, members in _groups(solution):
        span = solution.still
        if value != 0.0:
            real = not pencil.quadratic
            span = independent(pencil, solution.vectors[members], real=real, zero=False)
        basis = _canonical(linearization, span, moved)
        shapes += list(basis)
        found += [value] * len(basis)
        doubts += [_doubt_of_growth(pencil, solution, value, members, basis)] * len(basis)
        sources += [int(members[np.argmax(solution.residuals[members])])] * len(basis)
    values = np.array(found)
    # of pairs that grow and decay alike those that grow come first: rounding would choose
    weights = np.where(values.real > STEADY * np.abs(values), 1.0 - _EQUAL, 1.0)
    order = np.argsort(weights * np.abs(values - 1j * target), kind="stable")[:count]
    order = order[np.argsort(np.abs(values[order]), kind="stable")]
    kept = np.array(shapes, dtype=np.complex128).reshape(len(shapes), linearization.unknowns)[order]
    worst = np.array(sources, dtype=np.int64)[order]  # of the members of each eigenvalue
    part = linearization.total(kept.conj() @ moved[:3].T)
    reach = float(np.abs(values[order] - 1j * target).max(initial=0.0)) or np.inf
    crowd = pencil.overdamped_rate() if len(order) < count else np.inf
    modes = Modes(
        linearization, values[order], kept, _times(pencil, kept), np.abs(part) ** 2,
        solution.residuals[worst], solution.doubtful(accuracy)[worst],
        np.array(doubts)[order], solution.missing, solution.uncounted, solution.zero_below,
        failure=solution.failure,
        crowd=crowd if abs(crowd + 1j * target) <= _FAR * reach else np.inf,
    )  # fmt: skip
    if improve is None or modes.failure:
        return modes
    first = slice(solution.pairs(count))
    settled = ~solution.zero[first] & ~solution.doubtful(accuracy)[first]
    later = _later(linearization, solution, np.flatnonzero(settled), improve)
    if later is None:
        return replace(modes, state_error=np.inf, unsettled=True)
    error = float(later.residuals.max(initial=0.0))
    return replace(modes, state_error=error, unsettled=bool(later.doubtful(accuracy).any()))


def _later(
    linearization: Linearization, solution: Solution, used: IntArray, improve: Callable[[], bool]
) -> Solution | None:
    """Some of the eigenpairs with their errors in a better state (collective)."""
    if not improve():
        return None
    values, vectors = solution.values[used], solution.vectors[used]
    try:
        inverse = ShiftedInverse(Pencil.of(linearization), solution.shift)
    except SingularShiftError:
        return None
    return replace(
        solution, values=values, vectors=vectors, zero=solution.zero[used],
        errors=square_errors(inverse, values, vectors), noise=solution.noise[used],
    )  # fmt: skip


def _doubt_of_growth(
    pencil: Pencil, solution: Solution, value: complex, members: IntArray, basis: ComplexArray
) -> float:  # fmt: skip
    """Rate below which growth of an eigenvalue may be an error, 1/s (collective).

    An error e of ``u^H P u`` moves the eigenvalue by ``e/|u^H P' u|``, ``P' = 2 lambda M + C``.
    Where two nearly meet, as those of a free body do in rotating axes, ``(lambda + i spin)^2 = 0``,
    the slope vanishes and the error is the root of e.

    Args:
        pencil: the problem.
        solution: its eigenpairs.
        value: the eigenvalue, 1/s.
        members: numbers of its eigenpairs.
        basis: (m, n) of their vectors, orthonormal in the mass.
    """
    if value.real <= 0.0:
        return 0.0
    slope = 2.0 * value * np.eye(len(basis))
    if pencil.quadratic:
        lin, K, C = pencil.linearization, pencil.matrices.stiffness, pencil.matrices.damping
        slope = slope + lin.total(basis.conj() @ lin.multiply(C, basis, laws=K).T)
    least = float(np.linalg.svd(slope, compute_uv=False).min())
    error = float((ZERO * solution.noise + _SURE * solution.errors)[members].max())
    return max(error / least if least > 0.0 else np.inf, STEADY * abs(value))


def _times(pencil: Pencil, shapes: ComplexArray) -> ComplexArray:
    return pencil.linearization.multiply(pencil.matrices.mass, shapes)


def _groups(solution: Solution) -> list[tuple[complex, IntArray]]:
    """Equal eigenvalues, all zeros first, with the numbers of all their vectors."""
    values, zero = solution.values, np.flatnonzero(solution.zero)
    groups = [(0.0 + 0.0j, zero)] if len(zero) else []
    left = np.flatnonzero(~solution.zero)
    while len(left):
        same = np.abs(values[left] - values[left[0]]) <= _EQUAL * np.abs(values[left[0]])
        groups.append((complex(np.mean(values[left[same]])), left[same]))
        left = left[~same]
    return groups


def _canonical(
    linearization: Linearization, basis: ComplexArray, moved: ComplexArray
) -> ComplexArray:  # fmt: skip
    """Canonical basis of the span of an orthonormal one, which may be any.

    The projections of fixed motions of the model onto the span, made orthonormal in the mass; they
    fix order, sign and phase.
    """
    coefficients = linearization.total(basis.conj() @ moved.T)
    rows = []
    for _ in range(len(basis)):
        lengths = np.linalg.norm(coefficients, axis=0)
        chosen = int(np.argmax(lengths >= _LEADING * lengths.max()))
        direction = coefficients[:, chosen] / lengths[chosen]
        rows.append(direction @ basis)
        coefficients = coefficients - np.outer(direction, direction.conj() @ coefficients)
    return np.array(rows)


def _motions(linearization: Linearization) -> ComplexArray:
    """Fixed motions (24, n): translations and rotations along the axes, weighted over space."""
    system = linearization.system
    blocks = [part.block for part in system.parts]
    points = np.concatenate([se3.position(b.frames[: b.owned]) for b in blocks])
    count = system.comm.allreduce(len(points))
    centre = system.comm.allreduce(points.sum(axis=0)) / count
    reach = float(np.max(np.linalg.norm(points - centre, axis=1), initial=0.0))
    length = system.comm.allreduce(reach, op=MPI.MAX) or 1.0
    place = (points - centre) @ np.array([1.0, 0.8, 0.6]) / length
    motions = []
    for power in range(_POWERS):
        for axis in np.eye(6):
            xi = np.concatenate([axis[:3] - np.cross(axis[3:], centre), axis[3:]])
            local = [
                (se3.adjoint(se3.inverse(b.frames[: b.owned])) @ xi)[:, : b.width] for b in blocks
            ]
            # a little of the next power: no weight is even or odd
            weight = place**power + 0.3 * place ** (power + 1) if power else np.ones(len(place))
            ends = np.cumsum([len(motion) for motion in local])[:-1]
            motions.append(np.concatenate([
                (share[:, np.newaxis] * motion).ravel()
                for share, motion in zip(np.split(weight, ends), local, strict=True)
            ]))  # fmt: skip
    still = np.zeros((len(motions), linearization.states.count))  # states of force elements
    return np.concatenate([motions, still], axis=1).astype(np.complex128)
