# SPDX-License-Identifier: LGPL-3.0-or-later
"""The rigid arm of ``robot.py`` in MuJoCo and Pinocchio: time of a step and error of the tip.

Needs ``pip install mujoco pin`` in an environment of its own; ``robot_data.py`` has the numbers.
The error is the distance of the tip at the end from a run with an eighth of the smallest step.
"""

import argparse
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from robot_data import AXES, DAMPING, MASSES, PLACES, SPAN, STIFFNESS, TARGETS, inertia

K, C, GOAL = (np.array(x) for x in (STIFFNESS, DAMPING, TARGETS))
#: End of the motion, s.
END = 1.0


def reference(t: float) -> tuple[float, float]:
    """Part of the way at a time (s), and its rate."""
    s = min(t / SPAN, 1.0)
    part = s * s * s * (10.0 + s * (6.0 * s - 15.0))
    return part, 30.0 * s * s * (1.0 - s) * (1.0 - s) / SPAN


def mujoco(integrator: str) -> Callable[[float], tuple[float, np.ndarray]]:
    """A run by a step size, s: seconds a step, and the tip; PD forces are those of actuators."""
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
    tip = f'<site name="tip" pos="{_text(PLACES[6] - PLACES[5])}"/>'
    motors = "".join(
        f'<general joint="j{k}" gainprm="1" biastype="affine" biasprm="0 {-K[k]} {-C[k]}"/>'
        for k in range(len(AXES))
    )
    model = mj.MjModel.from_xml_string(
        f'<mujoco><option gravity="0 0 -9.81" integrator="{integrator}">'
        '<flag contact="disable"/></option>'
        f"<worldbody>{text}{tip}{end}</worldbody><actuator>{motors}</actuator></mujoco>"
    )

    def run(h: float) -> tuple[float, np.ndarray]:
        data, steps = mj.MjData(model), round(END / h)
        model.opt.timestep = h
        begin = time.process_time()
        for k in range(steps):
            # forces of Runge-Kutta's stages follow the motion, but not the reference within a step
            part, rate = reference((k + _LEAD[integrator]) * h)
            data.ctrl[:] = GOAL * (K * part + C * rate)
            mj.mj_step(model, data)
        spent = time.process_time() - begin
        mj.mj_forward(model, data)
        return spent / steps, data.site("tip").xpos.copy()

    return run


#: Time of the references within a step, in steps: at the middle where this is of second order.
_LEAD = {"Euler": 0.0, "implicitfast": 0.0, "RK4": 0.5}


def pinocchio() -> Callable[[float], tuple[float, np.ndarray]]:
    """The same with Pinocchio's articulated bodies and Runge and Kutta's method of fourth order."""
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

    def rates(t: float, q: np.ndarray, v: np.ndarray) -> Any:
        part, rate = reference(t)
        return pin.aba(model, data, q, v, K * (GOAL * part - q) + C * (GOAL * rate - v))

    def run(h: float) -> tuple[float, np.ndarray]:
        q, v, steps = np.zeros(6), np.zeros(6), round(END / h)
        begin = time.process_time()
        for k in range(steps):
            t = k * h
            a1 = rates(t, q, v).copy()
            a2 = rates(t + 0.5 * h, q + 0.5 * h * v, v + 0.5 * h * a1).copy()
            v2 = v + 0.5 * h * a1
            a3 = rates(t + 0.5 * h, q + 0.5 * h * v2, v + 0.5 * h * a2).copy()
            v3 = v + 0.5 * h * a2
            v4 = v + h * a3
            a4 = rates(t + h, q + h * v3, v4)
            q = q + h / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4)
            v = v + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
        spent = time.process_time() - begin
        pin.forwardKinematics(model, data, q)
        tip = data.oMi[6].act(PLACES[6] - PLACES[5])
        return spent / steps, np.asarray(tip)

    return run


def _text(x: Any) -> str:
    return " ".join(str(float(one)) for one in x)


def main() -> None:
    """Print times and errors of several step sizes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", default="4e-3,2e-3,1e-3,5e-4,2.5e-4")
    sizes = [float(one) for one in parser.parse_args().steps.split(",")]
    programs = {
        "MuJoCo Euler": lambda: mujoco("Euler"),
        "MuJoCo implicitfast": lambda: mujoco("implicitfast"),
        "MuJoCo RK4": lambda: mujoco("RK4"),
        "Pinocchio RK4": pinocchio,
    }
    for name, make in programs.items():
        run = make()
        _, exact = run(min(sizes) / 8.0)
        print(f"{name}: converged tip {exact}")
        for h in sizes:
            spent, tip = min((run(h) for _ in range(3)), key=lambda one: one[0])
            error = np.linalg.norm(tip - exact)
            print(
                f"  h {1e3 * h:6.3f} ms: {1e6 * spent:7.2f} us a step, {1e3 * spent / h:8.3f} ms a "
                f"second of motion, error {error:.2e} m"
            )


if __name__ == "__main__":
    main()
