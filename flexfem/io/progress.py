# SPDX-License-Identifier: LGPL-3.0-or-later
"""Progress over simulated time or a load factor: a bar on a terminal, or lines in a log."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Sequence
from types import TracebackType
from typing import Any, Self

from flexfem.io.notebook import bar_class, in_notebook
from flexfem.options import progress_kind

#: Seconds between two looks at a bar.
_REFRESH = 0.2
#: Part of the time that display may take, unless the pause would be longer than this, s.
_SHARE, _LONGEST = 0.02, 30.0


def shown_kind(how: str) -> tuple[str, float]:
    """Resolve a choice of display: "auto", "bar", "lines", "lines:SECONDS" or "none".

    Returns:
        "bar", "lines" or "none", and the seconds between two lines; "auto" is a bar on a terminal
        and in a notebook, else nothing.

    Raises:
        ValueError: It is none of these.
    """
    kind, seconds = progress_kind(how)
    if kind == "auto":
        kind = "bar" if sys.stderr.isatty() or in_notebook() else "none"
    return kind, seconds


class Progress:
    """Time, iterations, factorisations, remaining time and more on the standard error stream.

    A bar appears on a terminal and in notebooks; lines with date and clock, every so many
    seconds, are for the logs of batch queues. The caller looks at :attr:`due` and calls
    :meth:`update` only then.
    """

    def __init__(
        self, t_end: float, enabled: bool, *, t_start: float = 0.0, unit: str = "s",
        how: str = "auto",
    ) -> None:  # fmt: skip
        """Show an empty bar, or nothing yet.

        Args:
            t_end: End of the simulated time or of the load factor.
            enabled: False on ranks other than 0 and in quiet runs.
            t_start: Its start (after a restart: where it continues).
            unit: Of both; empty for a load factor.
            how: see :func:`shown_kind`.

        Raises:
            ValueError: If it is none of these.
        """
        kind, self._interval = shown_kind(how)
        self._bar: Any = None
        self._t_end, self._t_start = float(t_end), float(t_start)
        self._unit = f" {unit}" if unit else ""
        self._begin, self._next = time.monotonic(), 0.0
        self._lines = enabled and kind == "lines"
        if enabled and kind == "bar":
            self._interval = _REFRESH
            self._open()

    def _open(self) -> None:
        # its import costs start-up time, and batch runs never need it
        self._bar = bar_class()(
            total=self._t_end,
            initial=self._t_start,
            file=sys.stderr,
            miniters=0,
            mininterval=0.0,
            dynamic_ncols=True,
            # the part that may be cut off on narrow terminals comes last
            bar_format="{percentage:3.0f}%|{bar:10}| {elapsed} < {remaining}{postfix}",
        )

    @property
    def enabled(self) -> bool:
        """True if anything is shown."""
        return self._lines or self._bar is not None

    @property
    def due(self) -> bool:
        """True if it is time to show the state."""
        return self.enabled and time.monotonic() >= self._next

    def update(
        self,
        t: float,
        iterations: int,
        factorizations: int,
        more: Sequence[str] = (),
        cost: float = 0.0,
    ) -> None:
        """Show the state after a step.

        Args:
            t: Simulated time or load factor.
            iterations: Newton iterations so far.
            factorizations: Factorisations so far.
            more: Further text about the state.
            cost: Time that this text took, s; costly ones are shown less often.
        """
        if self.enabled:
            try:
                self._show(t, iterations, factorizations, more)
            except OSError:  # the terminal is gone
                self._bar, self._lines = None, False
            self._next = time.monotonic() + max(self._interval, min(cost / _SHARE, _LONGEST))

    def _show(self, t: float, iterations: int, factorizations: int, more: Sequence[str]) -> None:
        """Show the state."""
        counts = f"{iterations} iterations", f"{factorizations} factorisations"
        text = ", ".join([f"t = {t:.4g} of {self._t_end:.4g}{self._unit}", *counts, *more])
        if self._bar is not None:
            self._bar.set_postfix_str(text, refresh=False)
            # Rounding may carry the last step past the end, which would drop the bar.
            self._bar.update(min(t, self._t_end) - self._bar.n)
        else:
            self._print(t, text)

    def _print(self, t: float, text: str) -> None:
        """Print a line with date, share, times and text."""
        done, whole = t - self._t_start, self._t_end - self._t_start
        spent = time.monotonic() - self._begin
        left = f"{_clock(spent * (whole / done - 1.0))} left" if done > 0.0 else "starts"
        share = 100.0 * min(t / self._t_end, 1.0)
        date = time.strftime("%Y-%m-%d %H:%M:%S")
        print(f"{date} {share:5.1f}% {_clock(spent)}, {left}: {text}", file=sys.stderr, flush=True)

    def close(self) -> None:
        """Leave the bar as it is and end the line."""
        with contextlib.suppress(OSError):  # the terminal is gone
            if self._bar is not None:
                self._bar.close()
        self._bar, self._lines = None, False

    def __enter__(self) -> Self:
        """Return the bar."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the bar."""
        self.close()


def _clock(seconds: float) -> str:
    """Hours, minutes and seconds."""
    minutes, rest = divmod(max(round(seconds), 0), 60)
    return f"{minutes // 60}:{minutes % 60:02d}:{rest:02d}"
