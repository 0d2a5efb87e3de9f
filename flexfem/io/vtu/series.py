# SPDX-License-Identifier: LGPL-3.0-or-later
"""Time series of unstructured grids for ParaView: one VTU piece per rank, PVTU and PVD indices.

The pieces are written directly (XML header, raw appended arrays) and not through meshio, which
stores neither component names nor the time.
File format: https://docs.vtk.org/en/latest/design_documents/VTKFileFormats.html
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Buffer, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from hashlib import blake2b
from os import SEEK_END
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree as ET
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexfem._checks import InputError
from flexfem.io.atomic import raise_together, replace_file
from flexfem.io.vtu.field_choice import EVERYTHING, FieldChoice

if TYPE_CHECKING:
    from mpi4py import MPI

# VTK cell type number and nodes per cell
_CELLS = {
    "vertex": (1, 1), "line": (3, 2), "triangle": (5, 3), "quad": (9, 4), "tetra": (10, 4),
    # Lagrange cells of shape and degree
    "triangle_1": (5, 3), "triangle_2": (69, 6), "triangle_3": (69, 10),
    "quadrilateral_1": (9, 4), "quadrilateral_2": (70, 9), "quadrilateral_3": (70, 16),
    "tetrahedron_1": (10, 4), "tetrahedron_2": (71, 10), "tetrahedron_3": (71, 20),
    "hexahedron_1": (12, 8), "hexahedron_2": (72, 27), "hexahedron_3": (72, 64),
    "prism_1": (13, 6), "prism_2": (73, 18), "prism_3": (73, 40),
}  # fmt: skip
_TYPE_NAMES = {
    np.dtype(np.float64): "Float64", np.dtype(np.float32): "Float32", np.dtype(np.int32): "Int32",
    np.dtype(np.uint8): "UInt8",
}  # fmt: skip
# Attributes of the point and the cell arrays
type _Header = tuple[tuple[str, ...], tuple[str, ...]]
# Names of series, which are names of files
_NAME = re.compile(r"[A-Za-z0-9_.-]+")
# Stands for the time in a text; no document has this character
_TIME = "\0"
_DOCUMENT_END, _PVD_END = "</VTKFile>\n", "</Collection>"
_ENDIAN = "LittleEndian" if sys.byteorder == "little" else "BigEndian"


@dataclass(frozen=True)
class _Array:
    """One array of a piece: its XML attributes and its contiguous values."""

    name: str
    values: NDArray[Any]
    components: int
    component_names: tuple[str, ...]

    def attributes(self) -> str:
        """XML attributes shared by DataArray and PDataArray."""
        kind = _TYPE_NAMES[self.values.dtype]
        return _attributes(kind, self.name, self.components, self.component_names)


@lru_cache(maxsize=256)
def _attributes(kind: str, name: str, components: int, component_names: tuple[str, ...]) -> str:
    """XML attributes of an array; a series asks for the same ones at every instant."""
    names = "".join(f" ComponentName{i}={quoteattr(c)}" for i, c in enumerate(component_names))
    return f'type="{kind}" Name={quoteattr(name)} NumberOfComponents="{components}"{names}'


@dataclass(frozen=True)
class _Piece:
    """This rank's part of one instant, checked and converted."""

    points: _Array
    connectivity: NDArray[np.int32]
    cell_type: str
    point_data: tuple[_Array, ...]
    cell_data: tuple[_Array, ...]

    def header(self) -> _Header:
        """Attributes of the point and cell arrays: data on which all ranks must agree."""
        return (
            tuple(a.attributes() for a in self.point_data),
            tuple(a.attributes() for a in self.cell_data),
        )


