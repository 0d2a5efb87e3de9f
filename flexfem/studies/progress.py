# SPDX-License-Identifier: LGPL-3.0-or-later
"""Progress of a study: a bar on a terminal, or a line for each run that ends."""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping, Sequence
from typing import Any

from flexfem.io.notebook import bar_class
from flexfem.io.progress import shown_kind

__all__ = ["SweepProgress"]

#: Seconds between two looks at a bar.
_REFRESH = 0.5


class SweepProgress:
    """Numbers of runs that have ended and names of running ones, on standard error."""

    def __init__(self, count: int, done: int, how: str) -> None:
        """Show where the study starts.

        Args:
            count: number of runs.
            done: those that are there already.
            how: as for a run, but lines come with runs that end, whatever their seconds.

        Raises:
            ValueError: It is none of these.
        """
        kind, _ = shown_kind(how)
        self._count, self._done, self._failed = count, done, 0
        self._lines, self._shown = kind == "lines", 0.0
        self._bar: Any = None
        if kind == "bar":
            self._bar = bar_class()(
                total=count, initial=done, file=sys.stderr, dynamic_ncols=True,
                bar_format="{n_fmt} of {total_fmt} runs|{bar:10}| {elapsed} < {remaining}{postfix}",
            )  # fmt: skip
        elif self._lines and done:
            self._print(f"{done} of {count} runs are there already")

    def ended(self, name: str, results: Mapping[str, Any]) -> None:
        """Show a run that has ended."""
        self._done += 1
        self._failed += results["status"] != "ok"
        if self._bar is not None:
            self._bar.update()
        elif self._lines:
            spent = results.get("wall_seconds")
            took = f", {spent:.1f} s" if spent is not None else ""
            self._print(f"{self._done} of {self._count}: {name}: {results['status']}{took}")

    def running(self, names: Sequence[str]) -> None:
        """Show the running ones."""
        if self._bar is not None and time.monotonic() > self._shown + _REFRESH:
            self._shown = time.monotonic()
            failed = f"{self._failed} failed, " if self._failed else ""
            self._bar.set_postfix_str(f"{failed}running {', '.join(names)}")

    def close(self) -> None:
        """End the bar."""
        if self._bar is not None:
            self._bar.close()
            self._bar = None

    @staticmethod
    def _print(text: str) -> None:
        print(f"{time.strftime('%Y-%m-%d %H:%M:%S')} {text}", file=sys.stderr, flush=True)
