# SPDX-License-Identifier: LGPL-3.0-or-later
"""VTK's older files (.vtk): unstructured grids, and grids of points in rows; text and binary."""

import re
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import numpy.typing as npt

from flexfem._files import read_bytes
from flexfem._types import FloatArray, IntArray
from flexfem.mesh.imported.limits import LARGEST, Allowance, decoded, real, whole
from flexfem.mesh.imported.mesh_file import MeshFile
from flexfem.mesh.imported.numbers import TextNumbers
from flexfem.mesh.imported.vtk import VtkGrid, mesh_file

__all__ = ["read"]

_TYPES = {
    "unsigned_char": "u1", "char": "i1", "unsigned_short": "u2", "short": "i2",
    "unsigned_int": "u4", "int": "i4", "unsigned_long": "u8", "long": "i8", "vtkidtype": "i4",
    "vtktypeint64": "i8", "vtktypeuint64": "u8", "float": "f4", "double": "f8",
}  # fmt: skip
# Components of data that have a fixed number of them
_COMPONENTS = {"VECTORS": 3, "NORMALS": 3, "TENSORS": 9, "GLOBAL_IDS": 1, "PEDIGREE_IDS": 1}
_GRIDS = ("UNSTRUCTURED_GRID", "STRUCTURED_POINTS", "STRUCTURED_GRID", "RECTILINEAR_GRID")
_BEGIN = re.compile(b"# vtk DataFile Version")
_TOKENS = re.compile(rb"(?:\s*+\S++){1000}")


def read(path: Path) -> MeshFile:
    """Read a .vtk file; see `mesh_file` for the sets in it.

    Raises:
        ValueError: It cannot be read.
    """
    return mesh_file(path, _File(path).grid())


