# SPDX-License-Identifier: LGPL-3.0-or-later
"""Arm of six revolute joints under PD control: time of a step of a small model."""

import argparse
import math
import time
from collections.abc import Callable, Sequence

import numpy as np

import flexfem as ff
from flexfem.simulation.motion.stepping import Simulation
from flexfem.system.measure.marker_states import MarkerStates
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

#: Radius of the flexible link, m, and its elements; length, m, and mass at the end, kg, as a tool.
RADIUS, ELEMENTS, TOOL, LOAD = 0.02, 8, 0.4, 2.0
#: Number of the link that is flexible as an arm; mass, kg, and inertia, kg m^2, of its hub, with
#: the rotor of the motor behind its gear.
ARM, HUB = 1, (3.0, 0.5)


def servo(x: float, v: float, t: float, p: tuple[float, ...]) -> float:
    """PD law of one joint as a function that is compiled; p is (k, c, target, span)."""
    s = min(t / p[3], 1.0)
    part = s * s * s * (10.0 + s * (6.0 * s - 15.0))
    rate = 30.0 * s * s * (1.0 - s) * (1.0 - s) / p[3]
    return p[0] * (x - p[2] * part) + p[1] * (v - p[2] * rate)


def angle_of(axis: Sequence[float]) -> Callable[..., tuple[float, float]]:
    """Function of a probe: angle and rate of a joint about one of the axes x, y, z."""
    k = axis.index(1)
    i, j = (k + 1) % 3, (k + 2) % 3

    def measured(t: float, a: ff.MarkerState, b: ff.MarkerState) -> tuple[float, float]:
        R, S = a.turn, b.turn
        cosine = R[:, i] @ S[:, i]
        sine = R[:, j] @ S[:, i]
        return math.atan2(sine, cosine), R[:, k] @ (b.angular_velocity - a.angular_velocity)

    return measured


def _pd(t: float, y: np.ndarray) -> np.ndarray:
    """PD law of all joints: y are angles and rates in turns."""
    s = min(t / SPAN, 1.0)
    part = s * s * s * (10.0 + s * (6.0 * s - 15.0))
    rate = 30.0 * s * s * (1.0 - s) * (1.0 - s) / SPAN
    return _GAINS[0] * (_GAINS[2] * part - y[::2]) + _GAINS[1] * (_GAINS[2] * rate - y[1::2])


_GAINS = np.array([STIFFNESS, DAMPING, TARGETS])


def robot(law: str = "compiled", flexible: str = "tool", sample_time: float = 1e-3) -> ff.Model:
    """The arm.

    Args:
        law: "compiled" for functions of angle and rate that are compiled, "continuous" and
            "sampled" for controllers in Python.
        flexible: "tool" for six rigid links and a beam with a mass at its end, "arm" for a beam in
            place of the second link, between a hub and the third joint, "none" for a rigid tool.
        sample_time: of "sampled", s.
    """
    beam = PLACES[ARM : ARM + 2] if flexible == "arm" else PLACES[-1] + [(0, 0, 0), (TOOL, 0, 0)]
    mesh = ff.LineMesh.straight({"beam": beam.tolist()}, ELEMENTS)
    model = ff.Model("robot", mesh=None if flexible == "none" else mesh)
    model.add(ff.Gravity((0.0, 0.0, -9.81)))
    if flexible != "none":
        rod = ff.Section.circle(RADIUS, ff.Material(7e10, 0.3, 2700.0))
        model.add(ff.Beam("beam", rod, orientation=tuple(np.ptp(beam, axis=0)[[1, 2, 0]])))
    before: ff.Marker | ff.Ground = ff.Ground()
    names = []
    for k, axis in enumerate(AXES):
        own, after = _link(model, k, hub=flexible == "arm" and k == ARM)
        model.add(ff.Revolute(f"joint_{k + 1}", before, own, axis=axis))
        if law == "compiled":
            p = (STIFFNESS[k], DAMPING[k], TARGETS[k], SPAN)
            turning = {"axis": axis, "motion": "rotation", "force": servo, "parameters": p}
            model.add(ff.CustomForce(f"servo_{k + 1}", before, own, **turning))
        else:
            names.append((f"angle_{k + 1}", f"rate_{k + 1}"))
            model.add(
                ff.Actuator(f"motor_{k + 1}", before, own, axis=axis),
                ff.Probe(f"turn_{k + 1}", (before, own), names[-1], angle_of(axis)),
            )
        before = after
    if names:
        motors = [f"motor_{k + 1}" for k in range(len(AXES))]
        every = sample_time if law == "sampled" else None
        inputs = [name for pair in names for name in pair]
        model.add(ff.Controller("pd", inputs, motors, _pd, sample_time=every))
    if flexible == "tool":
        model.add(ff.Rigid("flange", before, ff.Marker("beam", "start")))
        before = ff.Marker("beam", "end")
        model.add(ff.PointMass("load", LOAD, before))
    model.add(ff.PositionProbe("tip", before))
    return model


