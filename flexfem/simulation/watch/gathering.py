# SPDX-License-Identifier: LGPL-3.0-or-later
"""Warnings of things of which each is watched by one rank."""

from collections.abc import Mapping
from typing import Any

from mpi4py import MPI

__all__ = ["gathered"]


def gathered(comm: MPI.Intracomm, own: Mapping[Any, str]) -> list[str]:
    """Texts of all ranks in the order of their keys, the same on every rank (collective).

    Args:
        comm: communicator of all ranks.
        own: those of this rank by keys that can be sorted, each on one rank.
    """
    every: dict[Any, str] = {}
    for part in comm.allgather(own):
        every |= part
    return [every[key] for key in sorted(every)]
