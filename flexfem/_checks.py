# SPDX-License-Identifier: LGPL-3.0-or-later
"""Checks of user input that answer with one line naming the object and the value.

Every function takes the `owner` (for example ``Beam "rod_1"``) and the `what` (for example
``damping``) it reports on, and returns the checked value in the form the package stores. Arrays
come back as read-only copies, so that a frozen object stays as it was checked.
"""

from collections.abc import Callable, Sequence
from math import isfinite
from typing import Any

import numpy as np
import numpy.typing as npt

from flexfem._faults import FAILURES, ReturnError, located
from flexfem._types import FloatArray, IntArray

# Rotation matrices typed with six digits are accepted and made orthonormal
_ROTATION_TOLERANCE = 1e-6
# Rotation matrices that differ from orthonormal ones by less are left as they are
_ROUNDING = 1e-15
# Axes of whatever is not rotated
_IDENTITY = np.eye(3)
_IDENTITY.setflags(write=False)
# Numbers of an array that are looked at one by one
_FEW = 9
# Whole numbers that arrays are counted by lie below
_COUNTS = 2**63
# Directions whose length can be squared
_SHORTEST, _LONGEST = 1e-150, 1e150


class InputError(ValueError):
    """Wrong input that all ranks notice, before anything is computed or written.

    Attributes:
        alone: this rank noticed it, and others did not come to the same end.
    """

    alone: bool = False


class NumericalError(ArithmeticError):
    """A computation that came to nothing where a model is being made; the same on all ranks."""


def show(value: object, length: int = 72) -> str:
    """Return `value` on one line, shortened to about `length` characters."""
    try:
        text = " ".join(repr(value).split())
    except ValueError:  # Python writes no integer of more than 4300 digits
        text = "an integer of thousands of digits"
    return text if len(text) <= length else text[: length - 3] + "..."


def assign(target: object, **fields: Any) -> None:
    """Set attributes of a frozen dataclass from inside its constructor."""
    for name, value in fields.items():
        object.__setattr__(target, name, value)


def freeze(values: npt.ArrayLike, dtype: npt.DTypeLike = np.float64) -> npt.NDArray[Any]:
    """Return a read-only, C-ordered copy of `values`."""
    copy = np.array(values, dtype=dtype, order="C")
    copy.setflags(write=False)
    return copy


def text(owner: str, what: str, value: object) -> str:
    """Return a non-empty printable string.

    Raises:
        TypeError: `value` is not a string.
        ValueError: `value` is empty, has surrounding blanks, control characters or quotes.
    """
    if not isinstance(value, str):
        raise TypeError(f"{owner}: {what} must be a string, got {show(value)}")
    if not value or value != value.strip() or not value.isprintable() or '"' in value:
        raise ValueError(
            f"{owner}: {what} must be a non-empty printable string without quotes or "
            f"surrounding blanks, got {show(value)}"
        )
    return value


def word(owner: str, what: str, value: object, words: Sequence[str]) -> str:
    """Return a word that is one of those known.

    Raises:
        TypeError: `value` is not a string.
        ValueError: It is none of `words`.
    """
    found = text(owner, what, value)
    if found not in words:
        known = " or ".join(f'"{one}"' for one in words)
        raise ValueError(f"{owner}: {what} must be {known}, got {show(found)}")
    return found


def named(thing: object, name: object) -> str:
    """Return class and quoted name of `thing`, the owner of its messages, and check the name."""
    kind = type(thing).__name__
    return f'{kind} "{text(kind, "name", name)}"'


