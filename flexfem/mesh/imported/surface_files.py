# SPDX-License-Identifier: LGPL-3.0-or-later
"""Triangles of STL and OBJ files, for rigid surfaces, shells and pictures of links.

Files may come from anywhere. Their counts are compared with their contents, and memory is taken in
proportion to their size.
"""

from array import array
from collections.abc import Iterator, Sequence
from itertools import cycle, pairwise
from pathlib import Path
from typing import NoReturn

import numpy as np

from flexfem._checks import show
from flexfem._files import number_in, read_bytes
from flexfem._types import FloatArray, IntArray
from flexfem.mesh.imported.mesh_file import MeshFile

__all__ = ["FORMATS", "read", "read_surface"]

#: Bytes of a file, which takes up to ten times as many while it is read.
_LARGEST = 500_000_000

# Binary STL: a text, the number of triangles, and for each its normal, three corners and two bytes
_HEAD = 84
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
# The lines of a triangle in an ASCII STL file
_LINES = ("facet", "outer", "vertex", "vertex", "vertex", "endloop", "endfacet")


def read_surface(path: Path) -> tuple[FloatArray, IntArray]:
    """Points (n, 3) and triangles (m, 3) of a file.

    Raises:
        ValueError: another format, no plain file, or not as its format requires.
    """
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        raise ValueError(f'"{suffix}" files are not read, {" and ".join(FORMATS)} are')
    content = read_bytes("it cannot be read", path, _LARGEST)
    points, triangles = FORMATS[suffix](content)
    if len(triangles) == 0:
        raise ValueError("it has no triangles")
    return points, triangles


def read(path: Path) -> MeshFile:
    """Read a file as a mesh: points in the same place are one, triangles without area are left out.

    Programs write such triangles where they round; without them the surface is closed as before.

    Raises:
        ValueError: It cannot be read, or no triangle has an area.
    """
    owner = f'mesh file "{path}"'
    try:
        points, triangles = read_surface(path)
    except ValueError as error:
        raise ValueError(f"{owner}: {error}") from None
    places, number = np.unique(points, axis=0, return_inverse=True)
    triangles = number.reshape(-1)[triangles]
    ends = np.roll(triangles, 1, axis=1)
    triangles = triangles[(triangles != ends).all(axis=1)]
    if len(triangles) == 0:
        raise ValueError(f"{owner}: none of its triangles has an area")
    return MeshFile(path, places, {"triangle": triangles}, {}, {})


def _stl(content: bytes) -> tuple[FloatArray, IntArray]:
    """Corners of STL triangles; those in the same place become one point."""
    count = int.from_bytes(content[_HEAD - 4 : _HEAD], "little") if len(content) >= _HEAD else 0
    held = (len(content) - _HEAD) // _FACET.itemsize
    if len(content) >= _HEAD and held == count:
        single = np.frombuffer(content, _FACET, count, _HEAD)["corners"]
        if not np.isfinite(single).all():  # some texts are no numbers
            raise ValueError("its points are not all finite")
        corners = single.astype(np.float64).reshape(-1, 3)
    elif content.lstrip()[:5].lower() == b"solid":
        corners = _stl_corners(content)
    elif len(content) < _HEAD:
        raise ValueError("it is neither a binary nor an ASCII STL file")
    else:
        raise ValueError(f"it is to have {count} triangles and has room for {held}")
    points, numbers = np.unique(corners, axis=0, return_inverse=True)
    return points, numbers.reshape(-1, 3).astype(np.int64)


def _stl_corners(content: bytes) -> FloatArray:
    """Corners of the triangles of an ASCII file, one after another."""
    values, expected, solid, number = array("d"), cycle(_LINES), False, 0
    wanted = next(expected)
    for number, words in _lines(content):
        word = words[0].lower()
        if wanted == _LINES[0] and word in ("solid", "endsolid") and solid is (word == "endsolid"):
            solid = not solid
            continue
        if not solid or word != wanted:
            meant = wanted if solid else "solid"
            _refuse(number, f"{meant} must come here, got {show(' '.join(words[:4]))}")
        if word == "vertex":
            values.extend(_coordinates(number, words, exactly=True))
        wanted = next(expected)
    if solid:
        _refuse(number, "the file ends before its solid does")
    return np.frombuffer(values, dtype=np.float64).reshape(-1, 3)


def _obj(content: bytes) -> tuple[FloatArray, IntArray]:
    """Points and faces of an OBJ file; polygons are cut into fans."""
    values, triangles = array("d"), array("q")
    for number, words in _lines(content.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ")):
        if words[0] == "v":
            values.extend(_coordinates(number, words, exactly=False))
        elif words[0] == "f":
            corners = [_corner(number, word, len(values) // 3) for word in words[1:]]
            if len(corners) < 3:
                _refuse(number, f"a face needs three corners, got {len(corners)}")
            for second, third in pairwise(corners[1:]):
                triangles.extend((corners[0], second, third))
    points = np.frombuffer(values, dtype=np.float64).reshape(-1, 3)
    return points, np.frombuffer(triangles, dtype=np.int64).reshape(-1, 3)


#: Readers of files by suffix.
FORMATS = {".stl": _stl, ".obj": _obj}


def _corner(number: int, word: str, count: int) -> int:
    """Number of a point from 0; files count from 1, or backwards from the last one so far."""
    digits = word.split("/", 1)[0]
    sign, figures = (-1, digits[1:]) if digits.startswith("-") else (1, digits)
    if not (figures.isascii() and figures.isdecimal() and len(figures) <= 12):
        _refuse(number, f"corners must be numbers of points, got {show(word)}")
    given = sign * int(figures)
    index = given + count if given < 0 else given - 1
    if not 0 <= index < count:
        _refuse(number, f"there is no point {given} among the {count} so far")
    return index


def _coordinates(number: int, words: Sequence[str], *, exactly: bool) -> list[float]:
    """Three numbers behind the first word; in OBJ files weights and colours may follow."""
    if len(words) < 4 or (exactly and len(words) > 4):
        _refuse(number, f"{words[0]} must have three coordinates, got {show(' '.join(words[1:5]))}")
    try:
        return [number_in(word) for word in words[1:4]]
    except ValueError as error:
        _refuse(number, f"coordinates {error}")


def _lines(content: bytes) -> Iterator[tuple[int, list[str]]]:
    """Numbers and words of the lines of a text, without comments and empty ones.

    Raises:
        ValueError: there is a zero byte, it is no text.
    """
    start, number = 0, 0
    while start < len(content):
        end = content.find(b"\n", start) + 1 or len(content)
        number += 1
        line = content[start:end]
        if b"\0" in line:
            _refuse(number, "it has a zero byte, it is no text")
        words = line.decode("latin-1").split("#", 1)[0].split()
        if words:
            yield number, words
        start = end


def _refuse(number: int, reason: str) -> NoReturn:
    raise ValueError(f"line {number}: {reason}")
