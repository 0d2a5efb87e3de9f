# SPDX-License-Identifier: LGPL-3.0-or-later
"""Warnings of a run: kept for the summary, and printed to stderr once the run is accepted."""

from collections.abc import Iterable
from typing import Self

from mpi4py import MPI

from flexfem import launch
from flexfem.inspection.check import findings_of_run
from flexfem.layout.numbered_model import NumberedModel
from flexfem.options import Settings
from flexfem.simulation.run.rank_use import idle_or_crowded
from flexfem.system.system import System

__all__ = ["Cautions"]


class Cautions:
    """Warnings of a run, one line each.

    Attributes:
        texts: all lines so far, for the summary.
        found: names of the checks with findings.
    """

    def __init__(self, comm: MPI.Intracomm, options: Settings) -> None:
        """Begin without any; the first rank prints them, unless options are ``quiet``."""
        self._aloud = comm.rank == 0 and not options.quiet
        self._said = 0
        self.texts: list[str] = []
        self.found: set[str] = set()

    @classmethod
    def of_model(cls, serial: NumberedModel, options: Settings, system: System) -> Self:
        """Collect the findings of the checks of a model, and warnings on idle ranks (collective).

        Args:
            serial: serial data of the model, the same on every rank.
            options: those of the analysis.
            system: the model's system.
        """
        made = cls(system.comm, options)
        findings = findings_of_run(serial, options)
        made.found = {finding.check for finding in findings}
        # the run compares the velocities at its start itself
        made.note(str(finding) for finding in findings if finding.check != "velocities")
        made.note(idle_or_crowded(system))
        return made

    def note(self, texts: Iterable[str]) -> None:
        """Store warnings, the same on every rank, until the next :meth:`say`."""
        self.texts += texts

    def say(self, texts: Iterable[str] = ()) -> None:
        """Print the stored and further warnings, the same on every rank."""
        self.note(texts)
        for text in self.texts[self._said :] if self._aloud else ():
            launch.say(f"warning: {text}", error=True)
        self._said = len(self.texts)
