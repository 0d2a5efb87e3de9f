# SPDX-License-Identifier: LGPL-3.0-or-later
"""Sections that vary along a beam: tables of matrices at stations of its axis.

Axes, orders and signs are those of ``flexfem.materials.section``. Between stations all entries are
linear in the arc length, so that stiffness and inertia stay what they are at the stations: a mean
of positive definite matrices is positive definite, and one of inertias is an inertia.
"""

from collections.abc import Callable, Sequence
from dataclasses import KW_ONLY
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from flexfem import _checks
from flexfem._fields import Array, Given, checked, declared, flag, settled
from flexfem._types import FloatArray
from flexfem.materials.matrices import check_definite, check_inertia_form
from flexfem.materials.section import Section

__all__ = ["AnySection", "SectionTable"]

#: Distance of the ends of a table from those of a beam, relative to its length, that counts as
#: none: a line of chords is shorter than its curve by less on any mesh that resolves it.
_ENDS = 1e-3


def _stations(owner: str, what: str, value: Any) -> FloatArray:
    """Return checked places along the axis."""
    places = _checks.array(owner, what, value, (-1,))
    if len(places) < 2:
        raise ValueError(f"{owner}: {what} must be at least two, got {len(places)}")
    steps = np.diff(places)
    if (steps < 0.0).any():
        i = int(np.argmax(steps < 0.0))
        raise ValueError(
            f"{owner}: {what} must not decrease, got {places[i]:g} before {places[i + 1]:g}"
        )
    if (same := (steps[1:] == 0.0) & (steps[:-1] == 0.0)).any():
        place = places[1 + int(np.argmax(same))]
        raise ValueError(f"{owner}: {what}: {place:g} occurs more than twice")
    if steps[0] == 0.0 or steps[-1] == 0.0:
        raise ValueError(f"{owner}: {what}: the first and the last one must occur once")
    return places


