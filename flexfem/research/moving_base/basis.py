# SPDX-License-Identifier: LGPL-3.0-or-later
"""Assumed modes of a cantilever: of a finite-element eigenproblem, or given functions."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
import scipy.optimize
import scipy.sparse.linalg

from flexfem._checks import NumericalError
from flexfem._types import FloatArray
from flexfem.installation import load_dolfinx
from flexfem.research.moving_base.effects import Effects
from flexfem.research.moving_base.fields import (
    FiniteElements,
    Sections,
    centre_displacements,
    section_values,
    stiffness_of,
)
from flexfem.research.moving_base.properties import BeamProperties
from flexfem.research.moving_base.space import GAUSS, Quadrature, divide

__all__ = ["Basis", "analytic_basis", "modal_basis"]

#: A vector that adds less than this to the span of others adds nothing.
_NOTHING = 1e-8


@dataclass(frozen=True, eq=False)
class Basis:
    """Functions ``phi_ij(x)`` of the fields s, u2, u3, theta1, theta2, theta3.

    Attributes:
        quadrature, sections: points of the integrals, and the beam there.
        fields, slopes: (6, p, n), values and derivatives at the points.
        stiffness: H, (n, n).
        nodes: (k,) places for pictures, the last one the tip, m.
        node_fields: (6, k, n).
        node_shortening: (k, n, n), ``b + g`` at the nodes.
        frequencies: of the beam with these functions and a base at rest, (n,), rad/s.
    """

    quadrature: Quadrature
    sections: Sections
    fields: FloatArray
    slopes: FloatArray
    stiffness: FloatArray
    nodes: FloatArray
    node_fields: FloatArray
    node_shortening: FloatArray
    frequencies: FloatArray

    @property
    def size(self) -> int:
        """Number n of functions."""
        return int(self.fields.shape[2])

    @property
    def shortening(self) -> FloatArray:
        """``b_ij + g_ij`` at the points, (p, n, n)."""
        return self.quadrature.running(_squares(self.slopes))


def _squares(slopes: FloatArray) -> FloatArray:
    """``u2_i' u2_j' + u3_i' u3_j'``, (p, n, n)."""
    out: FloatArray = np.einsum("api,apj->pij", slopes[1:3], slopes[1:3])
    return out


def _basis(
    quadrature: Quadrature, sections: Sections, fields: FloatArray, slopes: FloatArray,
    twist: FloatArray, node_fields: FloatArray,
) -> Basis:  # fmt: skip
    """A basis from its functions; mass and stiffness are made diagonal."""
    w = quadrature.weights
    stiffness = stiffness_of(sections, w, list(fields), list(slopes), twist)
    centres = centre_displacements(list(fields), sections.eccentricity)
    mass = sum(
        o.T @ ((w * m)[:, None] * o)
        for o, m in zip(
            [*centres, *fields[3:]], [sections.mass] * 3 + list(sections.rotary), strict=True
        )
    )
    squares, vectors = scipy.linalg.eigh(stiffness, mass)
    # the largest displacement or rotation of the tip is positive
    tip = node_fields[:, -1] @ vectors
    largest = tip[np.argmax(np.abs(tip), axis=0), np.arange(tip.shape[1])]
    vectors = vectors * np.where(largest < 0.0, -1.0, 1.0)
    fields, slopes, node_fields = fields @ vectors, slopes @ vectors, node_fields @ vectors
    by_element = (w[:, None, None] * _squares(slopes)).reshape(
        len(quadrature.edges) - 1, GAUSS, *[len(squares)] * 2
    )
    shortening = np.concatenate(
        [np.zeros((1, *by_element.shape[2:])), np.cumsum(by_element.sum(axis=1), axis=0)]
    )
    return Basis(
        quadrature, sections, fields, slopes, vectors.T @ stiffness @ vectors, quadrature.edges,
        node_fields, shortening, np.sqrt(squares),
    )  # fmt: skip


def modal_basis(
    properties: BeamProperties, effects: Effects, modes: int, elements: int, stretch: bool = True
) -> Basis:
    """Modes of the cantilever with its base at rest, lowest frequencies first (SLEPc).

    Args:
        properties: the beam.
        effects: effects taken into account.
        modes: number of modes.
        elements: about as many cubic elements.
        stretch: besides, two static functions: the displacements under the loads rho and rho x
            along the axis, which are those of a spinning beam with a hub. The lowest modes hardly
            stretch.

    Raises:
        ValueError: there are not as many functions in the elements.
        NumericalError: the eigensolver did not find them (an ArithmeticError).
    """
    quadrature = Quadrature.of(divide(properties.breaks, elements))
    sections = section_values(properties, effects, quadrature.x)
    space = FiniteElements(properties, effects, sections, quadrature)
    stiffness, mass, load = space.matrices()
    most = space.size // 2
    if modes > most:
        raise ValueError(f"modes {modes}: {elements} elements have no more than {most}")
    span = _eigenvectors(stiffness, mass, modes)
    if stretch and effects.extension:
        solve = scipy.sparse.linalg.splu(stiffness.tocsc()).solve
        for column in load.T:
            span = _extended(span, solve(column), mass)

    def at(operators: Sequence[Any]) -> FloatArray:
        return np.array([o @ span for o in operators])

    points = 0.5 * (np.polynomial.legendre.leggauss(GAUSS)[0] + 1.0)
    fields, slopes, twist = space.operators(points)
    starts, ends = (space.operators(np.array([xi]))[0] for xi in (0.0, 1.0))
    nodes = np.concatenate([at(starts), at(ends)[:, -1:]], axis=1)
    return _basis(quadrature, sections, at(fields), at(slopes), twist @ span, nodes)


def _extended(span: FloatArray, vector: FloatArray, mass: Any) -> FloatArray:
    """Mass-orthonormal columns with one more, unless it is in their span."""

    def norm(x: FloatArray) -> float:
        return float(np.sqrt(x @ (mass @ x)))

    left = vector / norm(vector)
    for _ in range(2):
        left = left - span @ (span.T @ (mass @ left))
    size = norm(left)
    return np.column_stack([span, left / size]) if size > _NOTHING else span


def _eigenvectors(stiffness: Any, mass: Any, count: int) -> FloatArray:
    """Mass-normalised modes of lowest frequency, (size, count), the same on every rank."""
    load_dolfinx()
    from mpi4py import MPI
    from petsc4py import PETSc
    from slepc4py import SLEPc

    def petsc(a: Any) -> PETSc.Mat:
        a = a.tocsr()
        a.sort_indices()
        rows = (a.indptr.astype(PETSc.IntType), a.indices.astype(PETSc.IntType), a.data)
        return PETSc.Mat().createAIJ(a.shape, csr=rows, comm=MPI.COMM_SELF)

    k, m = petsc(stiffness), petsc(mass)
    eps = SLEPc.EPS().create(MPI.COMM_SELF)
    eps.setOperators(k, m)
    eps.setProblemType(SLEPc.EPS.ProblemType.GHEP)
    eps.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
    eps.setTarget(0.0)
    eps.getST().setType(SLEPc.ST.Type.SINVERT)
    eps.setDimensions(count)
    eps.setTolerances(1e-13, 500)
    first = k.createVecRight()
    first.setArray(np.random.default_rng(1).normal(size=first.getSize()))
    eps.setInitialSpace(first)
    eps.solve()
    found = eps.getConverged()
    vectors, one = [], k.createVecRight()
    for i in range(min(count, found)):
        eps.getEigenpair(i, one)
        vectors.append(one.array.copy())
    for thing in (eps, k, m, first, one):
        thing.destroy()
    if found < count:
        raise NumericalError(
            f"modes {count}: the eigenproblem gave {found}; take fewer modes or more elements"
        )
    out = np.array(vectors).T
    # exactly orthonormal, which modes of equal frequency need not be
    gram = np.linalg.cholesky(out.T @ (mass @ out))
    normal: FloatArray = np.linalg.solve(gram, out.T).T
    return normal


def analytic_basis(
    properties: BeamProperties, effects: Effects, counts: Sequence[int], points: int = 64
) -> Basis:
    """Functions of the uniform beam without shear, whatever the beam.

    Args:
        properties: the beam.
        effects: effects taken into account; sections stay normal to the axis.
        counts: numbers of functions of s, u2, u3 and theta1: ``sin((2k - 1) pi x/(2 L))`` for s and
            theta1, clamped-free bending modes for u2 and u3.
        points: elements for the integrals.

    Raises:
        ValueError: no functions, or some of a field that the effects leave out.
    """
    quadrature = Quadrature.of(divide(properties.breaks, points))
    sections = section_values(properties, effects, quadrature.x)
    used = (effects.extension, effects.in_plane, effects.out_of_plane, effects.torsion)
    if len(counts) != 4 or min(counts) < 0 or not any(counts):
        raise ValueError(f"counts of functions of s, u2, u3, theta1 expected, got {counts}")
    if any(count and not there for count, there in zip(counts, used, strict=True)):
        raise ValueError(f"counts {counts}: functions of a field that the effects leave out")
    length = properties.length
    shapes = [(f, k) for f, count in enumerate(counts) for k in range(count)]
    nodes = quadrature.edges

    def sample(x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        fields, slopes = np.zeros((2, 6, len(x), len(shapes)))
        twist = np.zeros((len(x), len(shapes)))
        for j, (field, k) in enumerate(shapes):
            value, first, second = (_bending if field in (1, 2) else _sine)(k, length)(x)
            fields[field, :, j], slopes[field, :, j] = value, first
            if field in (1, 2):
                turned, sign = (5, 1.0) if field == 1 else (4, -1.0)
                fields[turned, :, j], slopes[turned, :, j] = sign * first, sign * second
            elif field == 3:
                twist[:, j] = second
        return fields, slopes, twist

    fields, slopes, twist = sample(quadrature.x)
    return _basis(quadrature, sections, fields, slopes, twist, sample(nodes)[0])


_Function = Callable[[FloatArray], tuple[FloatArray, FloatArray, FloatArray]]


def _sine(k: int, length: float) -> _Function:
    """Values and two derivatives of the k-th function of a bar, clamped and free."""
    c = (k + 0.5) * np.pi / length
    return lambda x: (np.sin(c * x), c * np.cos(c * x), -(c**2) * np.sin(c * x))


def _bending(k: int, length: float) -> _Function:
    """Values and two derivatives of the k-th bending mode of a clamped-free uniform beam.

    Written with decaying exponentials: ``cosh`` and ``sinh`` lose all digits from mode 12 on.
    """
    guess = (k + 0.5) * np.pi
    b = scipy.optimize.brentq(
        lambda y: np.cos(y) + 1.0 / np.cosh(y), guess - 0.5 * np.pi + 0.3, guess + 0.5 * np.pi
    )
    # cosh - cos - sigma (sinh - sin), sigma = (cosh b + cos b)/(sinh b + sin b)
    decay = np.exp(-b)
    below = 0.5 * (1.0 - decay**2) + np.sin(b) * decay  # (sinh b + sin b) exp(-b)
    sigma = (0.5 * (1.0 + decay**2) + np.cos(b) * decay) / below
    # (1 - sigma)/2 times exp(b), without cancellation
    growing = 0.5 * (np.sin(b) - np.cos(b) - decay) / below

    def at(x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        y, c = b * x / length, b / length
        up = growing * np.exp(y - b)
        down = 0.5 * (1.0 + sigma) * np.exp(-y)
        return (
            up + down - np.cos(y) + sigma * np.sin(y),
            c * (up - down + np.sin(y) + sigma * np.cos(y)),
            c**2 * (up + down + np.cos(y) - sigma * np.sin(y)),
        )

    return at
