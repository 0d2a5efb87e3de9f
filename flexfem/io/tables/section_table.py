# SPDX-License-Identifier: LGPL-3.0-or-later
"""Materials and sections from tables (CSV files with one of them in a row)."""

from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any

from flexfem import _checks
from flexfem.io.tables.csv_table import CsvTable, Row
from flexfem.materials.material import Material
from flexfem.materials.section import Section

__all__ = ["read_materials", "read_sections"]

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
    table = CsvTable(Path(path), {"name": "", **{name: _COLUMNS[name] for name in _MATERIAL}})
    for column in ("name", *_MATERIAL):
        table.need(column)
    return table.things(_material)


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
    table = CsvTable(Path(path), {"name": "", "kind": "", "material": "", **_COLUMNS})
    table.need("name")
    table.need("kind")
    return table.things(lambda row: _section(row, known))


def _section(row: Row, materials: Mapping[str, Material]) -> Section:
    kind = row.text("kind")
    if kind not in _DIMENSIONS:
        row.fail(f"kind must be one of {', '.join(_DIMENSIONS)}, got {_checks.show(kind)}")
    name = row.fields.get("material", "")
    if name and name not in materials:
        known = ", ".join(materials) or "none"
        row.fail(f'material "{name}" is not known; there are {_checks.show(known, 200)}')
    material = materials[name] if name else _material(row)
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


def _material(row: Row) -> Material:
    """Return the material of the row's constants."""
    return Material(**{field: row.number(column) for column, field in _MATERIAL.items()})
