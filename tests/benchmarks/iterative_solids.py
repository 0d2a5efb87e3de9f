# SPDX-License-Identifier: LGPL-3.0-or-later
"""Large solids with factors and with Krylov methods: iterations, memory and time as they grow.

A bar of quadratic tetrahedra, or a block, rotates freely or hangs from one end, or sinks to its
static equilibrium there. Each run is a fresh process with one thread a rank. Run from the source
tree::

    python -m tests.benchmarks.iterative_solids
    python -m tests.benchmarks.iterative_solids --statics --cells 11 --ranks 2
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
STEP, SOLVERS = 1e-3, ("direct", "iterative")
#: Sizes, m, and boxes of six tetrahedra along them, in parts of the smallest number.
SHAPES = {"bar": ((1.0, 0.1, 0.1), (10, 1, 1)), "block": ((0.3, 0.3, 0.3), (1, 1, 1))}


def measure(cells: int, solver: str, steps: int, shape: str, *, hangs: bool, statics: bool) -> None:
    """Run a solid of cells across its smallest side and print its figures on the first rank."""
    from mpi4py import MPI

    import flexfem as ff
    from flexfem.la.direct import DirectSolver
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
    timed(DirectSolver, "factor", "factors")
    timed(DirectSolver, "solve", "solves")
    timed(KrylovFactor, "_renew", "factors")
    timed(KrylovFactor, "_converges", "solves")
    sizes, counts = SHAPES[shape]
    mesh = ff.SolidMesh.box(sizes, [cells * count for count in counts], "tetrahedron")
    model = ff.Model(shape)
    rubber = ff.laws.NeoHookean.from_young(1e7, 0.3)
    hangs = hangs or statics
    solid = ff.Solid(
        "solid", rubber, mesh, density=1100.0, fixed={"x0": "xyz"} if hangs else {},
        angular_velocity=(0.0, 0.0, 0.0 if hangs else 2.0),
    )  # fmt: skip
    model.add(solid, ff.Gravity((0.0, 0.0, -9.81)))
    model.add(ff.PositionProbe("end", ff.Marker("solid", (sizes[0], 0.0, 0.0))))
    common: Any = {"split_above": 1, "quiet": True, "linear_solver": solver}
    if statics:
        outcome = ff.solve_static(model, ff.StaticOptions(load_steps=1, **common))
    else:
        outcome = ff.simulate(model, ff.RunOptions(dt=STEP, t_end=steps * STEP, **common))
    comm = MPI.COMM_WORLD
    used = resource.getrusage(resource.RUSAGE_SELF)
    peak = comm.allreduce(1e-6 * used.ru_maxrss)
    spent["processor"] = used.ru_utime + used.ru_stime
    spent = {name: comm.allreduce(value, op=MPI.MAX) for name, value in spent.items()}
    if comm.rank == 0:
        end = float(outcome.history["end_z"][-1])
        print(json.dumps(outcome.summary | spent | {"peak": peak, "end": end}))


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
    parser.add_argument("--measure", choices=SOLVERS, help=argparse.SUPPRESS)
    parser.add_argument("--solver", choices=SOLVERS, help="of one run alone")
    parser.add_argument("--cells", type=int, default=0, help="of one run alone")
    parser.add_argument("--steps", type=int, default=3)
    parser.add_argument("--ranks", type=int, default=1)
    parser.add_argument("--shape", choices=tuple(SHAPES), default="bar")
    parser.add_argument("--hangs", action="store_true", help="fixed at one end, at rest")
    parser.add_argument("--statics", action="store_true", help="static equilibrium, fixed likewise")
    args = parser.parse_args()
    if args.measure:
        measure(
            args.cells, args.measure, args.steps, args.shape, hangs=args.hangs,
            statics=args.statics,
        )  # fmt: skip
        return
    more = ["--shape", args.shape]
    more += [f"--{name}" for name in ("hangs", "statics") if getattr(args, name)]
    print(
        "| unknowns | solver | iterations a solve | factors, hierarchy s | solves s | processor s "
        "| peak GB | end m |"
    )
    for cells in (args.cells,) if args.cells else (3, 7, 16):
        for solver in (args.solver,) if args.solver else SOLVERS if cells < 16 else ("iterative",):
            found = run(cells, solver, args.ranks, args.steps, more)
            each = found["iterations"] / max(found.get("stiff_solves", 0.0), 1.0)
            print(
                f"| {found['unknowns']} | {solver} | {each:.1f} | {found['factors']:.1f} "
                f"| {found['solves']:.1f} | {found['processor']:.0f} | {found['peak']:.2f} "
                f"| {found['end']:.12f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
