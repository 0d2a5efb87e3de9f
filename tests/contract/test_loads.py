# SPDX-License-Identifier: LGPL-3.0-or-later
"""Loads and masses at markers: residuals by hand, tangents by differences, power, amplitudes."""

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem.layout.numbered_model import NumberedModel
from flexfem.lie import se3, so3
from flexfem.mesh.line_mesh import LineMesh
from flexfem.system.build import build
from flexfem.system.system import System

OFFSET = np.array([0.3, -0.5, 0.8])
TURN = so3.exp(np.array([0.4, -1.1, 0.7]))  # axes of the marker at the start
START = so3.exp(np.array([-0.9, 0.2, 0.5]))  # of the body
VECTOR = np.array([2.0, -3.0, 5.0])
SECTION = ff.Section.general((9.0, 8.0, 7.0, 6.0, 5.0, 4.0), (2.0, 2.0, 2.0, 0.3, 0.2, 0.1))


def _system(model: ff.Model, comm: MPI.Intracomm = MPI.COMM_SELF) -> System:
    model.validate()
    system = build(NumberedModel(model), comm, split_above=1)
    system.set_time(0.0)
    return system


def _body(**changes) -> ff.RigidBody:
    values = {"position": (1.0, 2.0, 3.0), "rotation": START} | changes
    return ff.RigidBody("body", 1.5, (0.2, 0.3, 0.4), **values)


def _marker() -> ff.Marker:
    return ff.Marker("body", offset=OFFSET, rotation=TURN)


def _load(kind: str, follower: bool, amplitude=None):
    cls = ff.PointForce if kind == "force" else ff.PointMoment
    return cls("load", _marker(), VECTOR, follower=follower, amplitude=amplitude)


def _loaded(kind: str, follower: bool, amplitude=None) -> System:
    model = ff.Model("test")
    model.add(_body(), _load(kind, follower, amplitude))
    return _system(model)


def _disturb(system: System, rng) -> None:
    for part in system.parts:
        block = part.block
        block.frames0[:] = se3.retract(block.start_frames, rng.normal(size=(len(block.frames), 6)))
        block.increment[:] = 0.3 * rng.normal(size=block.increment.shape)
        block.frames[:] = se3.retract(block.frames0, block.increment)
        block.velocity[:] = rng.normal(size=block.velocity.shape)
        block.acceleration[:] = rng.normal(size=block.velocity.shape)


def _forces(system: System, scale: float = 1.0) -> np.ndarray:
    part = system.parts[0]
    part.block.residual[:] = 0.0
    part.forces.add_residual(part.block, system.factors, scale)
    return part.block.residual.copy()


EVERY = pytest.mark.parametrize(
    ("kind", "follower"),
    [("force", False), ("force", True), ("moment", False), ("moment", True)],
    ids=["dead force", "follower force", "dead moment", "follower moment"],
)


@EVERY
def test_residual_by_hand(kind, follower, rng):
    system = _loaded(kind, follower)
    _disturb(system, rng)
    R = se3.rotation(system.parts[0].block.frames[0])
    # a follower keeps its components in the marker, which rotates with the body
    local = START.T @ TURN @ VECTOR if follower else R.T @ VECTOR
    if kind == "force":
        expected = np.concatenate([local, np.cross(OFFSET, local)])
    else:
        expected = np.concatenate([np.zeros(3), local])
    # round-off; a forgotten lever arm or marker rotation is of the order of the load
    np.testing.assert_allclose(_forces(system, 0.25)[0], -0.25 * expected, atol=1e-13)


