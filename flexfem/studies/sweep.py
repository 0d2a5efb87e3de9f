# SPDX-License-Identifier: LGPL-3.0-or-later
"""A sweep: a case run with many values of its options, several runs at a time."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from flexfem import launch
from flexfem.analyses.analysis import Analysis
from flexfem.io.folder_lock import FolderLock
from flexfem.options import progress_kind
from flexfem.studies.folders import RunFolder, StudyFolder
from flexfem.studies.model_check import check_models
from flexfem.studies.plan import Plan
from flexfem.studies.progress import SweepProgress
from flexfem.studies.reductions import Reduction
from flexfem.studies.workers import Workers

__all__ = ["Sweep", "sweep"]

#: ``--every`` of runs in a temporary folder.
_NEVER = 1_000_000_000


def sweep(
    case: str | Path,
    vary: Mapping[str, Sequence[Any]],
    *,
    options: Mapping[str, Any] | None = None,
    together: bool = False,
    reduce: Sequence[str] = (),
    columns: Sequence[str] = (),
    output: Path | str | None = None,
    jobs: int | None = None,
    ranks: int = 1,
    workers: Workers | None = None,
    analysis: Analysis | None = None,
    smoke: bool = False,
    progress: str = "none",
) -> Sweep:
    """Run a case with many values of its options; all options are checked before the first run.

    They run in processes of their own, several at a time. Iterate over the result to run them::

        for parameters, results in ff.sweep("heavy_top", {"dt": [1e-3, 5e-4]}, output="order"):
            print(parameters["dt"], results["status"], results["centre_x"])

    ``results`` has ``status`` ("ok", or why the run failed), the headline results of the case, the
    reduced columns, ``unknowns``, ``steps``, ``newton_iterations``, ``factorizations`` and
    ``wall_seconds``. They come in the order of the parameters, each as soon as it is there. A
    folder that holds some of the runs already, with the same options, is continued: what has ended
    well is not run again.

    Args:
        case: name of a shipped case, or path of a case file.
        vary: values of each option that is varied, each with each.
        options: values of other options.
        together: vary the options together, first value with first value and so on.
        reduce: columns of the history to reduce, such as "max:tip_x": final, max, min, mean, rms
            or integral (over time); results ``tip_x_max``.
        columns: other ones that the histories must have, such as those to be plotted.
        output: folder of the study with one folder for each run and the table ``sweep.csv``; None
            for a temporary one.
        jobs: runs at the same time; as many as there are cores for their ranks by default.
        ranks: MPI ranks of each run.
        workers: processes that stay for other studies; they have their own jobs and ranks.
        analysis: other than that of the case.
        smoke: a few steps on tiny meshes.
        progress: "auto", "bar", "lines" or "none".

    Raises:
        TypeError: A value has the wrong type.
        ValueError: There is no such case, option or column, a value is not admissible, nothing
            varies, or the folder is that of something else.
        OSError: The folder cannot be written.
    """
    plan = Plan(
        case, vary, options or {}, together=together, smoke=smoke, analysis=analysis
    )  # fmt: skip
    reductions = [Reduction.parse(text) for text in reduce]
    if workers is not None and (jobs is not None or ranks != 1):
        raise ValueError("sweep: workers have jobs and ranks, give neither beside them")
    shared = workers is not None
    pool = Workers(jobs, ranks) if workers is None else workers
    return Sweep(plan, reductions, columns, output, pool, shared, progress)


class Sweep:
    """The runs of a sweep; iterating over it makes the runs.

    Attributes:
        folder: where they are, None before a temporary one is made.
        results: of each run so far.
    """

    def __init__(
        self, plan: Plan, reductions: Sequence[Reduction], columns: Sequence[str],
        output: Path | str | None, workers: Workers, shared: bool, progress: str,
    ) -> None:  # fmt: skip
        """Check all that can be checked; see :func:`sweep`. Nothing is written."""
        self._workers, self._shared = workers, shared
        self._plan, self._reductions, self._how = plan, list(reductions), progress
        progress_kind(progress)
        self.folder = None if output is None else Path(output)
        self._study: StudyFolder | None = None
        if self.folder is not None:
            self._study = StudyFolder(self.folder, plan.identity, plan.runs)
        self.results: list[dict[str, Any]] = []
        needed = [*(reduction.column for reduction in reductions), *columns]
        check_models(plan.identity, [run.parameters for run in plan.runs], needed)

    def __len__(self) -> int:
        """Number of runs."""
        return len(self._plan.runs)

    @property
    def folders(self) -> list[Path]:
        """Folders of the runs, none where they are temporary."""
        return [] if self._study is None else [folder.path for folder in self._study.runs]

    @property
    def failed(self) -> int:
        """Number of runs that have failed so far."""
        return sum(own["status"] != "ok" for own in self.results)

    @property
    def missing_columns(self) -> list[str]:
        """Columns to be reduced that no run has."""
        done = [own for own in self.results if own["status"] == "ok"]
        return [
            reduction.column
            for reduction in self._reductions
            if done and all(own.get(reduction.label) is None for own in done)
        ]

    def run(self) -> list[dict[str, Any]]:
        """Make all runs and return the rows of the table: parameters and results of each."""
        return [{**parameters, **results} for parameters, results in self]

    def __iter__(self) -> Iterator[tuple[Mapping[str, Any], Mapping[str, Any]]]:
        """Make the runs that are not there yet; parameters and results of each.

        Raises:
            InputError: Another sweep is running in the folder.
            KeyboardInterrupt: SIGINT, SIGTERM or SIGHUP came; runs were interrupted, and can be
                resumed.
            OSError: Results cannot be written.
        """
        if self._study is not None:
            yield from self._runs(self._study)
            return
        folder = Path(tempfile.mkdtemp(prefix="flexfem-sweep-"))
        try:
            yield from self._runs(StudyFolder(folder, self._plan.identity, self._plan.runs))
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def _runs(self, study: StudyFolder) -> Iterator[tuple[Mapping[str, Any], Mapping[str, Any]]]:
        lock = FolderLock(study.path)
        lock.take()
        try:
            yield from self._locked(study)
        finally:
            lock.release()

    def _locked(self, study: StudyFolder) -> Iterator[tuple[Mapping[str, Any], Mapping[str, Any]]]:
        study.prepare()
        workers = self._workers
        waiting = [k for k, folder in enumerate(study.runs) if not folder.finished]
        known = set(range(len(study.runs))) - set(waiting)
        self.results = self._collect(study)
        shown, told = SweepProgress(len(study.runs), len(known), self._how), 0
        try:
            with launch.StopSignals() as signals:
                study.write_table(self.results)
                while waiting or workers.running:
                    while waiting and not workers.full and not signals.received:
                        self._start(study.runs, waiting.pop(0))
                    for k, code in workers.ended():
                        study.runs[k].ended(code)
                        self.results[k] = study.runs[k].results(self._reductions)
                        known.add(k)
                        study.write_table(self.results)
                        shown.ended(study.runs[k].run.name, self.results[k])
                    if signals.received:
                        workers.stop()
                        self.results = self._collect(study)
                        study.write_table(self.results)
                        raise self._interrupted(signals.received)
                    shown.running([study.runs[k].run.name for k in workers.running])
                    while told in known:
                        yield study.runs[told].run.parameters, self.results[told]
                        told += 1
                for k in range(told, len(study.runs)):
                    yield study.runs[k].run.parameters, self.results[k]
        finally:
            if workers.running or not self._shared:
                workers.stop()
            shown.close()

    def _start(self, folders: Sequence[RunFolder], k: int) -> None:
        folder = folders[k]
        more = folder.prepare()
        if self.folder is None and "every" in {o.name for o in self._plan.case.all_options()}:
            more.append(f"--every={_NEVER}")
        own = [*folder.run.arguments, *more, "--quiet", f"--output={folder.path}"]
        self._workers.start(k, own, folder.log)

    def _collect(self, study: StudyFolder) -> list[dict[str, Any]]:
        return [folder.results(self._reductions) for folder in study.runs]

    def _interrupted(self, number: int) -> launch.Interrupted:
        done = sum(own["status"] == "ok" for own in self.results)
        return launch.Interrupted(number, f"interrupted after {done} of {len(self)} runs")
