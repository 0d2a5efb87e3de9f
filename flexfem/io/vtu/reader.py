# SPDX-License-Identifier: LGPL-3.0-or-later
"""Reading the series that ``flexfem.io.vtu.series`` writes, and nothing else that may be called so.

A file may be damaged, or made to do harm: sizes are compared with those of the file before anything
is allocated, names of files lead nowhere but into the folder of their series, and documents with
declarations of their own (entities) are refused.
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from flexfem._checks import InputError, show
from flexfem._files import open_file, read_bytes

__all__ = ["Grid", "Instant", "read_index", "read_pieces"]

#: Bytes of an index, of the text in front of the arrays, and of a whole file that are read at most.
_INDEX, _HEADER, _WHOLE = 256_000_000, 1_000_000, 4_000_000_000
#: Number of pieces of an instant, one for each rank.
_PIECES = 100_000
_BEGIN = b'<AppendedData encoding="raw">\n_'
_TYPES = {"Float64": "f8", "Float32": "f4", "Int32": "i4", "Int64": "i8", "UInt8": "u1"}
_ORDER = {"LittleEndian": "<", "BigEndian": ">"}
#: Corners of a cell by its type in VTK.
_CORNERS = {1: 1, 3: 2, 5: 3, 9: 4, 10: 4}


@dataclass(frozen=True)
class Instant:
    """An entry of the index of a series: a time (s) and its file."""

    time: float
    file: Path


@dataclass(frozen=True)
class Grid:
    """The cells of one rank at one instant.

    Attributes:
        points: (n, 3) positions, m.
        cells: (m, k) points of the cells.
        kind: type of all of them, as VTK numbers types.
        point_data, cell_data: (n, ...) and (m, ...) values by name.
        components: names of the components of arrays that have such.
    """

    points: NDArray[np.float64]
    cells: NDArray[np.int64]
    kind: int
    point_data: Mapping[str, NDArray[Any]]
    cell_data: Mapping[str, NDArray[Any]]
    components: Mapping[str, tuple[str, ...]]


def read_index(path: Path, name: str) -> list[Instant]:
    """Instants of a series in order of time.

    Args:
        path: its index, ``<name>.pvd`` in a result folder.
        name: of the series.

    Raises:
        InputError: the index cannot be read, or is damaged.
    """
    owner = f"series '{path}'"
    own = re.compile(rf"{re.escape(name)}/{re.escape(name)}_\d{{6,}}(_\d+)?\.p?vtu")
    found: dict[float, Instant] = {}
    for element in _elements(owner, read_bytes(owner, path, _INDEX), "DataSet"):
        file, time = element.get("file", ""), _number(element.get("timestep", ""))
        if not own.fullmatch(file) or not math.isfinite(time):
            raise InputError(f"{owner}: it is damaged, or not a series of flexfem")
        found[time] = Instant(time, path.parent / file)
    return [found[time] for time in sorted(found)]


def read_pieces(file: Path, wanted: Sequence[str] | None = None) -> list[Grid]:
    """Grids of all ranks at one instant.

    Args:
        file: of an instant.
        wanted: names of the arrays to read; None for all.

    Raises:
        InputError: a file cannot be read, or is damaged.
    """
    if file.suffix == ".vtu":
        return [_Reader(file).grid(wanted)]
    owner = f"file '{file}'"
    own = re.compile(re.escape(file.stem) + r"_\d+\.vtu")
    sources = [e.get("Source", "") for e in _elements(owner, _text(owner, file), "Piece")]
    if not 0 < len(sources) <= _PIECES or not all(map(own.fullmatch, sources)):
        raise InputError(f"{owner}: it is damaged, or not of a series of flexfem")
    return [_Reader(file.with_name(source)).grid(wanted) for source in sources]


def _text(owner: str, file: Path) -> bytes:
    return read_bytes(owner, file, _INDEX)


def _elements(owner: str, text: bytes, tag: str) -> list[ET.Element]:
    """Elements of a name in a document, whose last lines a machine that failed may have lost."""
    _refuse_declarations(owner, text)
    parser: Any = ET.XMLPullParser(("start",))
    try:
        parser.feed(text.rstrip(b"\0"))
        return [element for _, element in parser.read_events() if element.tag == tag]
    except ET.ParseError as error:
        raise InputError(f"{owner}: it is damaged ({error})") from None


def _refuse_declarations(owner: str, text: bytes) -> None:
    if b"<!" in text:
        raise InputError(f"{owner}: it has declarations (<!), which no file of flexfem has")


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


class _Reader:
    """One file of a piece: its text, and the raw arrays behind it."""

    def __init__(self, file: Path) -> None:
        """Read the file."""
        self._owner = f"file '{file}'"
        with open_file(self._owner, file) as stream:
            head = stream.read(_HEADER)
        end = head.find(_BEGIN)
        if not head.startswith(b"<?xml") or end < 0:
            raise InputError(f"{self._owner}: it is damaged, or not of a series of flexfem")
        data = read_bytes(self._owner, file, _WHOLE)
        self._data = memoryview(data)[end + len(_BEGIN) :]
        _refuse_declarations(self._owner, head[:end])
        try:
            self._root = ET.fromstring(head[:end] + b"</VTKFile>")
            self._order = _ORDER[self._root.attrib["byte_order"]]
        except (ET.ParseError, KeyError):
            raise self._damaged("its text") from None
        self._components: dict[str, tuple[str, ...]] = {}

    def grid(self, wanted: Sequence[str] | None) -> Grid:
        """The cells with the wanted arrays."""
        piece = self._root.find("UnstructuredGrid/Piece")
        if piece is None:
            raise self._damaged("it has no piece")
        n, m = (self._count(piece, name) for name in ("NumberOfPoints", "NumberOfCells"))
        cells = {e.get("Name"): e for e in piece.iterfind("Cells/DataArray")}
        points = piece.find("Points/DataArray")
        if points is None or {"connectivity", "types"} - cells.keys():
            raise self._damaged("it has no points or cells")
        kinds = self._array(cells["types"], m)
        kind = int(kinds[0]) if m else 3
        if kind not in _CORNERS or np.any(kinds != kind):
            raise self._damaged(f"it has cells of the type {kind}, or of several")
        corners = self._array(cells["connectivity"], m * _CORNERS[kind]).astype(np.int64)
        if corners.size and not 0 <= corners.min() <= corners.max() < n:
            raise self._damaged("a cell names a point that is not there")
        x = self._array(points, n).astype(np.float64)
        if x.shape != (n, 3):
            raise self._damaged(f"its points have the shape {x.shape}")
        return Grid(
            x, corners.reshape(m, _CORNERS[kind]), kind,
            self._named(piece, "PointData", n, wanted), self._named(piece, "CellData", m, wanted),
            self._components,
        )  # fmt: skip

    def _named(
        self, piece: ET.Element, tag: str, rows: int, wanted: Sequence[str] | None
    ) -> dict[str, NDArray[Any]]:
        found = {}
        for element in piece.iterfind(f"{tag}/DataArray"):
            name = element.get("Name", "")
            if wanted is None or name in wanted:
                found[name] = self._array(element, rows)
                names = [element.get(f"ComponentName{i}") for i in range(16)]
                self._components[name] = tuple(text for text in names if text)
        return found

    def _array(self, element: ET.Element, rows: int) -> NDArray[Any]:
        """Values of an array: (rows,), or (rows, c) of several components."""
        name = show(element.get("Name", ""))
        kind, at = element.get("type", ""), self._count(element, "offset")
        width = self._count(element, "NumberOfComponents", "1")
        if kind not in _TYPES or not 1 <= width <= 1000 or at + 8 > len(self._data):
            raise self._damaged(f"array {name}")
        dtype = np.dtype(self._order + _TYPES[kind])
        size = rows * width * dtype.itemsize
        (stored,) = np.frombuffer(self._data, self._order + "u8", 1, at).tolist()
        if stored != size or at + 8 + size > len(self._data):
            raise self._damaged(f"array {name} has {stored} bytes, {size} fit the piece")
        values = np.frombuffer(self._data, dtype, rows * width, at + 8)
        values = values.astype(dtype.newbyteorder("="), copy=sys.byteorder == "big")
        return values if width == 1 else values.reshape(rows, width)

    def _count(self, element: ET.Element, name: str, default: str = "") -> int:
        text = element.get(name, default)
        if not re.fullmatch(r"[0-9]{1,12}", text):
            raise self._damaged(f"{name} {show(text)}")
        return int(text)

    def _damaged(self, what: str) -> InputError:
        return InputError(f"{self._owner}: it is damaged ({what})")
