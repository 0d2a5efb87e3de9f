# SPDX-License-Identifier: LGPL-3.0-or-later
"""Blades and other beams from windIO files, the YAML format of IEA Wind.

Versions 1 (``elastic_properties_mb``, ``six_x_six``) and 2 (``elastic_properties``) are read, see
the schemas of windIO (IEA Wind Task 55). Axes and the order of matrices are those of BeamDyn: z
along the blade, x downwind, y across; forces along x, y, z, then moments. Twist is in radians in
version 1, in degrees in version 2, and positive about -z.

Only plain data is read: a file makes no objects, and neither merge keys nor nested aliases let a
small file grow large.
"""

from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator

from flexfem import _checks
from flexfem._files import read_text
from flexfem._packages import missing
from flexfem._types import FloatArray
from flexfem.io.beams.beam_data import BeamData, arc_fractions
from flexfem.io.beams.beamdyn import ORDER
from flexfem.materials.section_table import SectionTable

__all__ = ["read_windio"]

#: Bytes of a file beyond which it must be something else.
_LARGEST = 16_000_000
_ACROSS = np.array([0.0, 1.0, 0.0])
_UPPER = np.triu_indices(6)


def read_windio(path: str | PathLike[str], component: str = "blade") -> BeamData:
    """Read a beam from a windIO file with 6x6 matrices.

    Axes are those of the component: z along a blade, x downwind, y across. Places are fractions of
    the arc length. A spline goes through the points of the reference axis.

    Args:
        path: YAML file of version 1 or 2. Nothing in it is executed.
        component: Name of the component in the file.

    Returns:
        Axis, sections and damping; version 1 has none.

    Raises:
        InstallationError: PyYAML is not installed.
        ValueError: The file is missing or unreadable, or something in it is missing or wrong; with
            its place in the file.
    """
    file = _Part(f'windIO file "{path}"', "", _load(Path(path)))
    part = file["components"][component]
    if "elastic_properties_mb" in part:
        six = part["elastic_properties_mb"]["six_x_six"]
        shape = part.get("outer_shape_bem")
        axis = six.get("reference_axis") or (shape or part)["reference_axis"]
        twist = six.get("twist") or (shape and shape.get("twist"))
        matrices = {name: _rows(six[name]) for name in ("stiff_matrix", "inertia_matrix")}
        damping, unit = np.zeros(6), 1.0
    else:
        inner = part.get("structure") or part
        elastic = inner["elastic_properties"]
        axis, shape = part["reference_axis"], part.get("outer_shape")
        twist = shape and shape.get("twist")
        matrices = {
            "stiffness_matrix": _entries(elastic["stiffness_matrix"]),
            "inertia_matrix": _inertias(elastic["inertia_matrix"]),
        }
        damping, unit = _damping(elastic), float(np.pi / 180.0)
    points = _axis(axis)
    return BeamData(points, _table(file, points, matrices, twist, unit), damping, _ACROSS)


def _table(
    file: "_Part", points: FloatArray, matrices: Mapping[str, tuple[FloatArray, FloatArray]],
    twist: "_Part | None", unit: float,
) -> SectionTable:  # fmt: skip
    """Sections on all grids together."""
    stations = np.unique(np.concatenate([grid for grid, _ in matrices.values()]))
    turn: Any = None
    if twist is not None:
        grid, angles = twist.distributed()
        angles = -unit * angles
        turn = CubicSpline(grid, angles) if len(grid) > 3 else PchipInterpolator(grid, angles)
    found = [_at(stations, *one)[:, ORDER][:, :, ORDER] for one in matrices.values()]
    try:
        return SectionTable(stations, found[0], found[1], twist=turn, relative=True)
    except ValueError as error:
        file.fail(str(error).removeprefix("SectionTable: ").removeprefix("SectionTable, "))


def _at(stations: FloatArray, grid: FloatArray, values: FloatArray) -> FloatArray:
    """Matrices (k, 6, 6) at stations (k,), linear between the grid's (n,)."""
    flat = values.reshape(len(grid), -1)
    columns = [np.interp(stations, grid, column) for column in flat.T]
    return np.stack(columns, axis=1).reshape(-1, 6, 6)


def _axis(part: "_Part") -> FloatArray:
    """Points (k, 3) of a reference axis."""
    curves = [part[name].distributed() for name in "xyz"]
    grid = np.unique(np.concatenate([grid for grid, _ in curves]))
    columns = [
        PchipInterpolator(own, values)(grid) if len(own) > 2 else np.interp(grid, own, values)
        for own, values in curves
    ]
    points = np.stack(columns, axis=1)
    try:
        arc_fractions(points)
    except ValueError as error:
        part.fail(str(error))
    return points


def _rows(part: "_Part") -> tuple[FloatArray, FloatArray]:
    """Grid (n,) and matrices (n, 6, 6) of rows of 21 entries."""
    grid, values = part["grid"].numbers(), part["values"]
    rows = values.matrix(len(grid), 21)
    return _grid(part, grid), _symmetric(rows)


def _entries(part: "_Part") -> tuple[FloatArray, FloatArray]:
    """Grid (n,) and matrices (n, 6, 6) of columns K11 to K66; those left out are zero."""
    grid = _grid(part, part["grid"].numbers())
    names = [f"K{i + 1}{j + 1}" for i, j in zip(*_UPPER, strict=True)]
    return grid, _symmetric(np.stack([part.column(name, len(grid)) for name in names], axis=1))


