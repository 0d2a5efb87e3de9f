# SPDX-License-Identifier: LGPL-3.0-or-later
"""Values of the equations at a trial state, and whether they jump with a parameter."""

from __future__ import annotations

from typing import Protocol

from mpi4py import MPI

import numpy as np

from flexfem._types import FloatArray
from flexfem.gradients.equations.node_maps import fixed_apart
from flexfem.gradients.equations.step_tangent import BlockVectors, collected
from flexfem.system.mechanics import END_POINT, Mechanics
from flexfem.system.system import Shifts, System

__all__ = [
    "Equations", "SystemEquations", "contact_forces", "copy_state", "equations_at", "jump",
    "product", "row_directions", "rows_turn",
]  # fmt: skip

#: Of blocks, (n_owned, width) each, and of all rows of this rank, (r,).
Equations = tuple[BlockVectors, FloatArray]


class SystemEquations(Protocol):
    """Equations that are not those of a step."""

    def equations(self, system: System, restitution: FloatArray | None = None) -> Equations:
        """Those of a system at a given trial state, see ``renewals.renewal`` (collective)."""
        ...


#: First differences over rounding, from which on equations may be found to jump.
_SEEN = 1e3
#: The rounding of directions of rows: meshes of gmsh have places to 1e-9.
_EQUAL = 1e-9


def equations_at(system: System, shifts: Shifts, mechanics: Mechanics = END_POINT) -> Equations:
    """Equations of blocks, without reactions of what is fixed, and of all rows (collective)."""
    mechanics.evaluate(system, shifts)
    return collected(system), system.constraints.values.copy()


def contact_forces(system: System, shifts: Shifts) -> BlockVectors:
    """The part of contacts in :func:`equations_at`, at a trial state that is given (collective)."""
    system.begin_evaluation(shifts.acceleration)
    for part in system.parts:
        part.block.residual[:] = 0.0
        if part.contacts is not None:
            part.contacts.add_residual(shifts.scale)
    return collected(system)


def row_directions(system: System) -> FloatArray:
    """This rank's forces (n,) of all rows at once, for multipliers that tell them apart."""
    kept = [part.block.residual.copy() for part in system.parts]
    for part in system.parts:
        part.block.residual[:] = 0.0
    system.add_constraint_forces(np.cos(np.arange(1.0, system.constraints.size + 1.0)))
    found = np.concatenate([forces.ravel() for forces in collected(system)])
    for part, residual in zip(system.parts, kept, strict=True):
        part.block.residual[:] = residual
    return found


def product(system: System, factors: Equations, changes: Equations) -> float:
    """This rank's part of factors of the equations times their changes."""
    blocks = sum(float((a * b).sum()) for a, b in zip(factors[0], changes[0], strict=True))
    return blocks + float(factors[1] @ (system.constraints.owned * changes[1]))


def jump(
    comm: MPI.Intracomm, sides: tuple[FloatArray, FloatArray], still: FloatArray, rough: float,
    rounding: float = 1.0,
) -> bool:  # fmt: skip
    """True if second differences are too large for a smooth function (collective).

    Args:
        comm: communicator.
        sides: this rank's part of the equations for a smaller and a larger value of a parameter.
        still: that of the solution.
        rough: second differences over first ones from which on they are.
        rounding: part of that of the solution that is rounding: all that is left of equations.
    """
    before, after = sides
    changes = after + before - 2.0 * still, after - before, still
    squares = np.array([float((change**2).sum()) for change in changes])
    comm.Allreduce(MPI.IN_PLACE, squares)
    bent, moved, left = np.sqrt(squares)
    return bool(bent > rough * moved and bent > _SEEN * rounding * left)


def rows_turn(
    comm: MPI.Intracomm, sides: tuple[FloatArray, FloatArray], still: FloatArray, rough: float
) -> bool:
    """The same of :func:`row_directions`: others may be satisfied as well, without forces."""
    return jump(comm, sides, still, rough, _EQUAL)


def copy_state(source: System, target: System) -> None:
    """Copy a trial state to another model, whose fixed unknowns stay at its own start."""
    for part, other in zip(source.parts, target.parts, strict=True):
        trial = other.block.trial()
        for name, values in part.block.trial().items():
            trial[name][:] = values
        if part.block.dirichlet is not None:
            other.block.frames[:] = fixed_apart(part.block, other.block)
    target.constraints.multipliers[:] = source.constraints.multipliers
