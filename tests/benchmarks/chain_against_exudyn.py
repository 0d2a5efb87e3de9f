# SPDX-License-Identifier: LGPL-3.0-or-later
"""Time per step of the chain of flexible links: flexfem against Exudyn on this machine.

Run from the source tree, on a quiet machine::

    python tests/benchmarks/chain_against_exudyn.py --json chain.json

The programs take turns (A B A B ...), each run in a fresh process; the smallest time counts.
"""

import argparse
import csv
import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
ALL_CASES = [(links, elements) for elements in (8, 32) for links in (1, 4, 16, 64, 256)]


@dataclass
class Measurement:
    """Runs of one program on one case.

    Attributes:
        program: Label, e.g. ``exudyn lagged`` or ``flexfem x 1``.
        seconds: Wall time per step of every run, s.
        iterations: Newton iterations per step.
        factorizations: Factorisations in the run.
        memory: Peak resident set of the largest process, MB.
        tip: Position of the chain's tip at the end in m, if known.
    """

    program: str
    seconds: list[float] = field(default_factory=list)
    iterations: float = 0.0
    factorizations: int = 0
    memory: float = 0.0
    tip: list[float] | None = None

    @property
    def best(self) -> float:
        """Smallest time per step, s."""
        return min(self.seconds)


def spawn(command: list[str]) -> tuple[str, float]:
    """Run a child; return its standard output and its peak resident set in MB."""
    environment = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as err:
        child = subprocess.Popen(command, stdout=out, stderr=err, cwd=ROOT, env=environment)
        # wait4 reports this child alone; RUSAGE_CHILDREN would keep the largest of all runs.
        _, status, usage = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
        out.seek(0)
        err.seek(0)
        if child.returncode != 0:
            reason = (err.read().strip().splitlines() or ["no message"])[-1]
            raise RuntimeError(f"{' '.join(command)} ended with {child.returncode}: {reason}")
        return out.read(), usage.ru_maxrss / 1024.0


def run_exudyn(
    links: int, elements: int, steps: int, dt: float, preset: str, into: Measurement
) -> None:
    """Add one Exudyn run to a measurement; see ``exudyn_chain.run`` for the arguments."""
    command = [sys.executable, str(HERE / "exudyn_chain.py"), "--preset", preset]
    command += ["--links", str(links), "--elements", str(elements)]
    command += ["--steps", str(steps), "--dt", str(dt)]
    out, into.memory = spawn(command)
    result = json.loads(out.strip().splitlines()[-1])
    if not result["success"]:
        raise RuntimeError(f"Exudyn ({preset}) failed on {links} x {elements}")
    into.seconds.append(result["wall_seconds_per_step"])
    into.iterations = result["iterations_per_step"]
    into.factorizations = result["jacobians"]
    into.tip = result["tip"]


