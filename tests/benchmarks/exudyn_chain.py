# SPDX-License-Identifier: LGPL-3.0-or-later
"""The chain of flexible links in Exudyn: time and iterations per step.

Run ``python tests/benchmarks/exudyn_chain.py --links 16 --elements 8``; one JSON line is printed.
Use a fresh process for every measurement, as ``chain_against_exudyn.py`` does.
"""

import argparse
import json
import resource
import time
from typing import Any

import numpy as np
from exudyn_beams import SquareSection, add_beam, eii, exu, integration_settings

LINK_LENGTH = 0.5
SECTION = SquareSection(side=0.01, youngs_modulus=1e9, poisson_ratio=0.3, density=1000.0)
GRAVITY = np.array([0.0, 0.0, -9.81])

_NEWTON = "timeIntegration.newton."
# Exudyn's own relative tolerance of 1e-8 is below the rounding of the residual from 16 links on.
_TOLERANCE = {_NEWTON + "relativeTolerance": 1e-6}
_REUSE = {"linearSolver.reuseAnalyzedPattern": True}
# "lagged" is the fastest in mild motion and on long chains, "per_step" on short chains in strong
# motion (a few per cent); the others are kept to show that nothing better was left out.
PRESETS: dict[str, dict[str, Any]] = {
    "default": _TOLERANCE,
    "lagged": _TOLERANCE | _REUSE | {_NEWTON + "modifiedNewtonContractivity": 0.2},
    "per_step": _TOLERANCE | _REUSE | {_NEWTON + "modifiedNewtonJacUpdatePerStep": True},
    "full": _TOLERANCE | _REUSE | {_NEWTON + "useModifiedNewton": False},
    "dense": _TOLERANCE | {"linearSolver.solverType": "EXUdense"},
    "loose": _REUSE
    | {
        _NEWTON + "relativeTolerance": 1e-4,
        _NEWTON + "absoluteTolerance": 1e-6,
        _NEWTON + "modifiedNewtonContractivity": 0.2,
    },
}


def build(links: int, elements: int) -> tuple[Any, int]:
    """Assemble the chain.

    Args:
        links: Number of links.
        elements: Two-node elements per link.

    Returns:
        The assembled Exudyn main system and the number of the node at the tip.
    """
    container = exu.SystemContainer()
    mbs = container.AddSystem()
    ground = mbs.AddObject(eii.ObjectGround())
    previous = mbs.AddMarker(eii.MarkerBodyPosition(bodyNumber=ground))
    lines = []
    for i in range(links):
        ends = LINK_LENGTH * np.array([[i, 0, 0], [i + 1, 0, 0]], dtype=float)
        line = add_beam(mbs, SECTION.data, ends[0], ends[1], elements, GRAVITY)
        start, end = (
            mbs.AddMarker(eii.MarkerNodePosition(nodeNumber=n))
            for n in (line.nodes[0], line.nodes[-1])
        )
        mbs.AddObject(eii.ObjectJointSpherical(markerNumbers=[previous, start]))
        previous = end
        lines.append(line)
    mbs.Assemble()
    mbs.variables["container"] = container
    return mbs, lines[-1].nodes[-1]


def run(
    links: int, elements: int, steps: int, dt: float, settings: dict[str, Any]
) -> dict[str, Any]:
    """Integrate the chain and measure the time-integration loop alone.

    Args:
        links: Number of links.
        elements: Two-node elements per link.
        steps: Number of steps.
        dt: Step size in s.
        settings: Changes to the Exudyn settings, see ``integration_settings``.

    Returns:
        ``seconds_per_step`` (process CPU time), ``wall_seconds_per_step``, ``iterations_per_step``,
        ``jacobians``, ``rejected_steps``, ``memory`` (peak resident set in MB), ``tip`` (m) and
        ``success``.
    """
    mbs, tip = build(links, elements)
    simulation = integration_settings(steps, dt, settings)
    solver: Any = exu.MainSolverImplicitSecondOrder()
    if not solver.InitializeSolver(mbs, simulation):
        raise RuntimeError(f"Exudyn did not initialise the chain of {links} x {elements}")
    cpu, wall = time.process_time(), time.perf_counter()
    success = bool(solver.SolveSteps(mbs, simulation))
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    iterator = solver.it
    done = max(1, round(iterator.currentTime / dt))
    result = {
        "links": links,
        "elements": elements,
        "steps": done,
        "dt": dt,
        "seconds_per_step": cpu / done,
        "wall_seconds_per_step": wall / done,
        "iterations_per_step": iterator.newtonStepsCount / done,
        "jacobians": int(iterator.newtonJacobiCount),
        "rejected_steps": int(iterator.rejectedModifiedNewtonSteps),
        "memory": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0,
        "tip": [float(v) for v in mbs.GetNodeOutput(tip, exu.OutputVariableType.Position)],
        "success": success and done == steps,
        "version": exu.__version__,
    }
    solver.FinalizeSolver(mbs, simulation)
    return result


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--links", type=int, default=4)
    parser.add_argument("--elements", type=int, default=8)
    parser.add_argument("--steps", type=int, default=100)
    parser.add_argument("--dt", type=float, default=1e-3, help="step size in s")
    parser.add_argument("--preset", choices=sorted(PRESETS), default="lagged")
    parser.add_argument(
        "--set", nargs="*", default=[], metavar="NAME=JSON", help="further settings"
    )
    args = parser.parse_args()
    settings = dict(PRESETS[args.preset])
    for item in args.set:
        name, _, value = item.partition("=")
        settings[name] = json.loads(value)
    print(json.dumps(run(args.links, args.elements, args.steps, args.dt, settings)))


if __name__ == "__main__":
    main()
