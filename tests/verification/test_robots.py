# SPDX-License-Identifier: LGPL-3.0-or-later
"""Robots from URDF files against Pinocchio (tests/data/generate/arm.py) and closed forms."""

from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem.analyses.dynamics import RunOptions
from flexfem.simulation.motion.stepping import Simulation

DATA = Path(__file__).parents[1] / "data"
JOINTS = ("q1", "q2", "q3", "q4", "q5", "q6", "grip")
GRAVITY = ff.Gravity((0.0, 0.0, -9.81))


def table(name: str) -> np.ndarray:
    lines = [x for x in (DATA / f"{name}.csv").read_text().splitlines() if not x.startswith("#")]
    return np.array([line.split(",") for line in lines[1:]], dtype=float)


STATES = table("arm")
SPLIT = np.cumsum([7, 7, 7, 7, 7])


def arm(q: np.ndarray, v: np.ndarray) -> tuple[ff.Robot, ff.Model]:
    """The arm in a state, without its drives."""
    robot = ff.read_urdf(
        DATA / "arm.urdf",
        configuration=dict(zip(JOINTS, q.tolist(), strict=True)),
        rates=dict(zip(JOINTS, v.tolist(), strict=True)),
    )
    model = ff.Model("arm")
    model.add(GRAVITY, *robot.items, robot.probe())
    return robot, model


def joint_accelerations(robot: ff.Robot, simulation: Simulation) -> list[float]:
    """Of all joints, from those of the bodies."""
    bodies = [body for body in robot.items if isinstance(body, ff.RigidBody)]
    block = simulation.system.parts[0].block
    twists = {body.name: twist for body, twist in zip(bodies, block.acceleration, strict=True)}
    speeds = {body.name: twist for body, twist in zip(bodies, block.velocity, strict=True)}

    def of(marker: ff.Marker | ff.Ground) -> tuple[np.ndarray, ...]:
        """Position, velocity, acceleration, and angular velocity and acceleration, inertial."""
        if isinstance(marker, ff.Ground):
            return marker.position, *(np.zeros(3),) * 4
        R, r = robot.links[marker.body].rotation, marker.offset
        (V, W), (A, B) = (x[marker.body].reshape(2, 3) for x in (speeds, twists))
        speed = V + np.cross(W, r)
        acceleration = A + np.cross(B, r) + np.cross(W, speed)
        place = robot.links[marker.body].position + R @ r
        return place, R @ speed, R @ acceleration, R @ W, R @ B

    found = []
    for name in JOINTS:
        joint = robot.joints[name]
        (xa, va, aa, wa, ba), (xb, vb, ab, _, bb) = of(joint.a), of(joint.b)
        if name == "grip":
            x, v = xb - xa, vb - va
            a = ab - aa - np.cross(ba, x) - 2 * np.cross(wa, v) + np.cross(wa, np.cross(wa, x))
            found.append(float(joint.direction @ a))
        else:
            found.append(float(joint.direction @ (bb - ba)))
    return found


@pytest.mark.serial
@pytest.mark.parametrize("row", STATES[:3])
def test_accelerations_under_gravity(row):
    """Of an arm with full inertias on skew axes that moves on all joints."""
    q, v, free, *_ = np.split(row, SPLIT)
    robot, model = arm(q, v)
    simulation = Simulation(model, RunOptions(dt=1e-3, t_end=1e-2), MPI.COMM_SELF)
    # accelerations go to 50 rad/s^2 and are right to 3e-13; an inertia tensor that is rotated the
    # wrong way, or a rate in the wrong axes, is off by parts of them
    np.testing.assert_allclose(joint_accelerations(robot, simulation), free, rtol=0, atol=1e-10)


@pytest.mark.serial
@pytest.mark.parametrize("row", STATES)
def test_torques_of_inverse_dynamics(row):
    """Forces of drives at each state, which depend on every entry of the mass matrix."""
    q, v, _, a, tau, tool = np.split(row, SPLIT)
    robot, model = arm(q, v)
    outputs = [
        robot.drive(name, lambda t, i=i: q[i] + v[i] * t + 0.5 * a[i] * t * t)
        for i, name in enumerate(JOINTS)
    ]
    actuators = [robot.actuator(name) for name in JOINTS]
    # parabolas are differentiated exactly over any span; the longer, the less round-off
    found = ff.inverse_dynamics(model, outputs, actuators, [0.0], difference=0.5)
    # torques to 40 N m, right to 2e-13; the camera alone, 0.1 kg, makes 0.1
    np.testing.assert_allclose(found.forces[0], tau, rtol=0, atol=1e-10)
    # the motion of the last link: positions of order 1, to round-off
    frame = robot.frames["tool"]
    np.testing.assert_allclose(frame.position, tool[:3], atol=1e-13)
    np.testing.assert_allclose(frame.rotation.ravel(), tool[3:12], atol=1e-13)
    finger, marker = robot.links["tool"], robot.marker("tool")
    velocity = np.cross(finger.angular_velocity, finger.rotation @ marker.offset)
    np.testing.assert_allclose(finger.velocity + velocity, tool[12:15], atol=1e-12)
    np.testing.assert_allclose(finger.angular_velocity, tool[15:], atol=1e-12)


@pytest.mark.three_ranks
def test_motion_under_gravity():
    """Half of the tenth of a second in the table, on any number of ranks."""
    _, model = arm(*np.split(STATES[0], SPLIT)[:2])
    outcome = ff.simulate(model, RunOptions(dt=1e-3, t_end=0.05, tolerance=1e-9))
    assert outcome.status == "ok"
    if MPI.COMM_WORLD.rank:
        return
    expected = table("arm_motion")[:6]
    found = np.stack([outcome.history[name][::10] for name in JOINTS], axis=1)
    # at 1 ms an error of second order is left; wrong velocities would leave 1e-2
    np.testing.assert_allclose(found, expected[:, 1:], rtol=0, atol=4e-6)
