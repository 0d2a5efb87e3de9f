# SPDX-License-Identifier: LGPL-3.0-or-later
"""flexfem sweep: a case with many values of its options."""

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexfem import launch
from flexfem.case import Case
from flexfem.cli.case_line import check_output, read_options
from flexfem.cli.case_run import load_case
from flexfem.cli.postprocessing import print_files, script
from flexfem.cli.shown_command import shown_command
from flexfem.cli.usage import Parser, UsageError, folder, join_negative_values, reader
from flexfem.options import PROGRESS, Option, with_components

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
    parser = _parser(prog)
    if not argv or argv[0].startswith("-"):
        parser.parse_args(argv)
        parser.error("the following arguments are required: NAME")
    named = f"{prog} {shlex.quote(argv[0])}"
    own, rest = parser.parse_known_args(join_negative_values(argv[1:]))
    if launch.launched_in_parallel():
        raise UsageError("start a sweep without mpirun, --ranks N gives each run its ranks")
    case, given = read_options(load_case(argv[0]), rest, prog=named)
    output = own.output or Path("results") / f"{case.folder}_sweep"
    try:
        check_output(output)
        if own.plot is not None:
            script("compare_runs")  # missing packages are found before the first run
        made = _sweep(argv[0], case, own, given, output)
        for _ in made:
            pass
    except launch.Interrupted as stop:
        command = shown_command(named, argv[1:])
        raise launch.Interrupted(stop.number, f"{stop}, go on with: {command}") from stop
    except (OSError, TypeError, ValueError) as error:
        raise UsageError(str(error)) from error
    code = _tell(made, output, own.quiet)
    if own.plot is not None and made.failed < len(made):
        code = max(code, _picture(made, own, output))
    return code


def _parser(prog: str) -> Parser:
    parser = Parser(prog=f"{prog} NAME", description=_TEXT, epilog=_MORE)
    add, count = parser.add_argument, reader(Option("number", int, 1, "", minimum=1))
    add(
        "--vary", action="append", default=[], metavar="OPTION=VALUES",
        help="values a,b,c of an option, or numbers start:stop:count, with :log by a constant "
        "factor; more of them are combined each with each",
    )  # fmt: skip
    add("--zip", action="store_true", help="combine first values with first values, and so on")
    add(
        "--reduce", action="append", default=[], metavar="HOW:COLUMN,...",
        help="columns of the history to reduce, such as max:tip_x: final, max, min, mean, rms",
    )  # fmt: skip
    add(
        "--plot", metavar="A,B",
        help="these columns of all runs in one picture, comparison.png in the folder of the sweep",
    )  # fmt: skip
    add("--clip", action="store_true", help="with --plot: axes of the runs that do not diverge")
    add("--jobs", type=count, metavar="N", help="runs at a time (default: cores / ranks)")
    add("--ranks", type=count, default=1, metavar="N", help="MPI ranks of each run (default: 1)")
    add(
        "--output", type=folder, metavar="DIR",
        help="folder of the sweep (default: results/NAME_sweep)",
    )  # fmt: skip
    add(
        "--progress", type=reader(PROGRESS), default="auto", metavar="{auto,bar,lines,none}",
        help="on stderr: a bar (auto: on terminals), or a line for each run (default: auto)",
    )  # fmt: skip
    add("--quiet", action="store_true", help="no progress bar, errors only")
    return parser


def _sweep(name: str, case: Case, own: Any, given: dict[str, Any], output: Path) -> "Sweep":
    """Check all runs.

    Raises:
        OSError, TypeError, ValueError: See :func:`flexfem.sweep`.
    """
    from flexfem.studies.sweep import sweep
    from flexfem.studies.variations import parse_variation

    for file in ("restart", "state"):
        if file in given:
            raise ValueError(f"a sweep does not take --{file}: its runs start from the beginning")
    smoke = given.pop("smoke")
    given.pop("quiet")
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
        name, varied, options=given, together=own.zip, reduce=reduced, output=output,
        columns=[] if own.plot is None else own.plot.split(","),
        jobs=own.jobs, ranks=own.ranks, analysis=case.analysis, smoke=smoke,
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
