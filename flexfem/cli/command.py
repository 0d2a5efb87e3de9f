# SPDX-License-Identifier: LGPL-3.0-or-later
"""The ``flexfem`` command: dispatch by its first argument."""

import importlib
import pkgutil
import sys
from collections.abc import Sequence
from types import ModuleType

import flexfem
from flexfem.cli import commands
from flexfem.cli.usage import Parser, exit_code


def command(argv: Sequence[str] | None = None) -> int:
    """Run ``flexfem ARGUMENTS``.

    Args:
        argv: Arguments; those of the process by default.

    Returns:
        The exit code.
    """
    arguments = sys.argv[1:] if argv is None else argv
    return exit_code(lambda: _dispatch(arguments), arguments)


def _dispatch(argv: Sequence[str]) -> int:
    names = [module.name for module in pkgutil.iter_modules(commands.__path__)]
    if argv and argv[0] in names:
        return int(_command(argv[0]).execute(argv[1:], f"flexfem {argv[0]}"))
    parser = Parser(prog="flexfem", description="Flexible multibody dynamics with finite elements.")
    parser.add_argument("--version", action="version", version=f"flexfem {flexfem.__version__}")
    listed = parser.add_subparsers(
        required=True,
        metavar="COMMAND",
        title="commands",
        description="COMMAND --help explains",
    )
    for name in names:
        listed.add_parser(name, help=_command(name).SUMMARY)
    parser.parse_args(argv)
    raise AssertionError(f"no command took {argv}")


def _command(name: str) -> ModuleType:
    return importlib.import_module(f"{commands.__name__}.{name}")
