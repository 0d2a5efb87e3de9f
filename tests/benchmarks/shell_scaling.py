# SPDX-License-Identifier: LGPL-3.0-or-later
"""Time of a step of one shell that grows, with kept factors and with fresh ones, on ranks.

A square sheet pinned at two corners swings under gravity. It is split over the ranks, so that its
factors are distributed. Each run is a fresh process with one thread a rank. Run from the source
tree, on an idle machine::

    python -m tests.benchmarks.shell_scaling
"""

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
STEP = 1e-3


def measure(nodes: int, policy: str, steps: int) -> None:
    """Run a sheet of nodes x nodes and print its summary on the first rank."""
    from mpi4py import MPI

    import flexfem as ff

    mesh = ff.SurfaceMesh.rectangle("sheet", (1.0, 1.0), (nodes - 1, nodes - 1))
    section = ff.ShellSection.isotropic(0.005, ff.Material(1e9, 0.3, 1000.0))
    model = ff.Model("sheet", surface=mesh)
    model.add(ff.Shell("sheet", section), ff.Gravity((0.0, 0.0, -9.81)))
    for side in ("left", "right"):
        corner = f"sheet_bottom_{side}"
        place = ff.Ground(mesh.points[mesh.nodes[corner]])
        model.add(ff.Spherical(side, place, ff.Marker("sheet", corner)))
    outcome = ff.simulate(
        model,
        ff.RunOptions(
            dt=STEP, t_end=steps * STEP, iteration_matrix=policy, split_above=1, quiet=True
        ),
    )
    if MPI.COMM_WORLD.rank == 0:
        print(json.dumps(outcome.summary))


def run(nodes: int, policy: str, ranks: int, steps: int) -> dict[str, Any]:
    """The summary of one run."""
    command = [sys.executable, "-m", "tests.benchmarks.shell_scaling", "--measure", policy]
    command += ["--nodes", str(nodes), "--steps", str(steps)]
    if ranks > 1:
        command = [str(Path(sys.executable).parent / "mpiexec"), "-n", str(ranks), *command]
    environment = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(
        command, check=True, cwd=ROOT, env=environment, capture_output=True, text=True
    )
    summary: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return summary


def main() -> None:
    """Print one line for each size."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--nodes", type=int, nargs="+", default=[19, 33, 61, 101, 183])
    parser.add_argument("--ranks", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--steps", type=int, default=20)
    parser.add_argument("--measure", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.measure:
        measure(args.nodes[0], args.measure, args.steps)
        return
    kinds = [(policy, n) for policy in ("auto", "updated") for n in args.ranks]
    print("nodes  unknowns  " + "  ".join(f"{p} x{n}, ms" for p, n in kinds)
          + "  iterations/step  factorizations")  # fmt: skip
    for nodes in args.nodes:
        runs = [run(nodes, policy, n, args.steps) for policy, n in kinds]
        times = [1e3 * one["wall_seconds_steps"] / one["steps"] for one in runs]
        kept = runs[0]
        print(f"{nodes:5d}  {kept['unknowns']:8d}  "
              + "  ".join(f"{t:{len(p) + 7}.2f}" for t, (p, _) in zip(times, kinds, strict=True))
              + f"  {kept['newton_iterations'] / kept['steps']:15.2f}"
              + f"  {kept['factorizations']:14d}")  # fmt: skip


if __name__ == "__main__":
    main()
