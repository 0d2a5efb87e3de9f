# SPDX-License-Identifier: LGPL-3.0-or-later
"""flexfem list: the cases that this installation has."""

from collections.abc import Sequence

from flexfem import launch
from flexfem.cli.case_run import load_case
from flexfem.cli.usage import Parser, UsageError
from flexfem.resources import shipped_files

SUMMARY = "list the cases"


def execute(argv: Sequence[str], prog: str) -> int:
    """Print a line per case."""
    Parser(prog=prog, description=SUMMARY).parse_args(argv)
    cases = {name: load_case(name) for name in shipped_files("cases")}
    width = max(map(len, cases), default=0)
    for name, case in cases.items():
        launch.say(f"{name:{width}}  {case.summary}")
    if message := launch.first_message(""):
        raise UsageError(message, agreed=True)
    return 0
