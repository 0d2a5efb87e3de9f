# SPDX-License-Identifier: LGPL-3.0-or-later
"""Materials and sections from tables (CSV files with one of them in a row)."""

import csv
from collections.abc import Callable, Mapping
from os import PathLike
from pathlib import Path
from typing import Any, NoReturn

from flexfem import _checks
from flexfem._files import number_in, read_text
from flexfem.materials.material import Material
from flexfem.materials.section import Section

__all__ = ["read_materials", "read_sections"]

#: Factors of the units that may stand in brackets behind the name of a column, by its SI unit.
_UNITS: dict[str, dict[str, float]] = {
    "": {},
    "m": {"m": 1.0, "cm": 1e-2, "mm": 1e-3},
    "m^2": {"m^2": 1.0, "cm^2": 1e-4, "mm^2": 1e-6},
    "m^4": {"m^4": 1.0, "cm^4": 1e-8, "mm^4": 1e-12},
    "Pa": {"Pa": 1.0, "MPa": 1e6, "N/mm^2": 1e6, "GPa": 1e9},
    "kg/m^3": {"kg/m^3": 1.0, "g/cm^3": 1e3, "t/mm^3": 1e12},
}

#: Bytes of a table, and characters of a line, beyond which it must be something else.
_LARGEST, _LONGEST = 16_000_000, 10_000
_MATERIAL = {"E": "youngs_modulus", "nu": "poisson_ratio", "rho": "density"}
# SI unit of each column of numbers
_COLUMNS = {
    "E": "Pa", "nu": "", "rho": "kg/m^3",
    "width": "m", "height": "m", "wall": "m", "diameter": "m", "inner_diameter": "m",
    "outer_diameter": "m", "web": "m", "flange": "m", "thickness": "m", "fillet": "m",
    "A": "m^2", "I2": "m^4", "I3": "m^4", "J": "m^4", "k2": "", "k3": "",
    "mass_y": "m", "mass_z": "m", "shear_y": "m", "shear_z": "m",
}  # fmt: skip
_DIMENSIONS: dict[str, tuple[str, ...]] = {
    "rectangle": ("width", "height"),
    "hollow_rectangle": ("width", "height", "wall"),
    "circle": ("diameter",),
    "tube": ("inner_diameter", "outer_diameter"),
    "i_section": ("width", "height", "web", "flange"),
    "channel": ("width", "height", "web", "flange"),
    "angle": ("width", "height", "thickness"),
    "t_section": ("width", "height", "web", "flange"),
    "constants": ("A", "I2", "I3", "J", "k2", "k3"),
}
#: Kinds that may have a fillet, and whose shear centre is known.
_PROFILES = ("i_section", "channel", "angle", "t_section")
_CENTRES = ("mass_y", "mass_z", "shear_y", "shear_z")


def read_materials(path: str | PathLike[str]) -> dict[str, Material]:
    """Read materials from a table.

    Args:
        path: CSV file, commas or semicolons between fields, "#" before comments. Its columns are
            ``name``, ``E`` (Pa), ``nu`` and ``rho`` (kg/m^3); another unit stands in brackets,
            ``E [GPa]``.

    Returns:
        The materials by name, in the order of the file.

    Raises:
        ValueError: The file is missing, a column is unknown, missing or in an unknown unit, or a
            value is wrong or missing; with the line.
    """
    table = _Table(Path(path), {"name", *_MATERIAL})
    for column in _MATERIAL:
        table.need(column)
    return table.things(lambda row: row.material())


def read_sections(
    path: str | PathLike[str], materials: Mapping[str, Material] | None = None
) -> dict[str, Section]:
    """Read sections of beams from a table.

    Args:
        path: CSV file as in :func:`read_materials`. Its columns are ``name``, ``kind``, either
            ``material`` (a name in `materials`) or ``E``, ``nu`` and ``rho``, and those that the
            kinds need, all in SI units unless another one stands in brackets (``width [mm]``):
            "rectangle" ``width, height``; "hollow_rectangle" ``width, height, wall``; "circle"
            ``diameter``; "tube" ``inner_diameter, outer_diameter``; "i_section", "channel" and
            "t_section" ``width, height, web, flange``, "angle" ``width, height, thickness``, these
            four with a ``fillet`` or none; "constants" the area ``A``, the second moments ``I2``
            (integral of z^2, bending about e2) and ``I3`` (of y^2, about e3), the torsion constant
            ``J`` and the shear factors ``k2, k3``. The latter two may be given for the other kinds
            as well; the mass centre ``mass_y, mass_z`` and the shear centre ``shear_y, shear_z``
            for all. Fields that do not apply stay empty.
        materials: Materials by name, as from :func:`read_materials`.

    Returns:
        The sections by name, in the order of the file.

    Raises:
        TypeError: The materials are no mapping of names to materials.
        ValueError: The file is missing, a column is unknown, missing or in an unknown unit, or a
            value is wrong, missing or not used by the kind; with the line.
    """
    known = {} if materials is None else materials
    _checks.instance("read_sections", "materials", known, Mapping)
    for name, material in known.items():
        _checks.instance("read_sections", f'material "{name}"', material, Material)
    table = _Table(Path(path), {"name", "kind", "material", *_COLUMNS})
    table.need("kind")
    return table.things(lambda row: _section(row, known))


