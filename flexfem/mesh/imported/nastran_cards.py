# SPDX-License-Identifier: LGPL-3.0-or-later
"""Cards of a Nastran bulk data file, in free, small and large fields."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from flexfem import _checks
from flexfem.mesh.imported.limits import TextFiles, included, real, whole

__all__ = ["Card", "cards"]


@dataclass
class Card:
    """A bulk data entry, with its continuations.

    Attributes:
        path: File it is in.
        line: Number of its first line there.
        name: In capitals, without a star.
        fields: After the name, "" where blank.
    """

    path: Path
    line: int
    name: str
    fields: list[str]

    def field(self, number: int) -> str:
        """Field by its number in the manuals, the name being the first."""
        return self.fields[number - 2] if number - 2 < len(self.fields) else ""

    def fail(self, reason: str) -> NoReturn:
        """Raise for an error on the card.

        Raises:
            ValueError: Always.
        """
        raise ValueError(f'mesh file "{self.path}", line {self.line}: {self.name}: {reason}')

    def integer(self, number: int) -> int:
        """Return the number of something in a field.

        Raises:
            ValueError: It is none.
        """
        text = self.field(number)
        value = whole(text)
        if value is None or value < 0:
            self.fail(f"field {number} must be the number of something, got {_checks.show(text)}")
        return value

    def real(self, number: int) -> float:
        """Return the value of a field, 0 where it is blank.

        Raises:
            ValueError: It is no number.
        """
        text = self.field(number)
        if not text:
            return 0.0
        value = real(text, bare_exponent=True)
        if value is None:
            self.fail(f"field {number} must be a number, got {_checks.show(text)}")
        return value


def cards(path: Path, files: TextFiles) -> Iterator[Card]:
    """Yield the cards of a file and of those that it includes, and its case control sets.

    Those come as cards of the name "SET" with one field, the text after "SET".

    Args:
        path: The file.
        files: Those of the mesh.

    Raises:
        ValueError: A file cannot be read, or files include each other without end.
    """
    with files.entered(path):
        yield from _cards(path, files)


def _cards(path: Path, files: TextFiles) -> Iterator[Card]:
    """Yield the cards of one file, and of those that it includes where it does so."""
    lines = list(_lines(path, files))
    begin = next((i for i, (_, text) in enumerate(lines) if _is_begin(text)), None)
    if begin is not None:
        yield from _case_sets(path, lines[:begin])
    current: Card | None = None
    for number, text in lines[0 if begin is None else begin + 1 :]:
        word = (text.split(",", 1)[0].split(None, 1) or [""])[0].upper()
        if word == "ENDDATA":
            break
        if word == "INCLUDE":
            if current is not None:
                yield current
                current = None
            yield from cards(_included(path, number, text), files)
            continue
        name, fields = _fields(text)
        if name and name[0] not in "+*":
            if current is not None:
                yield current
            current = Card(path, number, name.rstrip("*").upper(), fields)
        elif current is not None:
            current.fields += fields
    if current is not None:
        yield current


def _lines(path: Path, files: TextFiles) -> Iterator[tuple[int, str]]:
    """Yield numbers and texts of the lines that are not empty, without comments."""
    for number, raw in files.lines(path):
        text = raw.split("$")[0].rstrip().expandtabs(8)
        if text:
            yield number, text


def _is_begin(text: str) -> bool:
    return text.upper().split()[:2] == ["BEGIN", "BULK"]


def _included(path: Path, number: int, text: str) -> Path:
    name = text.strip()[len("INCLUDE") :].strip().strip("'\"")
    return included(path, number, "INCLUDE", name)


def _case_sets(path: Path, lines: list[tuple[int, str]]) -> Iterator[Card]:
    """Yield the SET commands of the case control."""
    rows = iter(lines)
    for number, first in rows:
        parts = [first.strip()]
        if not parts[0].upper().startswith("SET "):
            continue
        while parts[-1].endswith(",") and (following := next(rows, None)) is not None:
            parts.append(following[1].strip())
        yield Card(path, number, "SET", ["".join(parts)[4:]])


def _fields(text: str) -> tuple[str, list[str]]:
    """Return name and fields of a line, as many as a line of its format has."""
    if "," in text:
        name, *rest = (part.strip() for part in text.split(","))
        width = 4 if name.endswith("*") else 8
        return name, (rest + [""] * width)[:width]
    name = text[:8].strip()
    size, width = (16, 4) if "*" in name else (8, 8)
    return name, [text[8 + size * i : 8 + size * (i + 1)].strip() for i in range(width)]
