# SPDX-License-Identifier: LGPL-3.0-or-later
"""Mass matrix of a part that is multiplied element by element, never assembled."""

from dataclasses import dataclass

from petsc4py import PETSc

import numpy as np

from flexfem._types import FloatArray
from flexfem.layout.elements import MultigridElements
from flexfem.system.mechanics import Mechanics
from flexfem.system.system import MASS, BlockPart, System

__all__ = ["MassBlock", "mass_operator"]


@dataclass(frozen=True)
class MassBlock:
    """Such a matrix in the place of one that is assembled."""

    mat: PETSc.Mat

    def assemble(self, values: FloatArray) -> None:
        """Do nothing: it follows the elements."""


def mass_operator(system: System, part: BlockPart, mechanics: Mechanics) -> PETSc.Mat:
    """Mass matrix of a part at its trial state, with its diagonal (collective)."""
    size = part.block.sizes
    mat = PETSc.Mat().createPython(
        (size, size), context=_MassOperator(system, part, mechanics), comm=part.block.comm
    )
    mat.setUp()
    return mat


class _MassOperator:
    """Matrix in the format of PETSc; the block's steps and residuals are work space, restored."""

    def __init__(self, system: System, part: BlockPart, mechanics: Mechanics) -> None:
        self._system, self._part, self._mechanics = system, part, mechanics

    def mult(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """Multiply; fixed unknowns are multiplied by one (collective)."""
        block = self._part.block
        before = block.step.copy(), block.residual.copy()
        given = x.getArray(readonly=True).reshape(-1, block.width)
        block.owned_step[:] = given
        block.hold(block.owned_step)
        block.residual[:] = 0.0
        self._mechanics.add_own_action(self._system, self._part, MASS, 1.0, None)
        found = block.owned_residual.copy()
        if block.dirichlet is not None:
            held = block.dirichlet[: block.owned]
            found[held] = given[held]
        block.step[:], block.residual[:] = before
        y.setArray(found.ravel())

    def getDiagonal(self, _: PETSc.Mat, diagonal: PETSc.Vec) -> None:
        """Diagonal of the mass matrix, ones of fixed unknowns (collective)."""
        part, block = self._part, self._part.block
        assert isinstance(part.elements, MultigridElements)
        before = block.residual.copy()
        block.residual[:] = 0.0
        block.residual[:, :3] += part.elements.node_masses()[:, np.newaxis]
        block.add_ghosts()
        masses = self._mechanics.masses(self._system, part, MASS)
        diagonals = np.diagonal(masses, axis1=1, axis2=2)
        np.add.at(block.residual, part.masses.nodes, diagonals)
        found = block.owned_residual.copy()
        if block.dirichlet is not None:
            found[block.dirichlet[: block.owned]] = 1.0
        block.residual[:] = before
        diagonal.setArray(found.ravel())
