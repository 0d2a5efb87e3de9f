# SPDX-License-Identifier: LGPL-3.0-or-later
"""Chains, trusses and nets from a thousand to a million unknowns, on one rank and on two.

``rigid`` is a chain of rigid bodies that is declared by arrays; ``chain`` the case of this name
with 32 elements a link, whose multipliers are those of a tree; ``truss`` the case
``deployable_truss``, with loops along a line; ``net`` a square net of beams of two elements, with
loops in two directions. Each run is a fresh process with one thread a rank, in which a small model
loads what is compiled before, and starts at rest. Declaration and set-up are processor time of the
rank that takes most, steps what the clock says: on average, as some may factorise anew, and their
median, as the machine may stop for a while. Exponents are the slopes of log(time) over
log(unknowns) from the second size to the last; "faster by" is the time of a step on the first
number of ranks over that on this one, of the same steps. With ``--rounds`` the numbers of ranks
take turns; times and ratios are the medians of the rounds, with the least and the largest ratio.
Run from the source tree, on an idle machine::

    python -m tests.benchmarks.large_systems
    python -m tests.benchmarks.large_systems --systems rigid --sizes 10000,100000 --ranks 1
    python -m tests.benchmarks.large_systems --systems chain --sizes 512 --rounds 9
"""

import argparse
import gc
import json
import math
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from statistics import mean, median
from typing import Any

import flexfem as ff
from flexfem.core.status import Status
from flexfem.simulation.motion.stepping import Simulation
from tests.unit.test_many import rigid_chain
from tests.unit.test_rank_costs import net

ROOT = Path(__file__).resolve().parents[2]


def case(name: str, **given: int) -> ff.Model:
    """Model of a shipped case with these options."""
    found = ff.load_case(name)
    model: ff.Model = found.model(**found.prepare(given)[0])
    return model


#: Builder by the size, step in s, and sizes from a thousand to a million unknowns.
SYSTEMS: dict[str, tuple[Callable[[int], ff.Model], float, tuple[int, ...]]] = {
    "rigid": (rigid_chain, 1e-3, (170, 1700, 17000, 170000)),
    "chain": (lambda links: case("chain", links=links, elements=32), 1e-3, (5, 50, 512, 5120)),
    "truss": (lambda bays: case("deployable_truss", bays=bays), 5e-3, (2, 23, 230, 2300)),
    "net": (net, 1e-3, (5, 20, 80, 160)),
}
#: Size of the model that loads what is compiled, and steps before those that are timed.
SMALL, BEFORE = 4, 3


