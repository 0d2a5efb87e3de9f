# SPDX-License-Identifier: LGPL-3.0-or-later
"""Probe of stresses, strains and volumes of a solid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY
from typing import Any, ClassVar

from flexfem import _checks
from flexfem._fields import checked, declared, text
from flexfem.families.solid.body import Solid
from flexfem.model.probes.base import AnyProbe, name_columns
from flexfem.model.structure.structure import Structure

__all__ = ["MEASURES", "MOTION", "SolidProbe"]

_TENSOR = ("xx", "yy", "zz", "yz", "xz", "xy")
#: Columns of each measure.
MEASURES: dict[str, tuple[str, ...]] = {
    "stress": tuple(f"s{pair}" for pair in _TENSOR),
    "von_mises": ("von_mises",),
    "strain": tuple(f"e{pair}" for pair in _TENSOR),
    "J": ("J",),
    "volume": ("volume",),
    "position": ("x", "y", "z"),
    "displacement": ("ux", "uy", "uz"),
}
#: Measures of points and surfaces; the others are those of points, regions and the whole.
MOTION = ("position", "displacement")


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
    name_J, present over initial volume; of "volume": name_volume, m^3, of all cells of the place;
    of "position": name_x, _y, _z, m; of "displacement" since the start: name_ux, _uy, _uz, m. Means
    are over the volume at the start, those of a surface over its area.

    Attributes:
        name: Unique name in the model.
        solid: Name of the solid.
        place: A position (3,) at the start, m, inside the solid, in whose cell the fields are
            polynomials of a degree below that of the positions; or the name of a region of the
            mesh, for means; None for all of the solid. Positions and displacements are those of a
            point or of a named surface.
        measures: Some of "stress", "von_mises", "strain", "J" and "volume", or of "position" and
            "displacement".

    Raises:
        TypeError: An argument has the wrong type.
        ValueError: An unknown measure, or one that is named twice.
    """

    smooth: ClassVar[bool] = True
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
        moves = [name for name in self.measures if name in MOTION]
        if moves and len(moves) < len(self.measures):
            raise ValueError(
                f"{owner}: measures {_checks.show(list(self.measures))} need two probes, one for "
                f"{' and '.join(moves)}"
            )
        if moves and (self.place is None or isinstance(self.place, str)):
            solid.figure.area_weights(owner, self.place or "")
            return
        if isinstance(self.place, str) and self.place not in solid.mesh.region_names:
            known = ", ".join(solid.mesh.region_names) or "none"
            raise ValueError(
                f"{owner}: the mesh has no region {_checks.show(self.place)}; there are {known}"
            )
        if self.place is not None and not isinstance(self.place, str):
            solid.figure.place_in_cell(owner, self.place)
