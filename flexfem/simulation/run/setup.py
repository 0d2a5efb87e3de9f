# SPDX-License-Identifier: LGPL-3.0-or-later
"""Set-up of a run: the system of a model, with faults of the model as input errors."""

from collections.abc import Callable

from mpi4py import MPI

from flexfem._checks import InputError
from flexfem._faults import watched
from flexfem._packages import without_collection
from flexfem.la.dropped import destroy_dropped
from flexfem.la.linear_solver import LinearSolver
from flexfem.layout.numbered_model import NumberedModel
from flexfem.model.model import Model
from flexfem.simulation.control.controls import Controls, driven_model
from flexfem.simulation.run.guard import refuse
from flexfem.solvers.modal.modal_damping import attach_modal_damping
from flexfem.system.agreement import agreed
from flexfem.system.build import build
from flexfem.system.compile_beside import compile_beside
from flexfem.system.memory import check_memory
from flexfem.system.system import System

__all__ = ["set_up"]


def set_up(
    model: Model, comm: MPI.Intracomm | None, split_above: int,
    check: Callable[[NumberedModel], None] | None = None, controls: Controls | None = None,
    kernels: str = "fast", moving: bool = False, linear: LinearSolver | None = None,
) -> tuple[NumberedModel, System]:  # fmt: skip
    """Serial data and system of a model (collective).

    Args:
        model: the model, the same on every rank.
        comm: communicator, all ranks by default.
        split_above: elements above which one beam may be split over ranks.
        check: raises a ValueError for unsuitable serial data.
        controls: the model's controllers; their outputs are zero without.
        kernels: "fast" or "ufl", see ``flexfem.analyses.analysis.KERNELS``.
        moving: True for analyses in which velocities have an effect.
        linear: choice between factors and iterative solvers; None for factors.

    Raises:
        InputError: a mistake in the model, or it differs between ranks (a ValueError).
    """
    comm = comm or MPI.COMM_WORLD
    check_memory(model, comm, linear)

    def make() -> NumberedModel:
        with without_collection():
            model.validate()
            return NumberedModel(driven_model(model, controls), kernels)

    try:
        serial = agreed(comm, make)
        _check_functions(model, comm)
        if check is not None:
            check(serial)
        destroy_dropped(comm)  # models that were built before
        if comm.rank == 0:
            compile_beside(serial, comm.size)
        with without_collection():
            system = build(serial, comm, split_above, linear)
        if moving:
            attach_modal_damping(serial, system, split_above)
        return serial, system
    except ValueError as error:  # on every rank
        raise InputError(str(error)) from error


def _check_functions(model: Model, comm: MPI.Intracomm) -> None:
    """Call the functions of loads once, to find failures before anything is built (collective).

    Raises:
        InputError: names load and function; functions of joints are called when these are built.
    """
    with watched() as faults:
        for load in model.loads:
            load.factor(0.0)
    refuse(faults, comm)
