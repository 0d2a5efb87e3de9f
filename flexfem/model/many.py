# SPDX-License-Identifier: LGPL-3.0-or-later
"""Many objects of one class in one declaration."""

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, overload, override

import numpy as np

from flexfem import _checks
from flexfem._memory import check_room
from flexfem._packages import without_collection
from flexfem.core.marker import Marker

__all__ = ["Each", "Many", "each"]

#: Bytes of an object at least.
_OBJECT = 1e3


@dataclass(frozen=True)
class Each:
    """Values of an argument, one for each of many objects, see :func:`each`."""

    values: Sequence[Any]


def each(values: Sequence[Any]) -> Each:
    """Mark values of which each of :class:`Many` objects gets its own.

    Args:
        values: As many as there are objects: an array, whose first axis counts them, or a list.

    Raises:
        TypeError: They cannot be counted.
    """
    array = isinstance(values, np.ndarray) and values.ndim > 0
    if isinstance(values, (str, bytes)) or not (array or isinstance(values, Sequence)):
        raise TypeError(f"each: values must be an array or a list, got {_checks.show(values)}")
    return Each(values)


class Many[Thing](Sequence[Thing]):
    """Many bodies, joints, loads or probes of one class, declared at once.

    It is the sequence of these objects, the same as if each had been declared by itself::

        rods = model.add(ff.Many(ff.RigidBody, "rod", 1.0, inertia, position=ff.each(centres)))
        ends = rods.markers(offset=(0.5, 0.0, 0.0))
        starts = rods.markers(offset=(-0.5, 0.0, 0.0))
        model.add(
            ff.Many(ff.Revolute, "pin", ff.each([ff.Ground(), *ends[:-1]]), ff.each(starts))
        )

    Attributes:
        names: Names of the objects.
    """

    names: tuple[str, ...]

    def __init__(
        self, kind: type[Thing], names: str | Sequence[str], *arguments: Any,
        count: int | None = None, **named: Any,
    ) -> None:  # fmt: skip
        """Declare the objects.

        Args:
            kind: Their class.
            names: All names in a list, or a text for NAME_0, NAME_1 and so on; numbers take the
                place of ``{}`` in it, where there is one.
            *arguments: Arguments of the class after the name, the same for all objects; those
                under :func:`each` are different ones.
            count: Number of the objects; only needed where neither names nor values tell it.
            **named: The same by name.

        Raises:
            TypeError: It is no class, names have no order, or the class refuses an argument.
            ValueError: There is no object, numbers of names or values differ, a text for names
                has other braces than one ``{}``, or an object of the class refuses a value.
        """
        if not isinstance(kind, type):
            raise TypeError(f"Many: kind must be a class, got {_checks.show(kind)}")
        owner = f"Many {kind.__name__} {_checks.show(names, 40)}"
        _check_names(owner, names)
        given = {f"argument {i + 1}": value for i, value in enumerate(arguments)} | named
        told = {what: len(v.values) for what, v in given.items() if isinstance(v, Each)}
        if not isinstance(names, str):
            told["names"] = len(names)
        if count is not None:
            told["count"] = _checks.count(owner, "count", count, 1)
        numbers = set(told.values())
        if len(numbers) > 1:
            raise ValueError(f"{owner}: numbers of objects differ, got {_checks.show(told)}")
        if not any(numbers):
            raise ValueError(f"{owner}: needs names, a count or values of each, of one at least")
        (number,) = numbers
        check_room(f"{owner}: {number} objects", _OBJECT * number, what="objects")
        self.names = _names(names, number)
        self._owner = owner
        places = [_column(value, number) for value in arguments]
        columns = [(what, _column(value, number)) for what, value in named.items()]
        make: Callable[..., Thing] = kind
        with without_collection():
            self._things = [
                make(name, *[place[i] for place in places], **{w: one[i] for w, one in columns})
                for i, name in enumerate(self.names)
            ]

    def markers(self, *arguments: Any, **named: Any) -> list[Marker]:
        """Return a marker on each of the bodies, in their order.

        Args:
            *arguments: Those of a :class:`Marker` after the body, as of the class.
            **named: The same by name.

        Raises:
            TypeError: A marker refuses an argument.
            ValueError: It refuses a value, or numbers of values differ.
        """
        return list(Many(Marker, self.names, *arguments, **named))

    @overload
    def __getitem__(self, index: int) -> Thing: ...

    @overload
    def __getitem__(self, index: slice) -> Sequence[Thing]: ...

    @override
    def __getitem__(self, index: int | slice) -> Thing | Sequence[Thing]:
        """Return an object by its number, or several.

        Raises:
            TypeError: It is no number.
            IndexError: There is no object of this number.
        """
        try:
            return self._things[index]
        except (TypeError, IndexError) as error:
            raise type(error)(
                f"{self._owner}: objects have numbers from 0 to {len(self) - 1}, got "
                f"{_checks.show(index)}"
            ) from None

    @override
    def __len__(self) -> int:
        """Return the number of objects."""
        return len(self._things)

    @override
    def __iter__(self) -> Iterator[Thing]:
        """Go through the objects."""
        return iter(self._things)

    @override
    def __repr__(self) -> str:
        """Return class and names, for messages."""
        return f"{self._owner} of {len(self)}"


def _check_names(owner: str, names: Any) -> None:
    """Refuse names that have no number or no order, which ranks would see in orders of their own.

    Raises:
        TypeError: They are neither a text nor a list.
        ValueError: A text has other braces than one ``{}``.
    """
    if isinstance(names, str):
        if names.count("{}") > 1 or "{:" in names:
            raise ValueError(
                f"{owner}: names must have one {{}} for the number at most, and no other form of it"
            )
    elif isinstance(names, (bytes, set, frozenset)) or not (
        names.ndim > 0 if isinstance(names, np.ndarray) else isinstance(names, Collection)
    ):
        raise TypeError(f"{owner}: names must be a text or a list, got {_checks.show(names)}")


def _column(value: Any, number: int) -> Sequence[Any]:
    """Return the values of an argument, one for each object."""
    return value.values if isinstance(value, Each) else [value] * number


def _names(names: str | Sequence[str], number: int) -> tuple[str, ...]:
    """Return the names of objects, from all of them or what they have in common."""
    if not isinstance(names, str):
        return tuple(names)
    before, hole, after = names.partition("{}")
    join = "" if hole else "_"
    return tuple(f"{before}{join}{i}{after}" for i in range(number))
