# SPDX-License-Identifier: LGPL-3.0-or-later
"""Imports of other packages with one line about a missing one, and imports without delay."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from types import ModuleType

__all__ = ["InstallationError", "missing", "one_line", "require", "without_collection"]


class InstallationError(ImportError):
    """A package that flexfem needs is missing, or of a kind that it cannot work with.

    All ranks find the same. The message is one line with the package to install.
    """


def require(name: str) -> ModuleType:
    """Import a package that flexfem needs.

    Raises:
        InstallationError: it is missing, or a shared library that it needs is.
    """
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        if error.name != name.split(".")[0]:
            raise InstallationError(f"{name} cannot be imported: {one_line(error)}") from error
        raise missing(error.name) from error
    except (ImportError, OSError, RuntimeError) as error:
        raise InstallationError(
            f"{name} cannot be imported: {one_line(error)} (a shared library that it needs is "
            "missing or of another version)"
        ) from error


def missing(name: str) -> InstallationError:
    """The error for a package that is not installed."""
    return InstallationError(
        f"{name} is not installed, but required: pip install {name}, or its package of conda-forge "
        "or Debian"
    )


def one_line(error: BaseException) -> str:
    """The message of an error in one line."""
    return " ".join(str(error).split())


@contextmanager
def without_collection() -> Iterator[None]:
    """Context without Python's search for garbage, where nearly all new objects stay.

    It looks through all objects again and again while their number grows: imports and the
    compilation of loops make several hundred thousand, and hardly any garbage.
    """
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            gc.enable()