def _inertias(part: "_Part") -> tuple[FloatArray, FloatArray]:
    """Grid (n,) and inertias (n, 6, 6) about the reference axis, in the order of the file."""
    grid = _grid(part, part["grid"].numbers())
    n = len(grid)
    mass, x, y = (part.column(name, n) for name in ("mass", "cm_x", "cm_y"))
    about_x, about_y, polar, product = (
        part.column(name, n) for name in ("i_edge", "i_flap", "i_plr", "i_cp")
    )
    M = np.zeros((n, 6, 6))
    for i in range(3):
        M[:, i, i] = mass
    M[:, 0, 5], M[:, 1, 5], M[:, 2, 3], M[:, 2, 4] = -mass * y, mass * x, mass * y, -mass * x
    M[:, 3, 4] = -product
    upper = M[:, *_UPPER]
    M = _symmetric(upper)
    M[:, 3, 3], M[:, 4, 4], M[:, 5, 5] = about_x, about_y, polar
    return grid, M


def _damping(elastic: "_Part") -> FloatArray:
    """Damping of each strain (6,), s."""
    part = elastic.get("structural_damping")
    mu = part and part.get("mu")
    if mu is None:
        return np.zeros(6)
    values = mu.numbers()
    if len(values) != 6 or (values < 0.0).any():
        mu.fail(f"must be six numbers that are not negative, got {_checks.show(values.tolist())}")
    return values[list(ORDER)]


def _grid(part: "_Part", grid: FloatArray) -> FloatArray:
    """Checked fractions of the length."""
    if len(grid) < 2 or grid[0] != 0.0 or grid[-1] != 1.0 or not (np.diff(grid) > 0.0).all():
        part.fail(f"grid must increase from 0 to 1, got {_checks.show(grid.tolist())}")
    return grid


def _symmetric(upper: FloatArray) -> FloatArray:
    """Matrices (n, 6, 6) of upper triangles (n, 21)."""
    found = np.zeros((len(upper), 6, 6))
    found[:, *_UPPER] = upper
    return found + np.swapaxes(np.triu(found, 1), 1, 2)


class _Part:
    """A value in a file and its place there."""

    def __init__(self, owner: str, place: str, value: Any) -> None:
        self.owner, self.place, self.value = owner, place, value

    def fail(self, reason: str) -> NoReturn:
        """Raise for an error here."""
        raise ValueError(f"{self.owner}{', ' if self.place else ''}{self.place}: {reason}")

    def __contains__(self, name: str) -> bool:
        return isinstance(self.value, Mapping) and name in self.value

    def get(self, name: str) -> "_Part | None":
        """Part of a name, None without one."""
        if name not in self:
            return None
        place = f"{self.place}.{name}" if self.place else name
        return _Part(self.owner, place, self.value[name])

    def __getitem__(self, name: str) -> "_Part":
        found = self.get(name)
        if found is None:
            kind = "is missing" if isinstance(self.value, Mapping) else "is no mapping"
            self.fail(f'"{name}" is missing' if kind == "is missing" else f"{kind} with {name}")
        return found

    def numbers(self) -> FloatArray:
        """Numbers (n,) of a list."""
        if not isinstance(self.value, Sequence) or isinstance(self.value, str):
            self.fail(f"must be a list of numbers, got {_checks.show(self.value)}")
        try:
            return np.array([_number(one) for one in self.value])
        except ValueError as error:
            self.fail(str(error))

    def matrix(self, rows: int, columns: int) -> FloatArray:
        """Numbers (rows, columns) of a list of lists."""
        if not isinstance(self.value, Sequence) or len(self.value) != rows:
            self.fail(f"must be {rows} lists of {columns} numbers")
        found = [_Part(self.owner, f"{self.place}[{i}]", row) for i, row in enumerate(self.value)]
        for row in found:
            if len(row.numbers()) != columns:
                row.fail(f"must hold {columns} numbers, got {len(row.numbers())}")
        return np.array([row.numbers() for row in found])

    def column(self, name: str, count: int) -> FloatArray:
        """Numbers (count,) of a name, zeros without them."""
        part = self.get(name)
        if part is None:
            return np.zeros(count)
        values = part.numbers()
        if len(values) != count:
            part.fail(f"must have {count} numbers as the grid, got {len(values)}")
        return values

    def distributed(self) -> tuple[FloatArray, FloatArray]:
        """Grid and values (n,)."""
        grid = _grid(self, self["grid"].numbers())
        return grid, self.column("values", len(grid))


def _number(value: Any) -> float:
    """Return a finite number; YAML takes 1e5 for a word."""
    try:
        found = np.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        found = np.nan
    if not abs(found) < 1e60:
        raise ValueError(f"must hold finite numbers, got {_checks.show(value)}")
    return found


def _load(path: Path) -> Any:
    """Plain data of a YAML file."""
    try:
        import yaml
    except ModuleNotFoundError:
        raise missing("PyYAML") from None
    owner = f'windIO file "{path}"'
    text = read_text(f"{owner} cannot be read", path, _LARGEST)
    base: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)

    class Loader(base):
        """Loader of plain data without merge keys, which let files grow."""

        def flatten_mapping(self, node: Any) -> None:
            if any(key.tag == "tag:yaml.org,2002:merge" for key, _ in node.value):
                raise yaml.YAMLError("merge keys (<<) are not read")

    try:
        return yaml.load(text, Loader)
    except (yaml.YAMLError, RecursionError, ValueError, TypeError) as error:
        reason = " ".join(str(error).split())
        raise ValueError(f"{owner}: {_checks.show(reason, 200)}") from None