class VtuSeries:
    """Series ``<folder>/<name>.pvd`` of unstructured grids, one file per rank and step.

    Each rank writes ``<name>/<name>_<step>_<rank>.vtu`` with its own cells; ranks without cells
    write nothing. With several ranks rank 0 adds ``<name>/<name>_<step>.pvtu``. What ranks send
    each other for it does not depend on the size of the grid: a few numbers, and the names of the
    arrays where these, or the ranks that have cells, change. The index
    ``<name>.pvd`` is whole after every step, so that a killed run leaves a readable series. An
    instant without cells on any rank is left out.
    """

    def __init__(
        self,
        folder: Path,
        name: str,
        comm: MPI.Comm,
        *,
        components: Mapping[str, Sequence[str]] | None = None,
        resume: float | None = None,
        fields: FieldChoice = EVERYTHING,
        single: bool = False,
    ) -> None:
        """Declare the series; nothing is written yet. Collective if an earlier one is continued.

        Args:
            folder: Result folder, created if missing.
            name: Name of the series, used in file names.
            comm: Communicator; `write` and `close` are collective.
            components: Names of the components of some arrays, by array name.
            resume: Keep the instants of an earlier run up to this time (s); None removes them all.
            fields: Names of the arrays to write, and their precision.
            single: Positions are written in the precision of fields.

        Raises:
            ValueError: If the name cannot be used.
            InputError: If the index of the earlier run cannot be read.
        """
        if not _NAME.fullmatch(name):
            raise ValueError(f"VtuSeries '{name}': the name must be usable as a file name")
        self.folder, self.name, self.comm = Path(folder), name, comm
        self._folder, self._index_file = self.folder / name, self.folder / f"{name}.pvd"
        self._fields = fields
        self._place = fields.of_fields if single else fields.of_places
        self._components = {k: tuple(v) for k, v in (components or {}).items()}
        self._instants: dict[int, tuple[float, str]] = {}  # step -> (time, file), rank 0 only
        self._last: tuple[float, str] | None = None  # of them
        # of the last instant
        self._cells, self._count = np.zeros((0, 0), dtype=np.int32), 0
        self._text: _Text | None = None
        self._mine: _Header | None = None  # arrays of this rank at the last instant
        self._sources: list[int] = []  # ranks that had cells then; rank 0 only
        self._arrays: _Header = (), ()  # of all ranks
        if resume is not None:
            self._recall(resume)
        self._started = self._closed = False

    def write(
        self,
        time: float,
        step: int,
        points: ArrayLike,
        cells: ArrayLike,
        cell_type: str,
        point_data: Mapping[str, ArrayLike] | None = None,
        cell_data: Mapping[str, ArrayLike] | None = None,
    ) -> None:
        """Write one instant; collective. A step written before is replaced.

        Args:
            time: Time in s.
            step: Step number, part of the file names.
            points: This rank's points (n, 3) in m.
            cells: This rank's cells (m, k), local point numbers.
            cell_type: "vertex", "line", "triangle", "quad" or "tetra".
            point_data: Arrays (n,), (n, c) or (n, c, d), stored as float32 (float64 in double
                precision) or int32.
            cell_data: Arrays (m,), (m, c) or (m, c, d), stored in the same way.

        Raises:
            ValueError: On all ranks, if arrays do not fit each other on one of them.
            OSError: On all ranks, if a file cannot be written.
        """
        if self._closed:
            raise ValueError(f"VtuSeries '{self.name}': written after close")
        if not self._started:
            self._start()
        error: Exception | None = None
        header = piece = None
        try:
            piece = self._piece(points, cells, cell_type, point_data or {}, cell_data or {})
            header = piece.header() if len(piece.connectivity) else None
        except (TypeError, ValueError) as exc:
            error = exc
        if not self._agree(header, error):
            return
        try:
            if piece is not None and header is not None:
                name = f"{self._stem(step)}_{self.comm.rank}.vtu"
                self._replace(name, self._text_around(piece, header).contents(piece, time))
        except OSError as exc:
            error = exc
        raise_together(self.comm, error)
        if self.comm.rank == 0:
            try:
                self._index(time, step)
            except OSError as exc:
                error = exc
        raise_together(self.comm, error)

    def close(self) -> None:
        """End the series; collective: on return its files are complete for every rank.

        Files of an earlier run of a series that was never written are removed.
        """
        if not self._closed:
            if not self._started:
                self._start()
            self._closed = True
            self.comm.barrier()

    def _agree(self, header: _Header | None, error: Exception | None) -> bool:
        """Learn the arrays and the ranks that have cells; False if none has any (collective).

        Raises:
            Exception: On all ranks, the first rank's error, or that their arrays differ.
        """
        if self.comm.size == 1:
            if error is not None:
                raise error
            return header is not None
        from mpi4py import MPI

        least = np.iinfo(np.int64).min
        own = np.array(
            [error is not None, header != self._mine, least, least, least], dtype=np.int64
        )
        if header is not None:
            mark = int.from_bytes(blake2b(repr(header).encode(), digest_size=7).digest())
            own[2:] = mark, -mark, -self.comm.rank
        found = own.copy()
        self.comm.Allreduce(own, found, op=MPI.MAX)
        if found[0]:
            raise_together(self.comm, error)
        some = bool(found[4] > least)
        if some and found[2] != -found[3]:
            raise ValueError(f"VtuSeries '{self.name}': the ranks pass different arrays")
        if found[1]:  # on any rank
            self._mine = header
            every = self.comm.gather(header is not None) or []
            self._sources = [rank for rank, has in enumerate(every) if has]
            if some:
                self._arrays = self.comm.bcast(header, root=-int(found[4])) or self._arrays
        return some

    def _replace(self, name: str, chunks: Sequence[Buffer]) -> None:
        """Write a file of the series; its folder is made if it is not there."""
        try:
            replace_file(self._folder / name, chunks)
        except FileNotFoundError:
            self._folder.mkdir(parents=True, exist_ok=True)
            replace_file(self._folder / name, chunks)

    def _stem(self, step: int) -> str:
        return f"{self.name}_{step:06d}"

    def _start(self) -> None:
        """Remove the files of an earlier run of this series; collective."""
        error: Exception | None = None
        if self.comm.rank == 0:
            try:
                self._clean()
            except OSError as exc:
                error = exc
        raise_together(self.comm, error)
        self._started = True

    def _recall(self, resume: float) -> None:
        """Take over the instants of an earlier run; collective."""
        error: Exception | None = None
        pvd = self._index_file
        if self.comm.rank == 0 and pvd.exists():
            limit = resume + 1e-12 * abs(resume)
            try:
                known = _read_pvd(pvd, self.name)
                self._instants = {k: v for k, v in known.items() if v[0] <= limit}
                self._last = max(self._instants.values(), default=None)
            except (OSError, InputError) as exc:
                error = exc
        raise_together(self.comm, error)

    def _clean(self) -> None:
        # The index is removed first: it must never name a file that is gone.
        if self._instants:
            self._write_pvd()
        else:
            self._index_file.unlink(missing_ok=True)
        own = re.compile(rf"\.?{re.escape(self.name)}_(\d{{6,}})(_\d+)?\.p?vtu(\.tmp)?")
        for path in self._folder.iterdir() if self._folder.is_dir() else ():
            match = own.fullmatch(path.name)
            if match and (int(match[1]) not in self._instants or path.suffix == ".tmp"):
                path.unlink()

    def _piece(
        self,
        points: ArrayLike,
        cells: ArrayLike,
        cell_type: str,
        point_data: Mapping[str, ArrayLike],
        cell_data: Mapping[str, ArrayLike],
    ) -> _Piece:
        who = f"VtuSeries '{self.name}'"
        if cell_type not in _CELLS:
            raise ValueError(f"{who}: unknown cell type '{cell_type}', known: {', '.join(_CELLS)}")
        x = np.ascontiguousarray(points, dtype=self._place)
        if x.ndim != 2 or x.shape[1] != 3:
            raise ValueError(f"{who}: points have shape {x.shape}, expected (n, 3)")
        c = self._connectivity(cells, cell_type, len(x))
        return _Piece(
            _Array("Points", x, 3, ()),
            c,
            cell_type,
            tuple(self._array(k, v, len(x)) for k, v in point_data.items() if k in self._fields),
            tuple(self._array(k, v, len(c)) for k, v in cell_data.items() if k in self._fields),
        )

    def _connectivity(self, cells: ArrayLike, cell_type: str, count: int) -> NDArray[np.int32]:
        """Checked cells, by so many points."""
        who, nodes = f"VtuSeries '{self.name}'", _CELLS[cell_type][1]
        c = np.asarray(cells)
        if c.size == 0:
            return np.zeros((0, nodes), dtype=np.int32)
        if c.ndim != 2 or c.shape[1] != nodes or c.dtype.kind not in "iu":
            raise ValueError(
                f"{who}: cells have shape {c.shape} and type {c.dtype}, "
                f"expected integers (m, {nodes}) for '{cell_type}'"
            )
        if count != self._count or not np.array_equal(c, self._cells):
            if c.min() < 0 or c.max() >= count:
                raise ValueError(f"{who}: a cell names point {c.max()} (or {c.min()}) of {count}")
            self._cells, self._count = np.array(c, dtype=np.int32, order="C"), count
        return self._cells

    def _text_around(self, piece: _Piece, header: _Header) -> _Text:
        """Text of the file of a piece, that of the last one if it fits."""
        if self._text is None or not self._text.fits(piece, header):
            self._text = _Text(piece, header)
        return self._text

    def _array(self, name: str, values: ArrayLike, length: int) -> _Array:
        who = f"VtuSeries '{self.name}', array '{name}'"
        a = np.asarray(values)
        if a.shape[:1] != (length,):
            raise ValueError(f"{who}: shape {a.shape}, expected {length} rows")
        kind = a.dtype.kind
        if kind not in "fiub":
            raise TypeError(f"{who}: type {a.dtype} cannot be written")
        a = self._fields.rounded(a) if kind == "f" else np.ascontiguousarray(a, dtype=np.int32)
        components = math.prod(a.shape[1:])
        names = self._components.get(name, ())
        if names and len(names) != components:
            raise ValueError(f"{who}: {components} components but {len(names)} component names")
        return _Array(name, a, components, names)

    def _index(self, time: float, step: int) -> None:
        """Make the instant visible: PVTU (several ranks), then PVD; rank 0."""
        stem = self._stem(step)
        file = f"{stem}_0.vtu"
        if self.comm.size > 1:
            file = f"{stem}.pvtu"
            sources = [f"{stem}_{rank}.vtu" for rank in self._sources]
            kind = _TYPE_NAMES[np.dtype(self._place)]
            self._replace(file, [_pvtu(sources, kind, *self._arrays).encode()])
        instant = (float(time), f"{self.name}/{file}")
        later = step not in self._instants and (self._last is None or self._last < instant)
        self._instants[step] = instant
        self._last = instant if later else max(self._instants.values())
        if not (later and self._extend_pvd(instant)):
            self._write_pvd()

    def _write_pvd(self) -> None:
        lines = [_data_set(instant) for instant in sorted(self._instants.values())]
        text = _document("Collection", "0.1", ["<Collection>", *lines, _PVD_END])
        replace_file(self._index_file, [text.encode()])

    def _extend_pvd(self, instant: tuple[float, str]) -> bool:
        """Put one more line before the last ones, in one write; False if the index stays as it was.

        Long runs have many instants, and replacing a file waits for the disk.
        """
        end = f"{_PVD_END}\n{_DOCUMENT_END}".encode()
        new = f"{_data_set(instant)}\n".encode() + end
        try:
            with self._index_file.open("r+b", buffering=0) as stream:
                at = stream.seek(-len(end), SEEK_END)
                if stream.read() != end:
                    return False
                stream.seek(at)
                if stream.write(new) == len(new):
                    return True
                stream.seek(at)  # the disk is full
                stream.write(end)
                stream.truncate()
        except OSError:
            pass
        return False


