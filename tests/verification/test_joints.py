# SPDX-License-Identifier: LGPL-3.0-or-later
"""Joints, stops and friction in motion, against closed forms."""

from collections.abc import Callable

from mpi4py import MPI

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import flexfem as ff
from flexfem.analyses.dynamics import RunOptions
from flexfem.core.status import Status
from flexfem.lie import se3, so3
from flexfem.simulation.motion.stepping import Simulation

COMM = MPI.COMM_WORLD
POLICIES = ("auto", "updated", "frozen")
X, Y, Z = np.eye(3)


def body(name: str, position: np.ndarray, **arguments: object) -> ff.RigidBody:
    return ff.RigidBody(name, 2.0, (0.2, 0.3, 0.4), position=position, **arguments)


class Run:
    """A model in motion, observed on all ranks."""

    def __init__(self, *things: object, dt: float = 1e-3, **options: object) -> None:
        model = ff.Model("test")
        model.add(*things)
        settings = {"rho_inf": 1.0, "tolerance": 1e-10} | options
        self.simulation = Simulation(model, RunOptions(dt=dt, t_end=1e3, **settings))
        self.dt, self.system = dt, self.simulation.system
        assert self.simulation.status is Status.OK

    def go(self, time: float, watch: Callable[[], object] | None = None) -> list[object]:
        seen = []
        for _ in range(round(time / self.dt)):
            assert self.simulation.advance(self.dt) is Status.OK
            if watch is not None:
                seen.append(watch())
        return seen

    def states(self) -> tuple[np.ndarray, np.ndarray]:
        """Frames and inertial velocities of all rigid bodies, in the model's order."""
        block = next(p.block for p in self.system.parts if p.block.name == "rigid_bodies")
        turned = se3.rotation(block.frames[: block.owned])
        v = block.velocity[: block.owned].reshape(-1, 2, 3)
        rows = np.concatenate(
            [block.frames[: block.owned], np.einsum("nij,nkj->nki", turned, v).reshape(-1, 6)], 1
        )
        ids = block.node_ids[: block.owned]
        parts = self.system.comm.allgather((ids, rows))
        order = np.argsort(np.concatenate([p[0] for p in parts]))
        table = np.concatenate([p[1] for p in parts])[order]
        return table[:, :12], table[:, 12:]

    def wrench(self, joint: str, marker: int) -> np.ndarray:
        """Force and moment that a joint exerts at one of its markers, on all ranks."""
        rows, found = self.system.constraints, None
        for i, placed in enumerate(rows.joints):
            if placed.owned and placed.joint.name == joint:
                forces = rows.forces + rows.impulses
                found = rows.reactions(forces)[rows.marker_start[i] + marker]
        return next(w for w in self.system.comm.allgather(found) if w is not None)


def _shafts(joint: type, bend: float, **arguments: object) -> Run:
    """Two shafts at an angle on different bodies; the first one is driven at 3 rad/s."""
    second = np.array([np.cos(bend), np.sin(bend), 0.0])
    turn = so3.exp(np.array([0.0, 0.0, bend]))
    return Run(
        body("one", -X), body("two", second, rotation=turn),
        ff.Revolute("first", ff.Ground(-X), ff.Marker("one"), axis=X),
        ff.PointOnLine("second", ff.Ground(second), ff.Marker("two"), axis=second),
        joint("joint", ff.Marker("one", offset=X), ff.Marker("two", offset=-X), **arguments),
        ff.PrescribedAngle(
            "motor", ff.Ground(-X), ff.Marker("one"), axis=X, angle=lambda t: 3.0 * t
        ),
        dt=4e-3,
    )  # fmt: skip


def _speeds(run: Run, bend: float) -> tuple[float, float, float]:
    """Time and the speeds of both shafts about their axes."""
    _, v = run.states()
    second = np.array([np.cos(bend), np.sin(bend), 0.0])
    return run.system.time, v[0, 3:] @ X, v[1, 3:] @ second


@pytest.mark.serial
def test_universal_joint_speed_ratio():
    """w2/w1 = cos b/(1 - sin^2 b cos^2 a), a from the plane of the shafts."""
    bend = 0.6
    arm = np.array([-np.sin(bend), np.cos(bend), 0.0])
    run = _shafts(ff.Universal, bend, axis=Z, second_axis=arm)
    t, w1, w2 = np.array(run.go(2.2, lambda: _speeds(run, bend))).T
    a = 0.5 * np.pi + 3.0 * t
    expected = 3.0 * np.cos(bend) / (1.0 - np.sin(bend) ** 2 * np.cos(a) ** 2)
    # the speed varies between 2.5 and 3.6; the scheme's error is 1e-4
    np.testing.assert_allclose(w1, 3.0, atol=1e-6)
    np.testing.assert_allclose(w2, expected, atol=1e-3)


