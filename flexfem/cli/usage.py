# SPDX-License-Identifier: LGPL-3.0-or-later
"""Common parts of all command lines: parser, wrong input in one line, exit codes."""

import argparse
import contextlib
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NoReturn

from flexfem import launch
from flexfem.installation import InstallationError
from flexfem.options import Option, is_text, meant

#: Values that people give to switches.
_TRUTH = dict.fromkeys(("yes", "true", "on", "1"), True) | dict.fromkeys(
    ("no", "false", "off", "0"), False
)
#: Start of argparse's message about an unknown option.
_UNKNOWN = "unrecognized arguments: "
#: Seconds that other ranks leave the first one to say that it was interrupted and to end them.
_PATIENCE = 0.5
#: The option that shows where an error comes from.
TRACEBACK = "--traceback"


class UsageError(Exception):
    """Wrong input from the user; the message is printed, in one line.

    Args:
        message: The message.
        agreed: All ranks have the same error already.
        trace: Python's traceback of its cause, where that is of another rank.
    """

    def __init__(self, message: str, *, agreed: bool = False, trace: str = "") -> None:
        """Keep the message."""
        super().__init__(message)
        self.agreed, self.trace = agreed, trace


class FailedRunError(Exception):
    """A computation that ended before its planned end; the message is printed.

    Args:
        message: The message.
        trace: As of :class:`UsageError`.
    """

    def __init__(self, message: str, *, trace: str = "") -> None:
        """Keep the message."""
        super().__init__(message)
        self.trace = trace


class Parser(argparse.ArgumentParser):
    """Prints on rank 0 only and reports wrong input as UsageError."""

    def __init__(self, **arguments: Any) -> None:
        """Options cannot be shortened; texts keep their line breaks."""
        super().__init__(
            allow_abbrev=False,
            formatter_class=argparse.RawDescriptionHelpFormatter,
            **arguments,
        )
        self._arguments: list[str] = []

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """See argparse; the arguments are kept for messages."""
        self._arguments = list(sys.argv[1:] if args is None else args)
        return super().parse_known_args(args, namespace)

    def error(self, message: str) -> NoReturn:
        """Wrong input in one line, with close names and a pointer to the help."""
        raise UsageError(f"{message}{self._meant(message)} (see {self.prog} --help)")

    def _meant(self, message: str) -> str:
        """Options that are spelt like the first one that is unknown."""
        if switch := self._switch_with_value():
            return f"; it takes no value, write {switch}"
        unknown = message.removeprefix(_UNKNOWN).split()
        if not message.startswith(_UNKNOWN) or not unknown[0].startswith("--"):
            return ""
        known = [text for text in self._option_string_actions if text.startswith("--")]
        hint = meant(unknown[0].partition("=")[0], known)
        return f"; {hint}?" if hint else ""

    def _switch_with_value(self) -> str:
        """The right form of the first ``--name`` beside a ``--no-name`` that has a truth value."""
        words = [word for text in self._arguments for word in text.split("=", 1)]
        for name, value in pairwise(words):
            no = f"--no-{name.removeprefix('--')}"
            if value.lower() in _TRUTH and no in self._option_string_actions:
                return name if _TRUTH[value.lower()] else no
        return ""

    def _print_message(self, message: str, file: Any = None) -> None:
        if launch.rank() == 0:
            super()._print_message(message, file)


def exit_code(action: Callable[[], int], argv: Sequence[str]) -> int:
    """Turn errors of the user or of the installation, and Ctrl-C, into one line and an exit code.

    The rest ends all ranks. A failure before a run starts is sent to the other ranks, which may
    have got further.

    Args:
        action: Function to run.
        argv: Arguments of the command; with ``--traceback`` among them Python's is printed, too.

    Returns:
        Return value of the action, or 2 for wrong input, 1 for a failed run, 128 and its number for
        a signal.
    """
    sys.excepthook = launch.excepthook
    try:
        _check_text([*argv, *sys.argv[:1]])
        with launch.ended_by_signals():
            return action()
    except UsageError as error:
        failure = launch.Failure(str(error), 2, error.trace or traced(error.__cause__, argv))
        launch.say(str(failure if error.agreed else launch.first_failure(failure)), error=True)
        return 2
    except InstallationError as error:  # the same on all ranks
        failure = launch.Failure(str(error), 2, traced(error.__cause__, argv))
        launch.say(str(failure), error=True)
        return 2
    except FailedRunError as error:
        failure = launch.Failure(str(error), 1, error.trace or traced(error.__cause__, argv))
        launch.say(str(failure), error=True)
        return 1
    except SystemExit:
        if message := launch.first_message(""):
            launch.say(str(launch.Failure(message)), error=True)
            return 2
        raise
    except launch.Interrupted as stop:  # all ranks have ended in the same way
        launch.say(str(stop), error=True)
        return stop.code
    except KeyboardInterrupt as stop:
        code = stop.code if isinstance(stop, launch.Ended) else 130
        if launch.rank() > 0:
            time.sleep(_PATIENCE)  # whoever gets here next: the first rank may hang in a receive
        with contextlib.suppress(OSError):  # the terminal is gone
            launch.tell("interrupted")
        launch.abort(code)
        return code


def _check_text(arguments: Sequence[str]) -> None:
    """Refuse names of files that are no text: neither summaries nor ParaView's files hold them.

    Raises:
        UsageError: One is not UTF-8.
    """
    for argument in arguments:
        if not is_text(argument):
            raise UsageError(f"{argument!a} is not UTF-8; rename the file or folder")


def traced(cause: BaseException | None, argv: Sequence[str]) -> str:
    """Python's traceback of an error; empty unless requested on the command line."""
    if cause is None or TRACEBACK not in argv:
        return ""
    # that of another rank comes as text
    return getattr(cause, "trace", "") or "".join(traceback.format_exception(cause))


def join_negative_values(argv: Sequence[str]) -> list[str]:
    """Write ``--x -1e-3`` as ``--x=-1e-3``, which argparse would take for two options.

    So are lists of numbers, ``--view -1,0,0``.
    """
    joined: list[str] = []
    for argument in argv:
        follows_option = bool(joined) and joined[-1].startswith("--") and "=" not in joined[-1]
        if follows_option and argument.startswith("-") and _are_numbers(argument):
            joined[-1] += "=" + argument
        else:
            joined.append(argument)
    return joined


def _are_numbers(text: str) -> bool:
    try:
        [float(part) for part in text.split(",")]
    except ValueError:
        return False
    return True


def folder(text: str) -> Path:
    """A folder as an argument."""
    if not text:
        raise argparse.ArgumentTypeError("must name a folder, got ''")
    return Path(text)


def file(text: str) -> Path:
    """A file as an argument."""
    if not text:
        raise argparse.ArgumentTypeError("must name a file, got ''")
    return Path(text)


def reader(option: Option) -> Callable[[str], Any]:
    """Return a parser of an option's value whose errors state the admissible values."""

    def read(text: str) -> Any:
        try:
            return option.parse(text)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from None

    return read