@declared
class SectionTable:
    """Sections at stations along the axis of a beam, linear in between.

    A station that occurs twice is a jump: the first entry ends there, the second begins.

    Attributes:
        stations: Places along the axis in ascending order, shape (n,); arc lengths, metres, or
            fractions of the beam's length.
        stiffness: As in :class:`Section`, of each station, shape (n, 6, 6).
        inertia: As in :class:`Section`, of each station, shape (n, 6, 6).
        twist: Angle by which section axes are rotated about e1 from the orientation of the beam,
            radians: shape (n,), linear in between, or a function of places (k,) in the unit of the
            stations that returns angles (k,). None for zero.
        outlines: Vertices (y, z) of the outer boundary at each station, shape (n, k, 2), metres;
            None when unknown.
        relative: True if stations are fractions of the length, from 0 to 1.

    Raises:
        TypeError: An argument does not consist of numbers.
        ValueError: Fewer than two stations, or stations that decrease, a station more than twice,
            relative ones not from 0 to 1, arrays of other lengths, or a matrix that
            :class:`Section` refuses; with the station.
    """

    stations: Array = checked(_stations)
    stiffness: Array
    inertia: Array
    _: KW_ONLY
    twist: Given[
        npt.ArrayLike | Callable[[FloatArray], npt.ArrayLike] | None,
        FloatArray | Callable[[FloatArray], npt.ArrayLike],
    ] = settled(default=None)
    outlines: Given[npt.ArrayLike | None, FloatArray | None] = settled(default=None)
    relative: bool = flag(default=False)

    def __post_init__(self) -> None:
        """Check what has one entry for each station."""
        owner, n = "SectionTable", len(self.stations)
        stiffness = _checks.array(owner, "stiffness", self.stiffness, (n, 6, 6))
        inertia = _checks.array(owner, "inertia", self.inertia, (n, 6, 6))
        for place, K, M in zip(self.stations.tolist(), stiffness, inertia, strict=True):
            at = f"SectionTable, station {place:g}"
            check_definite(at, "stiffness", K, semidefinite=False)
            check_definite(at, "inertia", M, semidefinite=True)
            check_inertia_form(at, M)
        twist, outlines = self.twist, self.outlines
        if not callable(twist):
            twist = _checks.array(owner, "twist", np.zeros(n) if twist is None else twist, (n,))
        if outlines is not None:
            outlines = _checks.array(owner, "outlines", outlines, (n, -1, 2))
            if outlines.shape[1] < 3:
                raise ValueError(
                    f"{owner}: outlines must have at least three vertices, got {outlines.shape[1]}"
                )
        if self.relative and (self.stations[0] != 0.0 or self.stations[-1] != 1.0):
            first, last = self.stations[0], self.stations[-1]
            raise ValueError(
                f"{owner}: relative stations must go from 0 to 1, got {first:g} to {last:g}"
            )
        _checks.assign(
            self, stiffness=stiffness, inertia=inertia, twist=twist, outlines=outlines
        )  # fmt: skip

    @classmethod
    def of(cls, stations: npt.ArrayLike, sections: Sequence[Section], **given: Any) -> Self:
        """Create a table of sections, which are linear in between as all tables are.

        Args:
            stations: Places along the axis, shape (n,).
            sections: One for each place, with stiffnesses; outlines are taken over if all have one
                of as many vertices.
            **given: `twist` and `relative`.

        Raises:
            TypeError: Something is no Section.
            ValueError: A section has a law of its own, or as for the class itself.
        """
        for one in sections:
            _checks.instance("SectionTable", "each section", one, Section)
            if one.stiffness is None:
                assert one.law is not None
                raise ValueError(f"SectionTable: sections must be linear, got a {one.law.owner}")
        shapes = {None if one.outline is None else one.outline.shape for one in sections}
        if len(shapes) == 1 and None not in shapes:
            given["outlines"] = [one.outline for one in sections]
        stiffness = np.array([one.stiffness for one in sections])
        return cls(stations, stiffness, np.array([one.inertia for one in sections]), **given)

    @property
    def jumps(self) -> FloatArray:
        """Stations that occur twice."""
        found: FloatArray = self.stations[1:][np.diff(self.stations) == 0.0]
        return found

    def scale(self, owner: str, length: float) -> float:
        """Unit of the stations along a beam of a length, metres.

        Raises:
            ValueError: The table ends elsewhere than the beam.
        """
        if self.relative:
            return length
        first, last = self.stations[0], self.stations[-1]
        if abs(first) > _ENDS * length or abs(last - length) > _ENDS * length:
            raise ValueError(
                f"{owner}: the stations of its section go from {first:g} to {last:g} m, the beam "
                f"from 0 to {length:g} m (relative=True for fractions of the length)"
            )
        return 1.0

    def at(self, places: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Stiffness and inertia (k, 6, 6) at places (k,) in the unit of the stations.

        At a jump they are those behind it.
        """
        i, w = self._between(places)
        w = w[:, np.newaxis, np.newaxis]
        # of equal neighbours exactly these
        stiffness = self.stiffness[i] + w * (self.stiffness[i + 1] - self.stiffness[i])
        return stiffness, self.inertia[i] + w * (self.inertia[i + 1] - self.inertia[i])

    def outline_at(self, place: float, *, before: bool = False) -> FloatArray | None:
        """Outline (k, 2) at a place, ``before`` a jump there or behind it; None when unknown."""
        if self.outlines is None:
            return None
        i, w = self._between(np.array([place]), "left" if before else "right")
        outline: FloatArray = (1.0 - w) * self.outlines[i[0]] + w * self.outlines[i[0] + 1]
        return outline

    def twist_at(self, places: FloatArray) -> FloatArray:
        """Twist (k,) at places (k,) in the unit of the stations, rad.

        Raises:
            TypeError: A function of the twist returns no numbers.
            ValueError: It returns an array of another shape, or a number that is not finite.
        """
        if callable(self.twist):
            return _checks.array("SectionTable", "twist(s)", self.twist(places), np.shape(places))
        return np.interp(places, self.stations, self.twist)

    def _between(
        self, places: FloatArray, side: Any = "right"
    ) -> tuple[npt.NDArray[np.int64], FloatArray]:
        """Number of the station before each place, and the weight of the next one."""
        x, last = self.stations, len(self.stations) - 2
        i = np.clip(np.searchsorted(x, places, side) - 1, 0, last)
        return i, np.clip((places - x[i]) / (x[i + 1] - x[i]), 0.0, 1.0)


#: Section of a beam: the same everywhere, a table, or a function of the arc length, metres.
AnySection = Section | SectionTable | Callable[[float], Section]
