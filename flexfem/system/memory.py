# SPDX-License-Identifier: LGPL-3.0-or-later
"""Estimate of the memory of a computation, from the sizes of a model before it begins."""

from mpi4py import MPI

from flexfem._memory import (
    DOUBT,
    ITERATED,
    LINE_NODE,
    PROGRAM,
    SHEET,
    UNKNOWN,
    available,
    check_room,
    together,
)
from flexfem.la.linear_solver import LinearSolver
from flexfem.model.model import Model

__all__ = ["check_memory", "memory_of_run"]

#: Bytes for a node of a shell's mesh; directors have further nodes between those.
_NODES = {"rotation_free": 3.0 * SHEET, "director": 24.0 * UNKNOWN}
#: Dense matrices of a body in a floating frame.
_DENSE = 10


def memory_of_run(model: Model, linear: LinearSolver | None = None) -> float:
    """Approximate bytes of steps with one factorisation on one rank, without contact.

    Args:
        model: the model, of which only the numbers of nodes are used.
        linear: choice between factors and iterative solvers; None for that of motions.
    """
    linear = linear or LinearSolver("auto")
    nodes = len(model.rigid_bodies) + (0 if model.mesh is None else len(model.mesh.points))
    nodes += sum(len(b.curve.points) for b in model.beams_of("nurbs") if b.curve is not None)
    total = PROGRAM + LINE_NODE * nodes
    total += _memory_of_shells(model)
    for body in model.other_bodies:
        rows = body.width * len(body.points)
        iterative = body.continuum and linear.iterates(rows, body.bulk_over_shear)
        total += (ITERATED if iterative else UNKNOWN) * float(rows)
    widths = [float(body.reduced.size) for body in model.floating_bodies]
    return float(total + 8.0 * _DENSE * sum(width**2 for width in widths))


def _memory_of_shells(model: Model) -> float:
    if model.surface is None or not model.shells:
        return 0.0
    return _NODES[model.shells[0].element] * len(model.surface.points)


def check_memory(model: Model, comm: MPI.Intracomm, linear: LinearSolver | None = None) -> None:
    """Refuse a model that does not fit into memory, before it is built (collective).

    Args:
        model: the model.
        comm: communicator.
        linear: choice between factors and iterative solvers; None for factors.

    Raises:
        InputError: on all ranks.
    """
    # ranks may differ in their models
    needed = comm.allreduce(memory_of_run(model, linear or LinearSolver()), op=MPI.MAX)
    if needed <= 4.0 * PROGRAM:
        return
    here = comm.Split_type(MPI.COMM_TYPE_SHARED)
    taken = together(needed, here.size, comm.size)
    thin = bool(model.shells) and model.shells[0].element == "rotation_free"
    sheets = _memory_of_shells(model) * here.size / comm.size if thin else 0.0
    here.Free()
    # the least memory and the largest need of all computers: the same result on all ranks
    taken = comm.allreduce(sheets + (taken - sheets) / DOUBT, op=MPI.MAX)
    room = comm.allreduce(available(), op=MPI.MIN)
    check_room(f'Model "{model.name}": a step', taken, room)
