# SPDX-License-Identifier: LGPL-3.0-or-later
"""Command line of the cases: ``python cases/<name>.py``, ``flexfem run <name>``, ``flexfem list``.

Nothing here imports DOLFINx, PETSc, numba or gmsh before a run starts. Exit codes: 0 done, 1 the
computation failed, 2 wrong input (one line on stderr, nothing written), 130 interrupted (SIGINT),
143 terminated (SIGTERM).
"""

import argparse
import difflib
import os
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import flexfem
from flexfem import launch
from flexfem._checks import InputError
from flexfem.analyses.analysis import Analysis
from flexfem.analyses.modes import MODES
from flexfem.analyses.relaxation import RELAXATION
from flexfem.analyses.statics import STATICS
from flexfem.case import Case
from flexfem.options import Option, Settings
from flexfem.resources import load_module, shipped_files

if TYPE_CHECKING:
    from flexfem.model.model import Model

_METAVARS = {int: "N", float: "X", str: "TEXT"}
#: Files that analyses start from.
_FILES = {
    "restart": "checkpoint to go on from, on any number of ranks; --t-end may be later",
    "state": "checkpoint of a motion or relaxation of the same model, whose state is looked at",
}
#: Seconds that other ranks leave the first one to say that it was interrupted and to end them.
_PATIENCE = 0.5
_OUTPUTS = """\
Writes history.csv (one row per step), summary.json and ParaView files into the output folder.
Put "mpirun -n N" in front to run on N MPI ranks.
"""


class UsageError(Exception):
    """Wrong input from the user; the message is what to print, in one line.

    Args:
        message: The message.
        agreed: All ranks know it already.
    """

    def __init__(self, message: str, *, agreed: bool = False) -> None:
        """Keep the message."""
        super().__init__(message)
        self.agreed = agreed


class _Parser(argparse.ArgumentParser):
    """Prints on rank 0 only and reports wrong input as UsageError."""

    def __init__(self, **arguments: Any) -> None:
        super().__init__(
            allow_abbrev=False,
            formatter_class=argparse.RawDescriptionHelpFormatter,
            **arguments,
        )

    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{message} (see {self.prog} --help)")

    def _print_message(self, message: str, file: Any = None) -> None:
        if launch.rank() == 0:
            super()._print_message(message, file)


def main(case: Case, argv: Sequence[str] | None = None, *, prog: str | None = None) -> int:
    """Run a case from the command line.

    Args:
        case: What to run.
        argv: Arguments; those of the process by default.
        prog: Name of the command in help and messages.

    Returns:
        The exit code.
    """
    arguments = sys.argv[1:] if argv is None else argv
    return _exit_code(lambda: _run(case, arguments, prog))


def command(argv: Sequence[str] | None = None) -> int:
    """The ``flexfem`` command.

    Args:
        argv: Arguments; those of the process by default.

    Returns:
        The exit code.
    """
    arguments = sys.argv[1:] if argv is None else argv
    return _exit_code(lambda: _dispatch(arguments))


def _exit_code(action: Callable[[], int]) -> int:
    """Turn the user's errors and Ctrl-C into one line and an exit code; the rest ends all ranks.

    Whatever ends before a run starts is told to the other ranks, which may have got further.
    """
    sys.excepthook = launch.excepthook
    try:
        return action()
    except UsageError as error:
        message = str(error) if error.agreed else launch.first_message(str(error))
        launch.say("error: " + " ".join(message.split()), error=True)
        return 2
    except SystemExit:
        if message := launch.first_message(""):
            launch.say("error: " + " ".join(message.split()), error=True)
            return 2
        raise
    except launch.Interrupted as stop:  # all ranks have ended alike
        launch.say(str(stop), error=True)
        return stop.code
    except KeyboardInterrupt:
        if launch.rank() > 0:
            time.sleep(_PATIENCE)  # whoever gets here next: the first rank may hang in a receive
        print("interrupted", file=sys.stderr, flush=True)
        launch.abort(130)
        return 130


