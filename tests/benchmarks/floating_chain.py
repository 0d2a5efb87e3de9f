# SPDX-License-Identifier: LGPL-3.0-or-later
"""A chain of reduced bars that falls from rest, in Exudyn and in flexfem: time of a step.

Bars of aluminium (quadratic hexahedra, rigid end faces) along X are joined by spherical joints and
fall along -Z. Both programs reduce the same mass and stiffness matrices to the same functions: the
static ones of the far face and modes with both faces fixed (Craig and Bampton), in a frame at the
near face. Run ``python tests/benchmarks/floating_chain.py exudyn --bodies 4``; one JSON line is
printed. Use a fresh process for every measurement, as ``floating_against_exudyn.py`` does.
"""

import argparse
import json
import resource
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

LENGTH, SIDE, CELLS = 0.5, 0.01, 8
MODULUS, POISSON, DENSITY = 7e10, 0.3, 2700.0
GRAVITY = (0.0, 0.0, -9.81)

_NEWTON = "timeIntegration.newton."
_COMMON: dict[str, Any] = {
    _NEWTON + "relativeTolerance": 1e-6,
    "linearSolver.reuseAnalyzedPattern": True,
}
#: As in ``exudyn_chain.py``.
PRESETS: dict[str, dict[str, Any]] = {
    "lagged": _COMMON | {_NEWTON + "modifiedNewtonContractivity": 0.2},
    "per_step": _COMMON | {_NEWTON + "modifiedNewtonJacUpdatePerStep": True},
    "dense": _COMMON | {"linearSolver.solverType": "EXUdense"},
    "full": _COMMON | {_NEWTON + "useModifiedNewton": False},
}


def bar(nonlinear: bool = False) -> Any:
    """The bar on its mesh: a ``LinearBody``, or one with the energy of a law."""
    import flexfem as ff

    make = ff.solid_body  # imports what must come before dolfinx
    if nonlinear:
        law = ff.laws.SaintVenantKirchhoff(MODULUS, POISSON)
        return make(_box(), law, density=DENSITY, name="bar")
    return make(_box(), ff.Material(MODULUS, POISSON, DENSITY), name="bar")


def _box() -> Any:
    """Its mesh."""
    from mpi4py import MPI

    from dolfinx import mesh

    half = 0.5 * SIDE
    corners = [(0.0, -half, -half), (LENGTH, half, half)]
    return mesh.create_box(MPI.COMM_SELF, corners, (CELLS, 1, 1), mesh.CellType.hexahedron)


def near(x: np.ndarray) -> np.ndarray:
    """Points of the face at the body's origin."""
    return np.isclose(x[0], 0.0)


def far(x: np.ndarray) -> np.ndarray:
    """Points of the other face."""
    return np.isclose(x[0], LENGTH)


def run_flexfem(
    bodies: int,
    modes: int,
    steps: int,
    dt: float,
    frame: str,
    stiffening: bool,
    derivatives: int | None = None,
) -> dict[str, Any]:
    """Integrate the chain in flexfem; see ``run_exudyn`` for the result."""
    import flexfem as ff

    reduced = ff.reduce_body(
        bar(derivatives is not None), {"near": near, "far": far}, modes=modes, recovery=False,
        geometric_stiffness=stiffening, derivatives=derivatives,
    )  # fmt: skip
    model = ff.Model("chain")
    model.add(ff.Gravity(GRAVITY))
    last: Any = ff.Ground()
    for i in range(bodies):
        name = f"bar_{i + 1}"
        model.add(
            ff.FloatingBody(
                name, reduced, frame=frame, position=(i * LENGTH, 0.0, 0.0), stiffening=stiffening
            ),
            ff.Spherical(f"joint_{i + 1}", last, ff.Marker(name, "near")),
        )
        last = ff.Marker(name, "far")
    model.add(ff.PositionProbe("tip", last))
    with tempfile.TemporaryDirectory() as folder:
        outcome = ff.simulate(
            model,
            ff.RunOptions(
                dt=dt, t_end=steps * dt, output=Path(folder), every=10**9, quiet=True, rho_inf=0.9
            ),
        )
        summary = json.loads((Path(folder) / "summary.json").read_text())
    done = summary["steps"]
    return {
        # the first step, which loads compiled code, is not among those timed
        "wall_seconds_per_step": summary["wall_seconds_steps"] / max(done - 1, 1),
        "iterations_per_step": summary["newton_iterations"] / done,
        "jacobians": summary["factorizations"],
        "memory": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0,
        "tip": [float(outcome.history[f"tip_{c}"][-1]) for c in "xyz"],
        "success": outcome.status == "ok" and done == steps,
    }


