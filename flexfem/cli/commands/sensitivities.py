# SPDX-License-Identifier: LGPL-3.0-or-later
"""flexfem sensitivities: derivatives of results with respect to options of a case."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from flexfem import launch
from flexfem._files import number_in
from flexfem.cli.case_line import check_output
from flexfem.cli.study_line import StudyLine, add_study_options, errors_of_studies, read_study
from flexfem.cli.usage import FailedRunError, Parser

if TYPE_CHECKING:
    from flexfem.studies.sensitivities import Sensitivity

SUMMARY = "derivatives of results: flexfem sensitivities NAME --of max:tip_x --wrt option,option"
_TEXT = """\
Differentiates results of a case with respect to its options, by central differences of runs,
several at a time. Each derivative has an estimated error, from a second step of half the length and
from the noise of the results, and a warning where that is more than 1 %. The table is written to
sensitivities.csv and sensitivities.json in the folder of the study; the same command uses the runs
that are there.
"""
_MORE = """\
All other options are those of the case, at whose values the derivatives are taken: see "flexfem run
NAME --help". Exit codes: 0 all runs are done, 1 some have failed, 2 wrong input, 130, 143 or 129
interrupted.
"""


def execute(argv: Sequence[str], prog: str) -> int:
    """Make the runs and print the table."""
    line = read_study(_parser(prog), argv, prog)
    output = line.own.output or Path("results") / f"{line.case.folder}_sensitivities"
    with errors_of_studies(line, argv):
        check_output(output)
        found = _found(line, output)
    failed = [one for one in found if one.derivative != one.derivative]
    if line.own.json:
        launch.say(json.dumps([_plain(one) for one in found], indent=2))
    else:
        launch.say(_table(found))
        for one in found:
            if one.warning:
                launch.say(f"warning: {one.of}, {one.wrt}: {one.warning}", error=True)
    if failed:
        raise FailedRunError(f"{len(failed)} of {len(found)} derivatives are unknown")
    return 0


def _parser(prog: str) -> Parser:
    parser = Parser(prog=f"{prog} NAME", description=_TEXT, epilog=_MORE)
    parser.add_argument(
        "--of", action="append", default=[], metavar="HOW:COLUMN,...",
        help="results, such as max:tip_x: final, max, min, mean, rms, integral of a column of the "
        "history; or names of headline results of the case",
    )  # fmt: skip
    parser.add_argument(
        "--wrt", action="append", default=[], metavar="OPTION,...",
        help="options: real numbers, or components of vectors such as gravity[2]",
    )  # fmt: skip
    parser.add_argument(
        "--step", action="append", default=[], metavar="OPTION=X",
        help="the longer step of an option (default: 1 %% of its value, or another try)",
    )  # fmt: skip
    parser.add_argument("--json", action="store_true", help="print the table as JSON")
    add_study_options(parser, "sensitivities")
    return parser


def _found(line: StudyLine, output: Path) -> "list[Sensitivity]":
    """The derivatives.

    Raises:
        OSError, TypeError, ValueError: See :func:`flexfem.sensitivities`.
        FailedRunError: The first run has failed.
    """
    from flexfem.studies.sensitivities import sensitivities

    own = line.own
    try:
        return sensitivities(
            line.name, _parts(own.of), [name.replace("-", "_") for name in _parts(own.wrt)],
            options=line.given, steps=dict(map(_step, own.step)), output=output, jobs=own.jobs,
            ranks=own.ranks, analysis=line.case.analysis, smoke=line.smoke,
            progress="none" if own.quiet else own.progress,
        )  # fmt: skip
    except RuntimeError as error:
        raise FailedRunError(str(error)) from error


def _parts(texts: Sequence[str]) -> list[str]:
    return [part.strip() for text in texts for part in text.split(",")]


def _step(text: str) -> tuple[str, float]:
    """Read ``option=X``.

    Raises:
        ValueError: It is not of this form.
    """
    name, _, number = text.partition("=")
    try:
        return name.strip().replace("-", "_"), number_in(number)
    except ValueError:
        raise ValueError(f"--step '{text}' is not of the form option=number") from None


def _plain(one: "Sensitivity") -> dict[str, object]:
    """As an object of JSON, which has no NaN."""
    values = asdict(one).items()
    return {name: None if value != value else value for name, value in values}


def _table(found: "Sequence[Sensitivity]") -> str:
    """One line for each derivative."""
    head = ("of", "wrt", "at", "value", "derivative", "error", "relative", "step")
    rows = [
        (
            one.of, one.wrt, f"{one.at:.6g}", f"{one.value:.6g}", f"{one.derivative:.6g}",
            f"{one.error:.1e}", f"{one.relative:.4g}", f"{one.step:.3g}",
        )
        for one in found
    ]  # fmt: skip
    widths = [max(map(len, column)) for column in zip(head, *rows, strict=True)]
    lines = ("  ".join(map(str.ljust, row, widths)).rstrip() for row in (head, *rows))
    return "\n".join(lines)
