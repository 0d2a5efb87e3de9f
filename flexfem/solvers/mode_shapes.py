# SPDX-License-Identifier: LGPL-3.0-or-later
"""From eigenpairs to modes: zero frequencies, a basis that is unique, masses, comparison."""

from dataclasses import dataclass

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np

from flexfem._types import FloatArray
from flexfem.lie import se3
from flexfem.solvers.linearization import Linearization
from flexfem.solvers.modes import ComplexArray, Pencil, solve_pencil

__all__ = ["Modes", "find"]

#: An eigenvalue this many times above the round-off of its own stiffness is not zero.
_NOISE = 1e3
#: The same for the tolerance of the iteration, relative to the square of its shift.
_UNRESOLVED = 10.0
#: Eigenvalues that agree to this are one with several vectors.
_EQUAL = 1e-7
#: Share of the largest Gram eigenvalue below which vectors are dependent; vectors of a double zero
#: come in nearly equal pairs, whose difference is the root of round-off.
_DEPENDENT, _DEPENDENT_AT_ZERO = 1e-8, 1e-4
#: Polynomial weights of the motions that order the vectors of one eigenvalue.
_POWERS = 4
#: The first motion with at least this share of the largest projection is taken.
_LEADING = 0.5
#: Eigenvalues computed beyond those asked for, so that the last one is complete.
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
    """

    linearization: Linearization
    eigenvalues: ComplexArray
    shapes: ComplexArray
    momenta: ComplexArray
    masses: FloatArray

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

    def __len__(self) -> int:
        """Number of modes."""
        return len(self.eigenvalues)

    def first(self, count: int) -> "Modes":
        """The first modes."""
        return Modes(
            self.linearization, self.eigenvalues[:count], self.shapes[:count],
            self.momenta[:count], self.masses[:count],
        )  # fmt: skip

    def conjugate(self) -> "Modes":
        """The conjugate solutions."""
        return Modes(
            self.linearization, self.eigenvalues.conj(), self.shapes.conj(), self.momenta.conj(),
            self.masses,
        )  # fmt: skip

    def correlation(self, other: "Modes") -> FloatArray:
        """Mass-weighted modal assurance criterion (k, m) with modes of another state (collective).

        ``|u^H M w|^2`` of normalised shapes (Allemang, Brown 1982): 1 where they are the same.
        """
        product = _reduce(self.linearization, self.shapes.conj() @ other.momenta.T)
        value: FloatArray = np.abs(product) ** 2
        return value


def find(linearization: Linearization, count: int, target: float, tolerance: float) -> Modes:
    """Modes nearest to a frequency about the state of the last evaluation (collective).

    Args:
        linearization: evaluated at the state.
        count: number of modes.
        target: rad/s; undamped problems only.
        tolerance: relative residual of the eigenvalues.

    Returns:
        At most ``count`` modes; fewer if the iteration has found fewer.
    """
    pencil = Pencil.of(linearization)
    values, vectors = solve_pencil(pencil, count + _MORE, target, tolerance)
    vectors = vectors[:, : linearization.unknowns]
    noise = _noise(pencil, vectors) + _UNRESOLVED * tolerance * pencil.shift**2
    zero = np.abs(values) ** 2 <= noise
    groups = [(0.0 + 0.0j, vectors[zero])] if zero.any() else []
    groups += _groups(values[~zero], vectors[~zero])
    motions = _motions(linearization)
    moved = _times(pencil, motions)
    found: list[complex] = []
    shapes: list[ComplexArray] = []
    for value, members in groups:
        real = (not pencil.damped and pencil.symmetric) or value == 0.0
        limit = _DEPENDENT_AT_ZERO if value == 0.0 else _DEPENDENT
        basis = _canonical(pencil, members, moved, real, limit)
        shapes += list(basis)
        found += [value] * len(basis)
    if target > 0.0:
        order = np.argsort(np.abs(np.abs(found) - target), kind="stable")
    else:
        order = np.argsort(np.abs(found), kind="stable")
    order = order[:count]
    order = order[np.argsort(np.abs(np.array(found)[order]), kind="stable")]
    kept = np.array(shapes, dtype=np.complex128).reshape(len(shapes), linearization.unknowns)[order]
    momenta = _times(pencil, kept)
    part = _reduce(linearization, kept.conj() @ moved[:3].T)
    return Modes(linearization, np.array(found)[order], kept, momenta, np.abs(part) ** 2)


def _reduce(linearization: Linearization, local: ComplexArray) -> ComplexArray:
    """Sum over the ranks."""
    total = np.ascontiguousarray(local)
    linearization.system.comm.Allreduce(MPI.IN_PLACE, total, op=MPI.SUM)
    return total


def _times(pencil: Pencil, shapes: ComplexArray) -> ComplexArray:
    return pencil.linearization.multiply(pencil.matrices.mass, shapes)


def _noise(pencil: Pencil, vectors: ComplexArray) -> FloatArray:
    """(k,) round-off in ``|lambda|^2``: that of the sums in ``u^H K u``, over ``u^H M u``."""
    lin, K = pencil.linearization, pencil.matrices.stiffness
    start, index, values = K.getValuesCSR()
    sizes = PETSc.Mat().createAIJ(
        (lin.sizes, lin.sizes), csr=(start, index, np.abs(values)), comm=lin.system.comm
    )
    absolute = np.abs(vectors).astype(np.complex128)
    forces = lin.multiply(sizes, absolute, laws=sizes)
    energy = _reduce(lin, np.einsum("ki,ki->k", absolute, forces)).real
    mass = _reduce(lin, np.einsum("ki,ki->k", vectors.conj(), _times(pencil, vectors))).real
    noise: FloatArray = _NOISE * np.finfo(float).eps * energy / np.where(mass > 0.0, mass, 1.0)
    return noise


def _groups(values: ComplexArray, vectors: ComplexArray) -> list[tuple[complex, ComplexArray]]:
    """Equal eigenvalues with all their vectors."""
    left = list(range(len(values)))
    groups = []
    while left:
        same = [
            k for k in left if abs(values[k] - values[left[0]]) <= _EQUAL * abs(values[left[0]])
        ]
        groups.append((complex(np.mean(values[same])), vectors[same]))
        left = [k for k in left if k not in same]
    return groups


def _canonical(
    pencil: Pencil, members: ComplexArray, moved: ComplexArray, real: bool, limit: float
) -> ComplexArray:
    """The basis of a span that is the same however the span was given.

    The projections of fixed motions of the model onto the span, made orthonormal in the mass; they
    fix order, sign and phase.
    """
    lin = pencil.linearization
    if real:
        members = np.concatenate([members.real, members.imag]).astype(np.complex128)
    gram = _reduce(lin, members.conj() @ _times(pencil, members).T)
    sizes = np.sqrt(np.abs(np.diag(gram)))
    used = sizes > 0.0
    members = members[used] / sizes[used, np.newaxis]
    gram = gram[np.ix_(used, used)] / np.outer(sizes[used], sizes[used])
    weights, turn = np.linalg.eigh(0.5 * (gram + gram.conj().T))
    kept = weights > limit * weights.max(initial=0.0)
    basis = (turn[:, kept] / np.sqrt(weights[kept])).T @ members
    coefficients = _reduce(lin, basis.conj() @ moved.T)
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
    return np.array(motions, dtype=np.complex128)
