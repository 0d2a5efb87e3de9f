# SPDX-License-Identifier: LGPL-3.0-or-later
"""Check that all ranks have the same model, before a collective build."""

import hashlib
from collections.abc import Callable
from itertools import zip_longest

from mpi4py import MPI

from flexfem import launch
from flexfem.layout.numbered_model import NumberedModel
from flexfem.system.fingerprint import checksum, fingerprints

__all__ = ["agreed"]

_ALIKE = (
    "a model must be the same on every rank: seed random numbers, sort what comes from sets, read "
    "the same files"
)
_NOTHING = "nothing"


def agreed(comm: MPI.Intracomm, make: Callable[[], NumberedModel]) -> NumberedModel:
    """Serial data of a model that is the same on all ranks (collective).

    Args:
        comm: communicator.
        make: creates the serial data on this rank.

    Raises:
        ValueError: a mistake in the model, or the first difference and its ranks; on all ranks.
    """
    if comm.size == 1:
        return make()
    if comm.size == MPI.COMM_WORLD.size:
        launch.meet()
    message, serial = "", None
    try:
        serial = make()
    except ValueError as error:
        message = str(error) or type(error).__name__
    messages = comm.allgather(message)
    text = next(filter(None, messages), "")
    if text:
        on = [rank for rank, message in enumerate(messages) if message != text]
        raise ValueError(f"{text} (not on {_ranks(on)}; {_ALIKE})" if on else text)
    assert serial is not None
    if difference := _difference(comm, serial):
        raise ValueError(difference)
    return serial


def _difference(comm: MPI.Intracomm, serial: NumberedModel) -> str:
    """Return the first difference between the first rank and others, and its rank; else empty."""
    if len(set(comm.allgather(checksum(serial)))) == 1:
        return ""
    own = fingerprints(serial)  # takes longer, and tells what differs
    every = comm.allgather(hashlib.blake2b(repr(own).encode(), digest_size=8).digest())
    others = [rank for rank, digest in enumerate(every) if digest != every[0]]
    if not others:
        return ""
    first: list[tuple[str, str]] = comm.bcast(own)
    nothing = (_NOTHING, "")
    words = ""
    for (here, value), (there, other) in zip_longest(first, own, fillvalue=nothing):
        if here != there:
            words = f"{here} of rank 0 is {there} on {_ranks(others)}"
        elif value != other:
            words = f"{here} differs between {_ranks([0, *others])}"
        if words:
            break
    words = comm.bcast(words, root=others[0])
    return f"{words}; {_ALIKE}"


def _ranks(numbers: list[int]) -> str:
    """Some ranks as text."""
    *some, last = map(str, numbers)
    return f"ranks {', '.join(some)} and {last}" if some else f"rank {last}"
