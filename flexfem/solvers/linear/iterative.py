# SPDX-License-Identifier: LGPL-3.0-or-later
"""Which bodies are solved by Krylov methods, and the data of these from nodes and elements."""

from petsc4py import PETSc

from flexfem._checks import InputError
from flexfem._types import IntArray
from flexfem.la.krylov import KrylovFactor, rigid_motions
from flexfem.la.linear_solver import LinearSolver
from flexfem.la.saddle import MOST_MULTIPLIERS
from flexfem.layout.elements import MultigridElements
from flexfem.system.system import BlockPart, Shifts, System

__all__ = ["check_iterative", "is_mass", "iterates", "krylov_factor"]


def iterates(system: System, part: BlockPart, shifts: Shifts, rows: int | None = None) -> bool:
    """True if bodies are solved iteratively; the same on all ranks.

    Args:
        system: with the choice of the run.
        part: their part.
        shifts: factors of the scheme of the matrix.
        rows: their unknowns, on all ranks if a body is on several; None for all of the part.
    """
    elements, linear = part.elements, system.linear
    if not (isinstance(elements, MultigridElements) and elements.multigrid):
        return False
    if system.constraints.size_global > MOST_MULTIPLIERS:
        return False
    count = part.block.sizes[1] if rows is None else rows
    if is_mass(shifts):
        return linear.iterates_masses(count)
    return linear.iterates(count, elements.bulk_over_shear)


def check_iterative(system: System) -> None:
    """Refuse iterative solvers where there is nothing that they could solve.

    Raises:
        InputError: They are asked for, and no body has a matrix for them, or there are too many
            multipliers to be eliminated one by one.
    """
    if system.linear.kind != "iterative":
        return
    owner = "linear_solver 'iterative'"
    every = [part.elements for part in system.parts]
    if not any(isinstance(one, MultigridElements) and one.multigrid for one in every):
        raise InputError(
            f"{owner} is for models with a Solid: all other bodies are solved by factors"
        )
    count = system.constraints.size_global
    if count > MOST_MULTIPLIERS:
        raise InputError(
            f"{owner} takes a solve for each constraint, at most {MOST_MULTIPLIERS}, and the "
            f"model has {count}"
        )


def is_mass(shifts: Shifts) -> bool:
    """True if a matrix is that of the masses alone."""
    return shifts.stiffness == 0.0 and shifts.velocity == 0.0


def krylov_factor(
    linear: LinearSolver, part: BlockPart, matrix: PETSc.Mat, shifts: Shifts, nodes: IntArray,
    last: KrylovFactor | None = None,
) -> KrylovFactor:  # fmt: skip
    """Krylov method for the matrix of some nodes at the trial state (collective if split).

    Args:
        linear: the choice of the run.
        part: part of the nodes.
        matrix: their matrix, which is taken over.
        shifts: factors of the scheme of the matrix.
        nodes: local numbers of the owned ones.
        last: method for a similar stiffness of them, which takes this one if it can; None to begin.
    """
    block, motions = part.block, None
    if matrix.getType() == PETSc.Mat.Type.PYTHON:  # masses, which hold their fixed unknowns
        return KrylovFactor(matrix, None, None, linear.tolerance, linear.counts)
    held = None if block.dirichlet is None else block.dirichlet[nodes]
    fixed = None if held is None else held.ravel()
    if not is_mass(shifts):
        frames = block.frames[nodes]
        axes = frames[:, 3:].reshape(-1, 3, 3)
        motions = rigid_motions(frames[:, :3], axes, held).reshape(6, -1)
        if last is not None:
            last.take(matrix, motions, fixed)
            return last
    return KrylovFactor(matrix, motions, fixed, linear.tolerance, linear.counts)
