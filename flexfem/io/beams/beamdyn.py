# SPDX-License-Identifier: LGPL-3.0-or-later
"""Blades from the input files of BeamDyn, the beam module of OpenFAST.

The primary file has the reference axis as key points with an initial twist, the blade file
stiffness and mass matrices (6, 6) at stations of the axis and the damping coefficients (Q. Wang, M.
A. Sprague, J. Jonkman, N. Johnson, B. Jonkman, Wind Energy 20 (2017) 1439-1462; OpenFAST's
documentation, "BeamDyn input files"). BeamDyn's z is along the blade, x and y across; its matrices
are in the order of forces along x, y, z and moments about x, y, z. Here e1 is z, e2 is x, e3 is y.
"""

from os import PathLike
from pathlib import Path
from typing import NoReturn

import numpy as np
from scipy.interpolate import CubicSpline

from flexfem import _checks
from flexfem._files import number_in, read_text
from flexfem._types import FloatArray
from flexfem.io.beams.beam_data import BeamData, arc_fractions
from flexfem.materials.section_table import SectionTable

__all__ = ["ORDER", "read_beamdyn"]

#: Place in BeamDyn's order of each strain in that of sections here.
ORDER = (2, 0, 1, 5, 3, 4)
#: Bytes of a file beyond which it must be something else.
_LARGEST = 16_000_000
#: BeamDyn's y.
_ACROSS = np.array([0.0, 1.0, 0.0])


def read_beamdyn(path: str | PathLike[str], blade: str | PathLike[str] | None = None) -> BeamData:
    """Read a blade from BeamDyn's primary file and its blade file.

    Axes are those of the blade's root: z along the blade, x downwind, y across. The initial twist
    rotates sections about z in the left-handed sense: BeamDyn changes its sign as it reads it. A
    spline goes through the key points, where BeamDyn fits a polynomial of at most the sixth degree
    to those of a member; its arc length gives the places of stations.

    Args:
        path: The primary file.
        blade: The file of sections; None for the one that the primary file names, from its folder.

    Returns:
        Axis, sections and damping.

    Raises:
        ValueError: A file is missing or unreadable, has several members, or a value is wrong; with
            the line.
    """
    file = _File(Path(path))
    if (members := file.whole("member_total")) != 1:
        file.fail(f"only blades of one member are read, got {members}")
    keys = _key_points(file)
    other = Path(path).parent / file.word("BldFile") if blade is None else Path(blade)
    points, twist = keys[:, :3], -np.deg2rad(keys[:, 3])
    try:
        places = arc_fractions(points)
    except ValueError as error:
        file.fail(str(error))
    table, damping = _sections(_File(other), CubicSpline(places, twist))
    return BeamData(points, table, damping, _ACROSS)


def _key_points(file: "_File") -> FloatArray:
    """Places and twist in degrees (k, 4) of the key points."""
    count = file.whole("kp_total")
    first = file.line_of("kp_total") + 2  # of one member: its number and that of its key points
    return file.numbers(first + 2, count, 4)[0]


def _sections(file: "_File", twist: CubicSpline) -> tuple[SectionTable, FloatArray]:
    """Sections at their stations, and the damping of each strain, s."""
    count, damped = file.whole("station_total"), file.whole("damp_type")
    if damped not in (0, 1):
        file.fail(f"damp_type must be 0 or 1, got {damped}")
    row = file.line_of("mu1")
    damping, after = file.numbers(row + 2, 1, 6)
    stations = np.empty(count)
    stiffness: list[FloatArray] = []
    inertia: list[FloatArray] = []
    after += 1  # the heading of the sections
    for i in range(count):
        station, after = file.numbers(after, 1, 1)
        stations[i] = station[0, 0]
        for matrices in (stiffness, inertia):
            matrix, after = file.numbers(after, 6, 6)
            matrices.append(0.5 * (matrix + matrix.T)[np.ix_(ORDER, ORDER)])
            _check_symmetry(file, after, matrix)
    try:
        table = SectionTable(
            stations, np.array(stiffness), np.array(inertia), twist=twist, relative=True
        )
    except ValueError as error:
        file.fail(str(error).removeprefix("SectionTable: ").removeprefix("SectionTable, "))
    return table, damped * damping[0, ORDER]


def _check_symmetry(file: "_File", after: int, matrix: FloatArray) -> None:
    """Raise for a matrix that is unsymmetric by more than the digits of files."""
    size = np.sqrt(np.abs(np.outer(np.diag(matrix), np.diag(matrix))))
    if (np.abs(matrix - matrix.T) > 1e-4 * size).any():
        file.fail("the matrix that ends here must be symmetric", after)


class _File:
    """Lines of a text file with values before their names."""

    def __init__(self, path: Path) -> None:
        self.owner = f'BeamDyn file "{path}"'
        text = read_text(f"{self.owner} cannot be read", path, _LARGEST)
        self.lines = text.splitlines()

    def fail(self, reason: str, line: int | None = None) -> NoReturn:
        """Raise for an error in the file, on a line counted from one."""
        place = "" if line is None else f", line {line}"
        raise ValueError(f"{self.owner}{place}: {reason}")

    def line_of(self, name: str) -> int:
        """Number of the line on which a name stands, from zero."""
        found = (number for number, line in enumerate(self.lines) if name in line.split())
        number = next(found, None)
        return self.fail(f"{name} is missing") if number is None else number

    def word(self, name: str) -> str:
        """Value before a name, without quotes."""
        at = self.line_of(name)
        value = self.lines[at].partition(name)[0].strip().strip("\"'").strip()
        return value or self.fail(f"{name} has no value", at + 1)

    def whole(self, name: str) -> int:
        """Whole number before a name."""
        text = self.word(name)
        if not (text.isascii() and text.isdigit() and len(text) < 10):
            self.fail(
                f"{name} must be a whole number, got {_checks.show(text)}", self.line_of(name) + 1
            )
        return int(text)

    def numbers(self, first: int, rows: int, columns: int) -> tuple[FloatArray, int]:
        """Numbers on lines that are not empty, and the line behind them; lines count from zero."""
        if rows > len(self.lines):
            self.fail(f"{rows} rows of numbers are announced, the file has {len(self.lines)} lines")
        values, at = np.empty((rows, columns)), first
        for row in range(rows):
            while at < len(self.lines) and not self.lines[at].strip():
                at += 1
            if at >= len(self.lines):
                self.fail(f"{rows - row} more rows of {columns} numbers are missing", at)
            fields = self.lines[at].replace(",", " ").split()[:columns]
            if len(fields) < columns:
                self.fail(f"there must be {columns} numbers, got {len(fields)}", at + 1)
            for column, field in enumerate(fields):
                try:
                    values[row, column] = number_in(field.replace("D", "E").replace("d", "e"))
                except ValueError as error:
                    self.fail(str(error), at + 1)
            at += 1
        return values, at
