# SPDX-License-Identifier: LGPL-3.0-or-later
"""Gradient of a chain's tip by ten masses: the adjoint, and central differences of Exudyn's runs.

    python tests/benchmarks/gradient_against_exudyn.py --links 20 --elements 8 --steps 300

The chain is that of ``chain_against_exudyn.py``; its links are ten groups, the mass of each of
which is a parameter. Exudyn has differences of whole runs (its ``ComputeSensitivities`` makes the
same 21), here with several relative steps, since the best one is not known beforehand. Seconds are
those of the processor in one thread, without the set-up of Exudyn's models and with that of
flexfem's. Each program runs in a process of its own. Printed are seconds and the largest difference
of the ten derivatives, over the largest derivative: between steps of Exudyn, between the programs,
whose elements differ, and between flexfem and differences of its own runs.
"""

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

GROUPS = 10
STEPS = (1e-2, 1e-3, 1e-4)


def group(link: int, links: int) -> int:
    """Number of the parameter of a link."""
    return link * GROUPS // links


def with_exudyn(own: argparse.Namespace) -> dict[str, object]:
    """Seconds and derivatives by differences."""
    import exudyn_chain
    from exudyn_beams import add_beam, eii, exu, integration_settings

    def tip(factors: np.ndarray) -> tuple[float, float]:
        """Height of the tip at the end, and seconds of the steps."""
        container = exu.SystemContainer()
        mbs = container.AddSystem()
        before = mbs.AddMarker(eii.MarkerBodyPosition(bodyNumber=mbs.AddObject(eii.ObjectGround())))
        for i in range(own.links):
            section, factor = exudyn_chain.SECTION.data, float(factors[group(i, own.links)])
            section.massPerLength = factor * exudyn_chain.SECTION.mass_per_length
            section.inertia = factor * np.diag(exudyn_chain.SECTION.rotary_inertia)
            ends = exudyn_chain.LINK_LENGTH * np.array([[i, 0, 0], [i + 1, 0, 0]], dtype=float)
            line = add_beam(mbs, section, *ends, own.elements, exudyn_chain.GRAVITY)
            start, end = (
                mbs.AddMarker(eii.MarkerNodePosition(nodeNumber=n))
                for n in (line.nodes[0], line.nodes[-1])
            )
            mbs.AddObject(eii.ObjectJointSpherical(markerNumbers=[before, start]))
            before = end
        mbs.Assemble()
        settings = integration_settings(own.steps, own.dt, exudyn_chain.PRESETS["lagged"])
        solver = exu.MainSolverImplicitSecondOrder()
        solver.InitializeSolver(mbs, settings)
        begin = time.process_time()
        if not solver.SolveSteps(mbs, settings):
            raise RuntimeError("Exudyn failed")
        spent = time.process_time() - begin
        return float(mbs.GetNodeOutput(line.nodes[-1], exu.OutputVariableType.Position)[2]), spent

    ones, found, seconds = np.ones(GROUPS), [], []
    tip(ones)
    for step in STEPS:
        runs = [
            tip(ones + sign * step * (np.arange(GROUPS) == k))
            for k in range(GROUPS) for sign in (1, -1)
        ]  # fmt: skip
        values = np.array([value for value, _ in runs]).reshape(GROUPS, 2)
        found.append(((values[:, 0] - values[:, 1]) / (2.0 * step)).tolist())
        seconds.append(sum(spent for _, spent in runs) * (2 * GROUPS + 1) / (2 * GROUPS))
    return {"seconds": min(seconds), "derivatives": found}