@pytest.mark.parametrize("bend", [0.0, 0.6])
def test_constant_velocity_joint_turns_both_shafts_alike(bend):
    second = (np.cos(bend), np.sin(bend), 0.0)
    run = _shafts(ff.ConstantVelocity, bend, axis=X, second_axis=second)
    _, w1, w2 = np.array(run.go(1.0, lambda: _speeds(run, bend))).T
    # a universal joint would be off by 0.5 when bent; what is left is the scheme's error
    np.testing.assert_allclose(w2, w1, atol=1e-5)


@pytest.mark.serial  # one body: nothing to share between ranks
def test_screw_advances_by_its_pitch():
    """Velocities at the start go to the motion of least distance in kinetic energy."""
    pitch, spin = 0.3, 20.0
    run = Run(
        body("nut", np.zeros(3), angular_velocity=(0.0, 0.0, spin)),
        ff.Screw("screw", ff.Ground(), ff.Marker("nut"), axis=Z, pitch=pitch),
    )
    lead = pitch / (2.0 * np.pi)
    expected = 0.4 * spin / (0.4 + 2.0 * lead**2)
    run.go(1.0)
    x, v = run.states()
    # a pitch per radian instead of per turn would be off by a factor of 6
    np.testing.assert_allclose(v[0], [0, 0, lead * expected, 0, 0, expected], atol=1e-8)
    assert x[0, 2] == pytest.approx(lead * expected, abs=1e-8)
    # more than three turns: the wheel stands at the angle of the advance
    angle = np.arctan2(x[0, 6], x[0, 3])
    assert np.exp(1j * angle) == pytest.approx(np.exp(1j * expected), abs=1e-8)


@pytest.mark.three_ranks
def test_gear_keeps_its_ratio():
    """Two wheels about different axes: momentum is shared by the ratio, over several turns."""
    ratio, spin = -2.5, 4.0
    run = Run(
        body("one", np.zeros(3), angular_velocity=(0.0, 0.0, spin)), body("two", 3.0 * X),
        ff.Revolute("pin", ff.Ground(), ff.Marker("one"), axis=Z),
        ff.Revolute("pivot", ff.Ground(3.0 * X), ff.Marker("two"), axis=Y),
        ff.Gear("gear", ff.Ground(), ff.Marker("one"), ff.Ground(3.0 * X), ff.Marker("two"),
                axis=Z, second_axis=Y, ratio=ratio), dt=1e-2,
    )  # fmt: skip
    expected = 0.4 * spin / (0.4 + 0.3 * ratio**2)
    run.go(3.0)
    x, v = run.states()
    # the inverse ratio would leave w2 = -1.4 instead of -1.8
    np.testing.assert_allclose(v[:, 3:], [[0, 0, expected], [0, ratio * expected, 0]], atol=1e-8)
    angles = np.arctan2(x[0, 6], x[0, 3]), np.arctan2(-x[1, 9], x[1, 3])
    assert np.exp(1j * angles[1]) == pytest.approx(np.exp(1j * ratio * angles[0]), abs=1e-8)


@pytest.mark.three_ranks
@pytest.mark.parametrize("ratio", [1.0, 2.0])
def test_pulley_shares_the_tension_by_its_ratio(ratio):
    """Two equal weights, the second on so many parts of the rope (Atwood's machine)."""
    g, mass = 9.81, 2.0
    run = Run(
        body("one", -Z), body("two", X - 2.0 * Z),
        ff.Pulley("rope", ff.Ground(), ff.Marker("one"), ff.Ground(X), ff.Marker("two"),
                  ratio=ratio),
        ff.Gravity((0.0, 0.0, -g)), dt=1e-2,
    )  # fmt: skip
    rise = g * (ratio - 1.0) / (1.0 + ratio**2)
    run.go(0.3)
    x, v = run.states()
    # the inverse ratio would pull the second one down
    expected = [[0, 0, -ratio * rise * 0.3], [0, 0, rise * 0.3]]
    np.testing.assert_allclose(v[:, :3], expected, atol=1e-8)
    assert abs(x[0, 2]) + ratio * abs(x[1, 2]) == pytest.approx(1.0 + 2.0 * ratio, abs=1e-9)
    tension = mass * (g - ratio * rise)
    for marker, force in ((1, tension), (3, ratio * tension), (0, -tension)):
        assert run.wrench("rope", marker)[2] == pytest.approx(force, abs=1e-7)


