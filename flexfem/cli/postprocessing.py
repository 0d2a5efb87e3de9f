# SPDX-License-Identifier: LGPL-3.0-or-later
"""Commands that make pictures: the shipped scripts, and libraries that may be missing."""

import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

from flexfem import launch
from flexfem.cli.usage import UsageError
from flexfem.resources import load_module, shipped_folder

__all__ = ["made_files", "print_files", "script"]

#: Packages of the extra "post".
_EXTRA = ("imageio", "imageio_ffmpeg", "matplotlib", "pyvista", "vtk", "vtkmodules", "PIL")


def script(name: str) -> ModuleType:
    """Load a script of postprocess/; it finds the others there as if started by itself.

    Raises:
        UsageError: This installation lacks them, or a library they need.
    """
    try:
        folder = shipped_folder("postprocess")
    except FileNotFoundError as error:
        raise UsageError(str(error)) from error
    if str(folder) not in sys.path:
        sys.path.append(str(folder))
    try:
        return load_module(folder / f"{name}.py", "flexfem_postprocess")
    except ImportError as error:
        raise _missing(error) from error


def print_files(make: Callable[[], list[Path]]) -> int:
    """Make pictures on the first rank and print their names; returns the exit code.

    Raises:
        UsageError: Results or options cannot be used, on all ranks.
    """
    for file in made_files(make):
        launch.say(str(file))
    return 0


def made_files(make: Callable[[], list[Path]]) -> list[Path]:
    """Make pictures on the first rank; returns their files there, none on other ranks.

    Raises:
        UsageError: Results or options cannot be used, on all ranks.
    """
    message, files = "", []
    if launch.rank() == 0:
        try:
            files = make()
        except UsageError as error:
            message = str(error)
        except ImportError as error:
            told = _missing(error)
            if not isinstance(told, UsageError):
                raise
            message = str(told)
        except (OSError, ValueError) as error:
            message = str(error) or type(error).__name__
    message = launch.first_message(message)
    if message:
        raise UsageError(message, agreed=True)
    return files


def _missing(error: ImportError) -> Exception:
    """One line for a library that is not installed; other errors of imports are not changed."""
    library = (error.name or "").partition(".")[0]
    if library not in _EXTRA and not isinstance(error, ModuleNotFoundError):
        return UsageError(f"cannot draw here, {error}")  # a library of the system
    if library not in _EXTRA:
        return error
    return UsageError(
        f"this command needs {library}, which is not installed: pip install 'flexfem[post]'"
    )
