# SPDX-License-Identifier: LGPL-3.0-or-later
"""Step times of deployable trusses of several sizes on one rank and on two.

The loops of such a truss make the multipliers' system wide. Each run is a fresh process with one
thread a rank, those of one size take turns. Run from the source tree, on an idle machine::

    python -m tests.benchmarks.truss_on_ranks
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
STEP = 5e-3


def run(bays: int, ranks: int, steps: int) -> dict[str, Any]:
    """The summary of one run."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "cases/deployable_truss.py"]
        command += ["--bays", str(bays), "--dt", repr(STEP), "--t-end", repr(steps * STEP)]
        command += ["--every", "1000000000", "--quiet", "--output", folder]
        if ranks > 1:
            command = [str(Path(sys.executable).parent / "mpiexec"), "-n", str(ranks), *command]
        environment = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        subprocess.run(command, check=True, cwd=ROOT, env=environment)
        summary: dict[str, Any] = json.loads((Path(folder) / "summary.json").read_text())
    return summary


def main() -> None:
    """Print one line for each size: the quickest run of several rounds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bays", type=int, nargs="+", default=[2, 8, 20])
    parser.add_argument("--ranks", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--steps", type=int, default=400)
    parser.add_argument("--rounds", type=int, default=3)
    args = parser.parse_args()
    print("bays  unknowns  multipliers  " + "  ".join(f"ms, x{n}" for n in args.ranks)
          + "  iterations/step  factorizations  faster by")  # fmt: skip
    for bays in args.bays:
        rounds = [[run(bays, n, args.steps) for n in args.ranks] for _ in range(args.rounds)]
        times = [
            min(1e3 * one["wall_seconds_steps"] / one["steps"] for one in runs)
            for runs in zip(*rounds, strict=True)
        ]
        one = rounds[0][0]
        print(f"{bays:4d}  {one['unknowns']:8d}  {one['multipliers']:11d}  "
              + "  ".join(f"{time:6.2f}" for time in times)
              + f"  {one['newton_iterations'] / one['steps']:15.2f}  {one['factorizations']:14d}"
              + f"  {times[0] / times[-1]:9.2f}")  # fmt: skip


if __name__ == "__main__":
    main()
