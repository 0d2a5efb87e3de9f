# SPDX-License-Identifier: LGPL-3.0-or-later
"""From a model to its system, with mistakes told as such."""

from collections.abc import Callable

from mpi4py import MPI

from flexfem._checks import InputError
from flexfem.la.dropped import destroy_dropped
from flexfem.model.model import Model
from flexfem.simulation.controls import Outputs, driven_model
from flexfem.system.assembly import Assembly
from flexfem.system.build import build
from flexfem.system.system import System

__all__ = ["set_up"]


def set_up(
    model: Model, comm: MPI.Intracomm | None, split_above: int,
    check: Callable[[Assembly], None] | None = None, outputs: Outputs | None = None,
) -> tuple[Assembly, System]:  # fmt: skip
    """Serial data and system of a model (collective).

    Args:
        model: the model, the same on every rank.
        comm: communicator, all ranks by default.
        split_above: elements above which one beam may be split over ranks.
        check: raises a ValueError for serial data that will not do.
        outputs: of the model's controllers at a time (s); zero by default.

    Raises:
        InputError: a mistake in the model (a ValueError).
    """
    try:
        model.validate()
        serial = Assembly(driven_model(model, outputs))
        if check is not None:
            check(serial)
        comm = comm or MPI.COMM_WORLD
        destroy_dropped(comm)  # models that were built before
        return serial, build(serial, comm, split_above)
    except ValueError as error:  # on every rank, the model being the same
        raise InputError(str(error)) from error