def _dispatch(argv: Sequence[str]) -> int:
    if len(argv) > 1 and argv[0] == "run" and not argv[1].startswith("-"):
        return _run(load_case(argv[1]), argv[2:], f"flexfem run {argv[1]}")
    parser = _Parser(
        prog="flexfem", description="Flexible multibody dynamics with finite elements."
    )
    parser.add_argument("--version", action="version", version=f"flexfem {flexfem.__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="{run,list}")
    run = commands.add_parser("run", help="run a case: flexfem run NAME [options]")
    run.add_argument(
        "case",
        metavar="NAME",
        help="a name from 'flexfem list' or a case file; "
        "'flexfem run NAME --help' explains its options",
    )
    commands.add_parser("list", help="list the cases")
    parser.parse_args(argv)
    cases = {name: load_case(name) for name in shipped_files("cases")}
    width = max(map(len, cases), default=0)
    for name, case in cases.items():
        launch.say(f"{name:{width}}  {case.summary}")
    if message := launch.first_message(""):
        raise UsageError(message, agreed=True)
    return 0


def load_case(name: str) -> Case:
    """Load a shipped case by its name, or the user's own by the path of its file.

    Raises:
        UsageError: If there is no such case, or the file does not define one.
    """
    path = Path(name)
    if path.suffix == ".py" or os.sep in name:
        sys.path.insert(0, str(path.resolve().parent))  # as if it had been started by itself
    else:
        path = _shipped_case(name)
    try:
        case = getattr(load_module(path, "flexfem_case"), "CASE", None)
    except (OSError, ValueError, TypeError) as error:
        raise UsageError(f"case '{name}': {error}") from error
    if not isinstance(case, Case):
        raise UsageError(f"case '{name}': the file does not define CASE = flexfem.Case(...)")
    return case


def _shipped_case(name: str) -> Path:
    try:
        cases = shipped_files("cases")
    except FileNotFoundError as error:
        raise UsageError(str(error)) from error
    if name not in cases:
        near = difflib.get_close_matches(name, cases)
        hint = "did you mean " + " or ".join(near) if near else "known are " + ", ".join(cases)
        raise UsageError(f"unknown case '{name}': {hint}")
    return cases[name]


def _run(case: Case, argv: Sequence[str], prog: str | None) -> int:
    case, parameters, options = parse(case, argv, prog=prog)
    model, folders = _prepare(case, parameters, options)

    try:
        outcome = case.analysis.run(model, options, case=case.name, results=case.results)
    except InputError as error:
        for folder in folders:
            folder.rmdir()
        raise UsageError(str(error), agreed=True) from error
    except OSError as error:
        launch.say(f"failed: {error}", error=True)
        launch.abort(1)
        return 1
    if outcome.status != "ok":
        launch.say(f"failed: {outcome.status}", error=True)
        return 1
    if not options.quiet:
        launch.say(f"results are in {options.output}")
    return 0


def parse(
    case: Case, argv: Sequence[str], *, prog: str | None = None
) -> tuple[Case, dict[str, Any], Settings]:
    """Read a case's command line.

    Args:
        case: The case.
        argv: Arguments without the program's name.
        prog: Name of the command in help and messages.

    Returns:
        The case under the analysis that was asked for, the keyword arguments of its ``build``, and
        the numerical options.

    Raises:
        UsageError: If an option is unknown or a value is not admissible.
        SystemExit: After ``--help``.
    """
    analyses = _analyses(case)
    case = _chosen(case, analyses, argv)
    parser = _case_parser(case, analyses, prog)
    given = vars(parser.parse_args(_join_negative_values(argv)))
    output = given.pop("output", Path("results") / case.folder)
    more = {name: given.pop(name) for name in _FILES if name in given}
    quiet, smoke = given.pop("quiet"), given.pop("smoke")
    given.pop("analysis", None)
    values = case.values(given, smoke=smoke)
    parameters = {option.name: values[option.name] for option in case.options}
    settings = case.analysis.settings
    numbers = {option.name: values[option.name] for option in settings.OPTIONS}
    try:
        _check_output(output)
        return case, parameters, settings(**numbers, **more, output=output, quiet=quiet)
    except (OSError, ValueError) as error:
        raise UsageError(str(error)) from error


def _analyses(case: Case) -> dict[str, Analysis]:
    """Analyses that the model of a case may undergo: its own first."""
    return {one.name: one for one in (case.analysis, STATICS, MODES, RELAXATION)}


def _chosen(case: Case, analyses: Mapping[str, Analysis], argv: Sequence[str]) -> Case:
    """The case under the analysis that the arguments name.

    Raises:
        UsageError: The case has options that this analysis has as well.
    """
    parser = _Parser(add_help=False)
    parser.add_argument("--analysis", nargs="?", default=case.analysis.name)
    name = parser.parse_known_args(argv)[0].analysis
    if name == case.analysis.name or name not in analyses:
        return case  # an unknown name is refused with all other arguments
    try:
        return case.under(analyses[name])
    except ValueError as error:
        raise UsageError(f"argument --analysis: {error}") from error


def _case_parser(case: Case, analyses: Mapping[str, Analysis], prog: str | None) -> _Parser:
    """A parser whose result holds only what was given, so that --smoke can set the rest."""
    parser = _Parser(
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
        type=_folder,
        metavar="DIR",
        help=f"folder of the results (default: {Path('results') / case.folder})",
    )
    known = {field.name for field in fields(case.analysis.settings)}
    for name, text in _FILES.items():
        if name in known:
            common.add_argument(f"--{name}", type=_file, metavar="FILE", help=text)
    common.add_argument(
        "--quiet", action="store_true", default=False, help="no progress bar, errors only"
    )
    common.add_argument(
        "--smoke", action="store_true", default=False, help="a few steps on a tiny mesh"
    )
    return parser


def _add_option(group: argparse._ArgumentGroup, option: Option, others: str) -> None:
    unit = f" [{option.unit}]" if option.unit else ""
    default = "" if option.default is None else f" (default: {option.default}{others})"
    text = f"{option.help}{unit}{default}".replace("%", "%%")
    if option.kind is bool:
        group.add_argument(option.flag, action=argparse.BooleanOptionalAction, help=text)
        return

    def read(value: str) -> Any:
        try:
            return option.parse(value)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from None

    choices = "{" + ",".join(map(str, option.choices)) + "}" if option.choices else None
    group.add_argument(option.flag, type=read, help=text, metavar=choices or _METAVARS[option.kind])


def _join_negative_values(argv: Sequence[str]) -> list[str]:
    """Write ``--x -1e-3`` as ``--x=-1e-3``, which argparse would take for two options."""
    joined: list[str] = []
    for argument in argv:
        follows_option = bool(joined) and joined[-1].startswith("--") and "=" not in joined[-1]
        if follows_option and argument.startswith("-") and _is_number(argument):
            joined[-1] += "=" + argument
        else:
            joined.append(argument)
    return joined


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _folder(text: str) -> Path:
    if not text:
        raise argparse.ArgumentTypeError("must name a folder, got ''")
    return Path(text)


def _file(text: str) -> Path:
    if not text:
        raise argparse.ArgumentTypeError("must name a file, got ''")
    return Path(text)


def _check_output(folder: Path) -> None:
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


def _prepare(
    case: Case, parameters: Mapping[str, Any], options: Settings
) -> tuple["Model", list[Path]]:
    """Build and validate the model and create the output folder; ranks agree on success.

    Returns:
        The model, and the folders that this process has created, innermost first.
    """
    from flexfem.model.model import Model

    message, created = "", []
    try:
        model = case.build(**parameters)
        if not isinstance(model, Model) and not hasattr(model, "drivers"):
            raise TypeError(f"case '{case.name}': build returned {model!r}, not a Model")
        model.validate()
        if launch.rank() == 0 and options.output is not None:
            path = options.output
            created = [folder for folder in (path, *path.parents) if not folder.exists()]
            path.mkdir(parents=True, exist_ok=True)
    except (OSError, TypeError, ValueError) as error:
        message = str(error) or type(error).__name__
    message = launch.first_message(message)
    if message:
        for folder in created:
            folder.rmdir()
        raise UsageError(message, agreed=True)
    return model, created
