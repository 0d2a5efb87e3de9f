# SPDX-License-Identifier: LGPL-3.0-or-later
"""Warnings of a run: kept for the summary, and printed to stderr once the run is accepted."""

from collections.abc import Iterable

from flexfem import launch
from flexfem.inspection.check import findings_of_run
from flexfem.options import Settings
from flexfem.simulation.rank_use import idle_or_crowded
from flexfem.system.assembly import Assembly
from flexfem.system.system import System

__all__ = ["Cautions"]


class Cautions:
    """Warnings of a run, one line each.

    Attributes:
        texts: all lines so far, for the summary.
        found: names of the checks that have found something.
    """

    def __init__(self, serial: Assembly, options: Settings, system: System) -> None:
        """Note what the checks of the model have found, and ranks in vain (collective).

        Args:
            serial: serial data of the model, the same on every rank.
            options: those of the analysis; with ``quiet`` nothing is said, but kept.
            system: the model's system, whose first rank speaks.
        """
        self._aloud = system.comm.rank == 0 and not options.quiet
        self._said = 0
        self.texts: list[str] = []
        findings = findings_of_run(serial, options)
        self.found = {finding.check for finding in findings}
        # the run knows better with which velocities it starts
        self.note(str(finding) for finding in findings if finding.check != "velocities")
        self.note(idle_or_crowded(system))

    def note(self, texts: Iterable[str]) -> None:
        """Keep warnings, the same on every rank, until the next :meth:`say`."""
        self.texts += texts

    def say(self, texts: Iterable[str] = ()) -> None:
        """Warn of what was noted and of something more, the same on every rank."""
        self.note(texts)
        for text in self.texts[self._said :] if self._aloud else ():
            launch.say(f"warning: {text}", error=True)
        self._said = len(self.texts)