def run_flexfem(
    links: int, elements: int, steps: int, dt: float, ranks: int, into: Measurement
) -> None:
    """Add one flexfem run on ``ranks`` processes to a measurement."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "cases/chain.py"]
        command += ["--links", str(links), "--elements", str(elements)]
        command += ["--t-end", repr(steps * dt), "--dt", repr(dt)]
        command += ["--every", "1000000000", "--quiet", "--output", folder]
        if ranks > 1:
            beside = Path(sys.executable).parent / "mpiexec"
            launcher = str(beside) if beside.exists() else shutil.which("mpiexec") or "mpiexec"
            command = [launcher, "-n", str(ranks), *command]
        _, into.memory = spawn(command)
        summary = json.loads((Path(folder) / "summary.json").read_text())
        into.tip = _last_tip(Path(folder) / "history.csv")
    done = summary["steps"]
    into.seconds.append(summary["wall_seconds_steps"] / max(done - 1, 1))
    into.iterations = summary["newton_iterations"] / done
    into.factorizations = summary["factorizations"]


def _last_tip(history: Path) -> list[float] | None:
    """Tip position in the last row of a history, None if it holds no such columns."""
    if not history.exists():
        return None
    with history.open(newline="") as file:
        rows = list(csv.DictReader(file))
    if not rows or "tip_x" not in rows[-1]:
        return None
    return [float(rows[-1][f"tip_{c}"]) for c in "xyz"]


def measure(links: int, elements: int, args: argparse.Namespace) -> list[Measurement]:
    """Measure all programs on one case, taking turns.

    Args:
        links: Number of links.
        elements: Elements per link.
        args: Command line.

    Returns:
        One measurement per program: Exudyn presets first, then flexfem by rank count.
    """
    exudyn = {p: Measurement(f"exudyn {p}") for p in args.presets}
    ranks = [] if args.no_flexfem else sorted({1, args.ranks})
    flexfem = {n: Measurement(f"flexfem x {n}") for n in ranks}
    for _ in range(args.repeats):
        for preset, into in exudyn.items():
            run_exudyn(links, elements, args.steps, args.dt, preset, into)
        for n, into in flexfem.items():
            run_flexfem(links, elements, args.steps, args.dt, n, into)
    return [*exudyn.values(), *flexfem.values()]


def report(case: dict[str, int], measurements: list[Measurement]) -> dict[str, Any]:
    """Print the rows of one case and return its record.

    Args:
        case: The two numbers that tell it, by their names.
        measurements: Of all programs.
    """
    record: dict[str, Any] = dict(case)
    links, elements = case.values()
    record["programs"] = [asdict(m) for m in measurements]
    for m in measurements:
        print(
            f"{links:5d} x {elements:2d}  {m.program:16s} {1e3 * m.best:9.3f}"
            f" {1e3 * statistics.median(m.seconds):9.3f} {m.iterations:6.2f}"
            f" {m.factorizations:6d} {m.memory:8.0f}"
        )
    exudyn = [m for m in measurements if m.program.startswith("exudyn")]
    flexfem = [m for m in measurements if m.program.startswith("flexfem")]
    fastest = min(exudyn, key=lambda m: m.best)
    if flexfem:
        record["exudyn_over_flexfem"] = fastest.best / flexfem[0].best
        print(f"{'':12s}-> Exudyn / flexfem {record['exudyn_over_flexfem']:.2f}", end="")
        if flexfem[0].tip and fastest.tip:
            pairs = zip(flexfem[0].tip, fastest.tip, strict=True)
            record["tip_distance"] = sum((a - b) ** 2 for a, b in pairs) ** 0.5
            print(f", tips apart {record['tip_distance']:.1e} m", end="")
        if len(flexfem) > 1 and " x " in flexfem[-1].program:
            record["speedup"] = flexfem[0].best / flexfem[-1].best
            print(f", {flexfem[-1].program} faster by {record['speedup']:.2f}", end="")
        print(flush=True)
    return record


def parse_cases(text: str) -> list[tuple[int, int]]:
    """Turn ``1x8,16x32`` into [(1, 8), (16, 32)]."""
    try:
        cases = [tuple(int(v) for v in item.split("x")) for item in text.split(",")]
        return [(links, elements) for links, elements in cases]
    except ValueError:
        raise argparse.ArgumentTypeError(f"cases are LINKSxELEMENTS,..., got {text!r}") from None


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=parse_cases, default=ALL_CASES, help="e.g. 1x8,16x32")
    parser.add_argument("--steps", type=int, default=100)
    parser.add_argument("--dt", type=float, default=1e-3, help="step size in s")
    parser.add_argument("--repeats", type=int, default=3, help="runs of each program")
    parser.add_argument("--ranks", type=int, default=1, help="also flexfem on this many ranks")
    parser.add_argument("--presets", nargs="+", default=["lagged", "per_step"])
    parser.add_argument("--no-flexfem", action="store_true", help="Exudyn alone")
    parser.add_argument("--json", type=Path, help="write the records to this file")
    args = parser.parse_args()
    print(f"load average {os.getloadavg()[0]:.2f} on {os.cpu_count()} cores")
    head = f"{'case':>10s}  {'program':16s} {'min ms':>9s} {'median ms':>9s}"
    print(f"{head} {'iter':>6s} {'factor':>6s} {'MB':>8s}")
    try:
        records = [report({"links": n, "elements": m}, measure(n, m, args)) for n, m in args.cases]
    except RuntimeError as error:
        sys.exit(f"error: {error}")
    if args.json:
        args.json.write_text(json.dumps({"dt": args.dt, "steps": args.steps, "cases": records}))


if __name__ == "__main__":
    main()
