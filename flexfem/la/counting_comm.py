# SPDX-License-Identifier: LGPL-3.0-or-later
"""Communicator that counts what its rank sends: the quantities of a model of cost."""

from __future__ import annotations

from typing import Any, NamedTuple

from mpi4py import MPI

__all__ = ["CountingComm", "Sent"]


class Sent(NamedTuple):
    """What a rank has sent.

    Attributes:
        messages: to single ranks.
        bytes: of these.
        reductions: calls of collective operations.
        reduced_bytes: of this rank's arrays in these.
    """

    messages: int = 0
    bytes: int = 0
    reductions: int = 0
    reduced_bytes: int = 0


class CountingComm(MPI.Intracomm):
    """A communicator with counts of the calls that steps of a motion make.

    Messages inside of PETSc and DOLFINx are not among them, unless :meth:`count` is told.
    """

    #: petsc4py recognises communicators by the module of their class.
    __module__ = MPI.__name__
    _messages = _bytes = _reductions = _reduced_bytes = 0

    @property
    def sent(self) -> Sent:
        """What this rank has sent since the communicator was made."""
        return Sent(self._messages, self._bytes, self._reductions, self._reduced_bytes)

    def count(self, messages: int, size: int) -> None:
        """Count messages with this number of bytes in all that libraries send for this rank."""
        self._messages += messages
        self._bytes += size

    def Isend(self, buf: Any, *args: Any, **kwargs: Any) -> MPI.Request:
        """See ``MPI.Comm``; the buffer is an array."""
        self.count(1, buf.nbytes)
        return super().Isend(buf, *args, **kwargs)

    def Allreduce(self, sendbuf: Any, recvbuf: Any, *args: Any, **kwargs: Any) -> None:
        """See ``MPI.Comm``; the second buffer is an array."""
        self._count_reduction(recvbuf.nbytes)
        super().Allreduce(sendbuf, recvbuf, *args, **kwargs)

    def Iallreduce(self, sendbuf: Any, recvbuf: Any, *args: Any, **kwargs: Any) -> MPI.Request:
        """See :meth:`Allreduce`."""
        self._count_reduction(recvbuf.nbytes)
        return super().Iallreduce(sendbuf, recvbuf, *args, **kwargs)

    def allreduce(self, sendobj: Any, *args: Any, **kwargs: Any) -> Any:
        """See ``MPI.Comm``; arrays count with their bytes, other objects with those of a number."""
        self._count_reduction(getattr(sendobj, "nbytes", 8))
        return super().allreduce(sendobj, *args, **kwargs)

    def allgather(self, sendobj: Any) -> Any:
        """See :meth:`allreduce`."""
        self._count_reduction(getattr(sendobj, "nbytes", 8))
        return super().allgather(sendobj)

    def _count_reduction(self, size: int) -> None:
        self._reductions += 1
        self._reduced_bytes += size