def _block(slope: float, speed: float, options: dict, **arguments: object) -> Run:
    """A block on a plane inclined by ``slope`` that it rubs on, moving uphill."""
    up = np.array([np.cos(slope), 0.0, np.sin(slope)])
    slider = ff.Prismatic("slider", ff.Ground(), ff.Marker("block"), axis=up)
    return Run(
        body("block", np.zeros(3), velocity=speed * up), slider,
        ff.JointFriction("friction", slider, **arguments),
        ff.Gravity((0.0, 0.0, -9.81)), **options,
    )  # fmt: skip


@pytest.mark.serial  # one body: nothing to share between ranks
@pytest.mark.parametrize("law", [{"coefficient": 0.3}, {"force": 0.3 * 2.0 * 9.81}])
def test_sliding_block_stops(law):
    """After v/(mu g) seconds and v^2/(2 mu g) metres, and stays."""
    speed, rate = 1.0, 0.3 * 9.81
    run = _block(0.0, speed, {}, velocity=1e-5, **law)
    before = run.go(0.3, lambda: run.states()[1][0, 0])
    np.testing.assert_allclose(before, speed - rate * 1e-3 * np.arange(1, 301), atol=1e-9)
    run.go(0.2)
    x, v = run.states()
    # one step of wrong friction changes it by 1e-6; friction that stays on pushes back
    assert x[0, 0] == pytest.approx(speed**2 / (2.0 * rate), abs=3e-6)
    assert abs(v[0, 0]) < 2e-3
    counters = run.system.counters
    assert run.simulation.rejected == 0
    # stick and slip are found in few iterations: plain Newton cycles until it gives up
    assert counters.newton_iterations < 3.0 * run.simulation.steps


@pytest.mark.serial  # one body: nothing to share between ranks
@pytest.mark.parametrize("policy", POLICIES)
def test_block_sticks_on_an_incline(policy):
    """Below the friction angle it creeps at v_0 atanh(tan(slope)/mu), above it slides."""
    slope, mu, creep = 0.35, 0.5, 1e-4
    options = {"iteration_matrix": policy, "rho_inf": 0.0}
    run = _block(slope, 0.0, options, coefficient=mu, velocity=creep)
    run.go(0.1)
    expected = -creep * np.arctanh(np.tan(slope) / mu)
    # without friction it would be at -0.34 m/s; with a static N of the flat plane at 0.85 of this
    assert run.states()[1][0] @ [np.cos(slope), 0, np.sin(slope), 0, 0, 0] == pytest.approx(
        expected, rel=1e-4
    )
    wrench = run.wrench("slider", 1)
    normal = 2.0 * 9.81 * np.cos(slope)
    np.testing.assert_allclose(
        wrench[:3], normal * np.array([-np.sin(slope), 0.0, np.cos(slope)]), atol=1e-6
    )


def test_friction_between_two_bodies_brings_them_to_one_speed():
    """Constant force on two bodies: after v m/(2 F) seconds both move at half the speed."""
    slider = ff.Prismatic("slider", ff.Marker("one"), ff.Marker("two"), axis=X)
    run = Run(
        body("one", np.zeros(3), velocity=X), body("two", X), slider,
        ff.JointFriction("friction", slider, force=5.0, velocity=1e-5), rho_inf=0.5,
    )  # fmt: skip
    run.go(0.1)
    # the reaction on the other body missing would leave it at rest
    np.testing.assert_allclose(run.states()[1][:, 0], [1.0 - 0.25, 0.25], atol=1e-8)
    run.go(0.2)
    np.testing.assert_allclose(run.states()[1][:, 0], [0.5, 0.5], atol=1e-4)


@pytest.mark.serial  # one body: nothing to share between ranks
@pytest.mark.parametrize("damping", [0.0, 15.0])
@pytest.mark.parametrize("motion", ["translation", "distance"])
def test_limit_stop_returns_what_it_takes(damping, motion):
    """Without damping the speed is turned round; with damping it loses, and never pulls."""
    line = {"axis": X} if motion == "translation" else {}
    run = Run(
        body("block", X, velocity=-X),
        ff.Prismatic("guide", ff.Ground(), ff.Marker("block"), axis=X),
        ff.LimitStop("stop", ff.Ground(), ff.Marker("block"), motion=motion, lower=0.9,
                     stiffness=2e4, damping=damping, **line), dt=2e-4,
    )  # fmt: skip
    force = run.go(0.2, lambda: run.wrench("stop", 1)[0])
    speed = run.states()[1][0, 0]
    assert min(force) > -1e-9
    assert max(force) > 100.0  # sqrt(k m) v = 200 undamped: the stop was met
    if damping == 0.0:
        # the scheme loses less than 1e-3 at the edges of the contact; a stop that pulls, all
        assert speed == pytest.approx(1.0, abs=2e-3)
    else:
        # ratio of damping 0.0375: exp(-pi zeta) = 0.889 for a spring and damper that may pull
        assert speed == pytest.approx(0.889, abs=0.03)


