# SPDX-License-Identifier: LGPL-3.0-or-later
"""Values of constants and of functions of places that users give for their bodies."""

from typing import Any

import numpy as np

from flexfem._checks import numbers, show
from flexfem._faults import FAILURES, ReturnError, located, noted
from flexfem._types import FloatArray

__all__ = ["present_values", "values_at"]


def values_at(
    owner: str, what: str, given: Any, arguments: tuple[Any, ...], shape: tuple[int, ...]
) -> FloatArray:
    """Values (k, ...) of a constant or of a function, with the owner in messages.

    Args:
        owner: of the function, with its name in quotes.
        what: name of the function.
        given: constant of the shape, or function.
        arguments: those of the function; the first are the places, (k,) or (k, 3).
        shape: of one value.

    Raises:
        TypeError: the function does not return numbers.
        ValueError: it fails or returns something else.
    """
    try:
        return _values(what, given, arguments, shape)
    except ReturnError as error:
        raise ValueError(f"{owner}: {error}") from None
    except FAILURES as error:
        raise ValueError(f"{owner}: {what}: {located(given, error)}") from error


def present_values(
    owner: str, what: str, given: Any, arguments: tuple[Any, ...], shape: tuple[int, ...]
) -> FloatArray:
    """The same in a run; nan where the function fails, which is noted.

    Raises:
        FunctionError: it fails outside of a run.
    """
    try:
        return _values(what, given, arguments, shape)
    except FAILURES as error:
        noted(owner, given, error)
        return np.full((len(arguments[0]), *shape), np.nan)


def _values(
    what: str, given: Any, arguments: tuple[Any, ...], shape: tuple[int, ...]
) -> FloatArray:
    """Values (k, ...) of a constant or of a function at k places.

    Raises:
        ReturnError: the function returns something else.
    """
    full = (len(arguments[0]), *shape)
    if not callable(given):
        return np.broadcast_to(given, full)
    values = numbers(given(*arguments))
    if values.shape not in (full, shape) or not np.isfinite(values).all():
        kind = "finite numbers" if values.shape in (full, shape) else f"shape {full} or {shape}"
        got = show(values.tolist())
        raise ReturnError(f"{what} must return {kind} for {full[0]} places, got {got}")
    return np.broadcast_to(values, full)
