# SPDX-License-Identifier: LGPL-3.0-or-later
"""flexfem info: summary and check of the model of a case."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from flexfem import launch
from flexfem._faults import FAILURES, mistake
from flexfem.cli.case_line import parse
from flexfem.cli.case_run import built, load_case
from flexfem.cli.usage import Parser, UsageError
from flexfem.options import Settings

SUMMARY = "sum up and check the model of a case: flexfem info NAME [options]"

_DESCRIPTION = """\
Print bodies, masses, joints, degrees of freedom, sizes and warnings of the model of a case.

Nothing is computed or written. The exit code is 0, with --strict 1 if there are warnings.
--ranks adds what an iteration would send on so many ranks.
"""
_FLAGS = {
    "--strict": "exit code 1 if there are warnings",
    "--json": "print one object of JSON, in SI units",
}
_RANKS, _MOST_RANKS = "--ranks", 100_000


def execute(argv: Sequence[str], prog: str) -> int:
    """Sum up the model of a case and check it; all other arguments are the case's own."""
    parser = _parser(prog)
    if not argv or argv[0].startswith("-") or {"-h", "--help"} & set(argv):
        parser.parse_args(argv)
        return 2
    flags = {flag for flag in _FLAGS if flag in argv}
    own = [argument for argument in argv[1:] if argument not in _FLAGS]
    own, ranks = _ranks(own)
    case, parameters, options = parse(
        load_case(argv[0]), own, prog=f"{prog} {argv[0]}", writes=False
    )
    model = built(case, parameters, own)
    message, text, warnings = "", "", 0
    try:
        text, warnings = _report(model, options, ranks, "--json" in flags)
    except FAILURES as error:
        message = mistake(error)
    if message := launch.first_message(message):
        raise UsageError(message, agreed=True)
    launch.say(text)
    return int("--strict" in flags and warnings > 0)


def _parser(prog: str) -> Parser:
    parser = Parser(prog=prog, description=_DESCRIPTION)
    parser.add_argument(
        "case",
        metavar="NAME",
        help="a name from 'flexfem list' or a case file; its own options follow, "
        "'flexfem run NAME --help' explains them",
    )
    for flag, text in _FLAGS.items():
        parser.add_argument(flag, action="store_true", help=text)
    parser.add_argument(_RANKS, metavar="N,N,...", help="numbers of ranks, up to 100000")
    return parser


def _ranks(arguments: Sequence[str]) -> tuple[list[str], list[int]]:
    """Other arguments, and the numbers of ranks of that option.

    Raises:
        UsageError: they are no numbers.
    """
    own, ranks = [], list[int]()
    rest = iter(arguments)
    for argument in rest:
        name, equals, value = argument.partition("=")
        if name != _RANKS:
            own.append(argument)
            continue
        text = value if equals else next(rest, "")
        for one in text.split(","):
            if not (one.isascii() and one.isdigit() and 1 <= int(one) <= _MOST_RANKS):
                raise UsageError(
                    f"argument --ranks: takes whole numbers from 1 to {_MOST_RANKS} with commas "
                    f"between, not '{text}'"
                )
            ranks.append(int(one))
    return own, ranks


def _report(model: Any, options: Settings, ranks: Sequence[int], as_json: bool) -> tuple[str, int]:
    """Text of summary and findings, and the number of findings."""
    from flexfem.gradients.parameter_search import ParameterSearch
    from flexfem.model.model import Model

    if isinstance(model, ParameterSearch):  # with the parameters to begin with
        model = model.model(model.start)
    if not isinstance(model, Model):  # it has equations of its own
        if ranks:
            raise UsageError("argument --ranks: this case has equations of its own")
        text = str(model)
        return (json.dumps({"model": text, "warnings": []}) if as_json else text), 0
    from flexfem.inspection.check import findings
    from flexfem.inspection.description import description_of
    from flexfem.inspection.inspection import Inspection
    from flexfem.inspection.rank_costs import rank_costs, table
    from flexfem.inspection.text import findings_text

    inspection = Inspection(model, options)
    description, found = description_of(inspection), findings(inspection)
    split = int(options.recorded["split_above"])
    costs = [rank_costs(inspection.serial, number, split) for number in ranks]
    if as_json:
        values = description.as_dict() | {"warnings": [asdict(finding) for finding in found]}
        if costs:
            values["ranks"] = [one.as_dict() for one in costs]
        return json.dumps(values, indent=2), len(found)
    text = f"{description}\n{table(costs)}\n" if costs else f"{description}\n"
    return f"{text}{findings_text(found)}", len(found)
