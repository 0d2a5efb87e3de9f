# SPDX-License-Identifier: LGPL-3.0-or-later
"""Processor time of declaration and set-up over the size of a model, and memory.

``rigid`` is a chain of rigid bodies on revolute joints that is declared by arrays, ``flexible``
that of ``cases/chain.py`` with 8 elements a link, ``truss`` that of ``cases/deployable_truss.py``,
``net`` a square of beams that are clamped to each other at its crossings. Sizes are bodies, links,
bays, and beams along a side. Run from the source tree::

    python -m tests.benchmarks.set_up rigid 10000 30000 100000

A small model compiles all loops before. The exponent is the slope of log(time) over log(unknowns).
"""

import argparse
import gc
import resource
import sys
import time
from pathlib import Path

import numpy as np

import flexfem as ff
from flexfem.simulation.motion.stepping import Simulation
from tests.unit.test_many import rigid_chain
from tests.unit.test_rank_costs import net

CASES = Path(__file__).resolve().parents[2] / "cases"
OPTIONS = ff.RunOptions(dt=1e-3, t_end=1.0, quiet=True)


def flexible_chain(links: int) -> ff.Model:
    """The chain of the case, 8 elements a link."""
    sys.path.insert(0, str(CASES))
    import chain

    model: ff.Model = chain.CASE.model(links=links, elements=8)
    return model


def truss(bays: int) -> ff.Model:
    """The truss of the case."""
    sys.path.insert(0, str(CASES))
    import deployable_truss

    options, _ = deployable_truss.CASE.prepare({"bays": bays})
    model: ff.Model = deployable_truss.CASE.model(**options)
    return model


KINDS = {"rigid": rigid_chain, "flexible": flexible_chain, "truss": truss, "net": net}


def main() -> None:
    """Print one line for each size, and exponents."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kind", choices=KINDS)
    parser.add_argument("sizes", type=int, nargs="+")
    args = parser.parse_args()
    make, found = KINDS[args.kind], []
    Simulation(make(3), OPTIONS).advance(OPTIONS.dt)
    print("size  unknowns  multipliers  declaration, s  set-up, s  peak of memory so far, GB")
    for size in args.sizes:
        gc.collect()
        begin = time.process_time()
        model = make(size)
        declared = time.process_time()
        simulation = Simulation(model, OPTIONS)
        done = time.process_time()
        system = simulation.system
        found.append((system.unknowns, declared - begin, done - declared))
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
        numbers = f"{size:6d} {system.unknowns:8d} {system.constraints.size_global:8d}"
        print(f"{numbers} {found[-1][1]:8.2f} {found[-1][2]:8.2f} {peak:8.2f}", flush=True)
        del model, simulation, system
    if len(found) > 1:
        unknowns, *times = np.log(found).T
        slopes = [float(np.polyfit(unknowns, one, 1)[0]) for one in times]
        print(f"exponents of declaration and set-up: {slopes[0]:.2f} {slopes[1]:.2f}")


if __name__ == "__main__":
    main()