def run_exudyn(
    bodies: int, modes: int, steps: int, dt: float, settings: dict[str, Any]
) -> dict[str, Any]:
    """Integrate the chain in Exudyn and measure the loop over the steps alone.

    Args:
        bodies: Number of bars.
        modes: Modes of each, besides the six functions of its far face.
        steps: Number of steps.
        dt: Step size in s.
        settings: Changes to the Exudyn settings, see ``integration_settings``.

    Returns:
        ``wall_seconds_per_step``, ``iterations_per_step``, ``jacobians``, ``memory`` (peak resident
        set in MB), ``tip`` (m) and ``success``.
    """
    # Exudyn's fast build must be selected before its modules are imported
    from exudyn_beams import eii, exu, integration_settings

    mbs, tip = _assembled(bodies, modes, eii, exu)
    simulation = integration_settings(steps, dt, settings)
    solver: Any = exu.MainSolverImplicitSecondOrder()
    if not solver.InitializeSolver(mbs, simulation):
        raise RuntimeError(f"Exudyn did not initialise the chain of {bodies} bars")
    wall = time.perf_counter()
    success = bool(solver.SolveSteps(mbs, simulation))
    wall = time.perf_counter() - wall
    iterator = solver.it
    done = max(1, round(iterator.currentTime / dt))
    result = {
        "wall_seconds_per_step": wall / done,
        "iterations_per_step": iterator.newtonStepsCount / done,
        "jacobians": int(iterator.newtonJacobiCount),
        "memory": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0,
        "tip": [float(v) for v in mbs.GetMarkerOutput(tip, exu.OutputVariableType.Position)],
        "success": success and done == steps,
    }
    solver.FinalizeSolver(mbs, simulation)
    return result


def _assembled(bodies: int, modes: int, eii: Any, exu: Any) -> tuple[Any, int]:
    """The assembled main system and the marker at the tip."""
    import contextlib
    import sys

    with contextlib.redirect_stdout(sys.stderr):
        from exudyn.FEM import HCBstaticModeSelection, ObjectFFRFreducedOrderInterface

    model = _finite_elements()
    places = model.nodes["Position"]
    faces = [np.flatnonzero(which(places.T)) for which in (near, far)]
    model.ComputeHurtyCraigBamptonModes(
        [face.tolist() for face in faces], modes, computationMode=HCBstaticModeSelection.RBE2
    )
    reduced = ObjectFFRFreducedOrderInterface(model)
    # the node in the middle of the far face moves as its frame does
    middle = int(np.argmin(np.linalg.norm(places - [LENGTH, 0.0, 0.0], axis=1)))
    container = exu.SystemContainer()
    mbs = container.AddSystem()
    ground = mbs.AddObject(eii.ObjectGround())
    last = mbs.AddMarker(eii.MarkerBodyPosition(bodyNumber=ground))
    for i in range(bodies):
        items = reduced.AddObjectFFRFreducedOrder(
            mbs, positionRef=[i * LENGTH, 0.0, 0.0], gravity=list(GRAVITY)
        )
        # the frame is that of the near face
        start = mbs.AddMarker(eii.MarkerNodePosition(nodeNumber=items["nRigidBody"]))
        mbs.AddObject(eii.ObjectJointSpherical(markerNumbers=[last, start]))
        last = mbs.AddMarker(
            eii.MarkerSuperElementPosition(
                bodyNumber=items["oFFRFreducedOrder"], meshNodeNumbers=[middle],
                weightingFactors=[1.0],
            )
        )  # fmt: skip
    mbs.Assemble()
    mbs.variables["container"] = container
    return mbs, last


def _finite_elements() -> Any:
    """Matrices and nodes of the bar as Exudyn takes them."""
    body = bar()  # before anything of dolfinx
    import ufl
    from dolfinx import fem
    from exudyn.FEM import FEMinterface

    u, v = ufl.TrialFunction(body.space), ufl.TestFunction(body.space)
    mass = sum(
        m.density * ufl.inner(m.displacement(u), m.displacement(v)) for m in body.masses
    ) * ufl.dx(body.space.mesh)
    model = FEMinterface()
    model.nodes = {"Position": body.space.tabulate_dof_coordinates()}
    model.massMatrix, model.stiffnessMatrix = (
        fem.assemble_matrix(fem.form(form)).to_scipy().tocsr()
        for form in (mass, body.elastic(u, v))
    )
    model.surface = [{"Name": "none", "Trigs": np.zeros((0, 3), dtype=int)}]
    return model


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("program", choices=("exudyn", "flexfem"))
    parser.add_argument("--bodies", type=int, default=4)
    parser.add_argument("--modes", type=int, default=6)
    parser.add_argument("--steps", type=int, default=500)
    parser.add_argument("--dt", type=float, default=1e-3, help="step size in s")
    parser.add_argument("--preset", choices=sorted(PRESETS), default="lagged")
    parser.add_argument("--frame", choices=("near", "far", "mean_axes"), default="near")
    parser.add_argument("--stiffening", action="store_true")
    parser.add_argument("--derivatives", type=int, help="nonlinear bars with so many of them")
    args = parser.parse_args()
    sizes = args.bodies, args.modes, args.steps, args.dt
    if args.program == "exudyn":
        result = run_exudyn(*sizes, PRESETS[args.preset])
    else:
        result = run_flexfem(*sizes, args.frame, args.stiffening, args.derivatives)
    print(json.dumps(result))


if __name__ == "__main__":
    main()
