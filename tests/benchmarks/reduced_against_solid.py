# SPDX-License-Identifier: LGPL-3.0-or-later
"""Time of a motion of a nonlinear reduced solid and of the same mesh with all nodes.

Run from the source tree, on a quiet machine::

    python tests/benchmarks/reduced_against_solid.py

The model is that of ``tests/verification/benchmarks/solid_reduction.py``, whose lengths of cells
may be divided. Both take turns (A B A B ...) in one process after a first run each, which compiles;
medians count.
"""

import argparse
import json
import statistics
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import flexfem as ff
from tests.verification.benchmarks import solid_reduction as case


def seconds(parts: tuple) -> tuple[float, dict]:
    """Time of a motion with its history."""
    model = case.falling(*parts)
    options = ff.RunOptions(dt=case.STEP, t_end=case.END, quiet=True)
    begin = time.perf_counter()
    history = ff.simulate(model, options).history
    return time.perf_counter() - begin, dict(history)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--modes", type=int, default=4)
    parser.add_argument("--derivatives", type=int, default=8)
    parser.add_argument("--finer", type=int, default=1, help="divide lengths of cells by this")
    parser.add_argument("--repeats", type=int, default=5, help="runs of each")
    args = parser.parse_args()
    case.CELLS = tuple(args.finer * count for count in case.CELLS)
    begin = time.perf_counter()
    data = case.reduction(args.modes, args.derivatives, case.CELLS)
    reducing = time.perf_counter() - begin
    bodies = {
        "reduced": (ff.FloatingBody("beam", data), *case.reduced_markers()),
        "solid": case.full(),
    }
    times: dict[str, list[float]] = {name: [] for name in bodies}
    last = {}
    for turn in range(args.repeats + 1):
        for name, parts in bodies.items():
            spent, last[name] = seconds(parts)
            if turn:
                times[name].append(spent)
    middle = {name: statistics.median(values) for name, values in times.items()}
    record = {
        "cells": case.CELLS, "reduction_s": reducing, "seconds": middle,
        "ratio": middle["solid"] / middle["reduced"], "all_seconds": times,
        "apart_m": float(case.apart(last["reduced"], last["solid"]).max()),
    }  # fmt: skip
    print(json.dumps(record))


if __name__ == "__main__":
    main()
