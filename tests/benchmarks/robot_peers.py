# SPDX-License-Identifier: LGPL-3.0-or-later
"""The rigid arm of ``robot.py`` in flexfem and in its peers: processor time at equal errors.

Run from the source tree::

    python -m tests.benchmarks.robot_peers                                    # all that are there
    python -m tests.benchmarks.robot_peers --peers-python VENV/bin/python     # where the peers are

The peers are optional: ``pip install mujoco pin drake exudyn``, or the extra ``peers``; those that
are missing are named. ``robot_data.py`` has the numbers of the arm for all of them.

Each program has an adapter below: a function that makes the arm for a method and returns a run by a
step size. Errors are the largest of all joint angles at ten times within the motion, against a
solution of flexfem that is extrapolated from two small steps; a program that does not converge to
it ends the comparison. Of every method the largest step whose error is below a target is timed.
Each program runs in a process of its own with one thread; they take turns, so that each round has a
run of all of them one after the other, and ratios are those within a round.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.benchmarks.robot_data import (
    AXES,
    DAMPING,
    MASSES,
    PLACES,
    SPAN,
    STIFFNESS,
    TARGETS,
    inertia,
)

ROOT = Path(__file__).resolve().parents[2]
K, C, GOAL = (np.array(x) for x in (STIFFNESS, DAMPING, TARGETS))
#: Times at which angles are compared, s: all steps are parts of the first one.
MARKS = SPAN * np.arange(1, 11) / 10
#: Numbers of steps to the first of them.
COUNTS = (4, 5, 6, 8, 10, 16, 25, 40, 50, 64, 80, 100, 128, 160, 200, 256, 320, 400, 640, 1000)
#: That with which each program must be at the reference, and within which error, rad: methods of
#: first order, and all others.
LEAST, FAR, NEAR = 3200, 2e-5, 2e-9
FIRST_ORDER = ("Euler", "implicitfast", "discrete")
#: Those of the reference, of second order, and the tolerance of its iterations.
FINE, FINEST, TIGHT = 800, 1600, 1e-12
#: Largest errors at which times are compared, rad.
ERRORS = (1e-4, 1e-6)

Floats = NDArray[np.float64]
#: Of a number of steps to the first mark: processor time, s, and angles (10, 6) at the marks.
Run = Callable[[int], tuple[float, Floats]]


def reference(t: float) -> tuple[float, float]:
    """Part of the way at a time (s), and its rate."""
    s = t / SPAN
    part = s * s * s * (10.0 + s * (6.0 * s - 15.0))
    return part, 30.0 * s * s * (1.0 - s) * (1.0 - s) / SPAN


def stretches(steps: int) -> Iterator[range]:
    """Numbers of the steps to each mark."""
    return (range(k * steps, (k + 1) * steps) for k in range(len(MARKS)))


def flexfem(method: str) -> Run:
    """Redundant coordinates, generalised-alpha; PD forces by a function that is compiled."""
    import flexfem as ff
    from flexfem.simulation.motion.stepping import Simulation
    from flexfem.system.measure.marker_states import MarkerStates
    from tests.benchmarks.robot import angle_of, robot

    tolerance = TIGHT if method == "reference" else 1e-6

    def run(steps: int) -> tuple[float, Floats]:
        h, spent, found = MARKS[0] / steps, 0.0, []
        model = robot("compiled", "none")
        options = ff.RunOptions(dt=h, t_end=SPAN, quiet=True, tolerance=tolerance)
        simulation = Simulation(model, options)
        bodies = [ff.Ground(), *(ff.Marker(f"link_{k + 1}") for k in range(len(AXES)))]
        states = MarkerStates(simulation.system, simulation.serial, bodies)
        for stretch in stretches(steps):
            begin = time.process_time()
            for _ in stretch:
                status = simulation.advance(h)
                if status.name != "OK":
                    return np.inf, np.full((len(MARKS), len(AXES)), np.nan)
            spent += time.process_time() - begin
            now = states.evaluate()
            found.append([angle_of(axis)(0.0, *now[k : k + 2])[0] for k, axis in enumerate(AXES)])
        return spent, np.array(found)

    return run


def mujoco(method: str) -> Run:
    """Minimal coordinates; PD forces are those of actuators."""
    import mujoco as mj

    text, end = "", ""
    for k, axis in enumerate(AXES):
        at = PLACES[k] - (PLACES[k - 1] if k else 0.0)
        middle, J = 0.5 * (PLACES[k + 1] - PLACES[k]), inertia(k)
        text += (
            f'<body name="b{k}" pos="{_text(at)}"><joint name="j{k}" axis="{_text(axis)}"/>'
            f'<inertial pos="{_text(middle)}" mass="{MASSES[k]}" diaginertia="{J} {J} {J}"/>'
        )
        end += "</body>"
    motors = "".join(
        f'<general joint="j{k}" gainprm="1" biastype="affine" biasprm="0 {-K[k]} {-C[k]}"/>'
        for k in range(len(AXES))
    )
    # steps that are too large are told, also in a file of the present folder
    mj.set_mju_user_warning(lambda _: None)
    model = mj.MjModel.from_xml_string(
        f'<mujoco><option gravity="0 0 -9.81" integrator="{method}">'
        '<flag contact="disable"/></option>'
        f"<worldbody>{text}{end}</worldbody><actuator>{motors}</actuator></mujoco>"
    )
    # forces of Runge-Kutta's stages follow the motion, but not the reference within a step
    lead = 0.5 if method == "RK4" else 0.0

    def run(steps: int) -> tuple[float, Floats]:
        data, spent, found = mj.MjData(model), 0.0, []
        model.opt.timestep = h = MARKS[0] / steps
        for stretch in stretches(steps):
            begin = time.process_time()
            for k in stretch:
                part, rate = reference((k + lead) * h)
                data.ctrl[:] = GOAL * (K * part + C * rate)
                mj.mj_step(model, data)
            spent += time.process_time() - begin
            found.append(data.qpos.copy())
        return spent, np.array(found)

    return run


def pinocchio(method: str) -> Run:
    """Minimal coordinates: articulated bodies, law and Runge and Kutta's method in Python."""
    import pinocchio as pin

    model, parent = pin.Model(), 0
    for k, axis in enumerate(AXES):
        at = PLACES[k] - (PLACES[k - 1] if k else 0.0)
        joint = pin.JointModelRevoluteUnaligned(*map(float, axis))
        parent = model.addJoint(parent, joint, pin.SE3(np.eye(3), at), f"j{k}")
        middle = 0.5 * (PLACES[k + 1] - PLACES[k])
        model.appendBodyToJoint(
            parent, pin.Inertia(MASSES[k], middle, inertia(k) * np.eye(3)), pin.SE3.Identity()
        )
    data = model.createData()

    def rates(t: float, q: Floats, v: Floats) -> Floats:
        part, rate = reference(t)
        forces = K * (GOAL * part - q) + C * (GOAL * rate - v)
        return pin.aba(model, data, q, v, forces).copy()  # type: ignore[no-any-return]

    def run(steps: int) -> tuple[float, Floats]:
        h, spent, found = MARKS[0] / steps, 0.0, []
        q, v = np.zeros((2, len(AXES)))
        for stretch in stretches(steps):
            begin = time.process_time()
            for k in stretch:
                t = k * h
                a1 = rates(t, q, v)
                v2 = v + 0.5 * h * a1
                a2 = rates(t + 0.5 * h, q + 0.5 * h * v, v2)
                v3 = v + 0.5 * h * a2
                a3 = rates(t + 0.5 * h, q + 0.5 * h * v2, v3)
                v4 = v + h * a3
                a4 = rates(t + h, q + h * v3, v4)
                q = q + h / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4)
                v = v + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
            spent += time.process_time() - begin
            found.append(q)
        return spent, np.array(found)

    return run


