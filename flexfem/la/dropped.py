# SPDX-License-Identifier: LGPL-3.0-or-later
"""Deferred collective destruction of PETSc objects that Python has released."""

from mpi4py import MPI
from petsc4py import PETSc

__all__ = ["destroy_dropped"]


def destroy_dropped(comm: MPI.Intracomm) -> None:
    """Destroy the PETSc objects that all ranks have released (collective).

    Objects on several ranks end together. Since ranks need not drop them in the same order,
    petsc4py only puts them aside, with their memory and their communicators, of which MPI has about
    two thousand. Whatever creates objects again and again calls this before it does so.
    """
    if comm.size > 1:
        PETSc.garbage_cleanup(comm)
