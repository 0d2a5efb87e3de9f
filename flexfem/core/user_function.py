# SPDX-License-Identifier: LGPL-3.0-or-later
"""Plain Python functions of the user's that are compiled into the loops over rows."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import Any

import numpy as np

from flexfem import _checks
from flexfem._faults import FAILURES, ReturnError, located
from flexfem._types import FloatArray
from flexfem.core.curves.curve import Curve

__all__ = ["MOST_PARAMETERS", "FunctionKind", "UserFunction"]

#: Rows have room for as many parameters of a function.
MOST_PARAMETERS = 8


class FunctionKind(IntEnum):
    """Kinds of users' functions."""

    #: speed -> coefficient of friction or friction force
    SPEED = 1
    #: x, v, t, parameters -> force; the last two may be left out
    FORCE = 2
    #: p, R, parameters -> number or tuple of numbers; the last may be left out
    POSE = 3
    #: x, v -> force; the last may be left out
    CURVE = 4


_NEEDED = {
    FunctionKind.SPEED: 1,
    FunctionKind.FORCE: 2,
    FunctionKind.POSE: 2,
    FunctionKind.CURVE: 1,
}
_WORDS = {
    FunctionKind.SPEED: ("speed",),
    FunctionKind.FORCE: ("x", "v", "t", "parameters"),
    FunctionKind.POSE: ("p", "R", "parameters"),
    FunctionKind.CURVE: ("x", "v"),
}


@dataclass(frozen=True, eq=False)
class UserFunction:
    """A function with its parameters; see :class:`FunctionKind` for its arguments.

    Attributes:
        owner: class and name of the joint, with which messages begin.
        what: field of the joint that holds it.
        function: defined by ``def`` or ``lambda``, so that it can be compiled.
        kind: its arguments, `FunctionKind`.
        parameters: numbers that are handed to it; they can differ where the function is the same.
    """

    owner: str
    what: str
    function: Callable[..., Any]
    kind: FunctionKind
    parameters: tuple[float, ...] = ()

    @classmethod
    def checked(
        cls,
        owner: str,
        what: str,
        function: object,
        kind: FunctionKind,
        parameters: Sequence[float] = (),
    ) -> UserFunction:
        """A function or a `Curve`, after checks of its arguments and parameters; it is not called.

        Raises:
            TypeError: it is no plain function, or parameters are no numbers.
            ValueError: it takes other arguments, or there are too many parameters.
        """
        _checks.instance(owner, "parameters", parameters, (list, tuple))
        if len(parameters) > MOST_PARAMETERS:
            raise ValueError(
                f"{owner}: parameters must be at most {MOST_PARAMETERS} numbers, got "
                f"{len(parameters)}"
            )
        numbers = [_checks.number(owner, "parameters", value) for value in parameters]
        if isinstance(function, Curve):
            function = function.function
        if not inspect.isfunction(function):
            raise TypeError(
                f"{owner}: {what} must be a function made by def or lambda, got "
                f"{_checks.show(function)}"
            )
        made = cls(owner, what, function, kind, tuple(numbers))
        names, needed = _WORDS[kind], _NEEDED[kind]
        if made.count < needed or made.count > len(names):
            forms = ", ".join(names[:needed]) + "".join(f"[, {name}]" for name in names[needed:])
            raise ValueError(
                f"{owner}: {what} must be a function of ({forms}), got one of {made.count} "
                "arguments"
            )
        return made

    @property
    def count(self) -> int:
        """Number of arguments it takes; -1 if it takes any number, or keywords."""
        kinds = [one.kind for one in inspect.signature(self.function).parameters.values()]
        plain = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
        return len(kinds) if all(kind in plain for kind in kinds) else -1

    @property
    def place(self) -> str:
        """Its name, file and line."""
        code = self.function.__code__
        name = "lambda" if code.co_name == "<lambda>" else code.co_name
        return f"{name} ({Path(code.co_filename).name}, line {code.co_firstlineno})"

    def __call__(self, *arguments: object) -> FloatArray:
        """Its values (n,) as Python computes them, for checks.

        Args:
            arguments: all but the parameters; those that it does not take are left out.

        Raises:
            ReturnError: it does not return a number, or a tuple of numbers for a function of poses.
            Exception: whatever it raises.
        """
        given = (*arguments, self.parameters)[: self.count]
        values = self.function(*given)
        several = self.kind is FunctionKind.POSE and isinstance(values, tuple)
        listed = values if several else (values,)
        if not listed:
            raise ReturnError("returned no number")
        return np.array([_checks.returned_number(self.what, value) for value in listed])

    def tried(self, *arguments: object) -> FloatArray:
        """The same; an exception becomes one line that names the function and its place.

        Raises:
            ValueError: it fails, or does not return finite numbers.
        """
        try:
            return self(*arguments)
        except FAILURES as error:
            place = located(self.function, error)
            raise ValueError(f"{self.owner}: {self.what}: {place}") from error