def drake(method: str) -> Run:
    """Minimal coordinates; springs and dampers of the joints, torques by a polynomial of time."""
    from pydrake.math import RigidTransform
    from pydrake.multibody.plant import MultibodyPlant
    from pydrake.multibody.tree import (
        FixedOffsetFrame,
        RevoluteJoint,
        RevoluteSpring,
        RotationalInertia,
        SpatialInertia,
    )
    from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator
    from pydrake.systems.framework import DiagramBuilder
    from pydrake.systems.primitives import TrajectorySource

    def made(step: float) -> tuple[Any, Any]:
        builder = DiagramBuilder()
        plant = builder.AddSystem(MultibodyPlant(time_step=step))
        plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, -9.81])
        parent = plant.world_body()
        for k, axis in enumerate(AXES):
            at = PLACES[k] - (PLACES[k - 1] if k else 0.0)
            J, middle = inertia(k), 0.5 * (PLACES[k + 1] - PLACES[k])
            whole = SpatialInertia.MakeFromCentralInertia(
                MASSES[k], middle, RotationalInertia(J, J, J)
            )
            own = plant.AddRigidBody(f"link_{k}", whole)
            frame = FixedOffsetFrame(f"frame_{k}", parent.body_frame(), RigidTransform(at))
            joint = plant.AddJoint(
                RevoluteJoint(f"joint_{k}", plant.AddFrame(frame), own.body_frame(), axis, C[k])
            )
            plant.AddForceElement(RevoluteSpring(joint, 0.0, K[k]))
            plant.AddJointActuator(f"motor_{k}", joint)
            parent = own
        plant.Finalize()
        source = builder.AddSystem(TrajectorySource(_torques()))
        builder.Connect(source.get_output_port(), plant.get_actuation_input_port())
        return builder.Build(), plant

    def run(steps: int) -> tuple[float, Floats]:
        h, spent, found = MARKS[0] / steps, 0.0, []
        diagram, plant = made(h if method == "discrete" else 0.0)
        simulator = Simulator(diagram)
        if method != "discrete":
            ResetIntegratorFromFlags(simulator, method, h)
            simulator.get_mutable_integrator().set_fixed_step_mode(True)
        context = plant.GetMyContextFromRoot(simulator.get_context())
        simulator.Initialize()
        for mark in MARKS:
            begin = time.process_time()
            simulator.AdvanceTo(mark)
            spent += time.process_time() - begin
            found.append(plant.GetPositions(context).copy())
        return spent, np.array(found)

    return run


