# SPDX-License-Identifier: LGPL-3.0-or-later
"""Functions of users that are compiled by numba."""

import math
from collections.abc import Callable
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any

import numpy as np
from numba import njit
from numba.core.errors import NumbaError

from flexfem.kernels.caching import install

__all__ = ["compiled_law", "not_compiled", "self_contained"]

install()


def compiled_law(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function, compiled at its first call; a division by zero gives inf or NaN.

    It is kept on disk if nothing but its own file says what it does, see :func:`self_contained`.
    Calls raise a TypeError in one line if it does not compile.
    """
    kept = self_contained(function)
    source = _at_home(function) if kept else function
    compiled: Callable[..., Any] = njit(error_model="numpy", cache=kept)(source)

    def call(*arguments: Any) -> Any:
        try:
            return compiled(*arguments)
        except NumbaError as error:
            raise TypeError(not_compiled(function, error)) from None

    return call


def _at_home(function: Callable[..., Any]) -> Callable[..., Any]:
    """A copy that belongs to this module.

    What numba keeps imports the function's module, which has another name in another program.
    """
    assert isinstance(function, FunctionType)
    copy = FunctionType(
        function.__code__, function.__globals__, function.__name__, function.__defaults__
    )
    copy.__kwdefaults__, copy.__module__ = function.__kwdefaults__, __name__
    return copy


def self_contained(function: Callable[..., Any]) -> bool:
    """True if all that a function of a file names are NumPy, ``math`` and builtins.

    numba keeps compiled functions until their file changes, and would not notice a new value of
    something else that they name or enclose.
    """
    if not isinstance(function, FunctionType) or function.__closure__:
        return False
    if not Path(function.__code__.co_filename).is_file() or function.__name__ == "<lambda>":
        return False
    named = (function.__globals__.get(name) for name in _names(function.__code__))
    return all(value is None or value in (np, math) for value in named)


def _names(code: CodeType) -> set[str]:
    """Names that code, and functions in it, look up; attributes among them."""
    inner = (_names(x) for x in code.co_consts if isinstance(x, CodeType))
    return set(code.co_names).union(*inner)


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