@pytest.mark.serial  # one body: nothing to share between ranks
def test_limit_stop_of_a_rotation():
    run = Run(
        body("arm", np.zeros(3), angular_velocity=(0.0, 0.0, 2.0)),
        ff.Revolute("hinge", ff.Ground(), ff.Marker("arm"), axis=Z),
        ff.LimitStop("stop", ff.Ground(), ff.Marker("arm"), motion="rotation", axis=Z, upper=0.3,
                     stiffness=4e3), dt=2e-4,
    )  # fmt: skip
    run.go(0.25)
    assert run.states()[1][0, 5] == pytest.approx(-2.0, abs=5e-3)


@pytest.mark.serial  # one body: nothing to share between ranks
@pytest.mark.parametrize("full", [True, False])
def test_bushing_deflects_by_its_flexibility(full):
    """A body hung in a bushing comes to rest where K q is its weight."""
    root = np.diag([60.0, 50.0, 70.0, 20.0, 25.0, 15.0])
    if full:
        root = root + 0.2 * np.random.default_rng(5).normal(size=(6, 6)) * 30.0
    K = root @ root.T
    K, C = (K, 0.03 * K) if full else (np.diag(K), 0.03 * np.diag(K))
    run = Run(
        body("hung", (0.3, 0.2, 0.1)), ff.Gravity((1.0, -2.0, -9.81)),
        ff.Bushing("bushing", ff.Ground((0.3, 0.2, 0.1)), ff.Marker("hung"), K, C),
        dt=1e-2, rho_inf=0.0,
    )  # fmt: skip
    run.go(3.0)
    x, _ = run.states()
    weight = 2.0 * np.array([1.0, -2.0, -9.81, 0.0, 0.0, 0.0])
    small = np.concatenate([x[0, :3] - [0.3, 0.2, 0.1], so3.log(x[0, 3:].reshape(3, 3))])
    expected = np.linalg.solve(K if full else np.diag(K), weight)
    # deflections are 1e-2, products of small angles 1e-5; a transposed or missing coupling is 1e-3
    np.testing.assert_allclose(small, expected, atol=1e-4)
    np.testing.assert_allclose(run.wrench("bushing", 1)[:3], -weight[:3], atol=1e-6)


@pytest.mark.serial  # one body: nothing to share between ranks
def test_distance_pendulum():
    """From the horizontal to the bottom in K(1/2) sqrt(L/g), where the rod pulls with 3 m g."""
    length, g = 0.8, 9.81
    quarter = 1.8540746773013719 * np.sqrt(length / g)
    run = Run(
        body("bob", length * X), ff.Gravity((0.0, 0.0, -g)),
        ff.Distance("rod", ff.Ground(), ff.Marker("bob")), dt=quarter / 500,
    )  # fmt: skip
    run.go(quarter)
    x, v = run.states()
    # a wrong length or inertia moves the arrival by 1e-2; the scheme's error is 1e-6
    np.testing.assert_allclose(x[0, :3], [0.0, 0.0, -length], atol=1e-4)
    np.testing.assert_allclose(v[0, :3], [-np.sqrt(2.0 * g * length), 0.0, 0.0], atol=1e-4)
    np.testing.assert_allclose(run.wrench("rod", 1), [0, 0, 3 * 2.0 * g, 0, 0, 0], atol=1e-2)
    np.testing.assert_allclose(run.wrench("rod", 0), -run.wrench("rod", 1), atol=1e-10)


@pytest.mark.serial  # one body: nothing to share between ranks
@pytest.mark.parametrize("policy", POLICIES)
def test_lock_holds_until_it_is_released(policy):
    slider = ff.Prismatic("slider", ff.Ground(), ff.Marker("block"), axis=Z)
    run = Run(
        body("block", np.zeros(3)), slider, ff.Lock("brake", slider, locked=True),
        ff.Gravity((0.0, 0.0, -9.81)), iteration_matrix=policy,
    )  # fmt: skip
    rows = run.system.constraints
    run.go(0.01)
    np.testing.assert_allclose(run.states()[0][0, :3], 0.0, atol=1e-12)
    assert run.wrench("brake", 1)[2] == pytest.approx(2.0 * 9.81)
    rows.release("brake")
    run.go(0.1)
    fall = run.states()[0][0, 2]
    # the first step still has the old acceleration variable: less than a step's fall
    assert fall == pytest.approx(-0.5 * 9.81 * 0.1**2, abs=2e-3)
    rows.lock("brake")
    (held,) = {float(t) for t in rows.targets[rows.switchable]} or {fall}
    assert held == pytest.approx(fall, abs=1e-14)
    with pytest.raises(
        ValueError, match='joint "slider": no such joint can be locked and released'
    ):
        rows.lock("slider")


