# SPDX-License-Identifier: LGPL-3.0-or-later
"""flexfem sweep: a case with many values of its options."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexfem import launch
from flexfem.cli.case_line import check_output
from flexfem.cli.postprocessing import print_files, script
from flexfem.cli.study_line import StudyLine, add_study_options, errors_of_studies, read_study
from flexfem.cli.usage import Parser
from flexfem.options import with_components

if TYPE_CHECKING:
    from flexfem.studies.sweep import Sweep

SUMMARY = "run a case with many values of its options: flexfem sweep NAME --vary option=a,b,c"
_TEXT = """\
Runs a case once for each combination of values, several runs at a time, each in a folder of its
own. The table sweep.csv has a row for each run: its options, status, headline results, reduced
columns of the history and wall time. The same command goes on with a sweep that was interrupted,
and repeats runs that failed.
"""
_MORE = """\
All other options are those of the case: see "flexfem run NAME --help". Exit codes: 0 all runs are
done, 1 some have failed, 2 wrong input, 130, 143 or 129 interrupted.
"""


def execute(argv: Sequence[str], prog: str) -> int:
    """Run the sweep."""
    line = read_study(_parser(prog), argv, prog)
    output = line.own.output or Path("results") / f"{line.case.folder}_sweep"
    with errors_of_studies(line, argv):
        check_output(output)
        if line.own.plot is not None:
            script("compare_runs")  # missing packages are found before the first run
        made = _sweep(line, output)
        for _ in made:
            pass
    own = line.own
    code = _tell(made, output, own.quiet)
    if own.plot is not None and made.failed < len(made):
        code = max(code, _picture(made, own, output))
    return code


def _parser(prog: str) -> Parser:
    parser = Parser(prog=f"{prog} NAME", description=_TEXT, epilog=_MORE)
    add = parser.add_argument
    add(
        "--vary", action="append", default=[], metavar="OPTION=VALUES",
        help="values a,b,c of an option, or numbers start:stop:count, with :log by a constant "
        "factor; more of them are combined each with each",
    )  # fmt: skip
    add("--zip", action="store_true", help="combine first values with first values, and so on")
    add(
        "--reduce", action="append", default=[], metavar="HOW:COLUMN,...",
        help="columns of the history to reduce, such as max:tip_x: final, max, min, mean, rms, "
        "integral",
    )  # fmt: skip
    add(
        "--plot", metavar="A,B",
        help="these columns of all runs in one picture, comparison.png in the folder of the sweep",
    )  # fmt: skip
    add("--clip", action="store_true", help="with --plot: axes of the runs that do not diverge")
    add_study_options(parser, "sweep")
    return parser


def _sweep(line: StudyLine, output: Path) -> "Sweep":
    """Check all runs.

    Raises:
        OSError, TypeError, ValueError: See :func:`flexfem.sweep`.
    """
    from flexfem.studies.sweep import sweep
    from flexfem.studies.variations import parse_variation

    own, case = line.own, line.case
    options = with_components(case.all_options())
    varied: dict[str, list[Any]] = {}
    for text in own.vary:
        option, values = parse_variation(text, options)
        if option in varied:
            raise ValueError(f"--vary {option} is given twice")
        varied[option] = values
    reduced = [one for text in own.reduce for one in text.split(",")]
    if own.clip and own.plot is None:
        raise ValueError("--clip needs --plot")
    return sweep(
        line.name, varied, options=line.given, together=own.zip, reduce=reduced, output=output,
        columns=[] if own.plot is None else own.plot.split(","),
        jobs=own.jobs, ranks=own.ranks, analysis=case.analysis, smoke=line.smoke,
        progress="none" if own.quiet else own.progress,
    )  # fmt: skip


def _picture(made: "Sweep", own: Any, output: Path) -> int:
    """Draw the columns of all runs that have not failed; returns the exit code.

    Raises:
        UsageError: They have no such columns, or nothing can be drawn here.
    """
    target = output / "comparison.png"
    done = [
        folder
        for folder, result in zip(made.folders, made.results, strict=True)
        if result["status"] == "ok"
    ]
    return print_files(
        lambda: [script("compare_runs").make(done, own.plot, output=target, clipped=own.clip)]
    )


def _tell(made: "Sweep", output: Path, quiet: bool) -> int:
    table = output / "sweep.csv"
    for column in made.missing_columns:
        launch.say(f"no history has a column '{column}'", error=True)
    if made.failed:
        launch.say(f"failed: {made.failed} of {len(made)} runs, see {table}", error=True)
        return 1
    if not quiet:
        launch.say(f"{len(made)} runs are done, their results are in {table}")
    return 0