@EVERY
def test_power_is_the_load_times_the_velocity_of_its_point(kind, follower, rng):
    """Central difference of the point's position or the turning of its axes."""
    system = _loaded(kind, follower)
    _disturb(system, rng)
    block, eps = system.parts[0].block, 1e-6
    sides = [se3.retract(block.frames[0], sign * eps * block.velocity[0]) for sign in (1.0, -1.0)]
    R = se3.rotation(block.frames[0])
    inertial = R @ START.T @ TURN @ VECTOR if follower else VECTOR
    if kind == "force":
        ends = [se3.position(h) + se3.rotation(h) @ OFFSET for h in sides]
        rate = (ends[0] - ends[1]) / (2.0 * eps)
    else:
        rate = so3.log(se3.rotation(sides[0]) @ se3.rotation(sides[1]).T) / (2.0 * eps)
    # differences are good to 1e-9; a force at the wrong point does the wrong work
    power = -_forces(system)[0] @ block.velocity[0]
    assert power == pytest.approx(inertial @ rate, rel=1e-7)


@EVERY
def test_tangent_is_the_derivative_of_the_residual(kind, follower, rng):
    system = _loaded(kind, follower)
    _disturb(system, rng)
    part, eps = system.parts[0], 1e-5
    frames, columns = part.block.frames.copy(), []
    for k in range(6):
        sides = []
        for sign in (1.0, -1.0):
            part.block.frames[:] = se3.retract(frames, sign * eps * np.eye(6)[k])
            sides.append(_forces(system, 0.4)[0])
        columns.append((sides[0] - sides[1]) / (2.0 * eps))
    part.block.frames[:] = frames
    tangent = part.forces.tangent(part.block, system.factors, 0.4)[0]
    # differences are good to 1e-10; symmetrising or dropping the lever arm's rotation is of order 1
    np.testing.assert_allclose(tangent, np.stack(columns, axis=-1), atol=1e-7)


@pytest.mark.parametrize(
    ("amplitude", "values"),
    [
        (None, (1.0, 1.0, 1.0)),
        (ff.Table((0.0, 1.0, 2.0), (0.0, 4.0, 1.0)), (0.0, 2.0, 1.0)),
        (ff.SmoothStep(0.0, 1.0), (0.0, 0.5, 1.0)),
        (lambda t: 3.0 - t, (3.0, 2.5, 1.0)),
    ],
    ids=["none", "table", "step", "function"],
)
def test_amplitude_scales_residual_and_tangent(amplitude, values, rng):
    system, constant = _loaded("force", False, amplitude), _loaded("force", False)
    reference = _forces(constant)
    part = constant.parts[0]
    tangent = part.forces.tangent(part.block, constant.factors, 1.0)
    for t, factor in zip((0.0, 0.5, 2.0), values, strict=True):
        system.set_time(t)
        # an amplitude taken at the start of a step, or left out of the tangent, shows at once
        np.testing.assert_allclose(_forces(system), factor * reference, atol=1e-13)
        part = system.parts[0]
        np.testing.assert_allclose(
            part.forces.tangent(part.block, system.factors, 1.0), factor * tangent, atol=1e-13
        )


def test_each_load_has_its_own_amplitude():
    model = ff.Model("test")
    model.add(
        _body(),
        ff.PointForce("one", ff.Marker("body"), (1.0, 0, 0), amplitude=lambda t: 2.0),
        ff.PointForce("two", ff.Marker("body"), (0, 1.0, 0), amplitude=lambda t: 5.0),
    )
    inertial = START @ _forces(_system(model))[0, :3]
    np.testing.assert_allclose(inertial, [-2.0, -5.0, 0.0], atol=1e-14)


def _beam_model(points: np.ndarray, *loads) -> ff.Model:
    cells = np.stack([np.arange(len(points) - 1), np.arange(1, len(points))], axis=1)
    model = ff.Model("test", mesh=LineMesh(points, cells, {"beam": np.arange(len(cells))}))
    model.add(ff.Beam("beam", SECTION, orientation=(0.0, 0.0, 1.0)), *loads)
    return model


def _resultant(system: System) -> np.ndarray:
    """Force and moment about the inertial origin on the beam, from the nodes of all ranks."""
    local, block = -_forces(system), system.parts[0].block
    frames = block.frames[: block.owned]
    back = np.swapaxes(se3.adjoint(se3.inverse(frames)), -1, -2)
    total = np.einsum("nij,nj->i", back, local[: block.owned])
    return system.comm.allreduce(total)


