# SPDX-License-Identifier: LGPL-3.0-or-later
"""Fields of model objects: type, default and check of a value in one place.

A class under :func:`declared` is a frozen dataclass. Its fields say how their values are checked
and converted to the stored form; messages name the object and the value, see ``flexfem._checks``.
Conditions on several values are checked in the ``__post_init__`` of the class, which finds all
fields checked. Units and meaning are in the docstring of the class.
"""

import inspect
import warnings
from collections.abc import Callable, Collection
from dataclasses import MISSING, InitVar, dataclass, field, fields
from functools import wraps
from typing import Any, dataclass_transform, get_args, get_origin

import numpy.typing as npt

from flexfem import _checks
from flexfem._types import FloatArray

__all__ = [
    "ZERO", "Array", "ArrayOrNone", "Given", "Renamed", "array", "checked", "choice", "declared",
    "direction", "flag", "function", "instance", "number", "one_of", "owner_of",
    "renamed_arguments", "rotation", "settled", "text", "time_function", "vector",
]  # fmt: skip

#: Takes the object, the field and its value for messages; returns the stored value.
Check = Callable[[str, str, Any], Any]


class Given[Value, Kept]:
    """Type of a field whose argument has another type than the stored value; for type checkers."""

    def __get__(self, instance: object, owner: Any = None) -> Kept:
        """Read the stored value."""
        raise NotImplementedError

    def __set__(self, instance: Any, value: Value) -> None:
        """Take an argument."""
        raise NotImplementedError


class Renamed:
    """Former name of an attribute: reads the attribute under its present name and warns."""

    def __init__(self, present: str) -> None:
        """Take the present name."""
        self._present = present

    def __set_name__(self, owner: type, former: str) -> None:
        """Take the former name, that of this attribute of the class."""
        self._former = f"{owner.__name__}.{former}"

    def __get__(self, instance: object, owner: Any = None) -> Any:
        """Read the attribute of an instance.

        Warns:
            DeprecationWarning: for instances, with both names.
        """
        if instance is None:
            return self
        warnings.warn(f"{self._former} is {self._present} now", DeprecationWarning, stacklevel=2)
        return getattr(instance, self._present)


def renamed_arguments[Class: type](**present: str) -> Callable[[Class], Class]:
    """Let a class take arguments by their former names, too, with a warning.

    Args:
        present: Present name by the former one.
    """

    def decorate(cls: Class) -> Class:
        create: Callable[..., None] = cls.__init__  # type: ignore[misc]

        @wraps(create)
        def init(self: Any, *given: Any, **named: Any) -> None:
            for former in [name for name in present if name in named]:
                new = present[former]
                if new in named:
                    raise TypeError(f"{cls.__name__}: {former} is {new} now, give it once")
                text = f"{cls.__name__}({former}=...) is {new}=... now"
                warnings.warn(text, DeprecationWarning, stacklevel=2)
                named[new] = named.pop(former)
            create(self, *given, **named)

        cls.__init__ = init  # type: ignore[misc]
        return cls

    return decorate


#: Anything that makes an array, stored as a read-only one.
Array = Given[npt.ArrayLike, FloatArray]
#: The same, where the argument may be None, for which something is chosen.
ArrayOrNone = Given[npt.ArrayLike | None, FloatArray]

ZERO = (0.0, 0.0, 0.0)
_NUMBERS = {int, float}


def checked(
    check: Check,
    *,
    default: Any = MISSING,
    as_given: bool = False,
    none: bool | None = None,
    kw_only: Any = MISSING,
) -> Any:
    """Declare a field with any check.

    Args:
        check: function that checks a value and returns the one to store.
        default: value when the argument is left out.
        as_given: the value is stored as it is.
        none: None is allowed; if None, where it is the default.
        kw_only: the argument is given by its name.
    """
    optional = default is None if none is None else none
    left_out: list[Any] = []  # what is stored for the default, checked once for all objects
    latest: list[Any] = []  # the latest tuple of numbers, and what is stored for it

    def apply(owner: str, what: str, value: Any) -> Any:
        if optional and value is None:
            return None
        if value is default and left_out:
            return left_out[0]
        if latest and value is latest[0]:  # many objects share it, and nothing can change it
            return latest[1]
        found = check(owner, what, value)
        stored = value if as_given else found
        if value is default:
            left_out.append(stored)
        elif type(value) is tuple and {type(one) for one in value} <= _NUMBERS:
            latest[:] = value, stored
        return stored

    return field(default=default, kw_only=kw_only, metadata={"check": apply})


def settled(*, default: Any) -> Any:
    """Declare a field that ``__post_init__`` checks and settles."""
    return field(default=default)


def text(*, default: Any = MISSING) -> Any:
    """Declare a name."""
    return checked(_checks.text, default=default)


def number(
    *,
    default: Any = MISSING,
    as_given: bool = False,
    none: bool | None = None,
    kw_only: Any = MISSING,
    **bounds: bool,
) -> Any:
    """Declare a finite number; ``positive``, ``nonnegative`` or ``nonzero`` on demand."""

    def check(owner: str, what: str, value: Any) -> float:
        return _checks.number(owner, what, value, **bounds)

    return checked(check, default=default, as_given=as_given, none=none, kw_only=kw_only)


def whole_number(*, least: int = 0, default: Any = MISSING) -> Any:
    """Declare a whole number that is at least `least`."""

    def check(owner: str, what: str, value: Any) -> int:
        return _checks.count(owner, what, value, least)

    return checked(check, default=default)


