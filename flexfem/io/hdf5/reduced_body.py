# SPDX-License-Identifier: LGPL-3.0-or-later
"""Reduced bodies in HDF5 files, the same whatever the number of ranks.

``/`` has the attributes ``format``, ``interfaces`` and ``lines`` (names), and a dataset for every
array of a body; ``/recovery`` holds the surface of all ranks as one, ``/lines`` the arrays of the
lines with the number of the line behind their names, ``/polynomial`` those of nonlinear elastic
forces. The attribute ``made_with`` holds the numbers
that the body was made with, as JSON. A checksum (BLAKE2b) of all of them is kept in the attribute
``digest``, so that damage is noticed.
"""

from __future__ import annotations

import hashlib
import io
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from flexfem._checks import InputError
from flexfem._files import read_bytes
from flexfem._types import FloatArray, IntArray
from flexfem.io.atomic import raise_together, replace_file
from flexfem.io.hdf5.arrays import PlainFile, load_h5py
from flexfem.io.hdf5.structure import check_structure
from flexfem.reduction.body_line import BodyLine
from flexfem.reduction.elastic_polynomial import ARRAYS as POLYNOMIAL
from flexfem.reduction.elastic_polynomial import ElasticPolynomial
from flexfem.reduction.reduced_body import Interface, Recovery, ReducedBody

if TYPE_CHECKING:
    from mpi4py import MPI

__all__ = ["load_reduced_body", "save_reduced_body"]

#: Methods of reduction that a file of a body may name.
type Parameter = bool | float | str
_NOTHING: Mapping[str, Parameter] = MappingProxyType({})
#: Layout of the file; another one is refused.
_FORMAT = 1
_ARRAYS = ("moments", "products", "stiffness", "damping", "held", "frequencies")
_OPTIONAL = ("acceleration_stiffness", "interface_stiffness")
_SURFACE = ("points", "cells", "displacement")
_STRESS = ("stress", "gradient", "law")
_LINE = ("points", "displacement", "rotation")
_GROUPS = ("recovery", "lines", "polynomial")
#: Bytes of a file beyond which it must be something else: it is read as a whole.
_LARGEST = 4_000_000_000


def save_reduced_body(
    path: str | Path,
    body: ReducedBody,
    comm: MPI.Intracomm | None = None,
    *,
    made_with: Mapping[str, Parameter] = _NOTHING,
) -> None:
    """Write a reduced body, or leave everything as it is (collective).

    Args:
        path: file to create or replace; its folder must exist.
        body: the body; that of the first rank, and the surfaces of all.
        comm: communicator; None for all ranks.
        made_with: numbers that the body was made with, by name; :func:`load_reduced_body` can ask
            for them.

    Raises:
        OSError: on all ranks, if the file cannot be written.
    """
    comm = _communicator(comm)
    recovery = _gathered(body.recovery, comm)
    error: Exception | None = None
    if comm.rank == 0:
        try:
            replace_file(Path(path), [_contents(body, recovery, made_with)])
        except OSError as exc:
            error = OSError(exc.errno, exc.strerror or str(exc), str(path))
    raise_together(comm, error)


def load_reduced_body(
    path: str | Path,
    comm: MPI.Intracomm | None = None,
    *,
    made_with: Mapping[str, Parameter] = _NOTHING,
) -> ReducedBody:
    """Read a reduced body on all ranks, each with its share of the surface (collective).

    Args:
        path: the file.
        comm: communicator; None for all ranks.
        made_with: numbers that the body must have been made with.

    Raises:
        InputError: a ValueError on all ranks; the file cannot be read, is something else, is
            damaged, or holds a body that was made with other numbers.
    """
    from mpi4py import MPI

    comm = _communicator(comm)
    error: Exception | None = None
    raw, owner = b"", f"reduced body '{path}'"
    if comm.rank == 0:
        try:
            raw = read_bytes(owner, path, _LARGEST)
            check_structure(Path(path))
            _body(raw, MPI.COMM_SELF)
            _check_made_with(raw, made_with)
        except InputError as exc:
            error = exc if str(exc).startswith(owner) else InputError(f"{owner}: {exc}")
        except Exception as exc:  # whatever HDF5's library makes of a forged file
            error = InputError(f"{owner}: {' '.join(str(exc).split()) or type(exc).__name__}")
    raise_together(comm, error)
    return _body(comm.bcast(raw), comm)


