# SPDX-License-Identifier: LGPL-3.0-or-later
"""Ahead-of-time compilation of loops and forms, by short runs of cases."""

import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from flexfem.studies.workers import Workers

__all__ = ["KINDS_OF_MODELS", "Compiled", "compile_ahead"]

#: Shipped cases that together have all kinds of bodies, joints, contacts and results that any of
#: them has; what takes longest comes first.
KINDS_OF_MODELS = (
    "circular_strips", "slider_crank", "connecting_rod", "deployable_truss", "solar_array",
    "sliding_beam", "draping", "nonlinear_beam", "bend_45", "heavy_top",
)  # fmt: skip


class Compiled(NamedTuple):
    """Outcome of the short run of a case.

    Attributes:
        case: its name.
        seconds: that it took.
        fault: its last output if it failed, else empty.
    """

    case: str
    seconds: float
    fault: str


def compile_ahead(cases: Sequence[str], jobs: int) -> Iterator[Compiled]:
    """Run cases for some steps each, several at a time, and yield them as they end.

    Loops that two of them need at the same time are compiled by one.

    Args:
        cases: names of shipped cases, or paths of case files.
        jobs: number of runs at the same time.
    """
    workers = Workers(jobs)
    begun: dict[str, float] = {}
    left = list(cases)
    with tempfile.TemporaryDirectory(prefix="flexfem-compile-") as folder:
        try:
            while left or workers.running:
                while left and not workers.full:
                    case = left.pop(0)
                    begun[case] = time.monotonic()
                    own = Path(folder) / str(len(begun))
                    line = [case, "--smoke", "--quiet", "--output", str(own / "results")]
                    workers.start((case, own / "log"), line, own / "log")
                for (case, log), code in workers.ended():
                    said = log.read_text(errors="replace").strip().splitlines()
                    fault = f"exit code {code}: {said[-1] if said else 'no message'}"
                    yield Compiled(case, time.monotonic() - begun[case], fault if code else "")
        finally:
            workers.stop()