def vector(*, default: Any = MISSING, nonzero: bool = False, as_given: bool = False) -> Any:
    """Declare a vector of three numbers, ``nonzero`` for a direction."""

    def check(owner: str, what: str, value: Any) -> FloatArray:
        return _checks.vector(owner, what, value, nonzero=nonzero)

    return checked(check, default=default, as_given=as_given)


def array(*shape: int, default: Any = MISSING) -> Any:
    """Declare an array of a shape; -1 stands for any extent."""

    def check(owner: str, what: str, value: Any) -> FloatArray:
        return _checks.array(owner, what, value, shape)

    return checked(check, default=default)


def rotation(*, default: Any = MISSING) -> Any:
    """Declare a rotation matrix; None is the identity."""
    return checked(_checks.rotation, default=default, none=False)


def direction(*, default: Any = MISSING) -> Any:
    """Declare a direction: a vector, or a function of points that returns vectors."""

    def check(owner: str, what: str, value: Any) -> Any:
        return value if callable(value) else _checks.vector(owner, what, value, nonzero=True)

    return checked(check, default=default)


def instance(
    kinds: type | tuple[type, ...], *, default: Any = MISSING, kw_only: Any = MISSING
) -> Any:
    """Declare an object of a class, or of one of several."""

    def check(owner: str, what: str, value: Any) -> None:
        _checks.instance(owner, what, value, kinds)

    return checked(check, default=default, as_given=True, kw_only=kw_only)


def flag(*, default: Any = MISSING) -> Any:
    """Declare a truth value."""
    return instance(bool, default=default)


def choice(words: tuple[str, ...], *, default: Any = MISSING) -> Any:
    """Declare one of some words."""

    def check(owner: str, what: str, value: Any) -> str:
        return _checks.word(owner, what, value, words)

    return checked(check, default=default)


def one_of(names: Collection[str], *, default: Any = MISSING) -> Any:
    """Declare one of several names; anything else is the wrong value, whatever its type."""
    known = tuple(names)

    def check(owner: str, what: str, value: Any) -> Any:
        if not isinstance(value, str) or value not in known:
            raise ValueError(
                f"{owner}: {what} must be one of {', '.join(known)}, got {_checks.show(value)}"
            )
        return value

    return checked(check, default=default)


def time_function(*shape: int, default: Any = MISSING) -> Any:
    """Declare a function of time, by its value at t = 0: a number, or an array of a shape."""

    def check(owner: str, what: str, value: Any) -> None:
        _checks.function(owner, what, value, shape)

    return checked(check, default=default, as_given=True)


def function(of: str = "", *, default: Any = MISSING) -> Any:
    """Declare a function; ``of`` names its arguments in messages."""

    def check(owner: str, what: str, value: Any) -> None:
        if not callable(value):
            wanted = f"a function of {of}" if of else "callable"
            raise TypeError(f"{owner}: {what} must be {wanted}, got {_checks.show(value)}")

    return checked(check, default=default, as_given=True)


def owner_of(thing: Any) -> str:
    """Return the name of an object in messages: its ``_owner``, or class and name."""
    if hasattr(type(thing), "_owner"):
        return str(thing._owner)
    if hasattr(thing, "name"):
        return _checks.named(thing, thing.name)
    return type(thing).__name__


@dataclass_transform(
    frozen_default=True,
    eq_default=False,
    field_specifiers=(
        array, checked, choice, direction, field, flag, function, instance, number, one_of,
        rotation, settled, text, time_function, vector,
    ),
)  # fmt: skip
def declared(cls: type | None = None, *, eq: bool = False) -> Any:
    """Make a frozen dataclass whose fields are checked; ``eq`` compares by values."""
    if cls is None:
        return lambda kind: declared(kind, eq=eq)
    if "__post_init__" in vars(cls) or not hasattr(cls, "_field_checks"):
        _check_first(cls)
    dataclass(frozen=True, eq=eq)(cls)
    found = [(one.name, one.metadata["check"]) for one in fields(cls) if "check" in one.metadata]
    cls._field_checks = tuple(found)  # type: ignore[attr-defined]
    stored, accepted = inspect.get_annotations(cls), cls.__init__.__annotations__  # type: ignore[misc]
    for name, one in cls.__dataclass_fields__.items():  # type: ignore[attr-defined]
        if get_origin(one.type) is Given:
            accepted[name], kept = get_args(one.type)
            if name in stored:
                stored[name] = kept
        elif isinstance(one.type, InitVar):
            accepted[name] = one.type.type
            if vars(cls).get(name) is not None:  # None is left for `replace`, which reads it
                delattr(cls, name)
    cls.__annotations__ = stored
    return cls


def _check_first(cls: type) -> None:
    """Have the fields of new objects checked before its own ``__post_init__``.

    All fields are checked once, whatever bases its own one calls.
    """
    own: Callable[..., None] | None = getattr(cls, "__post_init__", None)

    def check_first(self: Any, *given: Any) -> None:
        outer = type(self).__post_init__
        if outer is check_first or not hasattr(outer, "checks_fields"):
            owner = owner_of(self)
            for name, check in self._field_checks:
                value = getattr(self, name)
                found = check(owner, name, value)
                if found is not value:
                    object.__setattr__(self, name, found)
        if own is not None:
            own(self, *given)

    check_first.checks_fields = True  # type: ignore[attr-defined]
    cls.__post_init__ = check_first  # type: ignore[attr-defined]
