# SPDX-License-Identifier: LGPL-3.0-or-later
"""flexfem run: a shipped case by name, or the user's own by the path of its file."""

import shlex
from collections.abc import Sequence

from flexfem.cli.case_run import load_case, run_case
from flexfem.cli.usage import Parser

SUMMARY = "run a case: flexfem run NAME [options]"


def execute(argv: Sequence[str], prog: str) -> int:
    """Run a case; all arguments after its name are the case's own."""
    if argv and not argv[0].startswith("-"):
        return run_case(load_case(argv[0]), argv[1:], f"{prog} {shlex.quote(argv[0])}")
    parser = Parser(prog=prog, description=SUMMARY)
    parser.add_argument(
        "case",
        metavar="NAME",
        help="a name from 'flexfem list' or a case file; "
        "'flexfem run NAME --help' explains its options",
    )
    parser.parse_args(argv)
    return 2
