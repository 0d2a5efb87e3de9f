# SPDX-License-Identifier: LGPL-3.0-or-later
"""The command line of a case: its own options and those of its analysis."""

import argparse
import os
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from flexfem.analyses.analysis import Analysis
from flexfem.case import Case
from flexfem.cli.usage import (
    TRACEBACK,
    Parser,
    UsageError,
    file,
    folder,
    join_negative_values,
    reader,
)
from flexfem.options import PROGRESS, Option, Settings, VectorOption, value_text

_METAVARS = {int: "N", float: "X", str: "TEXT"}
#: Files that analyses start from.
_FILES = ("restart", "state")
#: Options that concern the output alone.
_OUTPUT = ("output", "quiet", "progress")
_OUTPUTS = """\
Writes history.csv (one row per step), summary.json and ParaView files into the output folder.
Put "mpirun -n N" in front to run on N MPI ranks.
"""


def parse(
    case: Case, argv: Sequence[str], *, prog: str | None = None, writes: bool = True
) -> tuple[Case, dict[str, Any], Settings]:
    """Read a case's command line.

    Args:
        case: The case.
        argv: Arguments without the program's name.
        prog: Name of the command in help and messages.
        writes: True if the folder of the results is needed.

    Returns:
        The case under the selected analysis, the keyword arguments of its ``build``, and the
        numerical options.

    Raises:
        UsageError: If an option is unknown or a value is not admissible.
        SystemExit: After ``--help``.
    """
    case, given = read_options(case, argv, prog=prog)
    smoke = given.pop("smoke")
    more = {name: given.pop(name) for name in (*_FILES, *_OUTPUT) if name in given}
    more.setdefault("output", Path("results") / case.folder)
    try:
        if writes:
            check_output(more["output"])
        return case, *case.prepare(given, smoke=smoke, **more)
    except (OSError, ValueError) as error:
        raise UsageError(str(error)) from error


def read_options(
    case: Case, argv: Sequence[str], *, prog: str | None = None
) -> tuple[Case, dict[str, Any]]:
    """Read which options of a case are given.

    Returns:
        The case under the selected analysis, and the values of the options given, ``quiet`` and
        ``smoke`` always among them.

    Raises:
        UsageError: If an option is unknown or a value is not admissible.
        SystemExit: After ``--help``.
    """
    analyses = case.analyses
    case = _chosen(case, analyses, argv)
    parser = _case_parser(case, analyses, prog)
    given = vars(parser.parse_args(join_negative_values(argv)))
    for name in ("analysis", "traceback"):
        given.pop(name, None)
    return case, given


def _chosen(case: Case, analyses: Mapping[str, Analysis], argv: Sequence[str]) -> Case:
    """The case under the analysis that the arguments name.

    Raises:
        UsageError: The case has options that this analysis has as well.
    """
    parser = Parser(add_help=False)
    parser.add_argument("--analysis", nargs="?", default=case.analysis.name)
    name = parser.parse_known_args(argv)[0].analysis
    if name == case.analysis.name or name not in analyses:
        return case  # an unknown name is refused with all other arguments
    try:
        return case.under(analyses[name])
    except ValueError as error:
        raise UsageError(f"argument --analysis: {error}") from error


def _case_parser(case: Case, analyses: Mapping[str, Analysis], prog: str | None) -> Parser:
    """A parser whose result has the given options only, so that --smoke can set the rest."""
    parser = Parser(
        prog=prog,
        description=case.description or case.summary,
        epilog=_OUTPUTS,
        argument_default=argparse.SUPPRESS,
    )
    own = parser.add_argument_group("this case")
    common = parser.add_argument_group("all cases")
    common.add_argument(
        "--analysis",
        choices=analyses,
        help=f"what is done with the model (default: {next(iter(analyses))})",
    )
    for option in case.all_options():
        group = own if option in case.options else common
        _add_option(group, option, case.other_defaults(option.name))
    common.add_argument(
        "--output",
        type=folder,
        metavar="DIR",
        help=f"folder of the results (default: {Path('results') / case.folder})",
    )
    for one in fields(case.analysis.settings):
        if one.name in _FILES:
            text = one.metadata["help"]
            common.add_argument(f"--{one.name}", type=file, metavar="FILE", help=text)
    _add_option(common, PROGRESS, "", "{auto,bar,lines,lines:S,none}")
    common.add_argument(
        "--quiet", action="store_true", default=False, help="no progress bar, errors only"
    )
    common.add_argument(
        TRACEBACK, action="store_true", help="show Python's traceback of an error as well"
    )
    common.add_argument(
        "--smoke", action="store_true", default=False, help="a few steps on a tiny mesh"
    )
    return parser


def _add_option(
    group: argparse._ArgumentGroup, option: Option, others: str, metavar: str | None = None
) -> None:
    unit = f" [{option.unit}]" if option.unit else ""
    shown = value_text(option.default) if isinstance(option, VectorOption) else option.default
    default = "" if option.default is None else f" (default: {shown}{others})"
    text = f"{option.help}{unit}{default}".replace("%", "%%")
    if option.kind is bool:
        group.add_argument(option.flag, action=argparse.BooleanOptionalAction, help=text)
        return
    choices = "{" + ",".join(map(str, option.choices)) + "}" if option.choices else None
    metavar = metavar or choices or _METAVARS.get(option.kind)
    if isinstance(option, VectorOption):
        metavar = ",".join(f"X{k}" for k in range(len(option.default)))
        for k in range(len(option.default)):  # --gravity[2]=-1.62 leaves the others as they are
            group.add_argument(
                f"{option.flag}[{k}]", dest=f"{option.name}[{k}]", type=reader(option.component),
                help=argparse.SUPPRESS,
            )  # fmt: skip
    group.add_argument(option.flag, type=reader(option), help=text, metavar=metavar)


def check_output(folder: Path) -> None:
    """Refuse a folder that cannot be written before anything is computed.

    Raises:
        OSError: If the folder is a file, or cannot be created.
    """
    existing = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    if not existing.is_dir():
        reason = f"'{existing}' is not a folder"
    elif not os.access(existing, os.W_OK | os.X_OK):
        reason = f"no permission to write in '{existing}'"
    else:
        return
    raise OSError(f"argument --output: '{folder}' cannot be used, {reason}")
