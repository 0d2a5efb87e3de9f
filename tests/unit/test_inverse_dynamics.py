# SPDX-License-Identifier: LGPL-3.0-or-later
"""Forces of actuators along prescribed motions, against closed forms."""

import math
from typing import Any

import numpy as np
import pytest

import flexfem as ff
from flexfem.cli import load_case
from flexfem.kinematics.differences import stencil
from flexfem.lie import so3

Z = (0.0, 0.0, 1.0)
G = 9.81


def spiral(t: np.ndarray, duration: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position, velocity and acceleration (complex) of the manipulator's path at given times."""
    tau = t / duration
    s = 10 * tau**3 - 15 * tau**4 + 6 * tau**5
    ds = (30 * tau**2 - 60 * tau**3 + 30 * tau**4) / duration
    dds = (60 * tau - 180 * tau**2 + 120 * tau**3) / duration**2
    way = 0.03892 * np.exp(1j * (math.radians(111.75) + 2 * np.pi * (s - 1)))
    first, second = way * (1 + 2j * np.pi * s), way * 2j * np.pi * (2 + 2j * np.pi * s)
    return way * s, first * ds, second * ds**2 + first * dds


class PlanarManipulator:
    """3-RRR by geometry: two links of equal length in each chain, uniform rods."""

    def __init__(self, t: np.ndarray, duration: float, height: float) -> None:
        self.length, mass = 0.244, 2700.0 * 40e-6 * 0.244
        inertia = mass * (self.length**2 + height**2) / 12.0
        P, v, a = spiral(t, duration)
        n = len(t)
        self.J, self.F = np.zeros((n, 3, 2)), np.zeros((n, 2))
        self.rates = np.zeros((n, 3))
        self.least_joint_forces = np.zeros((n, 3))
        chains: list[tuple[np.ndarray, ...]] = []
        for chain in range(3):
            corner = 0.5 / math.sqrt(3.0) * np.exp(1j * math.radians(90.0 + 120.0 * chain))
            d = P - corner
            first = np.exp(1j * (np.angle(d) + np.arccos(0.5 * np.abs(d) / self.length)))
            second = (d - self.length * first) / self.length
            # rates of both links by the velocity of P, along X and Y and along the path
            by_x, by_y = (self._rates(first, second, np.full(n, u)) for u in (1.0, 1j))
            w = self._rates(first, second, v)
            turning = -self.length * (w[0] ** 2 * first + w[1] ** 2 * second)
            e = self._rates(first, second, a - turning)
            self.J[:, chain] = np.stack([by_x[0], by_y[0]], axis=-1)
            self.rates[:, chain] = w[0]
            half = 0.5 * self.length
            for i, (on_first, on_second) in enumerate([(half, 0.0), (self.length, half)]):
                centre = on_first * (1j * e[0] - w[0] ** 2) * first
                centre = centre + on_second * (1j * e[1] - w[1] ** 2) * second
                if i == 1:
                    chains.append((first, second, mass * centre, inertia * e[0], inertia * e[1],
                                   mass * half * (1j * e[0] - w[0] ** 2) * first))  # fmt: skip
                for k, by in enumerate((by_x, by_y)):
                    move = on_first * 1j * by[0] * first + on_second * 1j * by[1] * second
                    self.F[:, k] += mass * (np.conj(move) * centre).real + inertia * by[i] * e[i]

        for at in range(n):
            self.least_joint_forces[at] = self._newton_euler([[x[at] for x in c] for c in chains])

    def _newton_euler(self, chains: list[list[complex]]) -> np.ndarray:
        """Torques with the least forces at the followers' ends, link by link.

        The forces (f_B, f_P) on the three followers are the solution of least norm of the motion of
        these and of the balance of P; the driven links give the torques.
        """
        A, b = np.zeros((11, 12)), np.zeros(11)
        for i, (_, second, force, _, moment, _) in enumerate(chains):
            A[3 * i, [4 * i, 4 * i + 2]] = A[3 * i + 1, [4 * i + 1, 4 * i + 3]] = 1.0
            arm = 0.5 * self.length * np.array([-second.imag, second.real])
            A[3 * i + 2, 4 * i : 4 * i + 4] = [*-arm, *arm]
            b[3 * i : 3 * i + 3] = force.real, force.imag, moment.real
            A[9, 4 * i + 2] = A[10, 4 * i + 3] = 1.0
        f = np.linalg.lstsq(A, b, rcond=None)[0].reshape(3, 4)
        torques = []
        for (first, _, _, moment, _, force), (x, y, _, _) in zip(chains, f, strict=True):
            # about the corner: own inertia, and the follower's reaction at the elbow
            inner = 0.5 * self.length * (np.conj(first) * force).imag
            elbow = self.length * (np.conj(first) * complex(x, y)).imag
            torques.append(moment.real + inner + elbow)
        return np.array(torques)

    def _rates(self, first, second, velocity):
        """Angular velocities of both links that give P a velocity."""
        p, q = 1j * self.length * first, 1j * self.length * second
        det = p.real * q.imag - p.imag * q.real
        return (
            (velocity.real * q.imag - velocity.imag * q.real) / det,
            (p.real * velocity.imag - p.imag * velocity.real) / det,
        )


@pytest.fixture(scope="module")
def case() -> Any:
    """Functions of the case."""
    return load_case("parallel_manipulator").build.__globals__


@pytest.mark.serial
def test_planar_manipulator(case):
    end = 0.03892 * np.exp(1j * math.radians(111.75))
    path = case["Path"](end, 1.0, "smooth", 0.5)
    t = np.linspace(0.0, 0.5, 26)
    known = PlanarManipulator(t, 0.5, 5e-3)
    J, F = known.J, known.F
    least = np.einsum("nij,njk,nk->ni", J, np.linalg.inv(np.swapaxes(J, 1, 2) @ J), F)
    two = np.linalg.solve(np.swapaxes(J[:, :2], 1, 2), F[..., np.newaxis])[..., 0]
    # least power: the same formula for scaled torques
    K = J[1:-1] / known.rates[1:-1, :, np.newaxis]
    power = np.einsum(
        "nij,njk,nk->ni", K, np.linalg.inv(np.swapaxes(K, 1, 2) @ K), F[1:-1]
    ) / known.rates[1:-1]  # fmt: skip
    expected_of = {"torque": least, "1": two, "3": power, "2": known.least_joint_forces}
    for mode, expected in expected_of.items():
        found = case["torques"](case["Design"](), mode, path, 26)
        values = np.stack([spline.values for spline in found.values()], axis=1)
        values = values[1:-1] if mode == "3" else values
        # drives are differentiated to 1e-9; without the links' rotary inertia 0.1 would be missing
        np.testing.assert_allclose(values, expected, atol=1e-7 * np.abs(expected).max())


def arm() -> tuple[ff.Model, list[ff.Actuator], list[ff.PrescribedAngle]]:
    """A post that rotates about Z with an arm and a ball, raised about -Y, under gravity."""
    model = ff.Model("arm")
    up = (0.0, -1.0, 0.0)
    hinge = ff.Marker("post"), ff.Marker("ball", offset=(-0.8, 0.0, 0.0))
    model.add(
        ff.Gravity((0.0, 0.0, -G)),
        ff.RigidBody("post", 1.5, (0.2, 0.2, 0.3)),
        ff.RigidBody("ball", 2.0, (0.05, 0.05, 0.05), position=(0.8, 0.0, 0.0)),
        ff.Revolute("base", ff.Ground(), ff.Marker("post"), axis=Z),
        ff.Revolute("elbow", *hinge, axis=up),
    )
    drives = [
        ff.Actuator("yaw", ff.Ground(), ff.Marker("post"), axis=Z),
        ff.Actuator("pitch", *hinge, axis=up),
    ]
    motions = [
        ff.PrescribedAngle("turn", ff.Ground(), ff.Marker("post"), axis=Z,
                           angle=lambda t: 0.9 * math.sin(2.0 * t)),
        ff.PrescribedAngle("raise", *hinge, axis=up, angle=lambda t: 1.1 * t * t - 0.2 * t),
    ]  # fmt: skip
    return model, drives, motions


def arm_torques(t: np.ndarray) -> np.ndarray:
    """Lagrange's equations of the arm: yaw and elevation."""
    q, u, e = 0.9 * np.sin(2 * t), 1.8 * np.cos(2 * t), -3.6 * np.sin(2 * t)
    p, v, a = 1.1 * t * t - 0.2 * t, 2.2 * t - 0.2, 2.2
    assert q.shape == p.shape
    m, reach = 2.0 * 0.64, np.cos(p) * np.sin(p)
    yaw = (m * np.cos(p) ** 2 + 0.05 + 0.3) * e - 2 * m * reach * u * v
    pitch = (m + 0.05) * a + m * reach * u**2 + 2.0 * G * 0.8 * np.cos(p)
    return np.stack([yaw, pitch], axis=1)


@pytest.mark.serial
def test_spatial_arm_under_gravity():
    model, drives, motions = arm()
    t = np.linspace(0.0, 1.0, 9)
    found = ff.inverse_dynamics(model, motions, drives, t, difference=0.01)
    # differences over 0.01 s are good to 1e-9; gyroscopic terms left out would be of order 1
    np.testing.assert_allclose(found.forces, arm_torques(t), atol=1e-7)
    np.testing.assert_allclose(found.coordinates[:, 1], 1.1 * t * t - 0.2 * t, atol=1e-12)
    np.testing.assert_allclose(found.rates[:, 0], 1.8 * np.cos(2 * t), atol=1e-9)
    np.testing.assert_allclose(found.accelerations[:, 0], -3.6 * np.sin(2 * t), atol=1e-8)
    np.testing.assert_allclose(found.powers, found.forces * found.rates)


@pytest.mark.serial
def test_torques_fed_forward_move_the_arm():
    """A run with the torques gives the prescribed motion, to the order of the integrator."""
    model, drives, motions = arm()
    found = ff.inverse_dynamics(model, motions, drives, np.linspace(0.0, 0.5, 101))
    for drive in drives:
        torque = found.amplitude(drive.name)
        model.add(ff.Actuator(drive.name, drive.a, drive.b, drive.axis, force=torque))
    model["base"]
    from flexfem.simulation.motion.stepping import Simulation

    errors = []
    for dt in (4e-3, 2e-3):
        started = _with_velocities(model, u=1.8, v=-0.2)
        simulation = Simulation(started, ff.RunOptions(dt=dt, t_end=0.5, tolerance=1e-10))
        while simulation.time < 0.5 - 1e-9:
            simulation.advance(dt)
        ball = simulation.system.parts[0].block.frames[1, :3]
        p, q = 1.1 * 0.25 - 0.1, 0.9 * math.sin(1.0)
        place = 0.8 * np.array([math.cos(p) * math.cos(q), math.cos(p) * math.sin(q), math.sin(p)])
        errors.append(np.linalg.norm(ball - place))
    # second order; without the reaction of the pitch drive on the post there would be 0.1 m
    assert errors[0] < 1e-3
    assert 3.5 < errors[0] / errors[1] < 4.5


def _with_velocities(model: ff.Model, u: float, v: float) -> ff.Model:
    """The arm with the rates that its motion starts with."""
    started = ff.Model("started")
    started.add(model.gravity)
    for thing in model.things:
        if not isinstance(thing, ff.RigidBody):
            started.add(thing)
            continue
        spin = (0.0, -v if thing.name == "ball" else 0.0, u)
        velocity = np.cross(spin, thing.position)
        started.add(
            ff.RigidBody(
                thing.name, thing.mass, thing.inertia, position=thing.position, velocity=velocity,
                angular_velocity=spin,
            )
        )  # fmt: skip
    return started


@pytest.mark.serial
def test_slider_crank_with_spring_and_load():
    """The slider's motion is prescribed, the crank driven: power balance of the mechanism."""
    r, rod, m1, m2, J1, J2, m3, k = 0.2, 0.5, 1.0, 2.0, 0.004, 0.05, 0.7, 300.0
    start = 0.6

    def centres(angle: np.ndarray) -> tuple[np.ndarray, ...]:
        bend = -np.arcsin(r * np.sin(angle) / rod)
        pin = r * np.exp(1j * angle)
        return 0.5 * pin, pin + 0.5 * rod * np.exp(1j * bend), pin + rod * np.exp(1j * bend), bend

    first, second, slider, bend = (complex(x) if i < 3 else float(x)
                                   for i, x in enumerate(centres(np.array(start))))  # fmt: skip
    model = ff.Model("slider_crank")

    def turned(angle: float) -> np.ndarray:
        c, s = math.cos(angle), math.sin(angle)
        return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])

    def place(x: complex) -> tuple[float, float, float]:
        return x.real, x.imag, 0.0

    root, pin = (ff.Marker("crank", offset=(s * 0.5 * r, 0, 0)) for s in (-1, 1))
    joint, end = (ff.Marker("rod", offset=(s * 0.5 * rod, 0, 0)) for s in (-1, 1))
    model.add(
        ff.Gravity((0.0, -G, 0.0)),
        ff.RigidBody("crank", m1, (J1, J1, J1), position=place(first), rotation=turned(start)),
        ff.RigidBody("rod", m2, (J2, J2, J2), position=place(second), rotation=turned(bend)),
        ff.PointMass("slider", m3, end),
        ff.Revolute("A", ff.Ground(), root, axis=Z),
        ff.Revolute("B", pin, joint, axis=Z),
        ff.PointOnPlane("guide", ff.Ground(), end, axis=(0.0, 1.0, 0.0)),
        ff.SpringDamper("spring", ff.Ground((1.0, 0, 0)), end, stiffness=k, rest_length=0.2),
        ff.PointForce("push", end, (4.0, 0.0, 0.0)),
    )
    path = lambda t: start + 2.0 * t + 0.7 * np.sin(3.0 * t)  # noqa: E731
    x = lambda t: float(np.real(centres(np.array(path(t)))[2] - slider))  # noqa: E731
    drive = ff.Actuator("motor", ff.Ground(), root, axis=Z)
    output = ff.PrescribedTranslation("way", ff.Ground(), end, x, axis=(1.0, 0, 0))
    t = np.linspace(0.0, 0.6, 7)
    found = ff.inverse_dynamics(model, [output], [drive], t, difference=5e-3)

    def energies(angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Twice the kinetic energy by the squared rate, and the potential."""
        h = 1e-3
        steps = np.array([centres(angle + j * h) for j in (-2, -1, 1, 2)])
        by = np.tensordot(np.array([1, -8, 8, -1]) / (12 * h), steps, axes=1)
        kinetic = m1 * abs(by[0]) ** 2 + m2 * abs(by[1]) ** 2 + m3 * abs(by[2]) ** 2
        kinetic = kinetic + J1 + J2 * by[3].real ** 2
        c = centres(angle)
        stretch = 1.0 - c[2].real - 0.2
        potential = G * (m1 * c[0].imag + m2 * c[1].imag) - 4.0 * c[2].real + 0.5 * k * stretch**2
        return kinetic, potential

    angle, h = path(t), 1e-3
    around = np.array([energies(angle + j * h) for j in (-2, -1, 1, 2)])
    by = np.tensordot(np.array([1, -8, 8, -1]) / (12 * h), around, axes=1)
    rate, acceleration = 2.0 + 2.1 * np.cos(3 * t), -6.3 * np.sin(3 * t)
    expected = energies(angle)[0] * acceleration + 0.5 * by[0] * rate**2 + by[1]
    # both differences are good to 1e-7 of 50 N m
    np.testing.assert_allclose(found.forces[:, 0], expected, atol=2e-5)


@pytest.mark.serial
def test_beams_count_as_rigid_ones():
    """A pendulum of a beam needs the torque of a rod, with the rotary inertia of its section."""
    section = ff.Section.rectangle(0.05, 0.03, ff.Material(2e11, 0.3, 7800.0))
    model = ff.Model("rod", mesh=ff.LineMesh.straight({"rod": [(0, 0, 0), (0, 1.2, 0)]}, 3))
    start = ff.Marker("rod", "start")
    model.add(ff.Beam("rod", section), ff.Revolute("pin", ff.Ground(), start, axis=Z))
    swing = ff.PrescribedAngle("swing", ff.Ground(), start, axis=Z, angle=lambda t: 0.5 * t * t)
    motor = ff.Actuator("motor", ff.Ground(), start, axis=Z)
    found = ff.inverse_dynamics(model, [swing], [motor], [0.0, 0.5, 1.0])
    line = section.mass_per_length
    about = (
        max(section.inertia[4, 4], section.inertia[5, 5]),
        min(section.inertia[4, 4], section.inertia[5, 5]),
    )
    expected = [line * 1.2**3 / 3.0 + 1.2 * j for j in about]
    # one of the two: without the section 6e-4 would be missing, lumped at nodes 5e-2 too much
    assert np.abs(found.forces[0, 0] / np.array(expected) - 1.0).min() < 1e-9
    np.testing.assert_allclose(found.forces[:, 0], found.forces[0, 0], rtol=1e-8)


def test_stencil():
    """Exact for polynomials of degree eight, inside the span at its ends."""
    for t, first, last in ((0.0, 0.0, 1.0), (0.03, 0.0, 1.0), (0.5, 0.0, 1.0), (1.0, 0.0, 1.0)):
        at, weights = stencil(t, first, last, 0.02)
        assert at.min() > first - 1e-9
        assert at.max() < last + 1e-9
        values = (0.3 - at) ** 8
        exact = [(0.3 - t) ** 8, -8 * (0.3 - t) ** 7, 56 * (0.3 - t) ** 6]
        np.testing.assert_allclose(weights @ values, exact, atol=1e-9)


@pytest.mark.parametrize(("t", "before"), [(0.0, 0), (0.05, 2), (0.5, 4), (0.95, 6), (1.0, 8)])
def test_stencil_is_as_central_as_the_span_allows(t, before):
    """In a span that is long enough the points lie symmetrically."""
    at, _ = stencil(t, 0.0, 1.0, 0.02)
    np.testing.assert_allclose(at, t + 0.02 * np.arange(-before, 9 - before), atol=1e-12)


def test_distributions_check_their_arguments():
    with pytest.raises(ValueError, match="LeastEffort: scales must be positive, got -1"):
        ff.LeastEffort((1.0, -1.0))
    with pytest.raises(ValueError, match="LeastJointForces: at must hold at least one marker"):
        ff.LeastJointForces([])
    with pytest.raises(TypeError, match="LeastJointForces: at must be"):
        ff.LeastJointForces([ff.Ground()])


@pytest.mark.serial
def test_what_has_no_solution_is_told():
    model, drives, motions = arm()
    t = np.linspace(0.0, 1.0, 3)
    ask = ff.inverse_dynamics
    with pytest.raises(ValueError, match="2 degrees of freedom need as many actuators, got 1: yaw"):
        ask(model, motions, drives[:1], t)
    with pytest.raises(ValueError, match=r"prescribe 2 coordinates, .* got 1"):
        ask(model, motions[:1], drives, t)
    again = ff.Actuator("again", ff.Ground(), ff.Marker("post"), axis=Z)
    with pytest.raises(
        ValueError, match=r"yaw, again cannot drive all 2 degrees of freedom at t = 0 s"
    ):
        ask(model, motions, [drives[0], again], t)
    lost = ff.Actuator("lost", ff.Ground(), ff.Marker("nobody"), axis=Z)
    with pytest.raises(ValueError, match=r'Actuator "lost": .*"nobody"'):
        ask(model, motions, [*drives, lost], t)
    with pytest.raises(ValueError, match=r"times must increase, got \[1.0, 0.0\]"):
        ask(model, motions, drives, [1.0, 0.0])
    with pytest.raises(ValueError, match=r'"base": an output is a driven joint outside the model'):
        ask(model, [model["base"], motions[1]], drives, t)
    three = [*drives, ff.Actuator("third", ff.Ground(), ff.Marker("ball"), axis=Z)]
    away = ff.LeastJointForces([ff.Marker("post", offset=(1.0, 0, 0))])
    with pytest.raises(ValueError, match="no joint acts at Marker"):
        ask(model, motions, three, t, away)
    with pytest.raises(ValueError, match="2 scales for 3 actuators"):
        ask(model, motions, three, t, ff.LeastEffort((1.0, 2.0)))
    up = ff.PrescribedTranslation("far", ff.Ground(), ff.Marker("ball"), lambda t: t, axis=Z)
    with pytest.raises(
        ValueError, match=r'"far", .*"turn": the motion is out of reach at t = 1 s, a gap'
    ):
        ask(model, [up, motions[0]], drives, t)
    # straight up the arm cannot rise further: the outputs say nothing of how it got there
    top = ff.PrescribedTranslation(
        "top", ff.Ground(), ff.Marker("ball"), lambda t: -t, axis=(1.0, 0.0, 0.0)
    )
    with pytest.raises(
        ValueError, match=r'"top".*: these outputs leave 1 degrees of freedom .* free at t = 0.8 s'
    ):
        ask(model, [up, top], drives, [0.8])
    found = ask(model, motions, drives, t)
    with pytest.raises(ValueError, match='there is no actuator "roll", they are yaw, pitch'):
        found.amplitude("roll", 1)


@pytest.mark.serial
def test_forces_on_a_body_that_turns_about_a_turning_axis():
    """Three forces along fixed axes on points of a body, by Euler's equations about its pin."""
    J, mass, arms = np.diag([0.3, 0.5, 0.4]), 2.0, np.array([[0, 0.6, 0], [0, 0, 0.5], [0.7, 0, 0]])
    pushes = np.array([[0, 0, 1.0], [1.0, 0, 0], [0, 1.0, 0]])

    def rotation(t):
        return (0.8 * np.sin(5.0 * t), 0.5 * t, 3.0 * t**2)

    model = ff.Model("gimbal")
    model.add(
        ff.RigidBody("top", mass, np.diag(J)), ff.Spherical("pin", ff.Ground(), ff.Marker("top"))
    )
    turn = ff.PrescribedRotation("turn", ff.Ground(), ff.Marker("top"), rotation=rotation)
    forces = [
        ff.Actuator(f"push_{i}", ff.Ground(), ff.Marker("top", offset=arm), axis=push,
                    motion="translation")
        for i, (arm, push) in enumerate(zip(arms, pushes, strict=True))
    ]  # fmt: skip
    times = np.linspace(0.0, 0.4, 5)
    found = ff.inverse_dynamics(model, [turn], forces, times, difference=5e-3).forces
    h, places = 1e-3, np.arange(-3, 4)
    first = np.array([-1, 9, -45, 0, 45, -9, 1]) / 60.0 / h
    for t, force in zip(times, found, strict=True):
        R = np.array([so3.exp(np.array(rotation(t + k * h))) for k in places])
        momenta = []  # about the pin, inertial axes
        for k in places:
            near = np.array([so3.exp(np.array(rotation(t + (k + j) * h))) for j in places])
            spin = near[3].T @ np.tensordot(first, near, 1)
            momenta.append(near[3] @ J @ [spin[2, 1], spin[0, 2], spin[1, 0]])
        levers = np.cross(arms @ R[3].T, pushes).T
        expected = np.linalg.solve(levers, np.tensordot(first, momenta, 1))
        # differences of drives are good to 1e-8; half of the rows' turning is per cents
        np.testing.assert_allclose(force, expected, atol=1e-6 * np.abs(found).max())