def _section(row: "_Row", materials: Mapping[str, Material]) -> Section:
    kind = row.text("kind")
    if kind not in _DIMENSIONS:
        row.fail(f"kind must be one of {', '.join(_DIMENSIONS)}, got {_checks.show(kind)}")
    name = row.fields.get("material", "")
    if name and name not in materials:
        known = ", ".join(materials) or "none"
        row.fail(f'material "{name}" is not known; there are {_checks.show(known, 200)}')
    material = materials[name] if name else row.material()
    needed = _DIMENSIONS[kind]
    profile = ("fillet",) if kind in _PROFILES else ()
    allowed = {*needed, *profile, "k2", "k3", *_CENTRES, *(() if name else _MATERIAL)}
    for column in _COLUMNS:
        if row.fields.get(column) and column not in allowed:
            article = "an" if kind[0] in "ai" else "a"
            why = f"the material is {name}" if column in _MATERIAL else f"{article} {kind} has none"
            row.fail(f"{column} must be empty, {why}, got {_checks.show(row.fields[column])}")
    values = {column: row.number(column) for column in needed}
    if bool(row.fields.get("k2")) != bool(row.fields.get("k3")):
        row.fail("k2 and k3 must both be given, or neither")
    factors = (row.number("k2"), row.number("k3")) if row.fields.get("k2") else None
    mass_y, mass_z, shear_y, shear_z = (row.optional(column) or 0.0 for column in _CENTRES)
    more: dict[str, Any] = {"mass_centre": (mass_y, mass_z), "shear_factor": factors}
    # profiles have a shear centre
    if not profile or row.fields.get("shear_y") or row.fields.get("shear_z"):
        more["shear_centre"] = (shear_y, shear_z)
    if profile:
        more["fillet"] = row.optional("fillet") or 0.0
    if kind == "constants":
        assert factors is not None
        return Section.of_constants(
            values["A"], values["I2"], values["I3"], values["J"], material, **more
        )
    section: Section = getattr(Section, kind)(*values.values(), material, **more)
    return section


class _Table:
    """Rows of a CSV file with known columns."""

    def __init__(self, path: Path, known: set[str]) -> None:
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
        self.need("name")
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

    def things[Thing](self, make: "Callable[[_Row], Thing]") -> dict[str, Thing]:
        """Return the object of each row by its name."""
        found: dict[str, Thing] = {}
        for line, fields in self.rows:
            row = _Row(f"{self.owner}, line {line}", self, fields)
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

    def _add_column(self, field: str, known: set[str]) -> None:
        name, bracket, unit = field.partition("[")
        name, unit = name.strip(), unit.strip().removesuffix("]").strip()
        owner = f"{self.owner}, line {self.line}"
        if name not in known:
            raise ValueError(
                f"{owner}: column {_checks.show(name)} is not known; known are "
                f"{', '.join(['name', *sorted(known - {'name'})])}"
            )
        if name in self.columns:
            raise ValueError(f'{owner}: column "{name}" occurs twice')
        units = _UNITS[_COLUMNS.get(name, "")]
        if bracket and unit not in units:
            raise ValueError(
                f'{owner}: column "{name}" is in {unit!r}, it may be in '
                f"{', '.join(units) or 'no unit'}"
            )
        self.columns.append(name)
        self.factors[name] = units[unit] if bracket else 1.0


class _RowError(ValueError):
    """Raised with the place in the table."""


class _Row:
    """Fields of one line."""

    def __init__(self, owner: str, table: _Table, fields: list[str]) -> None:
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

    def material(self) -> Material:
        """Return the material of the row's constants."""
        return Material(**{field: self.number(column) for column, field in _MATERIAL.items()})