def remove_series(folder: Path, comm: MPI.Comm) -> None:
    """Remove all series of a folder, which are those of an earlier run (collective).

    Raises:
        OSError: On all ranks, if a file cannot be removed.
    """
    names: list[str] = []
    if comm.rank == 0:
        names = [path.stem for path in sorted(folder.glob("*.pvd")) if _is_index(path)]
    for name in comm.bcast(names):
        VtuSeries(folder, name, comm).close()


def _is_index(path: Path) -> bool:
    """Return True for the index of a series, and not for other files of ParaView."""
    try:
        return bool(_NAME.fullmatch(path.stem) and _read_pvd(path, path.stem))
    except (OSError, InputError):
        return False


#: Of grids: readers exchange two edges of hexahedra of older versions than 2.1.
_VERSION = "2.2"


def _data_set(instant: tuple[float, str]) -> str:
    time, file = instant
    return f'<DataSet timestep="{time!r}" part="0" file={quoteattr(file)}/>'


def _document(kind: str, version: str, lines: Sequence[str]) -> str:
    header = ' header_type="UInt64"' if version == _VERSION else ""
    return "\n".join(
        [
            '<?xml version="1.0"?>',
            f'<VTKFile type="{kind}" version="{version}" byte_order="{_ENDIAN}"{header}>',
            *lines,
            _DOCUMENT_END,
        ]
    )