def number(
    owner: str,
    what: str,
    value: object,
    *,
    positive: bool = False,
    nonnegative: bool = False,
    nonzero: bool = False,
) -> float:
    """Return a finite real number, positive, non-negative or not zero on demand.

    Raises:
        TypeError: `value` is not a real number.
        ValueError: `value` is NaN, infinite or has the wrong sign.
    """
    if isinstance(value, (bool, np.bool_)) or not isinstance(
        value, (int, float, np.integer, np.floating)
    ):
        raise TypeError(f"{owner}: {what} must be a number, got {show(value)}")
    try:
        result = float(value)
    except OverflowError:  # an integer beyond 1.8e308
        result = np.inf
    if not np.isfinite(result):
        raise ValueError(f"{owner}: {what} must be finite, got {show(value)}")
    if positive and result <= 0.0:
        raise ValueError(f"{owner}: {what} must be positive, got {show(value)}")
    if nonnegative and result < 0.0:
        raise ValueError(f"{owner}: {what} must not be negative, got {show(value)}")
    if nonzero and result == 0.0:
        raise ValueError(f"{owner}: {what} must not be zero, got {show(value)}")
    return result


def array(owner: str, what: str, value: object, shape: tuple[int, ...]) -> FloatArray:
    """Return a read-only array of finite numbers of the given shape (-1: any extent).

    Raises:
        TypeError: `value` does not consist of real numbers.
        ValueError: `value` has another shape, or holds NaN or infinite numbers.
    """
    try:
        raw = np.asarray(value)
    except ValueError:  # ragged nesting
        raise ValueError(_not_numbers(owner, what, value, shape)) from None
    if raw.dtype.kind not in "iuf":
        raise TypeError(_not_numbers(owner, what, value, shape))
    # equal shapes first: sections along beams are many
    if raw.shape != shape and (
        raw.ndim != len(shape)
        or any(want not in (-1, extent) for want, extent in zip(shape, raw.shape, strict=True))
    ):
        raise ValueError(_not_numbers(owner, what, value, shape))
    _refuse_masks(owner, what, value)
    # calls of NumPy take long for the few numbers that most arrays of a model hold
    few = raw.size <= _FEW
    if not (all(map(isfinite, raw.ravel().tolist())) if few else np.isfinite(raw).all()):
        raise ValueError(f"{owner}: {what} must be finite, got {show(value)}")
    return freeze(raw)


def _refuse_masks(owner: str, what: str, value: object) -> None:
    """Refuse entries that are masked: NumPy gives the numbers that their mask hides.

    Raises:
        ValueError: there is one.
    """
    if isinstance(value, np.ma.MaskedArray) and np.ma.is_masked(value):
        raise ValueError(f"{owner}: {what} must have no masked entries, got {show(value)}")


def _not_numbers(owner: str, what: str, value: object, shape: tuple[int, ...]) -> str:
    """Return the message about a value that is no array of a shape; on failure only: it is slow."""
    wanted = " x ".join("n" if extent < 0 else str(extent) for extent in shape)
    return f"{owner}: {what} must hold {wanted} numbers, got {show(value)}"


def indices(owner: str, what: str, values: object, limit: int, columns: int) -> IntArray:
    """Return an array of indices below a limit, shape (n, columns), or (n,) for one column.

    Raises:
        TypeError: `values` does not consist of whole numbers.
        ValueError: `values` has another shape, or an index is out of range.
    """
    try:
        raw = np.asarray(values)
    except ValueError:  # ragged nesting
        raise ValueError(f"{owner}: {what} must be indices, got {show(values)}") from None
    _refuse_masks(owner, what, values)
    if raw.size == 0:
        raw = np.empty((0, columns)[: 1 if columns == 1 else 2], dtype=np.int64)
    if raw.dtype.kind not in "iu":
        raise TypeError(f"{owner}: {what} must be whole numbers, got {show(values)}")
    if raw.shape[1:] != (() if columns == 1 else (columns,)):
        raise ValueError(f"{owner}: {what} must hold n x {columns} indices, got {show(values)}")
    outside = (raw < 0) | (raw >= limit)
    if outside.any():
        raise ValueError(
            f"{owner}: {what} must lie in 0 to {limit - 1}, got {raw[outside].flat[0]}"
        )
    return raw.astype(np.int64)


