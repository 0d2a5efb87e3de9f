# SPDX-License-Identifier: LGPL-3.0-or-later
"""Load balance of ranks: ranks without bodies, and more ranks than cores."""

from mpi4py import MPI

from flexfem import launch
from flexfem.system.system import System

__all__ = ["idle_or_crowded"]


def idle_or_crowded(system: System) -> list[str]:
    """Return warnings on the number of ranks, one line each, the same on all (collective)."""
    comm, found = system.comm, list[str]()
    if comm.size == 1:
        return found
    idle = comm.allreduce(int(not any(part.block.owned for part in system.parts)))
    if idle:
        found.append(
            f"{idle} of {comm.size} ranks have no bodies and wait: take fewer ranks, or "
            "--split-above below the number of elements of a large beam, shell or solid"
        )
    ranks, cores = _crowded(comm)
    if ranks:
        found.append(
            f"{ranks} ranks share {cores} cores and take turns, one waiting for the other: take no "
            "more ranks than cores"
        )
    return found


def _crowded(comm: MPI.Intracomm) -> tuple[int, int]:
    """Ranks and cores of the computer where most ranks lack a core; zeros if none lacks one."""
    here = comm.Split_type(MPI.COMM_TYPE_SHARED)
    cores = len(set().union(*here.allgather(launch.cores())))
    lacking = here.size - cores
    places = comm.allgather((lacking, here.size, cores))
    here.Free()
    worst = max(places)
    return worst[1:] if worst[0] > 0 else (0, 0)