def _link(model: ff.Model, k: int, *, hub: bool) -> tuple[ff.Marker, ff.Marker]:
    """Add a link; markers at its joint and at the next one."""
    name, start, end = f"link_{k + 1}", PLACES[k], PLACES[k + 1]
    if hub:
        model.add(ff.RigidBody(name, HUB[0], 3 * (HUB[1],), position=start))
        model.add(ff.Rigid("clamp", ff.Marker(name), ff.Marker("beam", "start")))
        return ff.Marker(name), ff.Marker("beam", "end")
    middle = 0.5 * (start + end)
    model.add(ff.RigidBody(name, MASSES[k], 3 * (inertia(k),), position=middle))
    return ff.Marker(name, offset=start - middle), ff.Marker(name, offset=end - middle)


def run(model: ff.Model, h: float, steps: int, tolerance: float) -> tuple[list[float], Simulation]:
    """Processor time of each of some steps of a size, s, until one fails, and the simulation."""
    options = ff.RunOptions(dt=h, t_end=steps * h, quiet=True, tolerance=tolerance)
    simulation, spent = Simulation(model, options), []
    for _ in range(steps):
        begin = time.process_time()
        status = simulation.advance(h)
        spent.append(time.process_time() - begin)
        if status.name != "OK":
            return spent[:-1], simulation
    return spent, simulation


def _tip(simulation: Simulation, model: ff.Model) -> np.ndarray:
    """Position of the tip, m."""
    probe = model.get("tip")
    states = MarkerStates(simulation.system, simulation.serial, probe.markers).evaluate()
    return states[0].position


def main() -> None:
    """Print the time of a step of every kind, and errors of the tip after 1 s."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--laws", default="compiled,sampled,continuous")
    parser.add_argument("--flexible", default="none,tool,arm")
    parser.add_argument("--steps", default="1e-3", help="sizes of steps, s")
    parser.add_argument("--tolerance", type=float, default=1e-6)
    parser.add_argument("--errors", action="store_true", help="against an eighth of the least step")
    given = parser.parse_args()
    sizes = [float(h) for h in given.steps.split(",")]
    for law in given.laws.split(","):
        for flexible in given.flexible.split(","):
            exact = None
            if given.errors:
                model, h = robot(law, flexible, min(sizes) / 8.0), min(sizes) / 8.0
                exact = _tip(run(model, h, round(1.0 / h), 1e-12)[1], model)
            for h in sizes:
                model = robot(law, flexible, h)
                spent, simulation = run(model, h, round(1.0 / h), given.tolerance)
                if len(spent) < round(1.0 / h):
                    print(f"{law:10} {flexible:5} h {1e3 * h:g} ms: fails after {len(spent)} steps")
                    continue
                counts, tip = simulation.system.counters, _tip(simulation, model)
                error = "" if exact is None else f", error {np.linalg.norm(tip - exact):.2e} m"
                print(
                    f"{law:10} {flexible:5} h {1e3 * h:g} ms: {1e3 * np.median(spent[1:]):.4f} ms "
                    f"a step, {counts.newton_iterations / len(spent):.2f} iterations, "
                    f"{counts.factorizations} factorisations, tip {tip}{error}"
                )


if __name__ == "__main__":
    main()
