# SPDX-License-Identifier: LGPL-3.0-or-later
"""Statements of an Abaqus input file, and its element types."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from flexfem.mesh.imported.limits import TextFiles, included

__all__ = ["FACES", "Statement", "element_kind", "statements"]

type Faces = dict[str, tuple[int, ...]]

# Families by the prefix of their names; the rest are options (reduced, hybrid, thermal, ...).
_TYPES = tuple(
    (re.compile(pattern), kind)
    for pattern, kind in (
        (r"B[23][13]|PIPE[23]1|T[23]D2|FRAME[23]D|RB[23]D2|R2D2", "line"),
        (r"B[23]2|PIPE[23]2|T[23]D3", "line3"),
        (r"STRI65|S6|M3D6|CPS6|CPE6|DS6|SFM3D6", "triangle6"),
        (r"S3|STRI3|M3D3|CPS3|CPE3|R3D3|DS3|SFM3D3", "triangle"),
        (r"S4|M3D4|CPS4|CPE4|R3D4|DS4|SFM3D4", "quad"),
        (r"S8|M3D8|CPS8|CPE8|DS8|SFM3D8", "quad8"),
        (r"S9|M3D9", "quad9"),
        (r"D?C3D10", "tetra10"),
        (r"D?C3D15(?!V)", "wedge15"),
        (r"D?C3D20", "hexahedron20"),
        (r"D?C3D4", "tetra"),
        (r"D?C3D5", "pyramid"),
        (r"D?C3D6|SC6", "wedge"),
        (r"D?C3D8|SC8", "hexahedron"),
    )
)

_TETRAHEDRON: Faces = {"S1": (0, 1, 2), "S2": (0, 3, 1), "S3": (1, 3, 2), "S4": (2, 3, 0)}
_WEDGE: Faces = {
    "S1": (0, 1, 2), "S2": (3, 5, 4), "S3": (0, 3, 4, 1), "S4": (1, 4, 5, 2), "S5": (2, 5, 3, 0),
}  # fmt: skip
_HEXAHEDRON: Faces = {
    "S1": (0, 1, 2, 3), "S2": (4, 7, 6, 5), "S3": (0, 4, 5, 1), "S4": (1, 5, 6, 2),
    "S5": (2, 6, 7, 3), "S6": (3, 7, 4, 0),
}  # fmt: skip
_TRIANGLE: Faces = {
    "SPOS": (0, 1, 2), "SNEG": (0, 2, 1), "E1": (0, 1), "E2": (1, 2), "E3": (2, 0),
}  # fmt: skip
_QUADRILATERAL: Faces = {
    "SPOS": (0, 1, 2, 3), "SNEG": (0, 3, 2, 1), "E1": (0, 1), "E2": (1, 2), "E3": (2, 3),
    "E4": (3, 0),
}  # fmt: skip

#: Corners of faces and edges by the names that Abaqus gives them.
FACES: dict[str, Faces] = {
    "triangle": _TRIANGLE,
    "triangle6": _TRIANGLE,
    "quad": _QUADRILATERAL,
    "quad8": _QUADRILATERAL,
    "quad9": _QUADRILATERAL,
    "tetra": _TETRAHEDRON,
    "tetra10": _TETRAHEDRON,
    "wedge": _WEDGE,
    "wedge15": _WEDGE,
    "hexahedron": _HEXAHEDRON,
    "hexahedron20": _HEXAHEDRON,
}


@dataclass
class Statement:
    """A keyword, its options and its data lines.

    Attributes:
        path: File it is in.
        line: Number of its line there.
        keyword: In capitals, without the star.
        options: Values by name in capitals, "" where there is none.
        rows: Line number and fields of each data line; a field after a last comma is left out.
        open: True for each data line that ends with a comma.
    """

    path: Path
    line: int
    keyword: str
    options: dict[str, str]
    rows: list[tuple[int, list[str]]] = field(default_factory=list)
    open: list[bool] = field(default_factory=list)


def element_kind(name: str) -> str:
    """Return the kind of cell that an element type is, "" for those that are no cells."""
    for pattern, kind in _TYPES:
        if pattern.match(name.upper()):
            return kind
    return ""


def statements(path: Path, files: TextFiles) -> Iterator[Statement]:
    """Yield the statements of a file and of those that it includes.

    Args:
        path: The file.
        files: Those of the mesh.

    Raises:
        ValueError: A file cannot be read, data stand before the first keyword, or files include
            each other without end.
    """
    with files.entered(path):
        for statement in _in_file(path, files):
            if statement.keyword != "INCLUDE":
                yield statement
                continue
            name = statement.options.get("INPUT", "")
            yield from statements(included(path, statement.line, "*INCLUDE", name), files)


def _in_file(path: Path, files: TextFiles) -> Iterator[Statement]:
    """Yield the statements of one file."""
    current: Statement | None = None
    head: list[str] = []
    begin = 0
    for number, raw in files.lines(path):
        text = raw.strip()
        if not text or text.startswith("**"):
            continue
        if head or text.startswith("*"):
            if not head:
                if current is not None:
                    yield current
                current, begin = None, number
            head.append(text)
            if not text.endswith(","):  # else the keyword continues in the next line
                current, head = _statement(path, begin, "".join(head)), []
        elif current is None:
            raise ValueError(
                f'mesh file "{path}", line {number}: a keyword (*...) must come first, got '
                f"{text[:40]!r}"
            )
        else:
            fields = [part.strip() for part in text.split(",")]
            current.open.append(fields[-1] == "")
            current.rows.append((number, fields[:-1] if current.open[-1] else fields))
    if current is not None:
        yield current


def _statement(path: Path, line: int, text: str) -> Statement:
    keyword, *parts = text[1:].split(",")
    options = {}
    for part in parts:
        name, _, value = part.partition("=")
        options[" ".join(name.upper().split())] = value.strip().strip('"')
    return Statement(path, line, " ".join(keyword.upper().split()), options)