def _torques() -> Any:
    """Torques of Drake's actuators besides its springs and dampers."""
    from pydrake.polynomial import Polynomial
    from pydrake.trajectories import PiecewisePolynomial

    T = SPAN
    part = np.array([0.0, 0.0, 0.0, 10.0 / T**3, -15.0 / T**4, 6.0 / T**5])
    rate = np.append(part[1:] * np.arange(1, 6), 0.0)
    forces = [[Polynomial(GOAL[k] * (K[k] * part + C[k] * rate))] for k in range(len(AXES))]
    return PiecewisePolynomial([np.array(forces)], [0.0, T])


def exudyn(method: str) -> Run:
    """A tree in minimal coordinates, or bodies with joints; torques by compiled functions."""
    import exudyn as exu

    container = exu.SystemContainer()
    mbs = container.AddSystem()
    sensors = _exudyn_bodies(mbs) if method.startswith("bodies") else _exudyn_tree(mbs)
    mbs.Assemble()
    mbs.variables["container"] = container

    def run(steps: int) -> tuple[float, Floats]:
        settings = exu.SimulationSettings()
        integration, solution = settings.timeIntegration, settings.solutionSettings
        integration.numberOfSteps, integration.endTime = len(MARKS) * steps, SPAN
        integration.verboseMode = 0
        solution.writeSolutionToFile, solution.sensorsWritePeriod = False, MARKS[0]
        if method == "RK44":
            solver: Any = exu.MainSolverExplicit()
            integration.explicitIntegration.dynamicSolverType = exu.DynamicSolverType.RK44
        else:
            solver = exu.MainSolverImplicitSecondOrder()
        if not solver.InitializeSolver(mbs, settings):
            raise RuntimeError(f"Exudyn did not initialise {method}")
        begin = time.process_time()
        success = bool(solver.SolveSteps(mbs, settings))
        spent = time.process_time() - begin
        solver.FinalizeSolver(mbs, settings)
        tables = [np.asarray(mbs.GetSensorStoredData(sensor)) for sensor in sensors]
        if not success or len(tables[0]) <= len(MARKS):
            return np.inf, np.full((len(MARKS), len(AXES)), np.nan)
        return spent, np.hstack([found[-len(MARKS) :, 1:] for found in tables])

    return run


