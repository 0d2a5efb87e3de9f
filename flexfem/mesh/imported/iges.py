# SPDX-License-Identifier: LGPL-3.0-or-later
"""B-spline curves of IGES files (version 5.3, fixed lines), read as data.

Taken are the entities 126 that are no curves in the parameters of a surface, their transformations
124, and the unit of length.
"""

import re
from pathlib import Path
from typing import NoReturn

import numpy as np

from flexfem._types import FloatArray
from flexfem.mesh.imported.curve_parts import CurveParts
from flexfem.mesh.imported.limits import real, whole

__all__ = ["read"]

_TEXT = re.compile(r"\s*([0-9]{1,9})H")
_CURVE, _TRANSFORMATION = 126, 124
#: Metres in the units of the file by their flags, as IGES numbers them.
_UNITS = {1: 0.0254, 2: 1e-3, 4: 0.3048, 6: 1.0, 7: 1e3, 8: 2.54e-5, 9: 1e-6, 10: 1e-2, 11: 2.54e-8}
#: Positions of the model's scale and unit flag among the global parameters.
_SCALE, _UNIT = 12, 13
#: Use of entities in the parameters of a surface.
_PLANE = "05"


def read(path: Path, text: str, scale: float | None) -> list[CurveParts]:
    """Read all curves; arguments and errors as in ``step.read``."""
    sections: dict[str, list[str]] = {"S": [], "G": [], "D": [], "P": [], "T": []}
    for number, line in enumerate(text.splitlines(), 1):
        letter = line[72:73]
        if letter not in sections:
            _fail(path, f"line {number} has no letter of an IGES section in column 73")
        sections[letter].append(line)
        if letter == "T":
            break
    if not (sections["S"] and sections["G"] and sections["T"]):
        _fail(path, "it is not a whole IGES file: a section is missing")
    separators, values = _globals(path, "".join(line[:72] for line in sections["G"]))
    factor = _unit(path, values) if scale is None else scale
    return _Reader(path, sections["D"], sections["P"], separators).curves(factor)


def _fail(path: Path, reason: str) -> NoReturn:
    raise ValueError(f'curve file "{path}": {reason}')


def _globals(path: Path, text: str) -> tuple[str, list[str]]:
    """Return both separators and the global parameters."""
    values: list[str] = []
    separators, at = ",;", 0
    while at < len(text):
        if found := _TEXT.match(text, at):
            at = found.end() + int(found[1])
            value = text[found.end() : at]
            if len(values) < 2 and value.strip():
                separators = separators[: len(values)] + value[0] + separators[len(values) + 1 :]
        else:
            end = at
            while end < len(text) and text[end] not in separators:
                end += 1
            value, at = text[at:end].strip(), end
        values.append(value)
        if at >= len(text) or text[at] == separators[1]:
            return separators, values
        if text[at] != separators[0]:
            break
        at += 1
    _fail(path, "its global section cannot be read")


def _unit(path: Path, values: list[str]) -> float:
    """Return the metres in the unit of length; the model is that of the file over its scale."""
    flag = whole(values[_UNIT]) if len(values) > _UNIT else None
    ratio = real(values[_SCALE] or "1") if len(values) > _SCALE else None
    if flag not in _UNITS or ratio != 1.0:
        _fail(path, "it does not say one unit of length in metres, give scale")
    return _UNITS[flag]


class _Reader:
    """Entities of a file by the numbers of their lines in its directory."""

    def __init__(self, path: Path, directory: list[str], data: list[str], separators: str) -> None:
        self._path, self._directory, self._data = path, directory, data
        self._separators = separators

    def curves(self, factor: float) -> list[CurveParts]:
        """Return all curves in space."""
        found = []
        for row in range(0, len(self._directory) - 1, 2):
            kind, use = self._directory[row][:8], self._directory[row][64:72].rjust(8, "0")[4:6]
            if whole(kind.strip()) == _CURVE and use != _PLANE:
                found.append(self._curve(row, factor))
        return found

    def _fail(self, row: int, reason: str) -> NoReturn:
        _fail(self._path, f"curve D{row + 1}: {reason}")

    def _values(self, row: int, kind: int) -> FloatArray:
        """Return the parameters of an entity without its kind."""
        first = whole(self._directory[row][8:16].strip())
        count = whole(self._directory[row + 1][24:32].strip())
        if first is None or count is None or not 0 < first <= first + count - 1 <= len(self._data):
            self._fail(row, "it lies outside the parameter section")
        lines = self._data[first - 1 : first - 1 + count]
        text = "".join(line[:64] for line in lines).split(self._separators[1])[0]
        values = [real(value.strip()) for value in text.split(self._separators[0])]
        if None in values or values[0] != kind:
            self._fail(row, f"its parameters are not the numbers of an entity {kind}")
        return np.array(values[1:], dtype=np.float64)

    def _curve(self, row: int, factor: float) -> CurveParts:
        values = self._values(row, _CURVE)
        if len(values) < 6 or not (np.abs(values[:2]) < len(values)).all():
            self._fail(row, "it has fewer numbers than its points and knots")
        last, degree = int(values[0]), int(values[1])
        knots, points = last + degree + 2, last + 1
        if degree < 1 or last < degree or len(values) < 6 + knots + 4 * points + 2:
            self._fail(row, "it has fewer numbers than its points and knots")
        _, t, w, x, rest = np.split(values, np.cumsum([6, knots, points, 3 * points]))
        return CurveParts(
            number=f"D{row + 1}",
            name=self._directory[row + 1][56:64].strip(),
            degree=degree,
            knots=t,
            points=factor * self._placed(row, x.reshape(-1, 3)),
            weights=w,
            ends=(float(rest[0]), float(rest[1])),
        )

    def _placed(self, row: int, points: FloatArray) -> FloatArray:
        """Return points after the transformation of their entity."""
        pointer = whole(self._directory[row][48:56].strip() or "0")
        if pointer == 0:
            return points
        at = -1 if pointer is None else abs(pointer) - 1
        if not 0 <= at < len(self._directory) - 1 or at % 2:
            self._fail(row, "its transformation is not in the file")
        if whole(self._directory[at][48:56].strip() or "0") != 0:
            self._fail(row, "its transformation has one of its own, which is not read")
        matrix = self._values(at, _TRANSFORMATION)
        if len(matrix) < 12:
            self._fail(row, "its transformation has fewer than 12 numbers")
        A = matrix[:12].reshape(3, 4)
        placed: FloatArray = points @ A[:, :3].T + A[:, 3]
        return placed