def vector(owner: str, what: str, value: object, *, nonzero: bool = False) -> FloatArray:
    """Return a read-only vector of three finite numbers; on demand it is a direction.

    Raises:
        TypeError: `value` does not consist of real numbers.
        ValueError: `value` has another shape, holds NaN or infinite numbers, or is a direction that
            is zero, or so short or long that the square of its length is no number.
    """
    result = array(owner, what, value, (3,))
    if nonzero and not result.any():
        raise ValueError(f"{owner}: {what} must not be zero, got {show(value)}")
    if nonzero and not _SHORTEST < np.abs(result).max() < _LONGEST:
        raise ValueError(
            f"{owner}: {what} must be of a length between {_SHORTEST:g} and {_LONGEST:g}, got "
            f"{show(value)}"
        )
    return result


def rotation(owner: str, what: str, value: object) -> FloatArray:
    """Return a read-only rotation matrix, the identity for None.

    Entries rounded to six digits are accepted: the closest rotation matrix is returned.

    Raises:
        TypeError: `value` does not consist of real numbers.
        ValueError: `value` is not 3 x 3, not finite, not orthonormal, or a reflection.
    """
    if value is None:
        return _IDENTITY
    matrix = array(owner, what, value, (3, 3))
    defect = np.abs(matrix.T @ matrix - _IDENTITY).max()
    if defect > _ROTATION_TOLERANCE or np.linalg.det(matrix) < 0.0:
        raise ValueError(f"{owner}: {what} must be a rotation matrix, got {show(value)}")
    return matrix if defect <= _ROUNDING else orthonormal(matrix[np.newaxis])[0]


def orthonormal(matrices: FloatArray) -> FloatArray:
    """Return the closest rotation matrices to (n, 3, 3) that nearly are some, read-only."""
    found = matrices.copy()
    defects = np.abs(np.swapaxes(found, 1, 2) @ found - _IDENTITY).max(axis=(1, 2))
    rounded = defects > _ROUNDING
    u, _, vt = np.linalg.svd(found[rounded])
    found[rounded] = u @ vt
    return freeze(found)


def instance(owner: str, what: str, value: object, kinds: type | tuple[type, ...]) -> None:
    """Check the type of `value`; a truth value is no whole number.

    Raises:
        TypeError: `value` is none of `kinds`.
        ValueError: `value` is a whole number of more than 64 bits, which counts nothing.
    """
    if kinds is int and (isinstance(value, bool) or not isinstance(value, int)):
        raise TypeError(f"{owner}: {what} must be a whole number, got {show(value)}")
    if isinstance(value, int):
        countable(owner, what, value)
    if not isinstance(value, kinds):
        names = [kind.__name__ for kind in (kinds if isinstance(kinds, tuple) else (kinds,))]
        raise TypeError(f"{owner}: {what} must be a {' or '.join(names)}, got {show(value)}")


def count(owner: str, what: str, value: Any, least: int) -> int:
    """Return a whole number that is no truth value.

    Raises:
        TypeError: `value` is none.
        ValueError: it is less than `least`, or has more than 64 bits.
    """
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)):
        raise TypeError(f"{owner}: {what} must be a whole number, got {show(value)}")
    if value < least:
        raise ValueError(f"{owner}: {what} must be at least {least}, got {show(value)}")
    countable(owner, what, int(value))
    return int(value)


def countable(owner: str, what: str, value: int) -> None:
    """Check that arrays can be counted by a whole number.

    Raises:
        ValueError: it has more than 64 bits.
    """
    if not -_COUNTS <= value < _COUNTS:
        raise ValueError(f"{owner}: {what} must be a whole number of 64 bits, got {show(value)}")


def function(owner: str, what: str, value: object, shape: tuple[int, ...]) -> None:
    """Check a function of time by its value at t = 0.

    Raises:
        TypeError: `value` cannot be called.
        ValueError: it fails at t = 0, or its value there does not have the given shape or is not
            finite.
    """
    if not callable(value):
        raise TypeError(f"{owner}: {what} must be a function of time, got {show(value)}")
    try:
        start = value(0.0)
    except FAILURES as error:
        raise ValueError(f"{owner}: {what}: {located(value, error)}") from error
    if shape:
        array(owner, f"{what}(0)", start, shape)
    else:
        number(owner, f"{what}(0)", start)


