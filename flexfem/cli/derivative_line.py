# SPDX-License-Identifier: LGPL-3.0-or-later
"""Command lines of derivatives by the adjoint: their own options, and those of a case."""

import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from flexfem import launch
from flexfem._checks import InputError
from flexfem._faults import FunctionError
from flexfem.case import Case
from flexfem.cli.case_line import check_output, read_options
from flexfem.cli.case_run import built, load_case
from flexfem.cli.usage import FailedRunError, Parser, UsageError, folder, join_negative_values
from flexfem.options import Option


class DerivativeLine(NamedTuple):
    """What a command line of derivatives says.

    Attributes:
        case: the case.
        own: options of the command.
        of: the numbers.
        command: name of the command, and of its file.
        output: folder of the results.
        parameters: keyword arguments of ``build``.
        settings: options of the analysis.
    """

    case: Case
    own: Any
    of: list[str]
    command: str
    output: Path
    parameters: dict[str, Any]
    settings: Any


def add_derivative_options(parser: Parser, command: str, checked: str) -> None:
    """Add options that all of these commands have.

    Args:
        parser: of the command.
        command: its name, which is that of its file as well.
        checked: what ``--unchecked`` leaves out.
    """
    add = parser.add_argument
    add(
        "--of", action="append", default=[], metavar="HOW:COLUMN,...",
        help="numbers, such as final:tip_x: final, mean, integral, rms, max, min, ks of a column; "
        "frequency:1, damping:1 of modes, buckling:1 of statics",
    )  # fmt: skip
    add("--ks-rho", type=float, metavar="X", help="rho of ks, one over the unit of the column")
    add(
        "--memory", type=float, default=2e9, metavar="BYTES",
        help="for states on each rank; with less, they are computed once more (default: 2e9)",
    )  # fmt: skip
    add(
        "--scratch", type=folder, metavar="DIR",
        help="folder in which states that do not fit are kept instead, for the time of the command",
    )  # fmt: skip
    add("--unchecked", action="store_true", help=f"do not {checked}")
    add(
        "--output", type=folder, metavar="DIR",
        help=f"folder of {command}.json (default: results/NAME_{command})",
    )  # fmt: skip
    add("--quiet", action="store_true", help="no table, errors only")


def read_derivatives(parser: Parser, argv: Sequence[str], prog: str) -> DerivativeLine:
    """Read ``NAME`` and options, and build the model on every rank.

    Raises:
        UsageError: A value is not admissible, or the analysis has no derivatives.
    """
    if not argv or argv[0].startswith("-"):
        parser.parse_args(argv)
        parser.error("the following arguments are required: NAME")
    own, rest = parser.parse_known_args(join_negative_values(argv[1:]))
    case, given = read_options(load_case(argv[0]), rest, prog=f"{prog} {shlex.quote(argv[0])}")
    command = prog.split()[-1]
    output = own.output or Path("results") / f"{case.folder}_{command}"
    parameters, settings = _prepared(case, given, output, command)
    built(case, parameters, argv)  # faults of the model before all else, on every rank
    return DerivativeLine(case, own, parts(own.of), command, output, parameters, settings)


def parts(texts: Sequence[str]) -> list[str]:
    """What stands between commas."""
    return [part.strip() for text in texts for part in text.split(",") if part.strip()]


def units(case: Case) -> dict[str, str]:
    """Units of the options, as far as they are known."""
    return {one.name: one.unit or "" for one in case.all_options() if isinstance(one, Option)}


def table_of(rows: Sequence[Sequence[str]]) -> str:
    """Rows in columns as wide as they need."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ("  ".join(map(str.ljust, row, widths)).rstrip() for row in rows)
    return "\n".join(lines)


class Derived(Protocol):
    """A result of a command.

    Attributes:
        warnings: what should be known before it is used.
    """

    @property
    def warnings(self) -> tuple[str, ...]:
        """See the class."""
        ...


def tell(
    line: DerivativeLine, found: Derived, names: Sequence[str], text: Callable[[Path], str]
) -> int:
    """Write a result and print it, on the first rank; returns the exit code.

    Args:
        line: the command line.
        found: the result.
        names: of its attributes that are written.
        text: what is printed, by the path of the file.
    """
    from mpi4py import MPI

    from flexfem.io.summary import write_summary

    path = line.output / f"{line.command}.json"
    write_summary(path, {name: getattr(found, name) for name in names}, MPI.COMM_WORLD)
    if not line.own.quiet:
        launch.say(text(path))
    for warning in found.warnings:
        launch.say(f"warning: {warning}", error=True)
    return 0


@contextmanager
def errors_of_derivatives() -> Iterator[None]:
    """Wrong input and failures become messages.

    Raises:
        UsageError: A name or a value is wrong, or something has no derivative.
        FailedRunError: The analysis failed.
    """
    try:
        yield
    except InputError as error:
        raise UsageError(str(error), agreed=not error.alone) from error
    except (TypeError, ValueError) as error:  # of the names, on every rank
        raise UsageError(str(error), agreed=True) from error
    except (FunctionError, RuntimeError) as error:
        raise FailedRunError(str(error)) from error


def _prepared(
    case: Case, given: Mapping[str, Any], output: Path, command: str
) -> tuple[dict[str, Any], Any]:
    """Keyword arguments of ``build`` and the options of the analysis.

    Raises:
        UsageError: A value is not admissible, or the analysis is none in time.
    """
    from flexfem.analyses.dynamics import RunOptions
    from flexfem.analyses.modes import ModeOptions
    from flexfem.analyses.statics import StaticOptions

    left_out = ("quiet", "progress", "smoke")
    chosen = {name: value for name, value in given.items() if name not in left_out}
    if "restart" in chosen:
        raise UsageError(f"{command} does not take --restart: a motion begins at its start")
    try:
        check_output(output)
        parameters, settings = case.prepare(chosen, smoke=given["smoke"])
    except (OSError, ValueError) as error:
        raise UsageError(str(error)) from error
    if type(settings) not in (RunOptions, StaticOptions, ModeOptions):  # and no kind of them
        name = case.analysis.name
        raise UsageError(
            f"{command} is for dynamics, statics and modes, not for the analysis {name}"
        )
    return parameters, settings