def _exudyn_tree(mbs: Any) -> list[Any]:
    """Add a kinematic tree with PD control and loads at its coordinates; the sensor of these."""
    import exudyn as exu
    import exudyn.itemInterface as eii

    count = len(AXES)
    node = mbs.AddNode(
        eii.NodeGenericODE2(
            referenceCoordinates=count * [0.0], initialCoordinates=count * [0.0],
            initialCoordinates_t=count * [0.0], numberOfODE2Coordinates=count,
        )
    )  # fmt: skip
    turns = (exu.JointType.RevoluteX, exu.JointType.RevoluteY, exu.JointType.RevoluteZ)
    places, middles, inertias, turned = (
        exu.Vector3DList(), exu.Vector3DList(), exu.Matrix3DList(), exu.Matrix3DList()
    )  # fmt: skip
    for k in range(count):
        places.Append(PLACES[k] - (PLACES[k - 1] if k else 0.0))
        middles.Append(0.5 * (PLACES[k + 1] - PLACES[k]))
        inertias.Append(inertia(k) * np.eye(3))
        turned.Append(np.eye(3))
    mbs.AddObject(
        eii.ObjectKinematicTree(
            nodeNumber=node, jointTypes=[turns[axis.index(1)] for axis in AXES],
            linkParents=list(range(-1, count - 1)), jointTransformations=turned,
            jointOffsets=places, linkInertiasCOM=inertias, linkCOMs=middles,
            linkMasses=list(MASSES), gravity=[0.0, 0.0, -9.81], jointPControlVector=K,
            jointDControlVector=C, jointPositionOffsetVector=count * [0.0],
            jointVelocityOffsetVector=count * [0.0],
        )
    )  # fmt: skip
    for k in range(count):
        marker = mbs.AddMarker(eii.MarkerNodeCoordinate(nodeNumber=node, coordinate=k))
        load = mbs.AddLoad(eii.LoadCoordinate(markerNumber=marker, load=1.0))
        mbs.SetLoadParameter(load, "loadUserFunction", _symbolic(mbs, "loadUserFunction", load, k))
    return [
        mbs.AddSensor(
            eii.SensorNode(
                nodeNumber=node, storeInternal=True,
                outputVariableType=exu.OutputVariableType.Coordinates,
            )
        )
    ]  # fmt: skip


