# SPDX-License-Identifier: LGPL-3.0-or-later
"""Progress bar over simulated time or a load factor."""

from __future__ import annotations

import sys
from types import TracebackType
from typing import Any, Self

from flexfem.io.notebook import bar_class, in_notebook


class Progress:
    """Bar on the standard error stream: time, iterations, factorisations, remaining time.

    It appears only if the stream is a terminal, and in notebooks.
    """

    def __init__(
        self, t_end: float, enabled: bool, *, t_start: float = 0.0, unit: str = "s"
    ) -> None:
        """Show an empty bar.

        Args:
            t_end: End of the simulated time or of the load factor.
            enabled: False on ranks other than 0 and in quiet runs.
            t_start: Its start (after a restart: where it goes on).
            unit: Of both; empty for a load factor.
        """
        self._bar: Any = None
        self._t_end = float(t_end)
        self._unit = f" {unit}" if unit else ""
        if not (enabled and (sys.stderr.isatty() or in_notebook())):
            return
        # its import costs start-up time, and batch runs never need it
        self._bar = bar_class()(
            total=float(t_end),
            initial=float(t_start),
            file=sys.stderr,
            miniters=0,
            mininterval=0.1,
            dynamic_ncols=True,
            bar_format="{percentage:3.0f}%|{bar}| {desc}{elapsed} < {remaining}",
        )

    def update(self, t: float, iterations: int, factorizations: int) -> None:
        """Show the state after a step.

        Args:
            t: Simulated time or load factor.
            iterations: Newton iterations so far.
            factorizations: Factorisations so far.
        """
        if self._bar is None:
            return
        self._bar.set_description_str(
            f"t = {t:.4g} of {self._t_end:.4g}{self._unit}, {iterations} iterations, "
            f"{factorizations} factorisations, ",
            refresh=False,
        )
        # Rounding may carry the last step past the end, which would drop the bar.
        self._bar.update(min(t, self._t_end) - self._bar.n)

    def close(self) -> None:
        """Leave the bar as it is and end the line."""
        if self._bar is not None:
            self._bar.close()
            self._bar = None

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