class _Text:
    """XML text of a VTU file, around the time and the values.

    It is the same for all pieces with the same arrays and as many points and cells.
    """

    def __init__(self, piece: _Piece, header: _Header) -> None:
        """Compose the text for a piece."""
        number, nodes = _CELLS[piece.cell_type]
        m = len(piece.connectivity)
        ends = np.arange(nodes, nodes * m + 1, nodes, dtype=np.int32)
        self._topology = ends, np.full(m, number, dtype=np.uint8)
        self._key = header, piece.cell_type, len(piece.points.values), m
        cells = (
            _Array("connectivity", piece.connectivity, 1, ()),
            _Array("offsets", ends, 1, ()),
            _Array("types", self._topology[1], 1, ()),
        )
        self._sizes: list[bytes] = []
        position = 0

        def section(tag: str, arrays: Sequence[_Array]) -> list[str]:
            nonlocal position
            lines = [f"<{tag}>"]
            for a in arrays:
                lines.append(f'<DataArray {a.attributes()} format="appended" offset="{position}"/>')
                self._sizes.append(np.uint64(a.values.nbytes).tobytes())
                position += 8 + a.values.nbytes
            return [*lines, f"</{tag}>"]

        body = [
            "<UnstructuredGrid>",
            '<FieldData><DataArray type="Float64" Name="TimeValue" NumberOfTuples="1" '
            f'format="ascii">{_TIME}</DataArray></FieldData>',
            f'<Piece NumberOfPoints="{len(piece.points.values)}" NumberOfCells="{m}">',
            *section("PointData", piece.point_data),
            *section("CellData", piece.cell_data),
            *section("Points", [piece.points]),
            *section("Cells", cells),
            "</Piece>",
            "</UnstructuredGrid>",
            '<AppendedData encoding="raw">',
            "_",
        ]
        head, tail = _document("UnstructuredGrid", _VERSION, body).split("\n_\n")
        before, after = f"{head}\n_".split(_TIME)
        self._before, self._after = before.encode(), after.encode()
        self._end = f"\n</AppendedData>\n{tail}".encode()

    def fits(self, piece: _Piece, header: _Header) -> bool:
        """Return True if it is the text for a piece."""
        size = len(piece.points.values), len(piece.connectivity)
        return self._key == (header, piece.cell_type, *size)

    def contents(self, piece: _Piece, time: float) -> list[Buffer]:
        """Contents of the file: text, and the raw arrays, each after its size in bytes."""
        arrays = (*piece.point_data, *piece.cell_data, piece.points)
        values = (*(a.values for a in arrays), piece.connectivity, *self._topology)
        chunks: list[Buffer] = [self._before, repr(float(time)).encode(), self._after]
        for size, own in zip(self._sizes, values, strict=True):
            chunks += (size, own.reshape(-1).data)
        chunks.append(self._end)
        return chunks


