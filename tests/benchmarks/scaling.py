# SPDX-License-Identifier: LGPL-3.0-or-later
"""Time of a step over the number of bodies, and of a small mechanism.

Run from the source tree, on a quiet machine::

    python tests/benchmarks/scaling.py

``rigid`` is a chain of rigid bodies on revolute joints, ``flexible`` that of ``cases/chain.py``
with 8 elements a link. The exponent is the slope of log(time per step) over log(bodies).
"""

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

import flexfem as ff
from flexfem.core.status import Status
from flexfem.simulation.motion.stepping import Simulation

ROOT = Path(__file__).resolve().parents[2]


def rigid_chain(links: int) -> ff.Model:
    """Rods of 1 m and 1 kg on revolute joints about Y, falling from the horizontal."""
    model = ff.Model("rigid_chain")
    model.add(ff.Gravity((0.0, 0.0, -9.81)))
    previous: ff.Marker | ff.Ground = ff.Ground()
    for i in range(links):
        name = f"rod_{i}"
        inertia = (1e-3, 1.0 / 12.0, 1.0 / 12.0)
        model.add(
            ff.RigidBody(name, 1.0, inertia, position=(i + 0.5, 0.0, 0.0)),
            ff.Revolute(
                f"joint_{i}", previous, ff.Marker(name, offset=(-0.5, 0.0, 0.0)),
                axis=(0.0, 1.0, 0.0),
            ),
        )  # fmt: skip
        previous = ff.Marker(name, offset=(0.5, 0.0, 0.0))
    return model


def flexible_chain(links: int) -> ff.Model:
    """The chain of the case, 8 elements a link."""
    sys.path.insert(0, str(ROOT / "cases"))
    import chain

    model: ff.Model = chain.CASE.model(links=links, elements=8)
    return model


KINDS = {"rigid": rigid_chain, "flexible": flexible_chain}


def seconds_per_step(kind: str, links: int, dt: float, steps: int, repeats: int) -> float:
    """Smallest mean time of a step over some stretches of a run, the first steps left out."""
    simulation = Simulation(KINDS[kind](links), ff.RunOptions(dt=dt, t_end=1.0))
    best = np.inf
    for _ in range(repeats + 1):
        begin = time.perf_counter()
        for _ in range(steps):
            if simulation.advance(dt) is not Status.OK:
                raise RuntimeError(f"{kind} chain of {links}: a step failed")
        elapsed = (time.perf_counter() - begin) / steps
        best = min(best, elapsed) if simulation.steps > steps else best
    counters = simulation.system.counters
    print(
        f"{kind:9s} {links:6d} {simulation.system.unknowns:9d} {1e3 * best:10.4f} "
        f"{counters.newton_iterations / simulation.steps:6.2f} {counters.factorizations:6d}",
        flush=True,
    )
    return float(best)


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--links", type=int, nargs="+", default=[16, 64, 256, 1024])
    parser.add_argument("--dt", type=float, default=1e-3, help="step size in s")
    parser.add_argument("--steps", type=int, default=20, help="steps of one stretch")
    parser.add_argument("--repeats", type=int, default=4, help="stretches that count")
    parser.add_argument("--kind", choices=KINDS, help="one kind, in this process")
    args = parser.parse_args()
    if args.kind is None:  # every kind in a fresh process
        print(f"load average {os.getloadavg()[0]:.2f} on {os.cpu_count()} cores")
        print(f"{'kind':9s} {'bodies':>6s} {'unknowns':>9s} {'ms/step':>10s} {'iter':>6s} factor")
        for kind in KINDS:
            subprocess.run([sys.executable, *sys.argv, "--kind", kind], check=True)
        return
    numbers = [10, *args.links] if args.kind == "rigid" else args.links
    options = (args.dt, args.steps, args.repeats)
    times = [seconds_per_step(args.kind, n, *options) for n in numbers][-len(args.links) :]
    slope = np.polyfit(np.log(args.links), np.log(times), 1)[0]
    print(json.dumps({"kind": args.kind, "exponent": round(float(slope), 3)}), flush=True)


if __name__ == "__main__":
    main()