def _arc(n: int) -> np.ndarray:
    s = np.linspace(0.0, 2.0, n + 1)
    return np.stack([2.0 * np.sin(s), 2.0 - 2.0 * np.cos(s), 0.0 * s], axis=1)


def test_dead_line_load_counts_the_arc_length(rng):
    system = _system(_beam_model(_arc(5), ff.LineLoad("load", "beam", VECTOR)), MPI.COMM_WORLD)
    # chords instead of arcs would lack 0.7 per cent
    np.testing.assert_allclose(_resultant(system)[:3], 4.0 * VECTOR, rtol=1e-13)
    block = system.parts[0].block
    block.frames[:] = se3.compose(se3.exp(np.array([0, 0, 0, 1.0, -2.0, 0.5])), block.frames)
    np.testing.assert_allclose(_resultant(system)[:3], 4.0 * VECTOR, rtol=1e-13)


def test_follower_line_load_turns_with_the_sections():
    """Pressure q along e3 = e1 x e2 on an arc of radius r: Hencky's closed resultant."""
    load = ff.LineLoad("load", "beam", (0.0, 0.0, 3.0), follower=True)
    errors = []
    for n in (8, 16):
        system = _system(_beam_model(_arc(n), load), MPI.COMM_WORLD)
        # e2 = z, so e3 = t x z points away from the centre: (sin s, -cos s)
        exact = 3.0 * 2.0 * np.array([1.0 - np.cos(2.0), -np.sin(2.0), 0.0])
        errors.append(np.abs(_resultant(system)[:3] - exact).max())
        block = system.parts[0].block
        turn = se3.exp(np.array([0, 0, 0, 1.0, -2.0, 0.5]))
        block.frames[:] = se3.compose(turn, block.frames)
        before = se3.rotation(turn) @ exact
        # rotating the beam rotates the load: a dead load would stay where it was
        assert np.abs(_resultant(system)[:3] - before).max() <= 1.0001 * errors[-1] * 2.0
    # trapezoidal rule of the nodes: second order; loads at one end of each element: first
    assert np.log2(errors[0] / errors[1]) >= 1.9
    assert errors[1] <= 2e-2


def test_follower_line_load_uses_each_cell_s_axes_at_a_corner():
    points = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 1, 0], [2, 2, 0]], dtype=float)
    load = ff.LineLoad("load", "beam", (0.0, 0.0, 3.0), follower=True)
    system = _system(_beam_model(points, load), MPI.COMM_WORLD)
    # e3 = x x z = -y on the first leg, y x z = x on the second, 2 m each; with the node's axes
    # for both legs half a cell's load would point the wrong way
    np.testing.assert_allclose(_resultant(system)[:3], [6.0, -6.0, 0.0], atol=1e-13)


def test_point_force_on_a_beam_node_acts_at_its_offset():
    load = ff.PointForce("load", ff.Marker("beam", 0.5, offset=(0.0, 0.2, 0.1)), VECTOR)
    points = np.linspace([0.0, 0, 0], [2.0, 0, 0], 5)
    system = _system(_beam_model(points, load), MPI.COMM_WORLD)
    # section axes: e1 = x, e2 = z, e3 = -y
    expected = np.concatenate([VECTOR, np.cross([1.0, -0.1, 0.2], VECTOR)])
    np.testing.assert_allclose(_resultant(system), expected, atol=1e-13)


def _masses(model: ff.Model, rng) -> tuple[np.ndarray, np.ndarray]:
    """Residual and tangent of the inertia of the body in a random moving state."""
    system = _system(model)
    _disturb(system, rng)
    part, gravity = system.parts[0], np.array([1.0, -9.0, 3.0])
    part.block.residual[:] = 0.0
    part.masses.add_residual(part.block, gravity, 0.7)
    tangents = part.masses.tangent(part.block, gravity, np.array([11.0, 60.0, 1.0]), 0.7)
    return part.block.residual[0].copy(), tangents.sum(axis=0)


