# SPDX-License-Identifier: LGPL-3.0-or-later
"""CSV files of users: columns with units, fields with their places in messages."""

import csv
from collections.abc import Callable, Mapping
from math import pi
from pathlib import Path
from typing import NoReturn

from flexfem import _checks
from flexfem._files import number_in, read_text

__all__ = ["UNITS", "CsvTable", "Row"]

#: Factors of the units that may stand in brackets behind the name of a column, by its SI unit.
UNITS: dict[str, dict[str, float]] = {
    "": {},
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3},
    "m^2": {"m^2": 1.0, "cm^2": 1e-4, "mm^2": 1e-6},
    "m^4": {"m^4": 1.0, "cm^4": 1e-8, "mm^4": 1e-12},
    "Pa": {"Pa": 1.0, "MPa": 1e6, "N/mm^2": 1e6, "GPa": 1e9},
    "N": {"N": 1.0, "kN": 1e3, "MN": 1e6},
    "N m": {"N m": 1.0, "kN m": 1e3, "MN m": 1e6},
    "N m^2": {"N m^2": 1.0, "kN m^2": 1e3, "MN m^2": 1e6, "N mm^2": 1e-6},
    "kg/m": {"kg/m": 1.0, "t/m": 1e3, "g/mm": 1.0},
    "kg": {"kg": 1.0},
    "kg m": {"kg m": 1.0},
    "rad": {"rad": 1.0, "deg": pi / 180.0},
    "kg/m^3": {"kg/m^3": 1.0, "g/cm^3": 1e3, "t/mm^3": 1e12},
}

#: Bytes of a table, and characters of a line, beyond which it must be something else.
_LARGEST, _LONGEST = 16_000_000, 10_000


class CsvTable:
    """Rows of a CSV file with known columns, commas or semicolons between fields.

    Attributes:
        owner: The table in messages.
        line: Number of the line with the names of columns.
        columns: These names.
        factors: Factor of each column's numbers, for SI units.
        rows: Number and fields of each line behind it.
    """

    def __init__(self, path: Path, known: Mapping[str, str]) -> None:
        """Read the file.

        Args:
            path: The file.
            known: SI unit of each column that may be there, empty for words and plain numbers.

        Raises:
            ValueError: It cannot be read, or a column is unknown or in an unknown unit.
        """
        self.owner = f'table "{path}"'
        text = read_text(f"{self.owner} cannot be read", path, _LARGEST)
        lines = [
            (number, line)
            for number, line in enumerate(text.splitlines(), 1)
            if line.strip(" ,;\t") and not line.lstrip().startswith("#")
        ]
        if not lines:
            raise ValueError(f"{self.owner}: no line with the names of columns")
        for number, line in lines:
            if len(line) > _LONGEST:
                raise ValueError(f"{self.owner}, line {number}: more than {_LONGEST} characters")
        self.line, head = lines[0]
        self.separator = ";" if ";" in head else ","
        self.columns: list[str] = []
        self.factors: dict[str, float] = {}
        for field in self._split(head):
            self._add_column(field, known)
        self.rows = [(number, self._split(line)) for number, line in lines[1:]]
        if not self.rows:
            raise ValueError(f"{self.owner}: no rows")

    def need(self, column: str) -> None:
        """Raise when a column is not there."""
        if column not in self.columns:
            raise ValueError(
                f'{self.owner}, line {self.line}: column "{column}" is missing; there are '
                f"{', '.join(self.columns)}"
            )

    def things[Thing](self, make: "Callable[[Row], Thing]") -> dict[str, Thing]:
        """Return the object of each row by its name."""
        found: dict[str, Thing] = {}
        for line, fields in self.rows:
            row = Row(f"{self.owner}, line {line}", self, fields)
            name = row.text("name")
            if name in found:
                row.fail(f'the name "{name}" occurs twice')
            row.owner += f' "{name}"'
            try:
                found[name] = make(row)
            except _RowError:
                raise
            except ValueError as error:
                row.fail(str(error).removeprefix("Section: ").removeprefix("Material: "))
        return found

    def _split(self, line: str) -> list[str]:
        fields = next(csv.reader([line], delimiter=self.separator, skipinitialspace=True))
        return [field.strip() for field in fields]

    def _add_column(self, field: str, known: Mapping[str, str]) -> None:
        name, bracket, unit = field.partition("[")
        name, unit = name.strip(), unit.strip().removesuffix("]").strip()
        owner = f"{self.owner}, line {self.line}"
        if name not in known:
            raise ValueError(
                f"{owner}: column {_checks.show(name)} is not known; known are "
                f"{', '.join(_listed(known))}"
            )
        if name in self.columns:
            raise ValueError(f'{owner}: column "{name}" occurs twice')
        units = UNITS[known[name]]
        if bracket and unit not in units:
            raise ValueError(
                f'{owner}: column "{name}" is in {unit!r}, it may be in '
                f"{', '.join(units) or 'no unit'}"
            )
        self.columns.append(name)
        self.factors[name] = units[unit] if bracket else 1.0


def _listed(known: Mapping[str, str]) -> list[str]:
    """Names of columns, sorted, ``name`` first."""
    return sorted(known, key=lambda column: (column != "name", column))


class _RowError(ValueError):
    """Raised with the place in the table."""


class Row:
    """Fields of one line.

    Attributes:
        owner: Table and line in messages.
        table: The table.
        fields: By their columns.
    """

    def __init__(self, owner: str, table: CsvTable, fields: list[str]) -> None:
        """Take the fields of a line.

        Raises:
            ValueError: There are more fields than columns.
        """
        self.owner, self.table = owner, table
        if len(fields) > len(table.columns) and any(fields[len(table.columns) :]):
            self.fail(f"{len(fields)} fields for {len(table.columns)} columns")
        self.fields = dict(zip(table.columns, fields, strict=False))

    def fail(self, reason: str) -> NoReturn:
        """Raise for an error in the line."""
        raise _RowError(f"{self.owner}: {reason}")

    def text(self, column: str) -> str:
        """Return a field that must not be empty."""
        value = self.fields.get(column, "")
        if not value:
            self.fail(f"{column} is missing")
        return value

    def optional(self, column: str) -> float | None:
        """Return a number in SI units, None for an empty field or no such column."""
        return self.number(column) if self.fields.get(column) else None

    def number(self, column: str) -> float:
        """Return a number in SI units."""
        text = self.text(column)
        try:
            value = number_in(text)
        except ValueError as error:
            self.fail(f"{column} {error}")
        return value * self.table.factors[column]
