# SPDX-License-Identifier: LGPL-3.0-or-later
"""Selection of modes: by number, frequency or effective modal mass."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from flexfem import _checks
from flexfem._types import FloatArray
from flexfem.reduction.fem.modes.orientation import Orientation

__all__ = ["Choice", "Spectrum", "choose_modes"]

#: Modes computed beyond those requested, to see whether the last has a multiple frequency.
_MORE = 2
#: Modes that are tried first where their number is not known.
_FIRST = 12


@dataclass(frozen=True)
class Choice:
    """Choice of modes to keep; exactly one of the attributes is given, or none for all.

    Attributes:
        number: so many.
        frequency: all up to this one, Hz.
        participation: as few as move this part of the mass along each axis.
    """

    number: int | None = None
    frequency: float | None = None
    participation: float | None = None

    def __str__(self) -> str:
        """Return the given attribute as text."""
        if self.frequency is not None:
            return f"frequency {self.frequency:g} Hz"
        if self.participation is not None:
            return f"participation {self.participation:g}"
        return f"number {self.number}"

    @classmethod
    def checked(
        cls, owner: str, number: object, frequency: object, participation: object
    ) -> "Choice":
        """From user input.

        Raises:
            TypeError: a value is not a number.
            ValueError: a value is out of range, or not exactly one is given.
        """
        given = [number, frequency, participation]
        if sum(value is not None for value in given) != 1:
            raise ValueError(
                f"{owner}: give one of modes, frequency and participation, got {given}"
            )
        if number is not None:
            return cls(number=_checks.count(owner, "modes", number, 0))
        if frequency is not None:
            return cls(frequency=_checks.number(owner, "frequency", frequency, positive=True))
        part = _checks.number(owner, "participation", participation, positive=True)
        if part >= 1.0:
            raise ValueError(f"{owner}: participation must be less than 1, got {part}")
        return cls(participation=part)


class Spectrum:
    """Modes that are computed on demand."""

    def __init__(
        self,
        compute: Callable[[int], tuple[FloatArray, FloatArray]],
        available: int | None,
        most: int = 0,
    ) -> None:
        """Create it.

        Args:
            compute: from a count to at least that many eigenvalues and modes, if there are.
            available: number of modes that `compute` gives whatever the count, None if it gives as
                many as requested.
            most: largest number of modes then.
        """
        self._compute, self._available, self.most = compute, available, available or most
        self.endless = available is None
        self.values, self.modes = np.zeros(0), np.zeros((0, 0))

    def extend(self, count: int) -> bool:
        """Have at least `count` modes (collective); False if there are no more."""
        if self._available is not None:
            if not len(self.values) and self._available:
                self.values, self.modes = self._compute(self._available)
            return count <= len(self.values)
        if count > len(self.values):
            self.values, self.modes = self._compute(count)
        return True


def choose_modes(
    owner: str,
    choice: Choice,
    spectrum: Spectrum,
    orientation: Orientation,
    moved: Callable[[FloatArray], FloatArray],
) -> FloatArray:
    """This rank's rows of the modes that are kept (collective).

    Args:
        owner: for messages.
        choice: choice of modes.
        spectrum: modes to choose from.
        orientation: gives them signs.
        moved: from modes to the part of the body's mass that each moves along each axis, (3, m);
            zero for axes along which the body does not move.

    Raises:
        ValueError: there are fewer modes than requested.
    """
    count = choice.number if choice.number is not None else _FIRST
    while True:
        if spectrum.endless and count > spectrum.most:
            raise ValueError(
                f"{owner}: at most {spectrum.most} modes of this mesh can be found, the {choice} "
                "asks for more"
            )
        more = spectrum.extend(count + _MORE)
        values = spectrum.values
        if choice.number is not None:
            kept = choice.number
            if kept > len(values):
                raise ValueError(f"{owner}: modes must be at most {len(values)}, got {kept}")
        elif choice.frequency is not None:
            kept = int(np.sum(values <= (2.0 * np.pi * choice.frequency) ** 2 * (1.0 + 1e-9)))
        elif choice.participation is not None:
            kept = _enough(moved(spectrum.modes), choice.participation)
            if kept > len(values) and not more:
                raise ValueError(
                    f"{owner}: all {len(values)} modes of the mesh have less than the "
                    f"participation {choice.participation:g}"
                )
        else:
            kept = len(values)
        families = orientation.families(values)
        # the family of the last mode must be known whole
        whole = kept == 0 or (kept <= len(values) and families[-1].start >= kept)
        if whole or not more:
            break
        count = 2 * max(count, _FIRST)
    last = next((f.stop for f in families if f.stop >= kept), kept)
    turned = orientation.turn(spectrum.modes[:, :last], values[:last])
    return turned[:, :kept]


def _enough(moved: FloatArray, participation: float) -> int:
    """Number of modes that together move enough mass along all axes; one more than all if none."""
    sums = np.cumsum(moved, axis=1)
    axes = sums[:, -1] > 0.0
    enough = (sums[axes] >= participation).all(axis=0)
    return int(np.argmax(enough)) + 1 if enough.any() else moved.shape[1] + 1
