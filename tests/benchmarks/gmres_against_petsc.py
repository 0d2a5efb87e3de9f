# SPDX-License-Identifier: LGPL-3.0-or-later
"""GMRES of refined steps against PETSc's GMRES and FGMRES, by the same operator.

The operator is the identity plus a small part, a product by a diagonal, so that what the methods
themselves cost is seen. Both begin from zero and stop at the same residual. Columns: unknowns,
applications, processor time in microseconds (least of 40 blocks in turns). On several ranks ours
takes one reduction a vector; PETSc's takes two, one for the products and one for the norm. Run from
the source tree::

    python -m tests.benchmarks.gmres_against_petsc
"""

import numpy as np

from flexfem.installation import load_dolfinx
from flexfem.solvers.linear.gmres import minimal_residual
from tests.benchmarks.timing import paired

load_dolfinx()  # in the order that its wheels need

from petsc4py import PETSc  # noqa: E402

#: Relative accuracy and most applications, those of refined steps.
TOLERANCE, MOST = 0.02, 8


class Operator:
    """Identity plus a diagonal, as a matrix of PETSc without entries."""

    def __init__(self, diagonal: np.ndarray) -> None:
        """Take the sum of both."""
        self.diagonal, self.calls = diagonal, 0

    def apply(self, vector: np.ndarray) -> np.ndarray:
        """A new vector."""
        self.calls += 1
        return self.diagonal * vector

    def mult(self, mat: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """The same for PETSc."""
        self.calls += 1
        y.setArray(self.diagonal * x.getArray(readonly=True))


def compare(size: int) -> tuple[dict[str, float], dict[str, int]]:
    """Times of a solution, s, and applications."""
    random = np.random.default_rng(size)
    operator = Operator(1.0 + 0.3 * random.uniform(-1.0, 1.0, size))
    right = random.normal(size=size)
    norm, calls, counts = np.linalg.norm(right), {}, {}
    calls["ours"] = lambda: minimal_residual(
        operator.apply, right, norm, np.dot, TOLERANCE * norm, MOST
    )[0]
    for kind in ("gmres", "fgmres"):
        mat = PETSc.Mat().createPython((size, size), operator, comm=PETSc.COMM_SELF)
        mat.setUp()
        ksp = PETSc.KSP().create(PETSc.COMM_SELF)
        ksp.setType(kind)
        ksp.setOperators(mat)
        ksp.getPC().setType("none")
        ksp.setTolerances(rtol=TOLERANCE, atol=0.0, max_it=MOST)
        x, b = mat.createVecs()

        def theirs(ksp=ksp, x=x, b=b) -> np.ndarray:
            b.setArray(right)
            ksp.solve(b, x)
            return x.getArray().copy()

        calls[kind] = theirs
    for name, call in calls.items():
        operator.calls = 0
        found = call()
        counts[name] = operator.calls
        assert np.linalg.norm(operator.diagonal * found - right) <= 1.01 * TOLERANCE * norm
    return paired(calls), counts


def main() -> None:
    """Print the table."""
    print("unknowns  applications: ours gmres fgmres   time: ours   gmres  fgmres")
    for size in (54, 500, 5000, 50000):
        times, counts = compare(size)
        row = [*counts.values(), *(1e6 * t for t in times.values())]
        print("{:8d} {:18d} {:5d} {:6d} {:12.1f} {:7.1f} {:7.1f}".format(size, *row))


if __name__ == "__main__":
    main()