def arguments(owner: str, what: str, function: Callable[..., Any], *names: str) -> None:
    """Check that a function can be called with so many arguments.

    Raises:
        TypeError: it takes others; functions whose arguments are unknown are let through.
    """
    from inspect import signature  # costs time where no function is checked

    try:
        taken = signature(function)
    except (TypeError, ValueError):  # written in C
        return
    try:
        taken.bind(*names)
    except TypeError:
        raise TypeError(
            f"{owner}: {what} must be a function of ({', '.join(names)}), got one of {taken}"
        ) from None


def numbers(value: object) -> FloatArray:
    """Return the array of numbers that a user's function has returned.

    NumPy makes numbers of text, and nan of None, which a function without ``return`` gives.

    Raises:
        TypeError: it consists of something else.
        ValueError: it is nested raggedly.
    """
    raw = np.asarray(value)
    if raw.dtype == np.float64:  # as of nearly all functions, which are called in every step
        return raw
    others = (str, bytes, type(None))
    if raw.dtype.kind not in "biufO" or any(isinstance(one, others) for one in _objects(raw)):
        raise TypeError(f"must be numbers, got {show(value)}")
    return raw.astype(np.float64, copy=False)


def _objects(raw: npt.NDArray[Any]) -> list[object]:
    return raw.ravel().tolist() if raw.dtype.kind == "O" else []


def returned(what: str, value: object, shape: tuple[int, ...]) -> FloatArray:
    """Numbers of the given shape that a function of the user's has returned in a run.

    Raises:
        ReturnError: It has returned something else.
    """
    try:
        values = numbers(value)
    except (TypeError, ValueError):
        raise ReturnError(f"{what} must return {_noun(shape)}, got {show(value)}") from None
    if not shape and values.size == 1:
        return values.reshape(())
    if values.shape != shape:
        raise ReturnError(f"{what} must return {_noun(shape)}, got shape {values.shape}")
    return values


def _noun(shape: tuple[int, ...]) -> str:
    return "a number" if not shape else f"{shape[0]} number" + "s" * (shape[0] > 1)


def returned_number(what: str, value: object) -> float:
    """The number that a function of the user's has returned in a run.

    Raises:
        ReturnError: It has returned something else.
    """
    return float(value) if isinstance(value, float) else float(returned(what, value, ()))


def stiffness_and_damping(owner: str, stiffness: object, damping: object) -> None:
    """Check the two numbers of a spring and damper.

    Raises:
        TypeError: one of them is not a number.
        ValueError: one of them is negative, or both are zero.
    """
    k = number(owner, "stiffness", stiffness, nonnegative=True)
    c = number(owner, "damping", damping, nonnegative=True)
    if k == 0.0 and c == 0.0:
        raise ValueError(f"{owner}: stiffness and damping must not both be zero")


def replaces(owner: str, what: str, **numbers: float) -> None:
    """Check that numbers that a function replaces are zero.

    Raises:
        ValueError: one of them is not.
    """
    for name, value in numbers.items():
        if value != 0.0:
            raise ValueError(f"{owner}: {what} takes the place of {name}, got {show(value)}")


def shaped_spring(owner: str, stiffness: float, preload: float, **shapes: float) -> None:
    """Check what makes a spring other than linear through zero against one another.

    Args:
        owner: owner of the spring in messages.
        stiffness: N/m or N m/rad.
        preload: force or moment at rest.
        **shapes: backlash, or a flag, by their names; not more than one of them may be set.

    Raises:
        ValueError: two that exclude each other, or one without stiffness.
    """
    names = [name for name, value in shapes.items() if value]
    given = [*names, *(["preload"] if preload else [])]
    if given and stiffness == 0.0:
        raise ValueError(f"{owner}: {given[0]} needs a stiffness, got 0.0")
    if len(names) > 1 or (preload and "backlash" in names):
        raise ValueError(f"{owner}: {' and '.join(given)} exclude each other, give one of them")
