# SPDX-License-Identifier: LGPL-3.0-or-later
"""VTK's files of unstructured grids in XML (.vtu): text, binary, compressed, appended."""

import base64
import binascii
import lzma
import re
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NoReturn
from xml.etree import ElementTree as ET

import numpy as np
import numpy.typing as npt

from flexfem._files import read_bytes
from flexfem._types import IntArray
from flexfem.mesh.imported.limits import LARGEST, Allowance, decoded
from flexfem.mesh.imported.mesh_file import MeshFile
from flexfem.mesh.imported.numbers import TextNumbers
from flexfem.mesh.imported.vtk import VtkGrid, mesh_file

__all__ = ["read"]

_TYPES = {
    "Float32": "f4", "Float64": "f8", "Int8": "i1", "Int16": "i2", "Int32": "i4", "Int64": "i8",
    "UInt8": "u1", "UInt16": "u2", "UInt32": "u4", "UInt64": "u8",
}  # fmt: skip
_BEGIN = re.compile(rb"(\xef\xbb\xbf)?\s*<")
_APPENDED = re.compile(rb"<AppendedData\b[^>]*>")


def read(path: Path) -> MeshFile:
    """Read a .vtu file; see `mesh_file` for the sets in it.

    Raises:
        ValueError: It cannot be read.
    """
    return mesh_file(path, _File(path).grid())


class _File:
    """Elements of XML and the arrays in them."""

    def __init__(self, path: Path) -> None:
        self.owner = f'mesh file "{path}" cannot be read'
        content = read_bytes(self.owner, path, LARGEST, _BEGIN)
        self.allowance = Allowance(path)
        self.appended, self.raw = b"", False
        self.root = self._parsed(content)
        order = self.root.get("byte_order", "LittleEndian")
        self.order = {"LittleEndian": "<", "BigEndian": ">"}.get(order, "")
        header = {"UInt32": "u4", "UInt64": "u8"}.get(self.root.get("header_type", "UInt32"), "")
        self.compressor = self.root.get("compressor", "")
        if not self.order or not header:
            self._fail("its order of bytes or type of headers is not known")
        if self.compressor not in ("", "vtkZLibDataCompressor", "vtkLZMADataCompressor"):
            self._fail(f"arrays of {decoded(self.compressor.encode())[:40]} are not read")
        self.header = np.dtype(self.order + header)

    def _parsed(self, content: bytes) -> ET.Element:
        """Return the XML without the appended arrays, which are kept."""
        begin = _APPENDED.search(content)
        if begin is not None:
            self.raw = b"raw" in begin[0]
            end = content.rfind(b"</AppendedData>")
            mark = content.find(b"_", begin.end())
            if not 0 <= mark < end:
                self._fail("its appended data have no end")
            self.appended = content[mark + 1 : end]
            content = content[: begin.end()] + content[end:]
        if b"\0" in content or re.search(rb"<!(?!--)", content):
            self._fail("it has declarations of XML, which no grid needs, or is in UTF-16")
        try:
            root = ET.fromstring(content)
        except (ET.ParseError, ValueError, LookupError) as error:
            self._fail(" ".join(str(error).split()))
        if root.tag != "VTKFile" or root.get("type") != "UnstructuredGrid":
            self._fail("it is no VTKFile of the type UnstructuredGrid")
        return root

    def grid(self) -> VtkGrid:
        """Return all pieces as one."""
        pieces = [self._piece(piece) for piece in self.root.findall("UnstructuredGrid/Piece")]
        if not pieces:
            self._fail("it has no Piece")
        points = np.cumsum([0, *(len(piece.points) for piece in pieces)])
        nodes = np.cumsum([0, *(len(piece.connectivity) for piece in pieces)])
        shifted = list(zip(pieces, points, nodes, strict=False))
        return VtkGrid(
            np.concatenate([piece.points for piece in pieces]),
            np.concatenate([piece.offsets + node for piece, _, node in shifted]),
            np.concatenate([piece.connectivity + point for piece, point, _ in shifted]),
            np.concatenate([piece.types for piece in pieces]),
            _joined([piece.point_data for piece in pieces]),
            _joined([piece.cell_data for piece in pieces]),
        )

    def _piece(self, piece: ET.Element) -> VtkGrid:
        count, cells = self._count(piece, "NumberOfPoints"), self._count(piece, "NumberOfCells")
        points = piece.find("Points/DataArray")
        if points is None:
            self._fail("a Piece has no Points")
        xyz = self._array(points, 3 * count).reshape(-1, 3).astype(np.float64)
        own = {array.get("Name"): array for array in piece.findall("Cells/DataArray")}
        if lost := {"connectivity", "offsets", "types"} - set(own):
            self._fail(f"the Cells of a Piece have no {min(lost)}")
        offsets = self._whole(own["offsets"], cells)
        used = int(offsets[-1]) if cells else 0
        connectivity = self._whole(own["connectivity"], used)
        if connectivity.size and not 0 <= connectivity.min() <= connectivity.max() < count:
            self._fail(f"a cell has a node that is not one of 0 to {count - 1}")
        types = self._whole(own["types"], cells)
        data = dict(self._data(piece, "PointData", count))
        return VtkGrid(
            xyz, offsets, connectivity, types, data, dict(self._data(piece, "CellData", cells))
        )

    def _data(self, piece: ET.Element, tag: str, count: int) -> Iterator[tuple[str, IntArray]]:
        """Yield names and values of whole-numbered data of one component."""
        for array in piece.findall(f"{tag}/DataArray"):
            whole = "Int" in array.get("type", "")
            if whole and array.get("NumberOfComponents", "") in ("", "1"):
                yield decoded(array.get("Name", "").encode()), self._whole(array, count)

    def _count(self, piece: ET.Element, name: str) -> int:
        text = piece.get(name, "").strip()
        if not re.fullmatch("[0-9]{1,15}", text):
            self._fail(f"a Piece has no number for {name}")
        return int(text)

    def _whole(self, array: ET.Element, count: int) -> IntArray:
        values = self._array(array, count)
        with np.errstate(invalid="ignore"):
            whole = values.astype(np.int64)
        if (whole != values).any():
            self._fail(f"{_named(array)} has something else than whole numbers")
        return whole

    def _array(self, array: ET.Element, count: int) -> npt.NDArray[Any]:
        """Return the values of an array, of which there must be so many."""
        kind = _TYPES.get(array.get("type", ""))
        if kind is None or not 0 <= count < 2**50:
            self._fail(f"{_named(array)} is of no known type or size")
        form = array.get("format", "ascii")
        if form == "ascii":
            text = TextNumbers(f"{self.owner}, {_named(array)}", (array.text or "").encode())
            (values,) = text.records(count, ("double", 1))
            text.finish()
            return values[:, 0]
        content, raw = (array.text or "").strip().encode(), False
        if form == "appended":
            text_offset = array.get("offset", "").strip()
            if not re.fullmatch("[0-9]{1,15}", text_offset):
                self._fail(f"{_named(array)} has no offset")
            content, raw = self.appended[int(text_offset) :], self.raw
        data = self._bytes(array, content, raw, count * np.dtype(kind).itemsize)
        return np.frombuffer(data, self.order + kind)

    def _bytes(self, array: ET.Element, content: bytes, raw: bool, size: int) -> bytes | bytearray:
        """Return the bytes of an array, of which there must be so many."""
        if size == 0:
            return b""
        stream = _Stream(b"".join(content.split()) if array.text and not raw else content, raw)
        if self.compressor:
            self.allowance.take(size, _named(array))
        try:
            data = self._unpacked(stream, size) if self.compressor else self._plain(stream, size)
        except (binascii.Error, ValueError, EOFError, zlib.error, lzma.LZMAError):
            self._fail(f"{_named(array)} is cut off or damaged")
        if len(data) != size:
            self._fail(f"{_named(array)} has not the {size} bytes that it needs")
        return data

    def _plain(self, stream: "_Stream", size: int) -> bytes:
        """Return the bytes of an array that states their number; nothing if it is wrong."""
        head = self.header.itemsize
        (found,) = np.frombuffer(stream.head(head), self.header).tolist()
        return stream.body(head, size) if found == size else b""

    def _unpacked(self, stream: "_Stream", size: int) -> bytearray:
        """Return the bytes of compressed blocks, at most one more than there must be."""
        width = self.header.itemsize
        count = int(np.frombuffer(stream.head(3 * width), self.header)[0])
        head = (3 + count) * width
        sizes = np.frombuffer(stream.head(head), self.header)[3:].tolist()
        packed, start = stream.body(head, sum(sizes)), 0
        data = bytearray()
        for block in sizes:
            if len(data) > size:
                break
            part = packed[start : start + block]
            data += _unpacked(self.compressor, part, size + 1 - len(data))
            start += block
        return data

    def _fail(self, reason: str) -> NoReturn:
        raise ValueError(f"{self.owner}: {reason}")


