# SPDX-License-Identifier: LGPL-3.0-or-later
"""Eigenmodes from an operator that inverts the stiffness under the conditions on the motion."""

from collections.abc import Callable
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc
from slepc4py import SLEPc

import numpy as np
import scipy.linalg

from flexfem._types import BoolArray, FloatArray
from flexfem.la.dense import gather_rows
from flexfem.reduction.fem.body.blocks import multiply, projected, same_everywhere

__all__ = ["dense_modes", "sparse_modes"]

#: Largest relative error of a mode's inverted eigenvalue.
_TOLERANCE = 1e-13
_ITERATIONS = 1000
#: Inverted eigenvalues, relative to the largest, that are zero: motion without mass.
_MASSLESS = 1e-14


class _Inverse:
    """Preconditioner that is the inverse itself."""

    def __init__(self, respond: Callable[[FloatArray], FloatArray]) -> None:
        self._respond = respond

    def apply(self, pc: Any, x: PETSc.Vec, y: PETSc.Vec) -> None:
        y.setArray(self._respond(x.getArray(readonly=True)[:, np.newaxis])[:, 0])


def sparse_modes(
    stiffness: PETSc.Mat,
    mass: PETSc.Mat,
    respond: Callable[[FloatArray], FloatArray],
    start: FloatArray,
    count: int,
) -> tuple[FloatArray, FloatArray]:
    """Lowest modes by shift and invert about zero, Krylov–Schur (Stewart 2001) (collective).

    Args:
        stiffness: of all rows.
        mass: of all rows.
        respond: from forces to displacements, one column; symmetric, and its range is the space
            of the modes.
        start: (rows,) force whose response is the first direction.
        count: of modes.

    Returns:
        Squared angular frequencies, ascending, and this rank's rows of the modes, mass-normalised.

    Raises:
        ArithmeticError: fewer modes were found.
    """
    eps = SLEPc.EPS().create(comm=stiffness.comm)
    eps.setOperators(stiffness, mass)
    eps.setProblemType(SLEPc.EPS.ProblemType.GHEP)
    eps.setType(SLEPc.EPS.Type.KRYLOVSCHUR)
    eps.setTarget(0.0)
    eps.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
    eps.setDimensions(count, max(2 * count, count + 15))
    eps.setTolerances(_TOLERANCE, _ITERATIONS)
    st = eps.getST()
    st.setType(SLEPc.ST.Type.SINVERT)
    st.setShift(0.0)
    ksp = st.getKSP()
    ksp.setType(PETSc.KSP.Type.PREONLY)
    ksp.getPC().setType(PETSc.PC.Type.PYTHON)
    ksp.getPC().setPythonContext(_Inverse(respond))
    first = stiffness.createVecRight()
    first.setArray(respond(start[:, np.newaxis])[:, 0])
    eps.setInitialSpace([first])
    eps.solve()
    found = eps.getConverged()
    if found < count:
        raise ArithmeticError(
            f"only {found} of {count} modes were found; request fewer, or refine the mesh"
        )
    vector = stiffness.createVecRight()
    modes = np.zeros((vector.getLocalSize(), count))
    for i in range(count):
        eps.getEigenvector(i, vector)
        modes[:, i] = vector.getArray()
    eps.destroy()
    comm = stiffness.comm.tompi4py()
    return _sorted(comm, stiffness, mass, modes)


def _sorted(
    comm: MPI.Intracomm, stiffness: PETSc.Mat, mass: PETSc.Mat, modes: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Rayleigh–Ritz in the span of the modes: orthonormal to machine precision."""
    m = projected(comm, modes, multiply(mass, modes))
    k = projected(comm, modes, multiply(stiffness, modes))
    values, vectors = scipy.linalg.eigh(0.5 * (k + k.T), 0.5 * (m + m.T))
    return same_everywhere(comm, values), modes @ same_everywhere(comm, vectors)


def dense_modes(
    stiffness: PETSc.Mat, mass: PETSc.Mat, fixed: BoolArray, conditions: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """All modes of a small body that have mass (collective).

    Args:
        stiffness: of all rows.
        mass: of all rows.
        fixed: this rank's rows that are at rest.
        conditions: this rank's rows of the functionals that are zero.

    Returns:
        As :func:`sparse_modes`.
    """
    comm = stiffness.comm.tompi4py()
    first, last = stiffness.getOwnershipRange()
    free = ~np.concatenate(comm.allgather(fixed))
    space = np.eye(len(free))[:, free]
    if conditions.shape[1]:
        # rows of other ranks come first or last: all in the order of the whole matrix
        whole = np.concatenate(comm.allgather(conditions))[free]
        q, _ = np.linalg.qr(whole / np.linalg.norm(whole, axis=0), mode="complete")
        space = space @ q[:, whole.shape[1] :]
    k = space.T @ gather_rows(stiffness) @ space
    m = space.T @ gather_rows(mass) @ space
    inverse, vectors = scipy.linalg.eigh(0.5 * (m + m.T), 0.5 * (k + k.T))
    moving = inverse > _MASSLESS * np.abs(inverse).max(initial=0.0)
    values = 1.0 / inverse[moving][::-1]
    modes = space @ (vectors[:, moving] / np.sqrt(inverse[moving]))[:, ::-1]
    return same_everywhere(comm, values), same_everywhere(comm, modes)[first:last]
