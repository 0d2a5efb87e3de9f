# SPDX-License-Identifier: LGPL-3.0-or-later
"""Fields that colours show: names, units, and their values over the instants of a page."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexfem.io.view.packing import Pack, rounded
from flexfem.io.vtu.reader import Grid

__all__ = ["SMALL", "USUAL", "columns", "range_of", "store_field", "unit"]

#: Fields in the order in which they are wanted, where there is no room for all.
USUAL = ("bending_moment", "von_mises", "energy", "deformation", "velocity")
#: Fields of few lines, for which there is always room.
SMALL = ("tension",)
#: Arrays that are no results, or that a page has in another way.
_NOT_SHOWN = {
    "body", "joint", "section", "section_axes", "e1", "e2", "e3", "displacement", "axial_stress",
    "shear_stress",
}  # fmt: skip
_UNITS = {
    "velocity": "m/s", "displacement": "m", "deformation": "m", "angular_velocity": "rad/s",
    "thickness": "m", "von_mises": "Pa", "axial_stress": "Pa", "shear_stress": "Pa",
    "membrane_energy": "J/m²", "bending_energy": "J/m²", "shear_energy": "J/m²",
    "force_magnitude": "N", "moment_magnitude": "N m", "tension": "N",
}  # fmt: skip
_UNITS |= dict.fromkeys(("xx", "yy", "zz", "yz", "xz", "xy"), "Pa")
_UNITS |= dict.fromkeys(("N", "Q2", "Q3"), "N") | dict.fromkeys(("T", "M2", "M3"), "N m")
_UNITS |= dict.fromkeys(("kappa1", "kappa2", "kappa3", "kappa11", "kappa22", "2kappa12"), "1/m")
_UNITS |= dict.fromkeys(("n11", "n22", "n12"), "N/m") | dict.fromkeys(
    ("m11", "m22", "m12"), "N m/m"
)
_ENERGY = {"energy_lines": "J/m", "energy_triangles": "J/m²", "energy_solids": "J/m³"}


def unit(series: str, name: str) -> str:
    """Unit of a field of a series; empty without one, or where it is not known."""
    if name == "bending_moment":
        return "N m/m" if series == "shells" else "N m"
    if name == "energy":
        return _ENERGY.get(series, "")
    return _UNITS.get(name, "")


def columns(grid: Grid) -> Iterator[tuple[str, str, str, int | None]]:
    """Fields of a grid: name, "point" or "cell", its array and component; None for the length."""
    for where, data in (("cell", grid.cell_data), ("point", grid.point_data)):
        for array, values in data.items():
            if array in _NOT_SHOWN:
                continue
            names = grid.components.get(array, ())
            if values.ndim == 1:
                yield array, where, array, 0
            elif names:
                yield from ((name, where, array, i) for i, name in enumerate(names))
            else:
                yield array, where, array, None


def column(data: Mapping[str, NDArray[Any]], array: str, component: int | None) -> NDArray[Any]:
    """Values (n,) of a field."""
    values = data[array]
    if values.ndim == 1:
        return values
    return np.linalg.norm(values, axis=1) if component is None else values[:, component]


def range_of(values: NDArray[Any]) -> tuple[float, float]:
    """Least and greatest finite value; 0 and 0 if there is none."""
    finite = values[np.isfinite(values)]
    return (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)


def store_field(pack: Pack, values: Sequence[NDArray[Any]]) -> dict[str, Any]:
    """Keep values (n,) at each instant."""
    every = np.array(values, dtype=np.float32)
    low, high = range_of(every)
    return {"values": pack.store_motion(rounded(every, low, high)), "low": low, "high": high}
