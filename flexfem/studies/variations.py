# SPDX-License-Identifier: LGPL-3.0-or-later
"""Variations of options in a study."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from flexfem._files import number_in
from flexfem.options import Option, VectorOption, meant, value_text

__all__ = ["combinations", "parse_variation"]

#: Significant digits of values between two ends: 0.3, not 0.30000000000000004.
_DIGITS = 12
_TRUTH = {"yes": True, "true": True, "no": False, "false": False}
#: Number of runs above which a range was probably mistyped.
_MOST = 100_000
#: Number of values of a range.
_COUNT = Option("count", int, 2, "of values")


def parse_variation(text: str, options: Mapping[str, Option]) -> tuple[str, list[Any]]:
    """Read ``option=a,b,c``; numbers may be ranges ``start:stop:count`` or with ``:log``.

    Vectors are separated by semicolons, ``gravity=0,0,-9.81;0,0,-1.62``.

    Args:
        text: as it was typed.
        options: that may be varied, by name; also components of vectors, ``gravity[2]``.

    Returns:
        The option's name, and its values.

    Raises:
        ValueError: There is no such option, or a value is not admissible.
    """
    name, equals, values = text.partition("=")
    name = name.strip().removeprefix("--").replace("-", "_")
    separator = ";" if isinstance(options.get(name), VectorOption) else ","
    if not equals or not name:
        raise ValueError(f"'{text}' is not of the form option=a,b,c or option=start:stop:count")
    if name not in options:
        hint = meant(name, options) or f"known are {', '.join(options)}"
        raise ValueError(f"no option '{name}', {hint}")
    option = options[name]
    found: list[Any] = []
    for item in values.split(separator):
        ranged = option.kind in (int, float) and ":" in item
        try:
            found += _range(item, option) if ranged else [_value(item.strip(), option)]
        except ValueError as error:
            raise ValueError(f"{name} {error}") from None
    return name, found


def _value(text: str, option: Option) -> Any:
    if option.kind is not bool:
        return option.parse(text)
    if text.lower() not in _TRUTH:
        raise ValueError(f"must be yes or no, got '{text}'")
    return _TRUTH[text.lower()]


def _range(text: str, option: Option) -> list[Any]:
    """Numbers from start to stop, evenly spaced or by a constant factor."""
    first, last, count, *how = text.split(":") + [""] * (2 - text.count(":"))
    try:
        ends, number = (number_in(first), number_in(last)), _COUNT.parse(count)
    except ValueError:
        raise ValueError(f"range must be start:stop:count or with :log, got '{text}'") from None
    if how not in ([], ["log"]) or number < 2 or not all(map(math.isfinite, ends)):
        raise ValueError(f"range must be start:stop:count or with :log, count > 1, got '{text}'")
    if number > _MOST:
        raise ValueError(f"range '{text}' has more than {_MOST} values")
    if how and min(ends) <= 0.0:
        raise ValueError(f"range '{text}': ends must be above 0 with log")
    values = (np.geomspace if how else np.linspace)(*ends, number)
    return [_rounded(value, option, text) for value in values.tolist()]


def _rounded(value: float, option: Option, text: str) -> Any:
    value = float(f"{value:.{_DIGITS}g}")
    if option.kind is int:
        if value != round(value):
            raise ValueError(f"range '{text}' has {value:g}, which must be {option.describe()}")
        return option.parse(str(round(value)))
    return option.parse(repr(value))


def combinations(varied: Mapping[str, Sequence[Any]], together: bool) -> list[dict[str, Any]]:
    """Values by option, for each run.

    Args:
        varied: values of each option.
        together: the first values of all, then the second ones, and so on; else each with each.

    Raises:
        ValueError: Nothing to vary, a value that comes twice, or numbers of values that differ.
    """
    if not varied:
        raise ValueError("nothing to vary, give options and their values")
    for name, values in varied.items():
        if not len(values):
            raise ValueError(f"no values of {name}")
    if together:
        counts = {name: len(values) for name, values in varied.items()}
        if len(set(counts.values())) > 1:
            told = ", ".join(f"{count} of {name}" for name, count in counts.items())
            raise ValueError(f"values that vary together must be as many: {told}")
        rows = list(zip(*varied.values(), strict=True))
    else:
        if math.prod(map(len, varied.values())) > _MOST:
            raise ValueError(f"more than {_MOST} runs")
        rows = list(itertools.product(*varied.values()))
    seen = set()
    for row in rows:
        if row in seen:
            told = ", ".join(f"{n}={value_text(v)}" for n, v in zip(varied, row, strict=True))
            raise ValueError(f"{told} comes twice")
        seen.add(row)
    return [dict(zip(varied, row, strict=True)) for row in rows]
