# SPDX-License-Identifier: LGPL-3.0-or-later
"""How much memory a computation with a model takes, told from its sizes before it begins."""

from mpi4py import MPI

from flexfem._memory import available, check_room
from flexfem.model.model import Model

__all__ = ["check_memory", "memory_of_run"]

#: Bytes of the program with its libraries, and of each unknown of beams (lines of nodes) and of
#: shells (surfaces, whose factors fill in): what motions took, measured with 1e4 to 4e5 unknowns.
_PROGRAM, _LINE, _SURFACE = 3e8, 2.6e3, 1.6e4
#: Unknowns of a node of a shell's mesh; directors have further nodes between those.
_WIDTHS = {"rotation_free": 3.0, "director": 24.0}
#: Dense matrices of a body in a floating frame.
_DENSE = 10
#: How far estimates may be too large.
_DOUBT = 1.25


def memory_of_run(model: Model) -> float:
    """Bytes that steps with one factorisation take on one rank, about; contact left out.

    Args:
        model: only counts of its nodes are asked for.
    """
    nodes = len(model.rigid_bodies) + (0 if model.mesh is None else len(model.mesh.points))
    nodes += sum(len(b.curve.points) for b in model.beams_of("nurbs") if b.curve is not None)
    total = _PROGRAM + 6.0 * _LINE * nodes
    if model.surface is not None and model.shells:
        width = _WIDTHS[model.shells[0].element]
        total += _SURFACE * width * len(model.surface.points)
    widths = [float(body.reduced.size) for body in model.floating_bodies]
    return float(total + 8.0 * _DENSE * sum(width**2 for width in widths))


def check_memory(model: Model, comm: MPI.Intracomm) -> None:
    """Refuse a model that will not fit, before anything is made of it (collective).

    Raises:
        InputError: on all ranks.
    """
    needed = comm.allreduce(memory_of_run(model), op=MPI.MAX)  # ranks may differ in their models
    if needed <= 4.0 * _PROGRAM:
        return
    here = comm.Split_type(MPI.COMM_TYPE_SHARED)
    together = needed * here.size / comm.size + _PROGRAM * (here.size - 1)
    here.Free()
    # the smallest room and the largest need of all computers: all ranks find the same
    together = comm.allreduce(together / _DOUBT, op=MPI.MAX)
    room = comm.allreduce(available(), op=MPI.MIN)
    check_room(f'Model "{model.name}": a step', together, room)