def measure(name: str, size: int, seconds: float, steps: int) -> None:
    """Take some steps in this process, and print what the first rank has measured.

    With ``steps`` of 0 so many as take these seconds.
    """
    build, dt, _ = SYSTEMS[name]
    options = ff.RunOptions(dt=dt, t_end=1e6 * dt, quiet=True)
    Simulation(build(SMALL), options).advance(dt)
    gc.collect()
    begin = time.process_time()
    model = build(size)
    built = time.process_time()
    simulation = Simulation(model, options)
    ready = time.process_time()
    system = simulation.system
    spans = system.comm.allgather((built - begin, ready - built))
    declared, set_up = (max(span) for span in zip(*spans, strict=True))

    def advance(steps: int) -> list[float]:
        """Seconds of some steps, of the slowest rank in each."""
        times = [time.perf_counter()]
        for _ in range(steps):
            assert simulation.advance(dt) is Status.OK
            times.append(time.perf_counter())
        own = [end - start for start, end in pairwise(times)]
        return [max(step) for step in zip(*system.comm.allgather(own), strict=True)]

    each = min(mean(advance(BEFORE)), mean(advance(2)))
    steps = steps or max(5, math.ceil(seconds / each))
    iterations = system.counters.newton_iterations
    spent = advance(steps)
    iterations = system.counters.newton_iterations - iterations
    peaks = system.comm.allgather(1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
    if system.comm.rank == 0:
        print(json.dumps({
            "unknowns": system.unknowns, "declared": declared, "set_up": set_up,
            "steps": steps, "step": mean(spent), "median": median(spent),
            "iterations": iterations / steps,
            "factorizations": system.counters.factorizations, "memory": max(peaks),
        }))  # fmt: skip


def run(name: str, size: int, ranks: int, seconds: float, steps: int) -> dict[str, Any]:
    """Measure a system in fresh processes, see :func:`measure`."""
    start = [str(Path(sys.executable).parent / "mpiexec"), "-n", str(ranks)] if ranks > 1 else []
    environment = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(
        [*start, sys.executable, "-m", "tests.benchmarks.large_systems",
         "--one", f"{name},{size},{steps}", "--seconds", repr(seconds)],
        env=environment, cwd=ROOT, text=True, stdout=subprocess.PIPE, check=True,
    )  # fmt: skip
    found: dict[str, Any] = json.loads(done.stdout.strip().splitlines()[-1])
    return found


def middle(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """Medians of what these runs of one system have measured."""
    return {key: median(one[key] for one in runs) for key in runs[0]}


def ratios(first: list[dict[str, Any]], others: list[dict[str, Any]], key: str) -> str:
    """Median of the ratios of rounds, with the least and the largest."""
    found = sorted(one[key] / other[key] for one, other in zip(first, others, strict=True))
    spread = f" ({found[0]:.2f} to {found[-1]:.2f})" if len(found) > 1 else ""
    return f"{median(found):.2f}{spread}"


def exponent(rows: list[dict[str, Any]], key: str) -> float:
    """Slope to the last size from the second, as calls from Python are most of the first's time."""
    first, last = rows[min(1, len(rows) - 2)], rows[-1]
    return math.log(last[key] / first[key]) / math.log(last["unknowns"] / first["unknowns"])


def main() -> None:
    """Print a table of each system."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--systems", default=",".join(SYSTEMS))
    parser.add_argument("--sizes", help="of one system, instead of its own ones")
    parser.add_argument("--ranks", default="1,2")
    parser.add_argument("--seconds", type=float, default=5.0, help="of the first run's steps")
    parser.add_argument("--rounds", type=int, default=1, help="runs on each number of ranks")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        name, *numbers = given.one.split(",")
        size, steps = map(int, numbers)
        measure(name, size, given.seconds, steps)
        return
    print("| system | size | unknowns | ranks | declared s | set-up s | MB a rank | ms a step | "
          "median | iterations | factorisations | faster by | of medians |")  # fmt: skip
    print("|---" * 13 + "|")
    ranks = [int(count) for count in given.ranks.split(",")]
    for name in given.systems.split(","):
        sizes = SYSTEMS[name][2]
        if given.sizes:
            sizes = tuple(int(size) for size in given.sizes.split(","))
        rows: dict[int, list[dict[str, Any]]] = {count: [] for count in ranks}
        for size in sizes:
            rounds: dict[int, list[dict[str, Any]]] = {count: [] for count in ranks}
            steps = 0
            for _ in range(given.rounds):
                for count in ranks:
                    rounds[count].append(run(name, size, count, given.seconds, steps))
                    steps = rounds[count][-1]["steps"]
            for count in ranks:
                x = middle(rounds[count])
                rows[count].append(x)
                faster = " | ".join(
                    ratios(rounds[ranks[0]], rounds[count], key) for key in ("step", "median")
                )
                print(f"| {name} | {size} | {x['unknowns']:.0f} | {count} | {x['declared']:.2f} | "
                      f"{x['set_up']:.2f} | {x['memory'] / 1e6:.0f} | {1e3 * x['step']:.2f} | "
                      f"{1e3 * x['median']:.2f} | {x['iterations']:.1f} | "
                      f"{x['factorizations']:.0f} | {faster} |", flush=True)  # fmt: skip
        for count in ranks if len(sizes) > 1 else ():
            print(f"{name}, ranks {count}: a step takes as the power "
                  f"{exponent(rows[count], 'step'):.2f} of the unknowns, the set-up as "
                  f"{exponent(rows[count], 'set_up'):.2f}")  # fmt: skip


if __name__ == "__main__":
    main()
