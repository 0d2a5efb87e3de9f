# SPDX-License-Identifier: LGPL-3.0-or-later
"""Command lines of studies: their own options, and those of a case."""

import shlex
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

from flexfem import launch
from flexfem.case import Case
from flexfem.cli.case_line import read_options
from flexfem.cli.case_run import load_case
from flexfem.cli.shown_command import shown_command
from flexfem.cli.usage import Parser, UsageError, folder, join_negative_values, reader
from flexfem.options import PROGRESS, Option


class StudyLine(NamedTuple):
    """What a command line of a study says.

    Attributes:
        command: the command with the name of the case, for messages.
        name: of the case, as it was given.
        case: under the selected analysis.
        own: options of the study.
        given: values of options of the case.
        smoke: a few steps on tiny meshes.
    """

    command: str
    name: str
    case: Case
    own: Any
    given: dict[str, Any]
    smoke: bool


def add_study_options(parser: Parser, study: str) -> None:
    """Add options that all studies have: processes, folder, progress."""
    add, count = parser.add_argument, reader(Option("number", int, 1, "", minimum=1))
    add("--jobs", type=count, metavar="N", help="runs at a time (default: cores / ranks)")
    add("--ranks", type=count, default=1, metavar="N", help="MPI ranks of each run (default: 1)")
    add(
        "--output", type=folder, metavar="DIR",
        help=f"folder of the results (default: results/NAME_{study})",
    )  # fmt: skip
    add(
        "--progress", type=reader(PROGRESS), default="auto", metavar="{auto,bar,lines,none}",
        help="on stderr: a bar (auto: on terminals), or a line for each run (default: auto)",
    )  # fmt: skip
    add("--quiet", action="store_true", help="no progress bar, errors only")


def read_study(parser: Parser, argv: Sequence[str], prog: str) -> StudyLine:
    """Read ``NAME`` and options; all that are not of the study are of the case.

    Raises:
        UsageError: Something is wrong with them.
    """
    if not argv or argv[0].startswith("-"):
        parser.parse_args(argv)
        parser.error("the following arguments are required: NAME")
    command = f"{prog} {shlex.quote(argv[0])}"
    own, rest = parser.parse_known_args(join_negative_values(argv[1:]))
    study = prog.split()[-1]
    if launch.launched_in_parallel():
        raise UsageError(f"start {study} without mpirun, --ranks N gives each run its ranks")
    case, given = read_options(load_case(argv[0]), rest, prog=command)
    for file in ("restart", "state"):
        if file in given:
            raise UsageError(f"{study} does not take --{file}: runs start from the beginning")
    smoke = given.pop("smoke")
    given.pop("quiet")
    return StudyLine(command, argv[0], case, own, given, smoke)


@contextmanager
def errors_of_studies(line: StudyLine, argv: Sequence[str]) -> Iterator[None]:
    """Wrong input becomes a message; after an interruption a command says how to go on.

    Raises:
        UsageError: Something is wrong with the study.
        Interrupted: It was interrupted.
    """
    try:
        yield
    except launch.Interrupted as stop:
        again = shown_command(line.command, argv[1:])
        raise launch.Interrupted(stop.number, f"{stop}, go on with: {again}") from stop
    except (OSError, TypeError, ValueError) as error:
        raise UsageError(str(error)) from error
