# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sections along a beam from a table, a CSV file with a station in a row."""

from itertools import combinations_with_replacement
from os import PathLike
from pathlib import Path

import numpy as np

from flexfem._types import FloatArray
from flexfem.io.tables.csv_table import CsvTable, Row
from flexfem.materials.section_matrices import about_centres, inertia_about_axis
from flexfem.materials.section_table import SectionTable

__all__ = ["read_section_table"]

_PAIRS = [(i, j) for i, j in combinations_with_replacement(range(6), 2)]
#: SI units of columns of stiffnesses, of inertia, and of entries of whole matrices.
_STIFFNESS = {
    "EA": "N", "GA2": "N", "GA3": "N", "GJ": "N m^2", "EI2": "N m^2", "EI3": "N m^2",
    "EI23": "N m^2", "tension_y": "m", "tension_z": "m", "shear_y": "m", "shear_z": "m",
}  # fmt: skip
_INERTIA = {
    "mass": "kg/m", "mass_y": "m", "mass_z": "m", "J2": "kg m", "J3": "kg m", "J23": "kg m",
}  # fmt: skip
_FORCES, _MASSES = ("N", "N m", "N m^2"), ("kg/m", "kg", "kg m")
_K = {f"K{i + 1}{j + 1}": _FORCES[(i > 2) + (j > 2)] for i, j in _PAIRS}
_M = {f"M{i + 1}{j + 1}": _MASSES[(i > 2) + (j > 2)] for i, j in _PAIRS}
_PLACES = {"s": "m", "eta": ""}
_COLUMNS = {**_PLACES, "twist": "rad", **_STIFFNESS, **_INERTIA, **_K, **_M}
#: Columns of which nothing can be left out.
_NEEDED = {
    "EA": ("EA", "GA2", "GA3", "GJ", "EI2", "EI3"), "mass": ("mass", "J2", "J3"),
    "K11": tuple(f"K{i}{i}" for i in range(1, 7)), "M11": tuple(f"M{i}{i}" for i in range(1, 7)),
}  # fmt: skip


def read_section_table(path: str | PathLike[str]) -> SectionTable:
    """Read the sections along a beam from a table.

    Args:
        path: CSV file, commas or semicolons between fields, "#" before comments, a station in each
            row. Its columns are the place, ``s`` (arc length, m) or ``eta`` (fraction of the
            length); the ``twist`` (rad) or none; the stiffness; and the inertia; in SI units unless
            another one stands in brackets (``EA [kN]``, ``twist [deg]``).

            The stiffness is either ``EA``, ``GA2, GA3`` (N), ``GJ``, ``EI2`` (bending about e2)
            and ``EI3`` (N m^2) with the product ``EI23`` or none, of normal forces through the
            tension centre ``tension_y, tension_z`` and of shear through the shear centre
            ``shear_y, shear_z`` (m); or the upper half ``K11, K12, ..., K66`` of the matrix in the
            order of :class:`Section`.

            The inertia is either ``mass`` (kg/m) at ``mass_y, mass_z`` (m) with ``J2, J3`` (and
            ``J23``) about the mass centre (kg m: the integrals of z^2, y^2 and y z over the mass);
            or the upper half ``M11, ..., M66``. What may be left out is zero.

    Returns:
        The table.

    Raises:
        ValueError: The file is missing, a column is unknown, missing or in an unknown unit, or a
            value is wrong or missing, with the line; or the table is refused by
            :class:`SectionTable`.
    """
    table = CsvTable(Path(path), _COLUMNS)
    place = _one_of(table, "s", "eta")
    engineering, inertia = _one_of(table, "EA", "K11"), _one_of(table, "mass", "M11")
    for column in (*_NEEDED[engineering], *_NEEDED[inertia]):
        table.need(column)
    _check_unused(table, engineering, inertia)
    rows = [Row(f"{table.owner}, line {line}", table, fields) for line, fields in table.rows]
    try:
        return SectionTable(
            [row.number(place) for row in rows],
            np.array(
                [_stiffness(row) if engineering == "EA" else _matrix(row, "K") for row in rows]
            ),
            np.array([_inertia(row) if inertia == "mass" else _matrix(row, "M") for row in rows]),
            twist=[row.optional("twist") or 0.0 for row in rows],
            relative=place == "eta",
        )
    except ValueError as error:
        text = str(error)
        if text.startswith(table.owner):
            raise
        reason = text.removeprefix("SectionTable: ").removeprefix("SectionTable, ")
        raise ValueError(f"{table.owner}: {reason}") from None


def _one_of(table: CsvTable, a: str, b: str) -> str:
    """The one of two columns that is there; the first has to be where both are missing."""
    if a in table.columns and b in table.columns:
        raise ValueError(
            f'{table.owner}, line {table.line}: columns "{a}" and "{b}" exclude each other'
        )
    if b in table.columns:
        return b
    table.need(a)
    return a


def _check_unused(table: CsvTable, engineering: str, inertia: str) -> None:
    """Raise for columns of the other kind of stiffness or inertia."""
    others = {
        **(_K if engineering == "EA" else _STIFFNESS),
        **(_M if inertia == "mass" else _INERTIA),
    }
    for column in table.columns:
        if column in others:
            kind = engineering if column in _K or column in _STIFFNESS else inertia
            raise ValueError(
                f'{table.owner}, line {table.line}: column "{column}" does not go with "{kind}"'
            )


def _zero(row: Row, *columns: str) -> list[float]:
    """Numbers of columns, zero where they are left out."""
    return [row.optional(column) or 0.0 for column in columns]


def _stiffness(row: Row) -> FloatArray:
    """Stiffness (6, 6) from the engineering constants."""
    D = np.diag([row.number(column) for column in _NEEDED["EA"]])
    D[4, 5] = D[5, 4] = -_zero(row, "EI23")[0]
    tension = np.array(_zero(row, "tension_y", "tension_z"))
    return about_centres(D, tension, np.array(_zero(row, "shear_y", "shear_z")))


def _inertia(row: Row) -> FloatArray:
    """Inertia (6, 6) from mass, mass centre and rotary inertia about it."""
    mass, J2, J3 = (row.number(column) for column in _NEEDED["mass"])
    rotary = np.diag([J2 + J3, J2, J3])
    rotary[1, 2] = rotary[2, 1] = -_zero(row, "J23")[0]
    return inertia_about_axis(mass, np.array(_zero(row, "mass_y", "mass_z")), rotary)


def _matrix(row: Row, letter: str) -> FloatArray:
    """Symmetric matrix (6, 6) from its upper half."""
    matrix = np.zeros((6, 6))
    for i, j in _PAIRS:
        matrix[i, j] = matrix[j, i] = row.optional(f"{letter}{i + 1}{j + 1}") or 0.0
    return matrix
