# SPDX-License-Identifier: LGPL-3.0-or-later
"""Large solids with factors and with Krylov methods: iterations, memory and time as they grow.

A bar of quadratic tetrahedra, or a block, rotates freely or hangs from one end. Each run is a fresh
process with one thread a rank. Run from the source tree::

    python -m tests.benchmarks.iterative_solids
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
STEP = 1e-3
#: Sizes, m, and boxes of six tetrahedra along them, in parts of the smallest number.
SHAPES = {"bar": ((1.0, 0.1, 0.1), (10, 1, 1)), "block": ((0.3, 0.3, 0.3), (1, 1, 1))}


def measure(cells: int, solver: str, steps: int, shape: str, *, hangs: bool) -> None:
    """Run a solid of cells across its smallest side and print its figures on the first rank."""
    from mpi4py import MPI

    import flexfem as ff
    from flexfem.la.factor import Factor
    from flexfem.la.krylov import KrylovFactor

    spent = dict.fromkeys(("factors", "solves", "iterations"), 0.0)

    def timed(kind: type, name: str, key: str) -> None:
        inner = getattr(kind, name)

        def outer(self: Any, *arguments: Any, **options: Any) -> Any:
            begin = time.process_time()
            found = inner(self, *arguments, **options)
            spent[key] += time.process_time() - begin
            if name == "_converges" and self._motions is not None:
                spent["stiff_solves"] = spent.get("stiff_solves", 0.0) + 1.0
                spent["iterations"] += self._ksp.getIterationNumber()
            return found

        setattr(kind, name, outer)

    timed(Factor, "__init__", "factors")
    timed(KrylovFactor, "__init__", "factors")
    timed(KrylovFactor, "_converges", "solves")
    sizes, counts = SHAPES[shape]
    mesh = ff.SolidMesh.box(sizes, [cells * count for count in counts], "tetrahedron")
    model = ff.Model(shape)
    rubber = ff.laws.NeoHookean.from_young(1e7, 0.3)
    solid = ff.Solid(
        "solid", rubber, mesh, density=1100.0, fixed={"x0": "xyz"} if hangs else {},
        angular_velocity=(0.0, 0.0, 0.0 if hangs else 2.0),
    )  # fmt: skip
    model.add(solid, ff.Gravity((0.0, 0.0, -9.81)))
    outcome = ff.simulate(
        model,
        ff.RunOptions(dt=STEP, t_end=steps * STEP, split_above=1, quiet=True, linear_solver=solver),
    )
    comm = MPI.COMM_WORLD
    peak = comm.allreduce(1e-6 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
    spent = {name: comm.allreduce(value, op=MPI.MAX) for name, value in spent.items()}
    if comm.rank == 0:
        print(json.dumps(outcome.summary | spent | {"peak": peak}))


def run(cells: int, solver: str, ranks: int, steps: int, more: list[str]) -> dict[str, Any]:
    """The figures of one run."""
    command = [sys.executable, "-m", "tests.benchmarks.iterative_solids", "--measure", solver]
    command += ["--cells", str(cells), "--steps", str(steps), *more]
    if ranks > 1:
        command = [str(Path(sys.executable).parent / "mpiexec"), "-n", str(ranks), *command]
    environment = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(
        command, check=True, cwd=ROOT, env=environment, capture_output=True, text=True
    )
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


def main() -> None:
    """Print a table, or carry out one run."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--measure", choices=("direct", "iterative"), help=argparse.SUPPRESS)
    parser.add_argument("--cells", type=int, default=0, help="of one run alone")
    parser.add_argument("--steps", type=int, default=3)
    parser.add_argument("--ranks", type=int, default=1)
    parser.add_argument("--shape", choices=tuple(SHAPES), default="bar")
    parser.add_argument("--hangs", action="store_true", help="fixed at one end, at rest")
    args = parser.parse_args()
    if args.measure:
        measure(args.cells, args.measure, args.steps, args.shape, hangs=args.hangs)
        return
    more = ["--shape", args.shape, *(["--hangs"] if args.hangs else [])]
    print("| unknowns | solver | iterations a solve | factors, hierarchy s | solves s | peak GB |")
    for cells in (args.cells,) if args.cells else (3, 7, 16):
        for solver in ("direct", "iterative") if cells < 16 else ("iterative",):
            found = run(cells, solver, args.ranks, args.steps, more)
            each = found["iterations"] / max(found.get("stiff_solves", 0.0), 1.0)
            print(
                f"| {found['unknowns']} | {solver} | {each:.1f} | {found['factors']:.1f} "
                f"| {found['solves']:.1f} | {found['peak']:.2f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
