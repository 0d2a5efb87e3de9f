# SPDX-License-Identifier: LGPL-3.0-or-later
"""Grid points of a Nastran file, in coordinate systems that may depend on one another."""

import numpy as np

from flexfem import _checks
from flexfem._types import FloatArray
from flexfem.mesh.imported.limits import whole
from flexfem.mesh.imported.nastran_cards import Card

__all__ = ["SYSTEMS", "GridPoints"]

# Systems that depend on one another in a chain
_NESTED = 50

#: Cards of coordinate systems: by three grid points, or by three points in another system.
SYSTEMS = ("CORD1R", "CORD1C", "CORD1S", "CORD2R", "CORD2C", "CORD2S")


class GridPoints:
    """Collects grid points and systems; positions come at the end, since any order is allowed."""

    def __init__(self) -> None:
        """Begin without points."""
        self._points: dict[int, Card] = {}
        self._systems: dict[int, tuple[Card, int]] = {}
        self._default = ""
        self._known: dict[int, FloatArray] = {}
        self._axes: dict[int, tuple[FloatArray, FloatArray]] = {}
        self._under_way: set[int] = set()

    def take(self, card: Card) -> None:
        """Take a point, a system, or the default system of points.

        Raises:
            ValueError: A number occurs twice with something else, or a field is wrong.
        """
        if card.name == "GRID":
            number = card.integer(2)
            other = self._points.setdefault(number, card)
            if other.fields != card.fields:
                card.fail(f"point {number} occurs twice, also in line {other.line}")
        elif card.name == "GRDSET":
            self._default = card.field(3)
        else:  # a card of grid points may have two systems
            for first in (2, 6) if card.name.startswith("CORD1") and card.field(6) else (2,):
                other, _ = self._systems.setdefault(card.integer(first), (card, first))
                if other.fields != card.fields:
                    card.fail(f"system {card.integer(first)} occurs twice")

    def positions(self) -> dict[int, tuple[Card, tuple[float, float, float]]]:
        """Return card and position of each point in the basic system.

        Raises:
            ValueError: A system is not there, has no axes, or is defined by itself.
        """
        found = {}
        with np.errstate(all="ignore"):  # values that are not finite are refused with their node
            for number, card in self._points.items():
                x, y, z = self._position(number).tolist()
                found[number] = (card, (x, y, z))
        return found

    def _position(self, number: int) -> FloatArray:
        if number not in self._known:
            card = self._points[number]
            own = np.array([card.real(field) for field in (4, 5, 6)])
            system = card.field(3) or self._default or "0"
            self._known[number] = self._moved(card, system, own)
        return self._known[number]

    def _moved(self, card: Card, system: str, own: FloatArray) -> FloatArray:
        """Return the basic coordinates of a point in a system."""
        if system == "0":
            return own
        number = whole(system)
        if number not in self._systems or number is None:
            card.fail(f"coordinate system {_checks.show(system)} is not in the file")
        origin, axes = self._frame(number)
        kind = self._systems[number][0].name[-1]
        if kind == "C":
            radius, angle, height = own[0], np.deg2rad(own[1]), own[2]
            own = np.array([radius * np.cos(angle), radius * np.sin(angle), height])
        elif kind == "S":  # distance, angle from the third axis, angle around it
            radius, tilt, angle = own[0], np.deg2rad(own[1]), np.deg2rad(own[2])
            around = np.sin(tilt)
            own = radius * np.array([around * np.cos(angle), around * np.sin(angle), np.cos(tilt)])
        moved: FloatArray = origin + own @ axes
        return moved

    def _frame(self, number: int) -> tuple[FloatArray, FloatArray]:
        """Return origin and axes (rows) of a system."""
        if number in self._axes:
            return self._axes[number]
        card, first = self._systems[number]
        if number in self._under_way:
            card.fail(f"system {number} is defined by itself")
        if len(self._under_way) > _NESTED:
            card.fail(f"system {number} depends on more than {_NESTED} others")
        self._under_way.add(number)
        if card.name.startswith("CORD1"):
            numbers = [card.integer(first + i) for i in (1, 2, 3)]
            for point in numbers:
                if point not in self._points:
                    card.fail(f"point {point} is not in the file")
            a, b, c = (self._position(point) for point in numbers)
        else:
            rows = [np.array([card.real(4 + 3 * i + k) for k in range(3)]) for i in range(3)]
            a, b, c = (self._moved(card, card.field(3) or "0", row) for row in rows)
        third = b - a
        second = np.cross(third, c - a)
        if not (np.linalg.norm(second) > 0.0):
            card.fail(f"the three points of system {number} are on one line")
        third, second = third / np.linalg.norm(third), second / np.linalg.norm(second)
        self._under_way.remove(number)
        self._axes[number] = (a, np.array([np.cross(second, third), second, third]))
        return self._axes[number]
