# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gradient of a chain's tip by stiffness of elements and mass of links: seconds both ways.

    python -m tests.benchmarks.adjoint_chain --links 64 --elements 32 --steps 100
    mpirun -n 2 python -m tests.benchmarks.adjoint_chain

Printed are unknowns, parameters, milliseconds a step of the motion and of its adjoint (differences
of two runs, so that set-up does not count), set-up of the parameters' models, applications of the
linearised equations, factorisations, and seconds of the whole motion and of the way back.
"""

import argparse
import resource
import time

from mpi4py import MPI

import numpy as np

import flexfem as ff

LENGTH = 0.5
BASE = ff.Section.general([8e4, 3e4, 3e4, 4.0, 5.0, 5.0], [0.1, 0.1, 0.1, 2e-4, 1e-4, 1e-4])


def chain(stiffness: np.ndarray, mass: np.ndarray, links: int, elements: int) -> ff.Model:
    """Links that hang on one another, with a factor of stiffness for each element, of mass each."""
    own = np.asarray(stiffness).reshape(links, elements)
    x = np.linspace(0.0, LENGTH, elements + 1)
    points = [(LENGTH * b + s, 0.0, 0.0) for b in range(links) for s in x]
    first = [(elements + 1) * b for b in range(links)]
    cells = [(at + i, at + i + 1) for at in first for i in range(elements)]
    groups = {f"link_{b}": np.arange(elements * b, elements * (b + 1)) for b in range(links)}
    model = ff.Model("chain", mesh=ff.LineMesh(np.array(points), np.array(cells), groups))
    model.add(ff.Gravity((0.0, 0.0, -9.81)))
    for b in range(links):
        inertia = mass[b] * BASE.inertia
        sections = [ff.Section.general(factor * BASE.stiffness, inertia) for factor in own[b]]

        def section(s: float, own: list[ff.Section] = sections) -> ff.Section:
            return own[min(int(s / LENGTH * elements), elements - 1)]

        before = ff.Marker(f"link_{b - 1}", "end") if b else ff.Ground()
        model.add(
            ff.Beam(f"link_{b}", section),
            ff.Spherical(f"pin_{b}", before, ff.Marker(f"link_{b}", "start")),
        )
    model.add(ff.PositionProbe("tip", ff.Marker(f"link_{links - 1}", "end")))
    return model


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--links", type=int, default=64)
    parser.add_argument("--elements", type=int, default=32)
    parser.add_argument("--steps", type=int, default=100)
    own = parser.parse_args()
    count = own.links * own.elements

    def build(stiffness: np.ndarray, mass: np.ndarray) -> ff.Model:
        return chain(stiffness, mass, own.links, own.elements)

    def timed(steps: int) -> tuple[ff.Gradient, float]:
        options = ff.RunOptions(dt=1e-3, t_end=1e-3 * steps, quiet=True)
        begin = time.perf_counter()
        values = {"stiffness": np.ones(count), "mass": np.ones(own.links)}
        found = ff.gradient(build, "final:tip_z", values, options)
        return found, time.perf_counter() - begin

    few = max(own.steps // 10, 2)
    timed(2)  # loads compiled code
    (short, _), (long, _) = timed(few), timed(own.steps)
    more = own.steps - few
    forward = (long.wall_seconds_forward - short.wall_seconds_forward) / more
    backward = (long.wall_seconds_backward - short.wall_seconds_backward) / more
    peak = MPI.COMM_WORLD.allreduce(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, op=MPI.MAX)
    if MPI.COMM_WORLD.rank == 0:
        models = long.wall_seconds_backward - backward * own.steps
        print(
            f"{6 * own.links * (own.elements + 1)} unknowns, {count + own.links} parameters, "
            f"{MPI.COMM_WORLD.size} ranks: forwards {1e3 * forward:.2f} ms, backwards "
            f"{1e3 * backward:.2f} ms a step, models of parameters {models:.1f} s, "
            f"{long.applications / own.steps:.1f} applications a step, factorisations "
            f"{long.factorizations_forward} and {long.factorizations_backward}, "
            f"{peak / 1e6:.2f} GB; {long.wall_seconds_forward:.1f} s forwards, "
            f"{long.wall_seconds_backward:.1f} s backwards"
        )


if __name__ == "__main__":
    main()