def with_flexfem(own: argparse.Namespace) -> dict[str, object]:
    """Seconds and derivatives by the adjoint, and by differences of precise runs."""
    import flexfem as ff

    base = ff.Section.rectangle(0.01, 0.01, ff.Material(1e9, 0.3, 1000.0))

    def chain(masses: np.ndarray) -> ff.Model:
        x = np.linspace(0.0, 0.5, own.elements + 1)
        points = [(0.5 * b + s, 0.0, 0.0) for b in range(own.links) for s in x]
        first = [(own.elements + 1) * b for b in range(own.links)]
        cells = [(at + i, at + i + 1) for at in first for i in range(own.elements)]
        groups = {
            f"link_{b}": np.arange(own.elements * b, own.elements * (b + 1))
            for b in range(own.links)
        }
        model = ff.Model("chain", mesh=ff.LineMesh(np.array(points), np.array(cells), groups))
        model.add(ff.Gravity((0.0, 0.0, -9.81)))
        for b in range(own.links):
            factor = float(masses[group(b, own.links)])
            before = ff.Marker(f"link_{b - 1}", "end") if b else ff.Ground()
            model.add(
                ff.Beam(f"link_{b}", ff.Section.general(base.stiffness, factor * base.inertia)),
                ff.Spherical(f"pin_{b}", before, ff.Marker(f"link_{b}", "start")),
            )
        model.add(ff.PositionProbe("tip", ff.Marker(f"link_{own.links - 1}", "end")))
        return model

    def options(steps: int, tolerance: float = 1e-6) -> ff.RunOptions:
        return ff.RunOptions(
            dt=own.dt, t_end=own.dt * steps, rho_inf=0.9, tolerance=tolerance, quiet=True
        )

    ones = np.ones(GROUPS)
    ff.gradient(chain, "final:tip_z", {"masses": ones}, options(2))  # loads compiled code
    begin = time.process_time()
    found = ff.gradient(chain, "final:tip_z", {"masses": ones}, options(own.steps))
    seconds = time.process_time() - begin
    precise = []
    for k in range(GROUPS):
        heights = [
            ff.simulate(
                chain(ones + part * 1e-3 * (np.arange(GROUPS) == k)), options(own.steps, 1e-12)
            ).history["tip_z"][-1]
            for part in (-2, -1, 1, 2)
        ]
        precise.append(float(np.dot((1 / 12, -2 / 3, 2 / 3, -1 / 12), heights) / 1e-3))
    return {
        "seconds": seconds, "forward": found.wall_seconds_forward, "precise": precise,
        "derivatives": found.gradient["final:tip_z"]["masses"].tolist(),
    }  # fmt: skip


def spawn(program: str, own: argparse.Namespace) -> dict[str, object]:
    """Results of a process of its own."""
    command = [sys.executable, __file__, "--program", program]
    for name in ("links", "elements", "steps", "dt"):
        command += [f"--{name}", str(getattr(own, name))]
    done = subprocess.run(
        command, check=True, stdout=subprocess.PIPE, text=True, cwd=Path(__file__).parent
    )
    found: dict[str, object] = json.loads(done.stdout.strip().splitlines()[-1])
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--links", type=int, default=20)
    parser.add_argument("--elements", type=int, default=8)
    parser.add_argument("--steps", type=int, default=300)
    parser.add_argument("--dt", type=float, default=1e-3, help="s")
    parser.add_argument("--repeats", type=int, default=3, help="runs of each program in turn")
    parser.add_argument("--program", choices=("exudyn", "flexfem"), help=argparse.SUPPRESS)
    own = parser.parse_args()
    if own.program:
        print(json.dumps((with_exudyn if own.program == "exudyn" else with_flexfem)(own)))
        return
    runs = [(spawn("exudyn", own), spawn("flexfem", own)) for _ in range(own.repeats)]
    theirs, ours = (np.array(one["derivatives"]) for one in runs[0])
    size = np.abs(ours).max()

    def apart(a: np.ndarray, b: np.ndarray) -> str:
        return f"{np.abs(a - b).max() / size:.1e}"

    seconds = [min(float(str(pair[k]["seconds"])) for pair in runs) for k in range(2)]
    print(f"Exudyn {seconds[0]:.2f} s for 21 runs, flexfem {seconds[1]:.2f} s for the gradient")
    for step, row in zip(STEPS, theirs, strict=True):
        print(f"Exudyn with steps of {step:g} to that of 1e-3: {apart(row, theirs[1])}")
    print(f"Exudyn with steps of 1e-3 to flexfem: {apart(theirs[1], ours)}")
    print(f"flexfem to differences of its own runs: {apart(ours, np.array(runs[0][1]['precise']))}")


if __name__ == "__main__":
    main()
