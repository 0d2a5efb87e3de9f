# SPDX-License-Identifier: LGPL-3.0-or-later
"""Find a case, build its model, run it."""

import gc
import sys
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from functools import cache
from typing import TYPE_CHECKING, Any

from flexfem import _beside, launch
from flexfem import case as cases
from flexfem._checks import InputError, NumericalError
from flexfem._faults import FAILURES, FunctionError, mistake
from flexfem._packages import without_collection
from flexfem.case import Case
from flexfem.cli.case_line import parse
from flexfem.cli.shown_command import shown_command
from flexfem.cli.usage import FailedRunError, UsageError, exit_code, traced
from flexfem.installation import InstallationError
from flexfem.options import Settings

if TYPE_CHECKING:
    from flexfem.model.model import Model


#: Exit codes of models that cannot be built: wrong input, or a computation that has failed.
_REFUSED, _FAILED = 2, 1


def main(case: Case, argv: Sequence[str] | None = None, *, prog: str | None = None) -> int:
    """Run a case from the command line.

    Args:
        case: Case to run.
        argv: Arguments; those of the process by default.
        prog: Name of the command in help and messages.

    Returns:
        The exit code.
    """
    arguments = sys.argv[1:] if argv is None else argv
    return exit_code(lambda: run_case(case, arguments, prog), arguments)


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
    _beside.start_early()
    with _word_on_compilation(options):
        return _run(case, parameters, options, argv, prog)


def _word_on_compilation(options: Settings) -> AbstractContextManager[None]:
    """Print on a terminal that compilation delays a first run."""
    if options.quiet or options.progress == "none" or not sys.stderr.isatty():
        return nullcontext()
    try:
        from flexfem.cli.first_compilation import announcing_compilation
    except ImportError:  # numba is missing, or will not load: the run says so
        return nullcontext()
    return announcing_compilation(lambda text: launch.say(text, error=True))


def _run(
    case: Case, parameters: Mapping[str, Any], options: Settings, argv: Sequence[str],
    prog: str | None,
) -> int:  # fmt: skip
    """Build the model of a case and run it; returns the exit code.

    Raises:
        UsageError: Nothing was computed.
        FailedRunError: The computation ended before its planned end.
    """
    model = built(case, parameters, argv)
    try:
        results = case.results_with(parameters)
        with without_collection():  # a search before they are exempt would go through all of them
            driver = case.analysis.loaded(model)
            _keep_all()
        outcome = driver(model, options, case=case.name, results=results)
    except InputError as error:
        raise UsageError(str(error), agreed=not error.alone) from error
    except InstallationError as error:
        raise UsageError(str(error), agreed=True) from error
    except launch.Interrupted as stop:
        raise _with_command(stop, options, prog, argv) from stop
    except (FunctionError, OSError) as error:  # on all ranks
        ended = getattr(error, "outcome", None)
        raise FailedRunError(str(error) if ended is None else ended.status) from error
    if outcome.status != "ok":
        launch.say(f"failed: {outcome.status}", error=True)
        return 1
    if not options.quiet:
        launch.say(f"results are in {options.output}")
    return 0


@cache
def _keep_all() -> None:
    """Exempt the modules that are loaded now from later searches for garbage, once a process."""
    gc.freeze()


def _with_command(
    stop: launch.Interrupted, options: Settings, prog: str | None, argv: Sequence[str]
) -> launch.Interrupted:
    """The same interruption, with the command that resumes the run."""
    if stop.checkpoint is not None:
        how = f"go on with: {shown_command(prog, argv, restart=stop.checkpoint)}"
    else:
        how = f"results so far are in {options.output}, there is no checkpoint"
    return launch.Interrupted(
        stop.number, f"{stop.reason}, {how}", reason=stop.reason, checkpoint=stop.checkpoint
    )


def built(case: Case, parameters: Mapping[str, Any], argv: Sequence[str]) -> "Model":
    """Build and validate the model; ranks agree on success.

    Raises:
        UsageError: It cannot be built on a rank.
        FailedRunError: A part of the model cannot be computed.
    """
    own, model = launch.Failure(""), None
    try:
        model = case.model(**parameters)
    except NumericalError as error:
        own = launch.Failure(str(error), _FAILED, traced(error, argv))
    except FAILURES as error:
        own = launch.Failure(mistake(error), _REFUSED, traced(error, argv))
    message, code, trace = launch.first_failure(own)
    if message and code == _FAILED:
        raise FailedRunError(message, trace=trace)
    if message:
        raise UsageError(message, agreed=True, trace=trace)
    assert model is not None
    return model
