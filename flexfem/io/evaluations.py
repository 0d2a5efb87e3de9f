# SPDX-License-Identifier: LGPL-3.0-or-later
"""Evaluations of an optimisation as lines of JSON: each is there as soon as it is known."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from flexfem._checks import InputError, show
from flexfem._files import read_text, replace_file
from flexfem._types import FloatArray

__all__ = ["Evaluation", "append_evaluation", "read_evaluations", "write_evaluations"]

#: Bytes of a file beyond which it must be something else.
_LARGEST = 1 << 30


class Evaluation(NamedTuple):
    """Functions of parameters at a point.

    Attributes:
        at: parameters, (n,).
        values: of all functions, (k,).
        slopes: their derivatives, (k, n).
    """

    at: FloatArray
    values: FloatArray
    slopes: FloatArray


def write_evaluations(path: Path, names: Sequence[str], rows: Sequence[Evaluation]) -> None:
    """Write names of the functions and evaluations, replacing an earlier file as a whole.

    Raises:
        OSError: the file cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = [json.dumps({"functions": list(names)}) + "\n", *map(_line, rows)]
    replace_file(path, [line.encode() for line in lines])


def append_evaluation(path: Path, row: Evaluation) -> None:
    """Add an evaluation to a file.

    Raises:
        OSError: the file cannot be written.
    """
    with path.open("a", encoding="utf-8") as stream:
        stream.write(_line(row))


def read_evaluations(path: Path) -> tuple[list[str], list[Evaluation]]:
    """Names of the functions and all evaluations; a last line that was not finished is left out.

    Raises:
        InputError: the file cannot be read, or holds something else.
    """
    owner = f"optimisation '{path}'"
    head, *lines = read_text(owner, path, _LARGEST).split("\n")[:-1] or [""]
    try:
        names = json.loads(head)["functions"]
        if not isinstance(names, list) or not all(isinstance(one, str) for one in names):
            raise TypeError
        rows = [_evaluation(json.loads(line), len(names)) for line in lines]
        if len({len(row.at) for row in rows}) > 1:
            raise TypeError
    except (KeyError, TypeError, ValueError, RecursionError, OverflowError):
        raise InputError(
            f"{owner}: it holds no evaluations of an optimisation, its first line is {show(head)}"
        ) from None
    return names, rows


def _line(row: Evaluation) -> str:
    return json.dumps([one.tolist() for one in row]) + "\n"


def _evaluation(found: Any, count: int) -> Evaluation:
    """A line as arrays.

    Raises:
        TypeError, ValueError, OverflowError: it is something else.
    """
    at, values, slopes = (np.array(one, dtype=np.float64) for one in found)
    if at.ndim != 1 or values.shape != (count,) or slopes.shape != (count, len(at)):
        raise TypeError
    if not all(np.isfinite(one).all() for one in (at, values, slopes)):
        raise ValueError
    return Evaluation(at, values, slopes)