class _Stream:
    """A head and what follows it, as they are or in base 64, together or each for itself."""

    def __init__(self, content: bytes, raw: bool) -> None:
        self.content, self.raw = content, raw

    def head(self, size: int) -> bytes:
        """Return the first bytes; there must be as many."""
        data = self._bytes(0, size)
        if len(data) < size:
            raise EOFError
        return data[:size]

    def body(self, head: int, size: int) -> bytes:
        """Return the bytes after a head."""
        apart = _characters(head)
        if not self.raw and self.content[:apart].endswith(b"="):
            return self._bytes(apart, size)[:size]
        return self._bytes(0, head + size)[head : head + size]

    def _bytes(self, start: int, size: int) -> bytes:
        if size > len(self.content):
            raise EOFError
        if self.raw:
            return self.content[start : start + size]
        return base64.b64decode(self.content[start : start + _characters(size)], validate=True)


def _characters(size: int) -> int:
    """Characters in base 64 of so many bytes."""
    return 4 * ((size + 2) // 3)


def _unpacked(compressor: str, data: bytes, size: int) -> bytes:
    """Return at most so many of the bytes of a compressed block."""
    if compressor == "vtkZLibDataCompressor":
        return zlib.decompressobj().decompress(data, size)
    return lzma.LZMADecompressor(memlimit=2**28).decompress(data, size)


def _named(array: ET.Element) -> str:
    return f'array "{decoded(array.get("Name", "").encode())[:40]}"'


def _joined(data: list[Mapping[str, IntArray]]) -> dict[str, IntArray]:
    """Return the data that all pieces have."""
    common = [name for name in data[0] if all(name in other for other in data)]
    return {name: np.concatenate([piece[name] for piece in data]) for name in common}