def _pvtu(
    sources: Sequence[str], kind: str, point_data: Sequence[str], cell_data: Sequence[str]
) -> str:
    lines = [
        '<PUnstructuredGrid GhostLevel="0">',
        "<PPointData>",
        *(f"<PDataArray {a}/>" for a in point_data),
        "</PPointData>",
        "<PCellData>",
        *(f"<PDataArray {a}/>" for a in cell_data),
        "</PCellData>",
        f'<PPoints><PDataArray type="{kind}" Name="Points" NumberOfComponents="3"/></PPoints>',
        *(f"<Piece Source={quoteattr(s)}/>" for s in sources),
        "</PUnstructuredGrid>",
    ]
    return _document("PUnstructuredGrid", _VERSION, lines)


def _read_pvd(path: Path, name: str) -> dict[int, tuple[float, str]]:
    """Instants of an existing series by step number."""
    try:
        # a machine that failed may have cut the last lines off
        parser: Any = ET.XMLPullParser(("start",))
        parser.feed(path.read_bytes().rstrip(b"\0"))
        sets = [element for _, element in parser.read_events() if element.tag == "DataSet"]
        entries = [(float(s.attrib["timestep"]), s.attrib["file"]) for s in sets]
        matches = [re.search(rf"{re.escape(name)}_(\d{{6,}})", Path(f).name) for _, f in entries]
        return {int(m[1]): e for m, e in zip(matches, entries, strict=True) if m}
    except (ET.ParseError, KeyError, ValueError) as exc:
        raise InputError(f"series '{path}': cannot be continued, {exc}") from exc