def _body(raw: bytes, comm: MPI.Intracomm) -> ReducedBody:
    """The body in a file's bytes, with this rank's share of its surface.

    Raises:
        OSError: no HDF5 file.
        TypeError, ValueError: another format, the checksum differs, or it is no body.
    """
    arrays = _read(raw)
    names, position = arrays.pop("names"), arrays.pop("positions")
    surface = arrays.pop("recovery")
    if len(names) != len(position):
        raise ValueError(f"it has {len(position)} positions of {len(names)} interfaces")
    return ReducedBody(
        interfaces=tuple(Interface(n, x) for n, x in zip(names, position, strict=True)),
        recovery=None if surface is None else _share(surface, comm),
        **arrays,
    )


def _communicator(comm: MPI.Intracomm | None) -> MPI.Intracomm:
    from mpi4py import MPI

    return MPI.COMM_WORLD if comm is None else comm


def _check_made_with(raw: bytes, wanted: Mapping[str, Parameter]) -> None:
    """Check the method that a body was reduced by.

    Raises:
        ValueError: it was reduced by another method, or the file does not state the method.
    """
    with load_h5py().File(io.BytesIO(raw), "r") as opened:
        text = _made_with(PlainFile(opened, len(raw)))
    known = json.loads(text) if text else {}
    for name, value in wanted.items():
        if name not in known:
            raise ValueError(
                f"the {name} that it was made with is not recorded; reduce the body again"
            )
        if known[name] != value:
            raise ValueError(
                f"it was made with {name} = {known[name]}, not {value}; name another file"
            )


def _made_with(file: PlainFile) -> str:
    """The attribute of this name, empty if there is none."""
    return file.text("made_with") if file.has_attribute("made_with") else ""


def _contents(
    body: ReducedBody, recovery: Recovery | None, made_with: Mapping[str, Parameter]
) -> bytes:
    """The file's bytes."""
    stream = io.BytesIO()
    with load_h5py().File(stream, "w", libver="v110") as file:
        file.attrs["format"] = _FORMAT
        file.attrs["interfaces"] = json.dumps([i.name for i in body.interfaces])
        file.attrs["mass"] = body.mass
        if made_with:
            file.attrs["made_with"] = json.dumps(dict(made_with))
        file["positions"] = np.array([i.position for i in body.interfaces]).reshape(-1, 3)
        for name in _ARRAYS:
            file[name] = getattr(body, name)
        for name in _OPTIONAL:
            if getattr(body, name) is not None:
                file[name] = getattr(body, name)
        if body.lines:
            file.attrs["lines"] = json.dumps(list(body.lines))
            for number, line in enumerate(body.lines.values()):
                for name, values in line.arrays.items():
                    file[f"lines/{name}_{number}"] = values
        if body.polynomial is not None:
            file["polynomial/turning"] = np.array([body.polynomial.turning])
            for name in POLYNOMIAL:
                file[f"polynomial/{name}"] = getattr(body.polynomial, name)
        if recovery is not None:
            for name in (*_SURFACE, *_STRESS):
                if getattr(recovery, name) is not None:
                    file[f"recovery/{name}"] = getattr(recovery, name)
        file.attrs["digest"] = _digest(PlainFile(file, sys.maxsize))
    return stream.getvalue()


def _digest(file: PlainFile) -> str:
    """Checksum of the attributes and all arrays, in the order of their names."""
    digest = hashlib.blake2b(digest_size=32)
    digest.update(f"{file.text('interfaces')} {file.number('mass')!r}".encode())
    digest.update(_made_with(file).encode())
    names = [name for name in file.names("") if name not in _GROUPS]
    for group in _GROUPS:
        if file.has(group):
            names += [f"{group}/{name}" for name in file.names(group)]
    if file.has("lines"):
        digest.update(file.text("lines").encode())
    for name in sorted(names):
        values = file.values(name)
        digest.update(f"{name} {values.shape} {values.dtype.str}".encode())
        digest.update(np.ascontiguousarray(values))
    return digest.hexdigest()


