# SPDX-License-Identifier: LGPL-3.0-or-later
"""Functions of users that are compiled by numba."""

from collections.abc import Callable
from types import FunctionType
from typing import Any

from numba import njit
from numba.core.errors import NumbaError

__all__ = ["compiled_law", "not_compiled"]


def compiled_law(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function, compiled at its first call; a division by zero gives inf or NaN.

    Calls raise a TypeError in one line if it does not compile.
    """
    compiled: Callable[..., Any] = njit(error_model="numpy")(function)

    def call(*arguments: Any) -> Any:
        try:
            return compiled(*arguments)
        except NumbaError as error:
            raise TypeError(not_compiled(function, error)) from None

    return call


def not_compiled(function: Callable[..., Any], error: Exception) -> str:
    """Reason in one line why a function does not compile, with its name, file and line."""
    assert isinstance(function, FunctionType)
    code = function.__code__
    lines = [line.strip() for line in str(error).splitlines()]
    file = code.co_filename.rsplit("/", 1)[-1]
    number = code.co_firstlineno
    for line in (line for line in lines if line.startswith("File ") and file in line):
        digits = "".join(c for c in line.rpartition("line ")[2] if c.isdigit())
        number = int(digits) if digits else number
    name = "lambda" if code.co_name == "<lambda>" else code.co_name
    why = next((line for line in lines if "No implementation" in line or "not " in line), "")
    said = " ".join((why or (lines[-1] if lines else type(error).__name__)).split())
    said = said.removesuffix(" found for signature:")[:160]
    return f"{name} ({file}, line {number}) cannot be compiled: {said}"