def _exudyn_bodies(mbs: Any) -> list[Any]:
    """Add bodies with revolute joints, springs and dampers; the sensors of their angles."""
    import exudyn as exu
    import exudyn.itemInterface as eii
    from exudyn.rigidBodyUtilities import RigidBodyInertia

    before, sensors = mbs.CreateGround(), []
    for k, axis in enumerate(AXES):
        own = mbs.CreateRigidBody(
            referencePosition=0.5 * (PLACES[k] + PLACES[k + 1]), gravity=[0.0, 0.0, -9.81],
            inertia=RigidBodyInertia(MASSES[k], inertia(k) * np.eye(3)),
        )  # fmt: skip
        joined = {"bodyNumbers": [before, own], "position": PLACES[k], "axis": list(axis)}
        mbs.CreateRevoluteJoint(**joined)
        spring = mbs.CreateTorsionalSpringDamper(**joined, stiffness=K[k], damping=C[k])
        name = "springTorqueUserFunction"
        mbs.SetObjectParameter(spring, name, _symbolic(mbs, name, spring, k))
        sensors.append(
            mbs.AddSensor(
                eii.SensorObject(
                    objectNumber=spring, storeInternal=True,
                    outputVariableType=exu.OutputVariableType.Rotation,
                )
            )
        )  # fmt: skip
        before = own
    return sensors


def _symbolic(mbs: Any, name: str, item: Any, k: int) -> Any:
    """Compiled function of a load, or of a spring and damper, of a joint; the system keeps it."""
    from exudyn.advancedUtilities import CreateSymbolicUserFunction

    goal, stiff, damp = float(GOAL[k]), float(K[k]), float(C[k])

    def load_torque(mbs: Any, t: Any, load: Any) -> Any:
        part, rate = reference(t)
        return load * goal * (stiff * part + damp * rate)

    def spring_torque(
        mbs: Any, t: Any, itemNumber: Any, rotation: Any, angularVelocity: Any, stiffness: Any,
        damping: Any, offset: Any,
    ) -> Any:  # fmt: skip
        part, rate = reference(t)
        return stiffness * (rotation - goal * part) + damping * (angularVelocity - goal * rate)

    function = load_torque if name == "loadUserFunction" else spring_torque
    made = CreateSymbolicUserFunction(mbs, function, name, item)
    mbs.variables[f"{name}_{k}"] = made
    return made


def _text(x: Any) -> str:
    return " ".join(str(float(one)) for one in x)


#: Adapters with their methods.
PROGRAMS: dict[str, tuple[Callable[[str], Run], tuple[str, ...]]] = {
    "flexfem": (flexfem, ("generalised-alpha",)),
    "mujoco": (mujoco, ("Euler", "implicitfast", "RK4")),
    "pinocchio": (pinocchio, ("RK4",)),
    "drake": (drake, ("discrete", "runge_kutta3", "runge_kutta5", "radau3")),
    "exudyn": (exudyn, ("generalised-alpha", "RK44", "bodies generalised-alpha")),
}


class Worker:
    """An adapter with a method in a process of its own.

    Attributes:
        name: program and method.
    """

    def __init__(self, python: str, program: str, method: str) -> None:
        """Start it."""
        self.name = f"{program} {method}"
        command = [python, "-W", "ignore", "-m", "tests.benchmarks.robot_peers"]
        self._process = subprocess.Popen(
            [*command, "--worker", program, method], cwd=ROOT, stdin=subprocess.PIPE,
            stdout=subprocess.PIPE, text=True,
            env=os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
        )  # fmt: skip

    def run(self, steps: int) -> tuple[float, Floats] | None:
        """See :data:`Run`; None if the process has ended."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        try:
            print(steps, file=self._process.stdin, flush=True)
        except BrokenPipeError:
            return None
        for line in self._process.stdout:
            if line.startswith("{"):
                found = json.loads(line)
                return found["seconds"], np.array(found["angles"])
        return None

    def end(self) -> None:
        """End it."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()


def work(program: str, method: str) -> None:
    """Run what standard input asks for, in this process."""
    run = PROGRAMS[program][0](method)
    for line in sys.stdin:
        seconds, angles = run(int(line))
        print(json.dumps({"seconds": seconds, "angles": angles.tolist()}), flush=True)


