# SPDX-License-Identifier: LGPL-3.0-or-later
"""Time per step of chains of reduced bars: flexfem against Exudyn on this machine.

Run from the source tree, on a quiet machine::

    python tests/benchmarks/floating_against_exudyn.py --json floating.json

The model is in ``floating_chain.py``. The programs take turns (A B A B ...), each run in a fresh
process; the smallest time counts. Besides the plain bar, whose functions are Exudyn's, flexfem is
timed with mean axes and with geometric stiffening, which the bars in Exudyn have not.
"""

import argparse
import json
import os
import sys
from pathlib import Path

from chain_against_exudyn import HERE, Measurement, parse_cases, report, spawn

ALL_CASES = [(1, 6), (4, 6), (16, 6), (64, 6), (4, 30)]
FLEXFEM = {
    "flexfem": [],
    "flexfem mean": ["--frame", "mean_axes"],
    "flexfem stiff": ["--stiffening"],
}


def measure(bodies: int, modes: int, args: argparse.Namespace) -> list[Measurement]:
    """Measure all programs on one case, taking turns: flexfem's plain bar before its others."""
    sizes = ["--bodies", str(bodies), "--modes", str(modes)]
    sizes += ["--steps", str(args.steps), "--dt", str(args.dt)]
    commands = {f"exudyn {preset}": ["exudyn", "--preset", preset] for preset in args.presets}
    commands |= {name: ["flexfem", *more] for name, more in FLEXFEM.items()}
    measurements = {name: Measurement(name) for name in commands}
    for _ in range(args.repeats):
        for name, command in commands.items():
            into = measurements[name]
            script = str(HERE / "floating_chain.py")
            out, into.memory = spawn([sys.executable, script, *command, *sizes])
            result = json.loads(out.strip().splitlines()[-1])
            if not result["success"]:
                raise RuntimeError(f"{name} failed on {bodies} bars with {modes} modes")
            into.seconds.append(result["wall_seconds_per_step"])
            into.iterations = result["iterations_per_step"]
            into.factorizations = result["jacobians"]
            into.tip = result["tip"]
    return list(measurements.values())


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=parse_cases, default=ALL_CASES, help="BODIESxMODES,...")
    parser.add_argument("--steps", type=int, default=500)
    parser.add_argument("--dt", type=float, default=1e-3, help="step size in s")
    parser.add_argument("--repeats", type=int, default=3, help="runs of each program")
    parser.add_argument("--presets", nargs="+", default=["lagged", "per_step", "dense"])
    parser.add_argument("--json", type=Path, help="write the records to this file")
    args = parser.parse_args()
    print(f"load average {os.getloadavg()[0]:.2f} on {os.cpu_count()} cores")
    head = f"{'case':>10s}  {'program':16s} {'min ms':>9s} {'median ms':>9s}"
    print(f"{head} {'iter':>6s} {'factor':>6s} {'MB':>8s}")
    try:
        records = [report({"bodies": n, "modes": m}, measure(n, m, args)) for n, m in args.cases]
    except RuntimeError as error:
        sys.exit(f"error: {error}")
    if args.json:
        args.json.write_text(json.dumps({"dt": args.dt, "steps": args.steps, "cases": records}))


if __name__ == "__main__":
    main()
