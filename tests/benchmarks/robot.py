# SPDX-License-Identifier: LGPL-3.0-or-later
"""Arm of six revolute joints under PD control: time of a step of a small model."""

import argparse
import math
import time
from collections.abc import Callable, Sequence

import numpy as np

import flexfem as ff
from flexfem.simulation.motion.stepping import Simulation

#: Origin of each joint before the first move, m, and its axis; the last one is the tip.
PLACES = np.array(
    [
        (0.0, 0.0, 0.0), (0.0, 0.0, 0.3), (0.0, 0.0, 0.9), (0.5, 0.0, 0.9), (0.6, 0.0, 0.9),
        (0.7, 0.0, 0.9), (0.8, 0.0, 0.9),
    ]
)  # fmt: skip
AXES = ((0, 0, 1), (0, 1, 0), (0, 1, 0), (1, 0, 0), (0, 1, 0), (1, 0, 0))
#: Masses of the links, kg.
MASSES = (8.0, 10.0, 5.0, 2.0, 2.0, 0.5)
#: Gains, N m / rad and N m s / rad, and angles to be reached, rad, within a time, s.
STIFFNESS = (2000.0, 2000.0, 1000.0, 100.0, 100.0, 20.0)
DAMPING = (100.0, 100.0, 50.0, 5.0, 5.0, 1.0)
TARGETS, SPAN = (1.0, 0.6, -0.8, 0.7, 0.9, -1.2), 1.0
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


def _angles(axis: Sequence[float]) -> Callable[..., tuple[float, float]]:
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
                ff.Probe(f"turn_{k + 1}", (before, own), names[-1], _angles(axis)),
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
    middle, length = 0.5 * (start + end), float(np.linalg.norm(end - start))
    inertia = MASSES[k] * (length**2 / 12.0 + 0.05**2)
    model.add(ff.RigidBody(name, MASSES[k], 3 * (inertia,), position=middle))
    return ff.Marker(name, offset=start - middle), ff.Marker(name, offset=end - middle)


def main() -> None:
    """Print the time of a step of every kind."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=1000)
    parser.add_argument("--dt", type=float, default=1e-3)
    parser.add_argument("--laws", default="compiled,sampled,continuous")
    parser.add_argument("--flexible", default="none,tool,arm")
    given = parser.parse_args()
    for law in given.laws.split(","):
        for flexible in given.flexible.split(","):
            model = robot(law, flexible, given.dt)
            options = ff.RunOptions(dt=given.dt, t_end=given.steps * given.dt, quiet=True)
            simulation = Simulation(model, options)
            spent = []
            for _ in range(given.steps):
                begin = time.process_time()
                status = simulation.advance(given.dt)
                spent.append(time.process_time() - begin)
                if status.name != "OK":
                    break
            counts = simulation.system.counters
            print(
                f"{law:10} {flexible:5} "
                f"{1e3 * np.median(spent[1:]):.4f} ms a step, "
                f"{counts.newton_iterations / given.steps:.2f} iterations, "
                f"{counts.factorizations} factorisations, "
                f"tip {simulation.system.interface.frames[-1, :3]}"
            )


if __name__ == "__main__":
    main()