class _File:
    """Takes the parts of a file one after another."""

    def __init__(self, path: Path) -> None:
        self.owner = f'mesh file "{path}" cannot be read'
        self.allowance = Allowance(path)
        self.content, self.position = read_bytes(self.owner, path, LARGEST, _BEGIN), 0
        if not _BEGIN.match(self.content):
            self._fail("it does not begin with # vtk DataFile Version")
        self._line()
        self._line()
        form = self._line().strip().upper()
        if form not in ("ASCII", "BINARY"):
            self._fail("it is neither ASCII nor BINARY")
        self.binary = form == "BINARY"
        self.kind = ""
        self.dimensions: list[int] = []
        self.steps: dict[str, list[float]] = {}
        self.axes: dict[str, FloatArray] = {}
        self.arrays: dict[str, npt.NDArray[Any]] = {}
        self.data: dict[str, dict[str, IntArray]] = {"CELL_DATA": {}, "POINT_DATA": {}}
        self.where, self.count = "", 0
        while words := self._words():
            self._take(words)

    def _take(self, words: list[str]) -> None:
        """Take the block that begins with some words."""
        take = {
            "DATASET": self._dataset,
            "POINTS": self._points,
            "CELLS": self._cells,
            "CELL_TYPES": self._types,
            "DIMENSIONS": self._size,
            "ORIGIN": self._spacing,
            "SPACING": self._spacing,
            "ASPECT_RATIO": self._spacing,
            "X_COORDINATES": self._axis,
            "Y_COORDINATES": self._axis,
            "Z_COORDINATES": self._axis,
            "CELL_DATA": self._of,
            "POINT_DATA": self._of,
            "SCALARS": self._scalars,
            "COLOR_SCALARS": self._colours,
            "LOOKUP_TABLE": self._table,
            "TEXTURE_COORDINATES": self._texture,
            "FIELD": self._field,
            "METADATA": self._metadata,
            **dict.fromkeys(_COMPONENTS, self._fixed),
        }.get(words[0].upper())
        if take is None:
            self._fail(f"{words[0][:40]!r} begins no section")
        take(words)

    # --- the grid ------------------------------------------------------------------------------

    def _dataset(self, words: list[str]) -> None:
        self.kind = self._word(words, 1).upper()
        if self.kind not in _GRIDS:
            self._fail(f"data sets {self.kind[:40]} are not read, but {', '.join(_GRIDS)}")

    def _points(self, words: list[str]) -> None:
        values = self._numbers(3 * self._number(words, 1), self._word(words, 2))
        self.arrays["points"] = values.reshape(-1, 3).astype(np.float64)

    def _cells(self, words: list[str]) -> None:
        count, size = self._number(words, 1), self._number(words, 2)
        mark = self.position
        following = self._words()
        if following[:1] != ["OFFSETS"]:  # before version 5: each cell's number of nodes first
            self.position = mark
            self._counted_cells(count, self._whole(size, "int"))
            return
        offsets = self._whole(count, self._word(following, 1))
        following = self._words()
        if following[:1] != ["CONNECTIVITY"]:
            self._fail("OFFSETS are not followed by CONNECTIVITY")
        self.arrays["connectivity"] = self._whole(size, self._word(following, 1))
        if count == 0 or offsets[0] != 0:
            self._fail("OFFSETS do not begin with 0")
        self.arrays["offsets"] = offsets[1:]

    def _counted_cells(self, count: int, values: IntArray) -> None:
        numbers, starts, at = values.tolist(), [], 0
        for _ in range(count):
            if not (at < len(numbers) and 0 <= numbers[at] < len(numbers) - at):
                self._fail("CELLS have fewer nodes than they say")
            starts.append(at)
            at += 1 + numbers[at]
        if at != len(numbers):
            self._fail("CELLS have more nodes than they say")
        self.arrays["connectivity"] = np.delete(values, np.array(starts, dtype=np.int64))
        self.arrays["offsets"] = np.cumsum(values[np.array(starts, dtype=np.int64)])

    def _types(self, words: list[str]) -> None:
        self.arrays["types"] = self._whole(self._number(words, 1), "int")

    def _size(self, words: list[str]) -> None:
        self.dimensions = [self._number(words, i) for i in (1, 2, 3)]

    def _spacing(self, words: list[str]) -> None:
        values = [real(self._word(words, i)) for i in (1, 2, 3)]
        if None in values:
            self._fail(f"{words[0]} needs three numbers")
        name = "ORIGIN" if words[0].upper() == "ORIGIN" else "SPACING"
        self.steps[name] = [value for value in values if value is not None]

    def _axis(self, words: list[str]) -> None:
        values = self._numbers(self._number(words, 1), self._word(words, 2))
        self.axes[words[0][0].upper()] = values.astype(np.float64)

    def grid(self) -> VtkGrid:
        """Return points, cells and data."""
        if self.kind != "UNSTRUCTURED_GRID":
            self._regular()
        if lost := {"points", "connectivity", "offsets", "types"} - set(self.arrays):
            self._fail(f"it has no {min(lost)}")
        return VtkGrid(
            self.arrays["points"],
            self.arrays["offsets"],
            self.arrays["connectivity"],
            self.arrays["types"],
            self.data["POINT_DATA"],
            self.data["CELL_DATA"],
        )

    def _regular(self) -> None:
        """Make points and cells of a grid that has them in rows."""
        if self.kind == "RECTILINEAR_GRID" and set(self.axes) == set("XYZ"):
            self.dimensions = [len(self.axes[name]) for name in "XYZ"]
        if len(self.dimensions) != 3 or not any(size > 1 for size in self.dimensions):
            self._fail("it has no grid of points, or one without cells")
        sizes = [max(size, 1) for size in self.dimensions]
        total = sizes[0] * sizes[1] * sizes[2]
        self.allowance.take(200.0 * total, "a grid of points")
        if self.kind == "STRUCTURED_POINTS":
            if set(self.steps) != {"ORIGIN", "SPACING"}:
                self._fail("it has no ORIGIN or SPACING")
            for name, size, origin, step in zip("XYZ", sizes, *self._steps(), strict=True):
                self.axes[name] = origin + step * np.arange(size, dtype=np.float64)
        if self.kind != "STRUCTURED_GRID":
            z, y, x = np.meshgrid(*(self.axes[name] for name in "ZYX"), indexing="ij")
            self.arrays["points"] = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
        if len(self.arrays.get("points", ())) != total:
            self._fail(f"it has {len(self.arrays.get('points', ()))} points, not {total}")
        self._cells_of_rows([size for size in sizes if size > 1])

    def _steps(self) -> tuple[list[float], list[float]]:
        return self.steps["ORIGIN"], self.steps["SPACING"]

    def _cells_of_rows(self, sizes: list[int]) -> None:
        """Make lines, quadrilaterals or hexahedra between points in rows."""
        nodes = np.arange(np.prod(sizes)).reshape(sizes[::-1])
        first = nodes[tuple(slice(-1) for _ in sizes)].ravel()
        corners = [0, 1]
        if len(sizes) > 1:
            corners += [1 + sizes[0], sizes[0]]
        if len(sizes) > 2:
            corners += [corner + sizes[0] * sizes[1] for corner in corners]
        cells = first[:, np.newaxis] + np.array(corners)
        self.arrays["connectivity"] = cells.ravel()
        self.arrays["offsets"] = np.arange(1, len(cells) + 1) * len(corners)
        self.arrays["types"] = np.full(len(cells), {2: 3, 4: 9, 8: 12}[len(corners)])

    # --- data ----------------------------------------------------------------------------------

    def _of(self, words: list[str]) -> None:
        self.where, self.count = words[0].upper(), self._number(words, 1)

    def _scalars(self, words: list[str]) -> None:
        width = self._number(words, 3) if len(words) > 3 else 1
        mark = self.position
        if self._line().split()[:1] != ["LOOKUP_TABLE"]:
            self.position = mark
        self._keep(self._word(words, 1), self.count, width, self._word(words, 2))

    def _fixed(self, words: list[str]) -> None:
        width = _COMPONENTS[words[0].upper()]
        self._keep(self._word(words, 1), self.count, width, self._word(words, 2))

    def _texture(self, words: list[str]) -> None:
        width = self._number(words, 2)
        self._keep(self._word(words, 1), self.count, width, self._word(words, 3))

    def _colours(self, words: list[str]) -> None:
        self._skip(self.count * self._number(words, 2), "unsigned_char" if self.binary else "float")

    def _table(self, words: list[str]) -> None:
        self._skip(4 * self._number(words, 2), "unsigned_char" if self.binary else "float")

    def _field(self, words: list[str]) -> None:
        for _ in range(self._number(words, 2)):
            row = self._words()
            if row[:1] == ["METADATA"]:
                self._metadata(row)
                row = self._words()
            if not row:
                self._fail("a FIELD has fewer arrays than it says")
            width, count = self._number(row, 1), self._number(row, 2)
            self._keep(row[0], count, width, self._word(row, 3))

    def _metadata(self, _: list[str]) -> None:
        while self._line().strip():
            pass

    def _keep(self, name: str, count: int, width: int, kind: str) -> None:
        """Keep whole numbers of one component of points or cells, and pass over all others."""
        own = self.where and width == 1 and count == self.count
        if own and not _TYPES.get(kind.lower(), "f").startswith("f"):
            self.data[self.where][name] = self._whole(count, kind)
        else:
            self._skip(count * width, kind)

    # --- words and numbers ---------------------------------------------------------------------

    def _words(self) -> list[str]:
        """Return the words of the next line that has some, none at the end of the file."""
        words: list[str] = []
        while not words and self.position < len(self.content):
            words = self._line().split()
        return words

    def _line(self) -> str:
        end = self.content.find(b"\n", self.position)
        end = len(self.content) if end < 0 else end
        line, self.position = self.content[self.position : end], end + 1
        if len(line) > 10000:
            self._fail("a line has more than 10000 characters")
        return decoded(line)

    def _word(self, words: list[str], place: int) -> str:
        if place >= len(words):
            self._fail(f"{words[0][:40]} lacks a word")
        return words[place]

    def _number(self, words: list[str], place: int) -> int:
        number = whole(self._word(words, place))
        if number is None or number < 0:
            self._fail(f"{words[0][:40]} has no number where it needs one")
        return number

    def _whole(self, count: int, kind: str) -> IntArray:
        values = self._numbers(count, kind)
        with np.errstate(invalid="ignore"):
            found = values.astype(np.int64)
        if (found != values).any():
            self._fail("something else is in place of whole numbers")
        return found

    def _numbers(self, count: int, kind: str) -> npt.NDArray[Any]:
        start, end = self._skip(count, kind)
        if self.binary:
            return np.frombuffer(self.content, f">{_TYPES[kind.lower()]}", count, start)
        text = TextNumbers(self.owner, self.content[start:end])
        return text.records(count, ("double", 1))[0][:, 0]

    def _skip(self, count: int, kind: str) -> tuple[int, int]:
        """Pass over some numbers and return where they begin and end."""
        form = _TYPES.get(kind.lower())
        if form is None:
            self._fail(f"numbers of the type {kind[:40]!r} are not read")
        width = np.dtype(form).itemsize if self.binary else 1
        start = self.position
        if count * width > len(self.content) - start:
            self._fail(f"it ends before {count} numbers that it says follow")
        if self.binary:
            self.position = start + count * width
            return start, self.position
        rest = re.compile(rb"(?:\s*+\S++){%d}" % (count % 1000))
        for pattern in (*[_TOKENS] * (count // 1000), rest):
            match = pattern.match(self.content, self.position)
            if match is None:
                self._fail(f"it ends before {count} numbers that it says follow")
            self.position = match.end()
        return start, self.position

    def _fail(self, reason: str) -> NoReturn:
        raise ValueError(f"{self.owner}: {reason}")