def exact(python: str) -> Floats:
    """Angles (10, 6) of flexfem, extrapolated by two runs of second order."""
    worker = Worker(python, "flexfem", "reference")
    runs = [worker.run(steps) for steps in (FINE, FINEST)]
    worker.end()
    assert runs[0] is not None
    assert runs[1] is not None
    coarse, fine = runs[0][1], runs[1][1]
    return np.asarray(fine + (fine - coarse) / ((FINEST / FINE) ** 2 - 1.0))


def coarsest(worker: Worker, angles: Floats) -> dict[float, tuple[int, float]]:
    """For each of ``ERRORS`` the fewest steps to a mark, and their error.

    Raises:
        RuntimeError: the program does not converge to the angles (10, 6).
    """
    chosen: dict[float, tuple[int, float]] = {}
    error = np.nan
    for steps in COUNTS:
        found = worker.run(steps)
        if found is None:
            raise RuntimeError(f"{worker.name}: the process has ended")
        with np.errstate(invalid="ignore", over="ignore"):
            error = float(np.abs(found[1] - angles).max())
        for largest in ERRORS:
            if error <= largest and largest not in chosen:
                chosen[largest] = steps, error
        if len(chosen) == len(ERRORS):
            break
    found = worker.run(LEAST)
    least = np.nan if found is None else float(np.abs(found[1] - angles).max())
    told = f"{worker.name}: error {least:.1e} rad with steps of {_ms(LEAST)} ms"
    if not least <= (FAR if worker.name.endswith(FIRST_ORDER) else NEAR):
        raise RuntimeError(f"{told} is another motion")
    print(told, flush=True)
    return chosen


def _ms(steps: int) -> str:
    """Step size in ms."""
    return f"{1e3 * MARKS[0] / steps:.4g}"


def table(workers: list[Worker], angles: Floats, rounds: int) -> None:
    """Print times and ratios of all programs at both errors."""
    chosen = {worker.name: coarsest(worker, angles) for worker in workers}
    print("\n| error below | program | step ms | error | ms a simulated second | over flexfem |")
    print("|---" * 6 + "|")
    for largest in ERRORS:
        able = [worker for worker in workers if largest in chosen[worker.name]]
        seconds: dict[str, list[float]] = {worker.name: [] for worker in able}
        for _ in range(rounds):
            for worker in able:
                found = worker.run(chosen[worker.name][largest][0])
                seconds[worker.name].append(np.nan if found is None else found[0] / SPAN)
        own = seconds[able[0].name]
        for worker in able:
            steps, error = chosen[worker.name][largest]
            times = seconds[worker.name]
            ratio = statistics.median(a / b for a, b in zip(times, own, strict=True))
            print(
                f"| {largest:g} | {worker.name} | {_ms(steps)} | {error:.1e} | "
                f"{1e3 * statistics.median(times):.3g} | {ratio:.3g} |"
            )
        for worker in workers:
            if worker not in able:
                print(f"| {largest:g} | {worker.name} | none | | | |", flush=True)


def missing(python: str, program: str) -> bool:
    """True if a program cannot be imported."""
    module = "pydrake" if program == "drake" else program
    code = f"import sys, importlib.util as u; sys.exit(u.find_spec('{module}') is None)"
    return subprocess.run([python, "-c", code], check=False, cwd=ROOT).returncode != 0


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--programs", default=",".join(PROGRAMS), help="flexfem is the first")
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--peers-python", default=sys.executable, help="interpreter with the peers")
    parser.add_argument("--worker", nargs=2, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.worker:
        work(*given.worker)
        return
    workers = []
    for program in given.programs.split(","):
        python = sys.executable if program == "flexfem" else given.peers_python
        if missing(python, program):
            print(f"missing: {program}")
            continue
        workers += [Worker(python, program, method) for method in PROGRAMS[program][1]]
    table(workers, exact(sys.executable), given.rounds)
    for worker in workers:
        worker.end()


if __name__ == "__main__":
    main()