def test_point_masses_make_a_rigid_body_of_the_same_inertia():
    """A body with two eccentric masses against one body with the sums of everything."""
    arms, sizes = (OFFSET, np.array([-0.4, 0.1, 0.2])), (0.7, 0.4)
    parts = ff.Model("parts")
    parts.add(_body())
    for k in range(2):
        parts.add(ff.PointMass(f"mass {k}", sizes[k], ff.Marker("body", offset=arms[k])))
    mass = 1.5 + sum(sizes)
    centre = sum(m * a for m, a in zip(sizes, arms, strict=True)) / mass
    about_point = np.diag([0.2, 0.3, 0.4]) + sum(
        m * (a @ a * np.eye(3) - np.outer(a, a)) for m, a in zip(sizes, arms, strict=True)
    )
    inertia = about_point - mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    whole = ff.Model("whole")
    whole.add(
        ff.RigidBody("body", mass, inertia, position=(1.0, 2.0, 3.0), rotation=START, centre=centre)
    )
    one, two = (_masses(model, np.random.default_rng(5)) for model in (parts, whole))
    # round-off; a sign of the first moment or a missing Steiner term is of the order of the mass
    np.testing.assert_allclose(one[0], two[0], atol=1e-12)
    np.testing.assert_allclose(one[1], two[1], atol=1e-10)


def test_inertia_tangent_is_the_derivative_of_the_residual(rng):
    model = ff.Model("test")
    model.add(_body(centre=(0.1, -0.2, 0.3)))
    system = _system(model)
    _disturb(system, rng)
    part, gravity, shifts = system.parts[0], np.array([1.0, -9.0, 3.0]), (11.0, 60.0)
    block, eps, columns = part.block, 1e-6, []
    n, v, a = (x.copy() for x in (block.increment, block.velocity, block.acceleration))
    for k in range(6):
        sides = []
        for sign in (1.0, -1.0):
            step = se3.exp(sign * eps * np.eye(6)[k])
            block.increment[:] = se3.log(se3.compose(se3.exp(n), step))
            block.frames[:] = se3.retract(block.frames0, block.increment)
            block.velocity[:] = v + shifts[0] * (block.increment - n)
            block.acceleration[:] = a + shifts[1] * (block.increment - n)
            block.residual[:] = 0.0
            part.masses.add_residual(block, gravity, 0.7)
            sides.append(block.residual[0].copy())
        columns.append((sides[0] - sides[1]) / (2.0 * eps))
    block.increment[:], block.velocity[:] = n, v
    block.frames[:] = se3.retract(block.frames0, n)
    tangent = part.masses.tangent(block, gravity, np.array([*shifts, 1.0]), 0.7)[0]
    expected = np.stack(columns, axis=-1)
    # differences are good to 1e-9 of the largest; gyroscopic terms left out are 1e-1 of it
    np.testing.assert_allclose(tangent, expected, atol=1e-7 * np.abs(expected).max())


def test_free_rigid_body_obeys_newton_and_euler():
    """m a_c = m g and J dOmega/dt + Omega x J Omega = 0, with an eccentric reference point."""
    c, omega = np.array([0.1, -0.2, 0.3]), np.array([2.0, -1.0, 0.7])
    model = ff.Model("test")
    model.add(_body(centre=c, local_angular_velocity=omega, velocity=(1.0, 2.0, -1.0)))
    system = _system(model)
    part, g, J = system.parts[0], np.array([1.0, -9.0, 3.0]), np.diag([0.2, 0.3, 0.4])
    block = part.block
    alpha = np.linalg.solve(J, -np.cross(omega, J @ omega))
    # acceleration of the reference point, then dV/dt = R^T a - Omega x V
    point = START.T @ g - np.cross(alpha, c) - np.cross(omega, np.cross(omega, c))
    local = START.T @ np.array([1.0, 2.0, -1.0])
    block.acceleration[0] = np.concatenate([point - np.cross(omega, local), alpha])
    block.residual[:] = 0.0
    part.masses.add_residual(block, g, 1.0)
    # a wrong sign of a gyroscopic or centrifugal term leaves a residual of order 1
    np.testing.assert_allclose(block.residual[0], 0.0, atol=1e-13)
