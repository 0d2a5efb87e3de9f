# SPDX-License-Identifier: LGPL-3.0-or-later
"""A four-legged robot that trots: motors with feedback, and feet on the ground.

The motors' gains act implicitly, so that light shanks need no small steps. The ground is one force
for all feet: it presses on a foot as a spring and damper, and rubs by regularised Coulomb friction.

Run: ``python examples/quadruped.py``, then ``flexfem view results/quadruped``; ``--smoke`` for a
few steps.
"""

import sys

import numpy as np

import flexfem as ff

THIGH, SHANK, HEIGHT = 0.22, 0.22, 0.36  # m
CORNERS = {"fl": (0.2, 0.12), "fr": (0.2, -0.12), "hl": (-0.2, 0.12), "hr": (-0.2, -0.12)}
PROPORTIONAL, DERIVATIVE = 120.0, 3.0  # N m/rad, N m s/rad
PERIOD, LIFT, STRIDE = 0.4, 0.06, 0.09  # s, m, m
GROUND, DAMPING, FRICTION, CREEP = 2e4, 150.0, 0.8, 0.02  # N/m, N s/m, 1, m/s
AXIS = (0.0, 1.0, 0.0)
START = ff.SmoothStep(0.5, 1.0)


def leg_angles(x: float, z: float) -> tuple[float, float]:
    """Angles of thigh and knee that put the foot at (x, -z) below the hip, the knee behind."""
    reach = np.hypot(x, z)
    bend = np.arccos(np.clip((THIGH**2 + SHANK**2 - reach**2) / (2.0 * THIGH * SHANK), -1.0, 1.0))
    inner = np.arcsin(np.clip(SHANK * np.sin(bend) / reach, -1.0, 1.0))
    return inner - np.arctan2(x, z), bend - np.pi


def gait(t: float, k: int) -> tuple[float, float]:
    """Angles of leg k at a time: diagonal legs step together, after half a second of standing."""
    grown = START(t)
    phase = 2.0 * np.pi * t / PERIOD + (0.0 if k in (0, 3) else np.pi)
    return leg_angles(
        -0.5 * grown * STRIDE * np.cos(phase),
        HEIGHT - grown * LIFT * max(np.sin(phase), 0.0) ** 2,
    )


def ground(t: float, ends: ff.Ends, z: np.ndarray) -> np.ndarray:
    """Normal force and friction on every foot."""
    depth = np.maximum(-ends.positions[:, 2], 0.0)
    v = ends.velocities
    rate = np.tanh(DAMPING * -v[:, 2] / np.maximum(GROUND * depth, 1.0))
    normal = GROUND * depth * (1.0 + rate)
    slip = v[:, :2]
    speed = np.sqrt((slip**2).sum(axis=1) + CREEP**2)
    return np.concatenate([-FRICTION * (normal / speed)[:, None] * slip, normal[:, None]], axis=1)


def angle(t: float, a: ff.MarkerState, b: ff.MarkerState) -> list[float]:
    """Angle of b against a about y, and its rate."""
    R = a.turn.T @ b.turn
    return [float(np.arctan2(R[0, 2], R[0, 0])),
            float((b.angular_velocity - a.angular_velocity) @ a.turn[:, 1])]  # fmt: skip


def build() -> ff.Model:
    """The robot standing on the ground."""
    model = ff.Model("quadruped")
    hip_angle, knee_angle = leg_angles(0.0, HEIGHT)
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.RigidBody("trunk", 8.0, (0.05, 0.16, 0.18), position=(0.0, 0.0, HEIGHT)),
    )
    feet, columns, motors = [], [], []
    for name, (x, y) in CORNERS.items():
        hip, turns = np.array([x, y, HEIGHT]), [hip_angle, hip_angle + knee_angle]
        down = [np.array([-np.sin(q), 0.0, -np.cos(q)]) for q in turns]
        knee = hip + THIGH * down[0]
        R = [np.column_stack([np.cross(AXIS, -d), AXIS, -d]) for d in down]
        model.add(
            ff.RigidBody(f"thigh_{name}", 0.6, (3e-3, 3e-3, 3e-4),
                         position=hip + 0.5 * THIGH * down[0], rotation=R[0]),
            ff.RigidBody(f"shank_{name}", 0.15, (7e-4, 7e-4, 5e-5),
                         position=knee + 0.5 * SHANK * down[1], rotation=R[1]),
        )  # fmt: skip
        up, low = (0.0, 0.0, 0.5 * THIGH), (0.0, 0.0, -0.5 * THIGH)
        joints = {
            "hip": (ff.Marker("trunk", offset=(x, y, 0.0)), ff.Marker(f"thigh_{name}", offset=up)),
            "knee": (ff.Marker(f"thigh_{name}", offset=low), ff.Marker(f"shank_{name}", offset=up)),
        }
        for kind, (a, b) in joints.items():
            joint = f"{kind}_{name}"
            model.add(
                ff.Revolute(joint, a, b, axis=AXIS),
                ff.Actuator(f"motor_{joint}", a, b, axis=AXIS),
                ff.Probe(f"angle_{joint}", [a, b], (joint, f"{joint}_rate"), angle),
            )
            columns += [joint, f"{joint}_rate"]
            motors.append(f"motor_{joint}")
        feet.append(ff.Marker(f"shank_{name}", offset=(0.0, 0.0, -0.5 * SHANK)))

    def hold(t: float, y: np.ndarray) -> np.ndarray:
        wanted = np.array([gait(t, k) for k in range(4)])
        wanted = wanted - (hip_angle, knee_angle)
        return PROPORTIONAL * (wanted.ravel() - y[::2]) - DERIVATIVE * y[1::2]

    model.add(
        ff.Controller("gait", columns, motors, hold),
        ff.Force("ground", feet, ground, each=1),
        ff.PositionProbe("trunk_at", ff.Marker("trunk")),
    )
    return model


def sag() -> float:
    """How far (m) the standing trunk sinks: by the ground, and by the knees' motors."""
    foot = (8.0 + 4.0 * (0.6 + 0.15)) * 9.81 / 4.0
    lever = THIGH * np.sin(leg_angles(0.0, HEIGHT)[0])
    return float(foot / GROUND + (foot - 0.5 * 0.15 * 9.81) * lever**2 / PROPORTIONAL)


def main(*, smoke: bool) -> None:
    """Let it trot."""
    options = ff.RunOptions(dt=2e-3, t_end=0.02 if smoke else 4.0, quiet=True, every=10,
                            output=None if smoke else "results/quadruped")  # fmt: skip
    history = ff.simulate(build(), options, case="quadruped").history
    way, standing = history["trunk_at_x"][-1], np.searchsorted(history["t"], 0.5)
    print(f"it has walked {way:.2f} m in {history['t'][-1]:.0f} s, its trunk between "
          f"{history['trunk_at_z'].min():.3f} and {history['trunk_at_z'].max():.3f} m")  # fmt: skip
    if not smoke:
        found = HEIGHT - history["trunk_at_z"][standing]
        print(f"before it has sunk by {1e3 * found:.2f} mm, in closed form {1e3 * sag():.2f} mm")
        assert abs(found / sag() - 1.0) < 0.03  # the ground alone is a quarter of it


if __name__ == "__main__":
    main(smoke="--smoke" in sys.argv)
