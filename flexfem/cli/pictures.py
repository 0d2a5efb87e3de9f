# SPDX-License-Identifier: LGPL-3.0-or-later
"""Pictures and plots from Python: the commands, as functions."""

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from flexfem.cli import commands
from flexfem.cli.postprocessing import made_files
from flexfem.cli.usage import UsageError

__all__ = ["plot", "render"]


def render(*folders: str | Path, **options: Any) -> list[Path]:
    """Draw the motion in result folders, as ``flexfem render`` does.

    Args:
        *folders: of results.
        **options: those of the command, ``colour="von_mises"`` for ``--colour von_mises``,
            ``time=[0.1, 0.2]`` for ``--time 0.1,0.2``, and ``no_animation=True``.

    Returns:
        The files that were made; none on other ranks than the first.

    Raises:
        ValueError: Options or results cannot be used, or a library for pictures is missing; with
            the message of the command line.
    """
    return _made("render", folders, options)


def plot(*folders: str | Path, **options: Any) -> list[Path]:
    """Plot the histories of one run, or compare several, as ``flexfem plot`` does.

    Args:
        *folders: of results.
        **options: those of the command, as for :func:`render`: ``columns=["tip_x", "tip_z"]``.

    Returns:
        The files that were made; none on other ranks than the first.

    Raises:
        ValueError: See :func:`render`.
    """
    return _made("plot", folders, options)


def _made(name: str, folders: Sequence[str | Path], options: dict[str, Any]) -> list[Path]:
    argv = [str(folder) for folder in folders]
    for key, value in options.items():
        argv += _flag(key, value)
    try:
        prepare = import_module(f"{commands.__name__}.{name}").prepare
        return made_files(prepare(argv, f"flexfem {name}"))
    except UsageError as error:
        raise ValueError(f"{name}: {error}") from None


def _flag(key: str, value: Any) -> list[str]:
    """An option as on a command line."""
    flag = "--" + key.replace("_", "-")
    if value is None or value is False:
        return []
    if value is True:
        return [flag]
    several = isinstance(value, Sequence) and not isinstance(value, str)
    return [f"{flag}={','.join(map(str, value)) if several else value}"]
