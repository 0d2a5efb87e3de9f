# SPDX-License-Identifier: LGPL-3.0-or-later
"""A car that drives a circle ever tighter: tyres by the Magic Formula with relaxation lengths.

Both axles have one tyre law (Pacejka 2012, "Tire and Vehicle Dynamics", section 4.3, without load
sensitivity): slip angles, which lag behind by a relaxation length, are the states of an
``ff.Force``. The front axle turns about a steering axis. While steering is small the car turns as
the single-track model says (yaw rate v delta / (l + K v^2 / g), K the understeer gradient); then
the front tyres reach their limit.

Run: ``python examples/steady_turn.py``, then ``flexfem view results/steady_turn``; ``--smoke`` for
a short one.
"""

import sys

import numpy as np

import flexfem as ff

MASS, YAW, FRONT, REAR = 1400.0, 2000.0, 1.2, 1.5  # kg, kg m^2, m before and behind the centre
SPEED, STEERING, TIME, G = 18.0, 0.22, 22.0, 9.81  # m/s, rad at the end, s
SHAPE, GRIP, CURVATURE = 1.4, 0.9, -0.2  # Magic Formula: C, D over the load, E
CORNERING = np.array([68e3, 80e3])  # both tyres of an axle, N/rad
LOADS = MASS * G * np.array([REAR, FRONT]) / (FRONT + REAR)  # N
RELAXATION, THRUST = 0.4, 4e3  # m, N s/m
STEER = ff.Table([0.0, 2.0, TIME], [0.0, 0.0, STEERING])
UP = (0.0, 0.0, 1.0)


def side_force(slip: np.ndarray, load: np.ndarray, cornering: np.ndarray) -> np.ndarray:
    """Magic Formula (N) of a lagged slip angle."""
    peak = GRIP * load
    x = cornering / (SHAPE * peak) * slip
    return peak * np.sin(SHAPE * np.arctan(x - CURVATURE * (x - np.arctan(x))))


def tyres(
    t: float, ends: ff.Ends, z: np.ndarray, axles: np.ndarray
) -> tuple[np.ndarray, None, np.ndarray]:
    """Forces on the axles along and across their wheels, and rates of the lagged slips."""
    ahead, left = ends.rotations[:, :, 0], ends.rotations[:, :, 1]
    along, across = ((ends.velocities * e).sum(axis=1) for e in (ahead, left))
    load, cornering, driven = axles.T
    push = driven * THRUST * (SPEED - along)
    side = -side_force(z[:, 0], load, cornering)
    rates = (across - np.abs(along) * np.tan(z[:, 0])) / RELAXATION
    return push[:, None] * ahead + side[:, None] * left, None, rates[:, None]


def build() -> ff.Model:
    """The car on a plane."""
    wheel = ff.Cylinder(0.33, 0.2, (0.0, 1.0, 0.0))

    def pair() -> list[tuple[ff.Cylinder, ff.Pose]]:
        return [(wheel, ff.Pose((0.0, y, 0.0), np.eye(3))) for y in (-0.75, 0.75)]

    body = [(ff.Box((4.3, 1.3, 0.5)), ff.Pose((-0.1, 0.0, 0.3), np.eye(3))),
            (ff.Box((2.0, 1.2, 0.5)), ff.Pose((-0.4, 0.0, 0.8), np.eye(3)))]  # fmt: skip
    rear = [(shape, ff.Pose((-REAR, *place.position[1:]), np.eye(3))) for shape, place in pair()]
    front = ff.Marker("car", offset=(FRONT, 0.0, 0.0))
    model = ff.Model("steady_turn")
    model.add(
        ff.RigidBody("car", MASS - 1.0, (500.0, YAW, YAW), velocity=(SPEED, 0.0, 0.0),
                     shape=ff.CompoundShape([*body, *rear])),
        ff.RigidBody("front axle", 1.0, (0.01,) * 3, position=(FRONT, 0.0, 0.0),
                     velocity=(SPEED, 0.0, 0.0), shape=ff.CompoundShape(pair())),
        ff.Planar("road", ff.Ground(), ff.Marker("car"), axis=UP),
        ff.Revolute("pivot", front, ff.Marker("front axle"), axis=UP),
        ff.PrescribedAngle("steering", front, ff.Marker("front axle"), axis=UP, angle=STEER),
        ff.Force("tyres", [ff.Marker("front axle"), ff.Marker("car", offset=(-REAR, 0.0, 0.0))],
                 tyres, each=1, states=1, parameters=np.column_stack([LOADS, CORNERING, [0, 1]])),
        ff.PositionProbe("at", ff.Marker("car")),
        ff.Probe("motion", ff.Marker("car"), ("yaw_rate", "speed"), lambda t, c: (
            c.angular_velocity[2], np.linalg.norm(c.velocity),
        )),
    )  # fmt: skip
    return model


def main(*, smoke: bool) -> None:
    """Drive, and compare with the single-track model."""
    options = ff.RunOptions(dt=0.01, t_end=3.2 if smoke else TIME, quiet=True, every=10,
                            output=None if smoke else "results/steady_turn")  # fmt: skip
    history = ff.simulate(build(), options, case="steady_turn").history
    gradient = LOADS[0] / CORNERING[0] - LOADS[1] / CORNERING[1]  # rad at 1 g
    early = np.searchsorted(history["t"], 3.0)
    # by then the car follows the wheel, which turns on, and tyres are linear
    per_angle = SPEED / (FRONT + REAR + gradient * SPEED**2 / G)
    rate = np.gradient(history["yaw_rate"], history["t"])[early] / (STEERING / (TIME - 2.0))
    print(f"yaw rate over steering {rate:.3f} /s, single-track model {per_angle:.3f} /s")
    assert abs(rate / per_angle - 1.0) < 0.01  # without understeer it is 40 % larger
    if not smoke:
        side = history["speed"][-1] * history["yaw_rate"][-1]
        print(f"in the end it corners with {side:.2f} m/s^2, the tyres allow {GRIP * G:.2f}")


if __name__ == "__main__":
    main(smoke="--smoke" in sys.argv)
