# SPDX-License-Identifier: LGPL-3.0-or-later
"""flexfem compile: ahead-of-time compilation of loops and forms."""

from collections.abc import Sequence

from flexfem import launch
from flexfem.case import case_file
from flexfem.cli.usage import FailedRunError, Parser, UsageError, reader
from flexfem.options import Option
from flexfem.studies.compile_ahead import KINDS_OF_MODELS, compile_ahead

SUMMARY = "compile what cases need, so that first runs start at once: flexfem compile [NAME ...]"
_TEXT = """\
Loops and forms are compiled when they are first used, and kept. This command compiles them now, by
short runs of cases, several at a time: after an installation, in the image of a container, or on a
cluster before many jobs start. What is compiled already is not compiled again.
"""


def execute(argv: Sequence[str], prog: str) -> int:
    """Compile, and print a line for each case."""
    parser = Parser(prog=prog, description=_TEXT)
    parser.add_argument(
        "names", metavar="NAME", nargs="*",
        help="cases, or files that define CASE (default: shipped ones with all kinds of bodies)",
    )  # fmt: skip
    count = reader(Option("jobs", int, 1, "", minimum=1))
    parser.add_argument(
        "--jobs", type=count, metavar="N", default=len(launch.cores()),
        help="runs at a time (default: cores)",
    )  # fmt: skip
    parser.add_argument("--quiet", action="store_true", help="print faults only")
    options = parser.parse_args(argv)
    if launch.launched_in_parallel():
        raise UsageError("start compile without mpirun, --jobs N runs several at a time")
    names = options.names or KINDS_OF_MODELS
    try:
        for name in names:
            case_file(name)
    except ValueError as error:
        raise UsageError(str(error)) from error
    faults = []
    for case, seconds, fault in compile_ahead(names, options.jobs):
        if fault:
            faults.append(f"{case}: {fault}")
        elif not options.quiet:
            launch.say(f"{case}: {seconds:.0f} s")
    if faults:
        raise FailedRunError("; ".join(faults))
    return 0
