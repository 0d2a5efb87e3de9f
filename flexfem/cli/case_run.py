# SPDX-License-Identifier: LGPL-3.0-or-later
"""Find a case, build its model, run it."""

import sys
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexfem import case as cases
from flexfem import launch
from flexfem._checks import InputError, NumericalError
from flexfem.case import Case
from flexfem.cli.case_line import parse
from flexfem.cli.shown_command import shown_command
from flexfem.cli.usage import UsageError, exit_code
from flexfem.installation import InstallationError
from flexfem.options import Settings

if TYPE_CHECKING:
    from flexfem.model.model import Model


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
    return exit_code(lambda: run_case(case, arguments, prog))


def load_case(name: str) -> Case:
    """Load a shipped case by its name, or the user's own by the path of its file.

    Raises:
        UsageError: If there is no such case, or the file does not define one.
    """
    try:
        return cases.load_case(name)
    except ValueError as error:
        raise UsageError(str(error)) from error


def run_case(case: Case, argv: Sequence[str], prog: str | None) -> int:
    """Read the command line of a case and run it; returns the exit code.

    Raises:
        UsageError: An option, a value or the model is not admissible.
    """
    case, parameters, options = parse(case, argv, prog=prog)
    with _word_on_compilation(options):
        return _run(case, parameters, options, argv, prog)


def _word_on_compilation(options: Settings) -> AbstractContextManager[None]:
    """Who watches a terminal learns why a first run takes long to start."""
    if options.quiet or options.progress == "none" or not sys.stderr.isatty():
        return nullcontext()
    try:
        from flexfem.la.first_compilation import told_of_compilation
    except ImportError:  # numba is missing, or will not load: the run says so
        return nullcontext()
    return told_of_compilation(lambda text: launch.say(text, error=True))


def _run(
    case: Case, parameters: Mapping[str, Any], options: Settings, argv: Sequence[str],
    prog: str | None,
) -> int:  # fmt: skip
    """Build the model of a case and run it; returns the exit code."""
    try:
        model, folders = _prepare(case, parameters, options)
    except NumericalError as error:
        launch.say(f"failed: {error}", error=True)
        return 1

    try:
        outcome = case.analysis.run(model, options, case=case.name, results=case.results)
    except (InputError, InstallationError) as error:
        for folder in folders:
            folder.rmdir()
        raise UsageError(str(error), agreed=True) from error
    except launch.Interrupted as stop:
        raise _with_command(stop, options, prog, argv) from stop
    except OSError as error:
        launch.say(f"failed: {error}", error=True)
        launch.abort(1)
        return 1
    for warning in outcome.summary.get("warnings", ()):
        launch.say(f"warning: {warning}", error=True)
    if outcome.status != "ok":
        launch.say(f"failed: {outcome.status}", error=True)
        return 1
    if not options.quiet:
        launch.say(f"results are in {options.output}")
    return 0


def _with_command(
    stop: launch.Interrupted, options: Settings, prog: str | None, argv: Sequence[str]
) -> launch.Interrupted:
    """The same interruption, which says by what command the run goes on."""
    if stop.checkpoint is not None:
        how = f"go on with: {shown_command(prog, argv, restart=stop.checkpoint)}"
    else:
        how = f"results so far are in {options.output}, there is no checkpoint"
    return launch.Interrupted(
        stop.number, f"{stop.reason}, {how}", reason=stop.reason, checkpoint=stop.checkpoint
    )


def _prepare(
    case: Case, parameters: Mapping[str, Any], options: Settings
) -> tuple["Model", list[Path]]:
    """Build and validate the model and create the output folder; ranks agree on success.

    Returns:
        The model, and the folders that this process has created, innermost first.
    """
    message, created = "", list[Path]()
    try:
        model = case.model(**parameters)
        if launch.rank() == 0 and options.output is not None:
            path = options.output
            missing = [folder for folder in (path, *path.parents) if not folder.exists()]
            for folder in reversed(missing):
                folder.mkdir(exist_ok=True)
                created.insert(0, folder)
            path.mkdir(exist_ok=True)  # says so if it is a file
    except (InstallationError, OSError, TypeError, ValueError) as error:
        message = str(error) or type(error).__name__
    message = launch.first_message(message)
    if message:
        for folder in created:
            folder.rmdir()
        raise UsageError(message, agreed=True)
    return model, created
