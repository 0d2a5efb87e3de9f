# SPDX-License-Identifier: LGPL-3.0-or-later
"""The frame of ``examples/frame.py`` here and in Exudyn: time of a step, and where a corner is.

Members, sections, elements and steps are the same. In Exudyn, too, each member has nodes of its
own, with the axes of its section; ``ObjectJointGeneric`` holds them together where members meet, as
``ff.Rigid`` does. Run from the source tree, in a fresh process for each measurement::

    python tests/benchmarks/frame_against_exudyn.py flexfem
    python tests/benchmarks/frame_against_exudyn.py exudyn --preset full --steps 10
"""

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

sys.path.insert(0, str(Path(__file__).parents[2] / "examples"))
import frame  # type: ignore[import-not-found]

GRAVITY = np.array([0.0, 0.0, -9.81])


def section_data(section: Any) -> Any:
    """Exudyn's numbers of a section."""
    from exudyn_beams import exu

    data = exu.BeamSection()
    data.massPerLength = section.inertia[0, 0]
    data.inertia = section.inertia[3:, 3:]
    data.stiffnessMatrix = section.stiffness
    return data


def section_axes(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Axes of a member's section as columns: its axis, and the second one horizontal."""
    along = (end - start) / np.linalg.norm(end - start)
    second = np.cross((1.0, 0.0, 0.0) if abs(along[2]) > 0.5 else (0.0, 0.0, 1.0), along)
    return np.column_stack((along, second, np.cross(along, second)))


def build() -> tuple[Any, int]:
    """Exudyn's assembled system and the number of the corner's node."""
    from exudyn_beams import add_beam, eii, exu

    container = exu.SystemContainer()
    mbs = container.AddSystem()
    model = frame.build()
    listed = frame.members(frame.STOREYS, by_kind=False)
    scale = np.array([frame.BAY, frame.BAY, frame.STOREY])
    ground = mbs.AddObject(eii.ObjectGround())
    held: dict[Any, int] = {}
    corner = -1
    for member, (a, b) in zip(model.beams, listed, strict=True):
        R = section_axes(scale * a, scale * b)
        data = section_data(member.section)
        x, y, z, w = Rotation.from_matrix(R).as_quat().tolist()
        nodes = add_beam(mbs, data, scale * a, scale * b, 2, GRAVITY, (w, x, y, z)).nodes
        for place, node in ((a, nodes[0]), (b, nodes[-1])):
            # axes of all markers are those of space
            upright = exu.HT(rotation=R.T, translation=np.zeros(3))
            marker = mbs.AddMarker(eii.MarkerNodeRigid(nodeNumber=node, localHT=upright))
            if place[2] == 0:
                foot = exu.HT(rotation=np.eye(3), translation=scale * place)
                held[place] = mbs.AddMarker(eii.MarkerBodyRigid(bodyNumber=ground, localHT=foot))
            if place in held:
                pair = [held[place], marker]
                mbs.AddObject(eii.ObjectJointGeneric(markerNumbers=pair))
            else:
                held[place] = marker
        if (a, b) == ((0, 0, frame.STOREYS - 1), (0, 0, frame.STOREYS)):
            corner = nodes[-1]
    mbs.Assemble()
    mbs.variables["container"] = container
    return mbs, corner


def in_flexfem(steps: int, dt: float) -> dict[str, Any]:
    """Integrate, and measure the steps alone."""
    import flexfem as ff

    options = ff.RunOptions(dt=dt, t_end=steps * dt, rho_inf=0.9, quiet=True)
    outcome = ff.simulate(frame.build(), options)
    summary = outcome.summary
    return {
        "success": outcome.status == "ok",
        "set_up": summary["wall_seconds_setup"],
        "milliseconds_a_step": 1e3 * summary["wall_seconds_steps"] / steps,
        "iterations": summary["newton_iterations"] / steps,
        "jacobians": summary["factorizations"],
        "corner": [float(outcome.history[f"corner_{axis}"][-1]) for axis in "xyz"],
    }


def in_exudyn(steps: int, dt: float, preset: str) -> dict[str, Any]:
    """The same there, by CPU time, which is the shorter one."""
    from exudyn_beams import exu, integration_settings
    from exudyn_chain import PRESETS

    begin = time.perf_counter()
    mbs, corner = build()
    built = time.perf_counter() - begin
    settings = integration_settings(steps, dt, PRESETS[preset])
    solver: Any = exu.MainSolverImplicitSecondOrder()
    if not solver.InitializeSolver(mbs, settings):
        raise RuntimeError("Exudyn did not initialise the frame")
    cpu = time.process_time()
    success = bool(solver.SolveSteps(mbs, settings))
    cpu = time.process_time() - cpu
    found = {
        "success": success,
        "set_up": built,
        "milliseconds_a_step": 1e3 * cpu / steps,
        "iterations": solver.it.newtonStepsCount / steps,
        "jacobians": int(solver.it.newtonJacobiCount),
        "corner": mbs.GetNodeOutput(corner, exu.OutputVariableType.Position).tolist(),
    }
    solver.FinalizeSolver(mbs, settings)
    return found


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("code", choices=("flexfem", "exudyn"))
    parser.add_argument("--steps", type=int, default=50)
    parser.add_argument("--dt", type=float, default=2e-3, help="step size in s")
    parser.add_argument("--preset", default="lagged", help="of exudyn_chain.py")
    given = parser.parse_args()
    if given.code == "flexfem":
        print(json.dumps(in_flexfem(given.steps, given.dt)))
    else:
        print(json.dumps(in_exudyn(given.steps, given.dt, given.preset)))


if __name__ == "__main__":
    main()
