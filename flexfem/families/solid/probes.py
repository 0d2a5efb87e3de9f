# SPDX-License-Identifier: LGPL-3.0-or-later
"""Probe of stresses, strains and volumes of a solid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY
from typing import Any

from flexfem import _checks
from flexfem._fields import checked, declared, text
from flexfem.families.solid.body import Solid
from flexfem.model.probes.base import AnyProbe, name_columns
from flexfem.model.structure.structure import Structure

__all__ = ["MEASURES", "SolidProbe"]

_TENSOR = ("xx", "yy", "zz", "yz", "xz", "xy")
#: Columns of each measure.
MEASURES: dict[str, tuple[str, ...]] = {
    "stress": tuple(f"s{pair}" for pair in _TENSOR),
    "von_mises": ("von_mises",),
    "strain": tuple(f"e{pair}" for pair in _TENSOR),
    "J": ("J",),
    "volume": ("volume",),
}


def _place(owner: str, what: str, value: Any) -> Any:
    if isinstance(value, str):
        return _checks.text(owner, what, value)
    return _checks.vector(owner, what, value)


def _measured(owner: str, what: str, values: Sequence[str]) -> tuple[str, ...]:
    names = (values,) if isinstance(values, str) else values
    _checks.instance(owner, what, names, (list, tuple))
    for name in names:
        _checks.word(owner, what, name, tuple(MEASURES))
    if not names or len(set(names)) < len(names):
        raise ValueError(f"{owner}: {what} must be different names, got {_checks.show(values)}")
    return tuple(names)


@declared
class SolidProbe(AnyProbe):
    """Stresses, strains and volume of a solid, at a point or as a mean over cells.

    Columns of "stress": Cauchy's, Pa, name_sxx, _syy, _szz, _syz, _sxz, _sxy; of "von_mises" (Pa),
    name_von_mises, that of these stresses; of "strain": Green's, name_exx to _exy; of "J":
    name_J, present over initial volume; of "volume": name_volume, m^3, of all cells of the place.
    Means are over the volume at the start.

    Attributes:
        name: Unique name in the model.
        solid: Name of the solid.
        place: A position (3,) at the start, m, inside the solid, in whose cell the fields are
            polynomials of a degree below that of the positions; or the name of a region of the
            mesh, for means; None for all of the solid.
        measures: Some of "stress", "von_mises", "strain", "J" and "volume".

    Raises:
        TypeError: An argument has the wrong type.
        ValueError: An unknown measure, or one that is named twice.
    """

    name: str
    solid: str = text()
    place: Any = checked(_place, default=None)
    _: KW_ONLY
    measures: Sequence[str] = checked(_measured, default=("stress",))

    def __post_init__(self) -> None:
        """Name the columns."""
        name_columns(self, [column for name in self.measures for column in MEASURES[name]])

    def check(self, model: Structure) -> None:
        """See :meth:`AnyProbe.check`."""
        owner, solid = f'SolidProbe "{self.name}"', model.get(self.solid)
        if not isinstance(solid, Solid):
            raise ValueError(f'{owner}: {model!r} has no Solid "{self.solid}"')
        if isinstance(self.place, str) and self.place not in solid.mesh.regions:
            known = ", ".join(solid.mesh.regions) or "none"
            raise ValueError(
                f"{owner}: the mesh has no region {_checks.show(self.place)}; there are {known}"
            )
        if self.place is not None and not isinstance(self.place, str):
            solid.figure.place_in_cell(owner, self.place)