def _read(raw: bytes) -> dict[str, Any]:
    """Fields of the body in a file's bytes.

    Raises:
        OSError: no HDF5 file.
        ValueError: something is missing, another format, or the checksum differs.
    """
    with load_h5py().File(io.BytesIO(raw), "r") as opened:
        if "format" not in opened.attrs or "digest" not in opened.attrs:
            raise ValueError("this is no file of a reduced body")
        file = PlainFile(opened, len(raw))
        if file.number("format") != _FORMAT:
            raise ValueError(f"its format is {file.number('format'):g}, not {_FORMAT}")
        if _digest(file) != file.text("digest"):
            raise ValueError("it is damaged: its checksum differs")
        file = PlainFile(opened, len(raw))  # all are read a second time
        fields: dict[str, Any] = {name: file.values(name) for name in _ARRAYS}
        fields |= {name: file.values(name) if file.has(name) else None for name in _OPTIONAL}
        fields["mass"] = file.number("mass")
        fields["names"] = _names(file.text("interfaces"), "interfaces")
        fields["positions"] = file.values("positions").reshape(-1, 3)
        fields["lines"] = {}
        if file.has("lines"):
            for number, name in enumerate(_names(file.text("lines"), "lines")):
                arrays = {k: file.values(f"lines/{k}_{number}") for k in _LINE}
                fields["lines"][name] = BodyLine(**arrays)
        fields["polynomial"] = _polynomial(file) if file.has("polynomial") else None
        fields["recovery"] = None
        if file.has("recovery"):
            names = file.names("recovery")
            fields["recovery"] = _surface({n: file.values(f"recovery/{n}") for n in names})
    return fields


def _polynomial(file: PlainFile) -> ElasticPolynomial:
    """Nonlinear elastic forces.

    Raises:
        TypeError, ValueError: they are none.
    """
    turning = file.values("polynomial/turning")
    if turning.shape != (1,):
        raise ValueError("its polynomial has no number of interfaces that turn")
    arrays = {name: file.values(f"polynomial/{name}") for name in POLYNOMIAL}
    return ElasticPolynomial(turning[0], **arrays)


def _names(text: str, what: str) -> list[str]:
    """Names of the interfaces or lines.

    Raises:
        ValueError: the text does not say them.
    """
    try:
        names = json.loads(text)
    except RecursionError:
        names = None
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise ValueError(f"its {what} have no names")
    return names


def _surface(arrays: dict[str, Any]) -> dict[str, Any]:
    """Arrays of the whole surface, checked.

    Raises:
        TypeError, ValueError: they are none.
    """
    for name in _SURFACE:
        if name not in arrays:
            raise ValueError(f'it has no "recovery/{name}"')
    points, cells, displacement = (arrays[name] for name in _SURFACE)
    whole = Recovery(points, cells, displacement, *(arrays.get(name) for name in _STRESS))
    return {name: getattr(whole, name) for name in (*_SURFACE, *_STRESS)}


def _gathered(recovery: Recovery | None, comm: MPI.Intracomm) -> Recovery | None:
    """The surfaces of all ranks as one on the first; points that ranks share are there twice."""
    pieces = comm.gather(recovery)
    if comm.rank != 0 or pieces is None or any(piece is None for piece in pieces):
        return None
    parts = [piece for piece in pieces if len(piece.cells)] or pieces[:1]
    starts = np.cumsum([0] + [len(piece.points) for piece in parts])
    stress: dict[str, FloatArray | None] = {}
    for name in ("stress", "gradient"):
        values = [getattr(piece, name) for piece in parts]
        stress[name] = None if any(v is None for v in values) else np.concatenate(values)
    return Recovery(
        np.concatenate([piece.points for piece in parts]),
        np.concatenate([p.cells + s for p, s in zip(parts, starts[:-1], strict=True)]),
        np.concatenate([piece.displacement for piece in parts]),
        stress=stress["stress"],
        gradient=stress["gradient"],
        law=parts[0].law,
    )


def _share(whole: dict[str, Any], comm: MPI.Intracomm) -> Recovery:
    """This rank's run of the cells and the points that these have."""
    mine: IntArray = np.array_split(np.arange(len(whole["cells"])), comm.size)[comm.rank]
    cells = whole["cells"][mine]
    used, numbers = np.unique(cells, return_inverse=True)
    stress, gradient = (whole.get(name) for name in ("stress", "gradient"))
    return Recovery(
        whole["points"][used],
        numbers.reshape(cells.shape),
        whole["displacement"][used],
        None if stress is None else stress[mine],
        None if gradient is None else gradient[mine],
        whole.get("law"),
    )
