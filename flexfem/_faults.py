# SPDX-License-Identifier: LGPL-3.0-or-later
"""Errors from outside flexfem during a run: functions of the user's, and files.

A function of the user's may fail on one rank only, while the others wait for it in a collective
call. So whoever calls one notes the exception and continues with nan, which makes the step fail on
all ranks alike; the driver then ends the run in good order and raises the noted exception.
"""

import sysconfig
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import partial
from pathlib import Path
from types import CodeType
from typing import Any

__all__ = [
    "FAILURES",
    "Faults",
    "FunctionError",
    "ReturnError",
    "current",
    "located",
    "mistake",
    "noted",
    "watched",
    "where",
]

#: Exceptions that a function of the user's may raise; ``sys.exit`` in it must not end one rank
#: alone.
FAILURES = (Exception, SystemExit)

_PACKAGE = Path(__file__).resolve().parent
#: Folders whose code is not the user's.
_FOREIGN = [str(_PACKAGE), *(sysconfig.get_path(name) for name in ("stdlib", "purelib", "platlib"))]
#: Shipped cases lie in the package once it is installed.
_CASES = str(_PACKAGE / "cases")


class FunctionError(RuntimeError):
    """A function of the user's failed during a run; results until then are written.

    Attributes:
        trace: Python's traceback as text, empty if there is none.
        outcome: result of the run until then, an ``Outcome``; None if unknown.
    """

    outcome: Any = None

    def __init__(self, message: str, trace: str = "") -> None:
        """Keep the line for the user, and the traceback."""
        super().__init__(message, trace)
        self.trace = trace

    def __str__(self) -> str:
        """The line."""
        return str(self.args[0])


class ReturnError(ValueError):
    """A function of the user's returned something else than it must."""


class Faults:
    """Errors of one run on this rank, with the first one kept, and its outcome.

    Attributes:
        error: the first exception, None without any.
        outcome: result of the run, an ``Outcome``, once it is known.
    """

    def __init__(self) -> None:
        """Nothing went wrong yet."""
        self.error: Exception | None = None
        self.outcome: Any = None

    def note(self, error: Exception) -> None:
        """Keep an exception, if it is the first."""
        self.error = self.error or error

    @contextmanager
    def files(self) -> Iterator[None]:
        """Keep an error of the files that are written within."""
        try:
            yield
        except OSError as error:
            self.note(error)


_RUN: ContextVar[Faults | None] = ContextVar("flexfem run", default=None)


@contextmanager
def watched() -> Iterator[Faults]:
    """Collect the faults noted within."""
    faults = Faults()
    token = _RUN.set(faults)
    try:
        yield faults
    finally:
        _RUN.reset(token)


def current() -> Faults:
    """Faults of the current run; outside of runs a record that nobody reads."""
    return _RUN.get() or Faults()


def noted(owner: str, function: object, error: BaseException) -> None:
    """Note that a function of the user's failed.

    Args:
        owner: owner of the function, with its name in quotes.
        function: the function.
        error: the exception raised, or the error in the returned value.

    Raises:
        FunctionError: outside of a run.
    """
    faults = _RUN.get()
    if faults is not None and faults.error is not None:
        return
    trace = "".join(traceback.format_exception(error))
    failure = FunctionError(f"{owner}: {located(function, error)}", trace)
    failure.__cause__ = error
    if faults is None:
        raise failure
    faults.note(failure)


def mistake(error: BaseException) -> str:
    """Return one line about an error in a user's file that builds a model.

    Messages of flexfem, and those that shipped cases raise, stay as they are.

    Raises:
        BaseException: the error itself, if no line of the user's has to do with it.
    """
    place, files = (
        where(error),
        [frame.filename for frame in traceback.extract_tb(error.__traceback__)],
    )
    own = max((k for k, file in enumerate(files) if _is_own(file)), default=-1)
    ours = max((k for k, file in enumerate(files) if file.startswith(_FOREIGN[0])), default=-1)
    told = isinstance(error, (ImportError, OSError, TypeError, ValueError))
    if told and (ours > own or _is_shipped(files[own])):
        return str(error) or type(error).__name__
    if not place:
        raise error
    return located(None, error)


def _is_shipped(file: str) -> bool:
    """Return True if a file is a shipped case, beside the package in a source tree."""
    return Path(file).parent in (_PACKAGE / "cases", _PACKAGE.parent / "cases")


def located(function: object, error: BaseException) -> str:
    """In one line where a function of the user's failed, and why."""
    why, place = " ".join(str(error).split()), where(error)
    if not place and type(error) in (ValueError, RuntimeError):
        return why  # messages of flexfem about its own laws
    place = place or _place_of(function)
    if isinstance(error, ReturnError):
        return f"{why}, from {place}"
    if isinstance(error, SystemExit):
        return f"{place}: sys.exit({error.code!r})"
    if isinstance(error, ImportError) and "libmpi" in why:  # the wheels of DOLFINx bring one
        why = f"{why}: import dolfinx_solver before dolfinx"
    kind = type(error).__name__
    return f"{place}: {kind}: {why}" if why else f"{place}: {kind}"


def where(error: BaseException) -> str:
    """Function and place of the user's innermost line that raised an error; empty without one."""
    frames = [
        (frame.f_code, line)
        for frame, line in traceback.walk_tb(error.__traceback__)
        if _is_own(frame.f_code.co_filename)
    ]
    return _words(*frames[-1]) if frames else ""


def _is_own(file: str) -> bool:
    """Return True if a file of code is the user's."""
    return file.startswith(_CASES) or not file.startswith(("<frozen", *_FOREIGN))


def _place_of(function: object) -> str:
    """Name and place of a function that was never entered, or that returned something wrong."""
    while isinstance(function, partial):
        function = function.func
    function = getattr(function, "__func__", function)  # of a method
    code = getattr(function, "__code__", None)
    if code is None:
        code = getattr(type(function).__call__, "__code__", None)
    return type(function).__name__ if code is None else _words(code, code.co_firstlineno)


def _words(code: CodeType, line: int) -> str:
    known = {"<lambda>": "lambda", "<module>": "the file"}
    name = known.get(code.co_name, code.co_name)
    return f"{name} ({Path(code.co_filename).name}, line {line})"