def test_rigid_nodes_move_as_one_body():
    """Two bodies on a third: the free motion of all keeps the place of each."""
    hub = body("hub", np.zeros(3), angular_velocity=(0.3, 0.5, 2.0))
    places = np.array([[1.0, 0.5, 0.0], [-0.5, 0.2, 0.7]])
    run = Run(
        hub, body("left", places[0]), body("right", places[1]),
        ff.RigidNodes("arms", ff.Marker("hub"), nodes=[ff.Marker("left"), ff.Marker("right")]),
    )  # fmt: skip
    run.go(0.5)
    x, _ = run.states()
    arms = (x[1:, :3] - x[0, :3]) @ x[0, 3:].reshape(3, 3)
    # what is not held is off by the motion, 0.1 and more
    np.testing.assert_allclose(arms, places, atol=1e-9)
    np.testing.assert_allclose(x[1:, 3:], np.broadcast_to(x[0, 3:], (2, 9)), atol=1e-9)


@pytest.mark.serial  # one body: nothing to share between ranks
def test_generic_joint_stops_at_its_limits():
    """Free along x within limits: it bounces between both, and holds all else."""
    run = Run(
        body("block", np.zeros(3), velocity=X),
        ff.Generic("guide", ff.Ground(), ff.Marker("block"), free=("x",),
                   limits={"x": (-0.05, 0.05, 2e4, 0.0)}), dt=2e-4,
    )  # fmt: skip
    seen = np.array(run.go(0.4, lambda: run.states()[0][0, :3]))
    # the depth of contact is v sqrt(m/k) = 0.01
    assert 0.058 < seen[:, 0].max() < 0.061
    assert -0.061 < seen[:, 0].min() < -0.058
    np.testing.assert_allclose(seen[:, 1:], 0.0, atol=1e-12)


@pytest.mark.slow_on_ranks
def test_link_with_hinge_and_ball():
    """A bob on an inclined link: a plane pendulum, whatever turns and pulls across the plane."""
    axis, down = np.array([0.0, 0.6, 0.8]), np.array([0.0, -0.8, 0.6])
    side, length, mass = np.array([1.0, 0.0, 0.0]), 0.7, 2.0
    # the ball is in the middle of the bob, whose spin is its own affair
    model = ff.Model("link")
    bob = ff.RigidBody("bob", mass, (0.1, 0.2, 0.3), position=length * side,
                       angular_velocity=(1.0, 2.0, 3.0))  # fmt: skip
    model.add(
        ff.Gravity(10.0 * down + 4.0 * axis), bob,
        ff.RevoluteSpherical("link", ff.Ground(), ff.Marker("bob"), axis=axis),
        ff.PositionProbe("bob_at", ff.Marker("bob")),
        ff.ReactionProbe("held", "link"),
    )  # fmt: skip
    outcome = ff.simulate(model, ff.RunOptions(dt=1e-3, t_end=0.8, rho_inf=0.8, quiet=True))
    assert outcome.status == "ok"
    if COMM.rank:
        return
    h = outcome.history
    x = np.stack([h[f"bob_at_{i}"] for i in "xyz"], axis=1)
    force = np.stack([h[f"held_f{i}"] for i in "xyz"], axis=1)
    pendulum = solve_ivp(
        lambda t, y: [y[1], -10.0 / length * np.sin(y[0])], (0.0, 0.8), [np.pi / 2.0, 0.0],
        rtol=1e-10, atol=1e-12, t_eval=[0.8],
    )  # fmt: skip
    angle = pendulum.y[0, -1]
    expected = length * (np.sin(angle) * side + np.cos(angle) * down)
    # second order of the step, 1.5e-5 here; a ball in place of the hinge leaves the plane at once
    np.testing.assert_allclose(x[-1], expected, atol=3e-5)
    # round-off of the constraints
    assert np.abs(x @ axis).max() < 1e-11
    assert np.abs(np.linalg.norm(x, axis=1) - length).max() < 1e-11
    # the hinge alone bears what pulls along its axis; the first steps ring
    np.testing.assert_allclose(force[100:] @ axis, -4.0 * mass, atol=2e-3)
