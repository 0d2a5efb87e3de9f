# SPDX-License-Identifier: LGPL-3.0-or-later
"""Multifrontal LU of the multipliers' system against PETSc's own LU and MUMPS.

Matrices couple three rows at each point of a grid with those of the eight around it, as hinge
lines and trusses do. Numbers change, the pattern stays; all begin with the same arrays of entries.
A row is a step's work: one factorisation and two solves. With rows shared between ranks the Schur
complement on them is needed: PETSc's LU has none, and petsc4py has no call for that of MUMPS
(``MatFactorSetSchurIS``). Columns: rows, shared rows, processor time in microseconds (least of 40
blocks in turns). Run from the source tree::

    python -m tests.benchmarks.fronts_against_petsc
"""

from collections.abc import Callable

import numpy as np

from flexfem.installation import load_dolfinx
from tests.benchmarks.timing import paired

load_dolfinx()  # in the order that its wheels need

from petsc4py import PETSc  # noqa: E402

from flexfem.solvers.linear.multifrontal import Fronts, ordering  # noqa: E402


def grid(side: int) -> tuple[np.ndarray, np.ndarray]:
    """Entries (i, j) of the matrix of a square grid."""
    places = np.stack(np.meshgrid(np.arange(side), np.arange(side)), axis=-1).reshape(-1, 2)
    near = np.abs(places[:, np.newaxis] - places).max(axis=2) <= 1
    i, j = np.nonzero(np.kron(near, np.ones((3, 3))))
    return i.astype(np.int64), j.astype(np.int64)


def petsc(i: np.ndarray, j: np.ndarray, size: int, kind: str) -> Callable:
    """A step's work by PETSc."""
    mat = PETSc.Mat().createAIJ((size, size), comm=PETSc.COMM_SELF)
    mat.setPreallocationCOO(i.astype(PETSc.IntType), j.astype(PETSc.IntType))
    mat.setValuesCOO(np.where(i == j, 30.0, 1.0))
    pc = PETSc.PC().create(PETSc.COMM_SELF)
    pc.setType("lu")
    pc.setFactorSolverType(kind)
    pc.setOperators(mat)
    if kind == "petsc":
        pc.setFactorOrdering("qmd")
    x, b = mat.createVecs()
    b.set(1.0)

    def work(values: np.ndarray) -> np.ndarray:
        mat.setValuesCOO(values)
        pc.setOperators(mat)
        pc.setUp()
        pc.apply(b, x)
        pc.apply(b, x)
        return x.getArray()

    return work


def compare(side: int, shared: int) -> dict[str, float]:
    """Times of a step's work, s."""
    i, j = grid(side)
    size = 3 * side * side
    values = np.random.default_rng(side).normal(size=len(i))
    values[i == j] += 30.0
    count = size - shared
    order = ordering("qmd", i, j, size)
    fronts = Fronts(i, j, order[order < count], size)
    x = np.empty(size)

    def ours() -> np.ndarray:
        assert fronts.factor(values)
        for _ in range(2):
            x[:] = 1.0
            fronts.reduce(x)
            fronts.complete(x)
        return x

    calls = {"ours": ours}
    if not shared:
        for kind in ("petsc", "mumps"):
            work = petsc(i, j, size, kind)
            np.testing.assert_allclose(work(values), ours(), rtol=1e-8)
            calls[kind] = lambda work=work: work(values)
    return paired(calls)


def main() -> None:
    """Print the table."""
    print("rows  shared      ours     PETSc     MUMPS")
    for side, shared in ((6, 0), (10, 0), (16, 0), (24, 0), (16, 24)):
        times = compare(side, shared)
        row = [f"{1e6 * times[k]:9.1f}" if k in times else "        -"
               for k in ("ours", "petsc", "mumps")]  # fmt: skip
        print(f"{3 * side * side:4d} {shared:7d} ", *row)


if __name__ == "__main__":
    main()
