# SPDX-License-Identifier: LGPL-3.0-or-later
"""Guides of cables: eyelets, sheaves and ends."""

from __future__ import annotations

from flexfem import _checks
from flexfem._fields import Array, declared, flag, instance, number, vector
from flexfem.core.marker import Attachment, Carrier, Ground, Marker, ShellLine

__all__ = ["Eyelet", "Guide", "Sheave", "check_path", "grips", "marker_of", "rubs"]


@declared
class Eyelet:
    """A point through which a cable slides.

    Attributes:
        marker: where it is.
        friction: mu; the tension changes by the factor ``exp(mu theta)`` over the angle theta of
            the bend (Euler and Eytelwein), against the motion of the cable.
        velocity: speed of sliding, m/s, below which friction holds it nearly: the regularisation
            is ``exp(mu theta tanh(v / velocity))``.

    Raises:
        TypeError: an argument has the wrong type.
        ValueError: friction is negative, or the velocity not positive.
    """

    marker: Attachment = instance((Marker, Ground))
    friction: float = number(default=0.0, nonnegative=True)
    velocity: float = number(default=1e-3, positive=True)

    @property
    def _owner(self) -> str:
        return "Eyelet"


@declared
class Sheave:
    """A grooved wheel over which a cable runs.

    Attributes:
        marker: its centre, which turns with the body that carries it.
        radius: of the middle of the cable, m.
        axis: about which the cable runs, right-handed, from the guide before it to the one after;
            fixed in the marker, inertial axes at the start; any length but zero.
        grip: True if the body of the marker is the wheel and the cable does not slip on it: it
            takes the cable along as it turns, and the tensions before and after it differ. False
            if the marker is on the bearing of a wheel without friction and inertia.
        turns: full turns of the cable around it besides the part of a turn between its neighbours.
            None for none, where the cable must not cross itself at the sheave, as it does where it
            would not touch it.
        friction, velocity: of a cable that slides on it, as those of an ``Eyelet``.

    Raises:
        TypeError: an argument has the wrong type.
        ValueError: the radius is not positive, the axis is zero, turns or friction are negative,
            the velocity is not positive, or friction with ``grip``.
    """

    marker: Attachment = instance((Marker, Ground))
    radius: float = number(positive=True)
    axis: Array = vector(default=(0.0, 0.0, 1.0), nonzero=True)
    grip: bool = flag(default=False)
    turns: int | None = instance(int, default=None)
    friction: float = number(default=0.0, nonnegative=True)
    velocity: float = number(default=1e-3, positive=True)

    def __post_init__(self) -> None:
        """Check turns and friction."""
        if self.grip and self.friction:
            raise ValueError(f"{self._owner}: friction needs grip=False, got {self.friction:g}")
        if self.turns is not None and self.turns < 0:
            raise ValueError(f"{self._owner}: turns must not be negative, got {self.turns}")

    @property
    def _owner(self) -> str:
        return "Sheave"


#: What the path of a cable consists of; markers and the ground are its fastened ends.
Guide = Marker | Ground | Eyelet | Sheave


def marker_of(guide: Guide) -> Attachment:
    """Its place."""
    return guide.marker if isinstance(guide, (Eyelet, Sheave)) else guide


def grips(guide: Guide) -> bool:
    """True if the cable does not slide there."""
    return guide.grip if isinstance(guide, Sheave) else not isinstance(guide, Eyelet)


def rubs(guide: Guide) -> bool:
    """True if the cable slides there with friction."""
    return isinstance(guide, (Eyelet, Sheave)) and guide.friction > 0.0


def check_path(owner: str, path: object, closed: bool) -> None:
    """Check the guides of a cable.

    Raises:
        TypeError: they are no list of guides.
        ValueError: there are too few, or ends or inner guides do not suit.
    """
    _checks.instance(owner, "path", path, (list, tuple))
    assert isinstance(path, (list, tuple))
    if len(path) < 2:
        raise ValueError(f"{owner}: path must have two guides at least, got {len(path)}")
    for k, guide in enumerate(path):
        what = f"path[{k}]"
        _checks.instance(owner, what, guide, (Marker, Ground, Eyelet, Sheave))
        if isinstance(marker_of(guide), (Carrier, ShellLine)):
            raise TypeError(f"{owner}: {what} must be at a place, not on a whole line")
        end = not closed and k in (0, len(path) - 1)
        if end and not grips(guide):
            raise ValueError(
                f"{owner}: {what} is an end: it must be a marker or a Sheave with grip=True, "
                f"got {type(guide).__name__}"
            )
        if not end and isinstance(guide, (Marker, Ground)):
            raise ValueError(
                f"{owner}: {what} must be an Eyelet, through which the cable slides, or a Sheave, "
                f"got {type(guide).__name__}"
            )
