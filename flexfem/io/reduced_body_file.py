# SPDX-License-Identifier: LGPL-3.0-or-later
"""Reduced bodies in HDF5 files, the same whatever the number of ranks.

``/`` has the attributes ``format`` and ``interfaces`` (names), and a dataset for every array of a
body; ``/recovery`` holds the surface of all ranks as one. A checksum (BLAKE2b) of all of them is
kept in the attribute ``digest``, so that damage is noticed.
"""

from __future__ import annotations

import hashlib
import io
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flexfem._checks import InputError
from flexfem._types import FloatArray, IntArray
from flexfem.io.atomic import raise_together, replace_file
from flexfem.reduction.reduced_body import Interface, Recovery, ReducedBody

if TYPE_CHECKING:
    from mpi4py import MPI

__all__ = ["load_reduced_body", "save_reduced_body"]

#: Layout of the file; another one is refused.
_FORMAT = 1
_ARRAYS = ("moments", "products", "stiffness", "damping", "held", "frequencies")
_OPTIONAL = ("acceleration_stiffness", "interface_stiffness")


def save_reduced_body(
    path: str | Path, body: ReducedBody, comm: MPI.Intracomm | None = None
) -> None:
    """Write a reduced body, or leave everything as it is (collective).

    Args:
        path: file to create or replace; its folder must exist.
        body: the body; that of the first rank, and the surfaces of all.
        comm: communicator; None for all ranks.

    Raises:
        OSError: on all ranks, if the file cannot be written.
    """
    comm = _communicator(comm)
    recovery = _gathered(body.recovery, comm)
    error: Exception | None = None
    if comm.rank == 0:
        try:
            replace_file(Path(path), [_contents(body, recovery)])
        except OSError as exc:
            error = OSError(exc.errno, exc.strerror or str(exc), str(path))
    raise_together(comm, error)


def load_reduced_body(path: str | Path, comm: MPI.Intracomm | None = None) -> ReducedBody:
    """Read a reduced body on all ranks, each with its share of the surface (collective).

    Args:
        path: the file.
        comm: communicator; None for all ranks.

    Raises:
        InputError: a ValueError on all ranks; the file cannot be read, is something else, or is
            damaged.
    """
    comm = _communicator(comm)
    error: Exception | None = None
    raw = b""
    if comm.rank == 0:
        try:
            raw = Path(path).read_bytes()
            _read(raw)
        except (OSError, KeyError, TypeError, ValueError) as exc:
            text = (exc.strerror if isinstance(exc, OSError) else None) or str(exc)
            error = InputError(f"reduced body '{path}': {' '.join(text.split())}")
    raise_together(comm, error)
    arrays = _read(comm.bcast(raw))
    names = json.loads(arrays.pop("names"))
    position = arrays.pop("positions")
    recovery = arrays.pop("recovery")
    if recovery is not None:
        recovery = _share(recovery, comm)
    return ReducedBody(
        interfaces=tuple(Interface(n, x) for n, x in zip(names, position, strict=True)),
        recovery=recovery,
        **arrays,
    )


def _communicator(comm: MPI.Intracomm | None) -> MPI.Intracomm:
    from mpi4py import MPI

    return MPI.COMM_WORLD if comm is None else comm


def _contents(body: ReducedBody, recovery: Recovery | None) -> bytes:
    """The file's bytes."""
    import h5py

    stream = io.BytesIO()
    with h5py.File(stream, "w", libver="v110") as file:
        file.attrs["format"] = _FORMAT
        file.attrs["interfaces"] = json.dumps([i.name for i in body.interfaces])
        file.attrs["mass"] = body.mass
        file["positions"] = np.array([i.position for i in body.interfaces]).reshape(-1, 3)
        for name in _ARRAYS:
            file[name] = getattr(body, name)
        for name in _OPTIONAL:
            if getattr(body, name) is not None:
                file[name] = getattr(body, name)
        if recovery is not None:
            for name in ("points", "cells", "displacement", "stress"):
                if getattr(recovery, name) is not None:
                    file[f"recovery/{name}"] = getattr(recovery, name)
        file.attrs["digest"] = _digest(file)
    return stream.getvalue()


def _digest(file: Any) -> str:
    """Checksum of the attributes and all arrays, in the order of their names."""
    digest = hashlib.blake2b(digest_size=32)
    digest.update(f"{file.attrs['interfaces']} {float(file.attrs['mass'])!r}".encode())
    names: list[str] = []
    file.visititems(lambda name, item: names.append(name) if hasattr(item, "shape") else None)
    for name in sorted(names):
        values = file[name][()]
        digest.update(f"{name} {values.shape} {values.dtype.str}".encode())
        digest.update(np.ascontiguousarray(values))
    return digest.hexdigest()


def _read(raw: bytes) -> dict[str, Any]:
    """Fields of the body in a file's bytes.

    Raises:
        OSError: no HDF5 file.
        KeyError: something is missing.
        ValueError: another format, or the checksum differs.
    """
    import h5py

    with h5py.File(io.BytesIO(raw), "r") as file:
        if "format" not in file.attrs or "digest" not in file.attrs:
            raise ValueError("this is no file of a reduced body")
        if int(file.attrs["format"]) != _FORMAT:
            raise ValueError(f"its format is {file.attrs['format']}, not {_FORMAT}")
        if _digest(file) != file.attrs["digest"]:
            raise ValueError("it is damaged: its checksum differs")
        fields: dict[str, Any] = {name: file[name][()] for name in _ARRAYS}
        fields |= {name: file[name][()] if name in file else None for name in _OPTIONAL}
        fields["mass"] = float(file.attrs["mass"])
        fields["names"] = str(file.attrs["interfaces"])
        fields["positions"] = file["positions"][()]
        fields["recovery"] = None
        if "recovery" in file:
            group = file["recovery"]
            fields["recovery"] = {name: dataset[()] for name, dataset in group.items()}
    return fields


def _gathered(recovery: Recovery | None, comm: MPI.Intracomm) -> Recovery | None:
    """The surfaces of all ranks as one on the first; points that ranks share are there twice."""
    pieces = comm.gather(recovery)
    if comm.rank != 0 or pieces is None or any(piece is None for piece in pieces):
        return None
    parts = [piece for piece in pieces if len(piece.cells)] or pieces[:1]
    starts = np.cumsum([0] + [len(piece.points) for piece in parts])
    stress = None
    if all(piece.stress is not None for piece in parts):
        stress = np.concatenate([piece.stress for piece in parts])
    return Recovery(
        np.concatenate([piece.points for piece in parts]),
        np.concatenate([p.cells + s for p, s in zip(parts, starts[:-1], strict=True)]),
        np.concatenate([piece.displacement for piece in parts]),
        stress,
    )


def _share(whole: dict[str, Any], comm: MPI.Intracomm) -> Recovery:
    """This rank's run of the cells and the points that these have."""
    mine: IntArray = np.array_split(np.arange(len(whole["cells"])), comm.size)[comm.rank]
    cells = whole["cells"][mine]
    used, numbers = np.unique(cells, return_inverse=True)
    stress: FloatArray | None = whole.get("stress")
    return Recovery(
        whole["points"][used],
        numbers.reshape(cells.shape),
        whole["displacement"][used],
        None if stress is None else stress[mine],
    )
