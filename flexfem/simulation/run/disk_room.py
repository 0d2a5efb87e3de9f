# SPDX-License-Identifier: LGPL-3.0-or-later
"""Warning of fields for which the disk has no room, while the run has hardly begun."""

import shutil
from contextlib import suppress
from pathlib import Path

from mpi4py import MPI

from flexfem._memory import shown

__all__ = ["lack_of_room"]


def lack_of_room(folder: Path | None, further: int, comm: MPI.Intracomm) -> list[str]:
    """Return a warning if the disk has no room for all fields, the same on all ranks (collective).

    Args:
        folder: result folder in which all ranks have written one instant; None for no results.
        further: instants to be written yet, which take as much each.
        comm: communicator of all ranks.
    """
    found = list[str]()
    if comm.rank == 0 and folder is not None:
        with suppress(OSError):  # a folder that was removed is told where it is written next
            each = sum(path.stat().st_size for path in folder.glob("*/*.vtu"))
            free = shutil.disk_usage(folder).free
            if each * further > free:
                found.append(
                    f"{further} further instants of fields of {shown(each)} each will take about "
                    f"{shown(each * further)}, {shown(free)} are free in output folder '{folder}'; "
                    "write fewer instants (every) or fewer fields (fields)"
                )
    return comm.bcast(found) if comm.size > 1 else found
