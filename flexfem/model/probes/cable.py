# SPDX-License-Identifier: LGPL-3.0-or-later
"""Probe of a cable."""

from typing import ClassVar

from flexfem import _checks
from flexfem._fields import declared, instance, text
from flexfem.joints.cable import Cable
from flexfem.model.probes.base import AnyProbe, name_columns
from flexfem.model.structure.structure import Structure

__all__ = ["CableProbe"]


@declared
class CableProbe(AnyProbe):
    """Tension (N) of a cable and its stretch (m).

    Columns name_tension at the first end, name_end_tension at the last one, which differs by the
    friction at the guides between, and name_stretch: the length less the rest length, negative
    where the cable is slack. Tensions belong to the time of the row, as forces of
    ``ReactionProbe``.

    Attributes:
        name: Unique name in the model.
        cable: Name of the cable.
        part: Number of the part between sheaves with ``grip``, in the order of the path from 0.

    Raises:
        TypeError: A name is no string, or the part no whole number.
        ValueError: An empty name.
    """

    smooth: ClassVar[bool] = True
    name: str
    cable: str = text()
    part: int = instance(int, default=0)

    def __post_init__(self) -> None:
        """Name the columns."""
        name_columns(self, ["tension", "end_tension", "stretch"])

    def check(self, model: Structure) -> None:
        """See :meth:`AnyProbe.check`."""
        cable, owner = model.get(self.cable), _checks.named(self, self.name)
        if not isinstance(cable, Cable):
            raise ValueError(f'{owner}: {model!r} has no cable "{self.cable}"')
        if not 0 <= self.part < cable.part_count:
            last = cable.part_count - 1
            known = f"from 0 to {last}, those" if last else "0, the only one"
            raise ValueError(f"{owner}: part must be {known} of {cable.owner}, got {self.part}")
