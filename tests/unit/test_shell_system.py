# SPDX-License-Identifier: LGPL-3.0-or-later
"""Shells in the system, split over the ranks: forces, matrices and their action, masses."""

from types import SimpleNamespace

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem.core.nodes import motion
from flexfem.layout.numbered_model import NumberedModel
from flexfem.lie import se3, so3
from flexfem.system.build import build
from flexfem.system.system import MASS

pytestmark = pytest.mark.three_ranks
COMM = MPI.COMM_WORLD
GRAVITY = np.array([1.0, -3.0, 2.0])
#: velocity, acceleration and stiffness factors: no term dominates
SHIFTS = np.array([12.0, 70.0, 1.0])
MASSES = pytest.mark.parametrize("mass", ["lumped", "consistent"])


def saddle(p: np.ndarray) -> np.ndarray:
    """A strongly curved surface."""
    return np.column_stack([p, 0.4 * p[:, 0] ** 2 - 0.3 * p[:, 0] * p[:, 1]])


def unequal() -> ff.ShellSection:
    """Membrane, bending and coupling of one size."""
    A, D = np.diag([9.0, 7.0, 3.0]), np.diag([2.0, 3.0, 1.0])
    B = np.array([[0.5, 0.1, 0.2], [0.1, -0.4, 0.0], [0.2, 0.0, 0.3]])
    return ff.ShellSection(np.block([[A, B], [B.T, D]]), mass=1.5, thickness=0.1)


def shells(
    surface=saddle, *, damping: float = 0.0, mass: str = "lumped", averaged: bool | None = None,
    edges: dict[str, str] | None = None,
) -> SimpleNamespace:  # fmt: skip
    """System of one shell, its arrays addressed by nodes of the mesh."""
    mesh = ff.SurfaceMesh.grid("shell", np.linspace(0, 2, 5), [0.0, 0.3, 0.9, 1.2], surface)
    model = ff.Model("test", surface=mesh)
    model.add(
        ff.Shell("shell", unequal(), damping=damping, mass=mass, averaged=averaged,
                 edges=edges or {}, direction=(1.0, 0.3, 0.1)),
    )  # fmt: skip
    model.validate()
    (part,) = build(NumberedModel(model), COMM, split_above=1).parts
    return SimpleNamespace(mesh=mesh, part=part, block=part.block, family=part.elements)


def everywhere(s: SimpleNamespace, values: np.ndarray) -> np.ndarray:
    """Rows of all nodes of the mesh, given those of the owned nodes."""
    out = np.zeros((len(s.mesh.points), values.shape[1]))
    out[s.block.node_ids[: s.block.owned]] = values[: s.block.owned]
    return COMM.allreduce(out)


def put(s: SimpleNamespace, x: np.ndarray, R: np.ndarray, v: np.ndarray, a: np.ndarray) -> None:
    """Set positions, axes, velocities and accelerations, inertial, of all nodes of the mesh."""
    ids, back = s.block.node_ids, np.swapaxes(R, -1, -2)
    s.block.frames[:] = se3.frame(x[ids], R[ids])
    s.block.velocity[:, :3] = np.einsum("nij,nj->ni", back, v)[ids]
    s.block.acceleration[:, :3] = np.einsum("nij,nj->ni", back, a)[ids]


def forces(s: SimpleNamespace, gravity: np.ndarray = GRAVITY) -> np.ndarray:
    """Residuals (n, 3) of all nodes of the mesh, inertial axes."""
    s.block.residual[:] = 0.0
    s.family.add_residual(s.block, gravity, 1.0)
    s.block.add_ghosts()
    R = se3.rotation(s.block.frames[: s.block.owned])
    return everywhere(s, np.einsum("nij,nj->ni", R, s.block.owned_residual))


def state(s: SimpleNamespace, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """A deformed, moving state in axes rotated at random."""
    n = len(s.mesh.points)
    x = s.mesh.points + 0.05 * rng.normal(size=(n, 3))
    return x, so3.exp(rng.normal(size=(n, 3))), rng.normal(size=(n, 3)), rng.normal(size=(n, 3))


def differences(s: SimpleNamespace, at: tuple[np.ndarray, ...], step: np.ndarray) -> np.ndarray:
    """Derivative of the forces along inertial steps, velocities and accelerations included."""
    x, R, v, a = at
    sides, eps = [], 1e-6
    for move in (eps * step, -eps * step):
        put(s, x + move, R, v + SHIFTS[0] * move, a + SHIFTS[1] * move)
        sides.append(forces(s))
    put(s, *at)
    return (sides[0] - sides[1]) / (2.0 * eps)


def action(s: SimpleNamespace, R: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Action of the tangent on inertial steps, inertial axes."""
    ids = s.block.node_ids
    s.block.step[:, :3] = np.einsum("nji,nj->ni", R, step)[ids]
    s.block.residual[:] = 0.0
    s.family.add_action(s.block, GRAVITY, SHIFTS, 1.0)
    s.block.add_ghosts()
    return np.einsum("nij,nj->ni", R, everywhere(s, s.block.owned_residual))


def product(s: SimpleNamespace, R: np.ndarray, step: np.ndarray) -> np.ndarray:
    """The same with the matrices."""
    local = np.einsum("nji,nj->ni", R, step)[s.block.node_ids]
    ((rows, columns),) = s.family.couplings
    blocks = s.family.values(s.block, GRAVITY, SHIFTS, 1.0).reshape(-1, 3, 3)
    s.block.residual[:] = 0.0
    parts = np.einsum("kij,kj->ki", blocks, local[columns[:, 0]])
    np.add.at(s.block.residual[:, :3], rows[:, 0], parts)
    s.block.add_ghosts()
    return np.einsum("nij,nj->ni", R, everywhere(s, s.block.owned_residual))


@MASSES
@pytest.mark.parametrize("averaged", [False, True])
def test_tangent_and_action_are_derivatives_of_the_forces(mass, averaged, rng):
    s = shells(mass=mass, averaged=averaged, edges={"shell_left": "clamped"})
    at, step = state(s, rng), rng.normal(size=(len(s.mesh.points), 3))
    expected = differences(s, at, step)
    scale = abs(expected).max()
    # differences are good to 1e-8; neighbours' shares missing on another rank are of order one
    np.testing.assert_allclose(action(s, at[1], step), expected, atol=1e-6 * scale)
    np.testing.assert_allclose(product(s, at[1], step), expected, atol=1e-6 * scale)
    # round-off between both
    np.testing.assert_allclose(
        product(s, at[1], step), action(s, at[1], step), atol=1e-12 * scale
    )  # fmt: skip


def test_tangent_with_damping_lacks_the_turning_of_strain_rates_only(rng):
    """Exact at rest; in motion its error is in proportion to damping and velocity."""
    errors = []
    for speed in (0.0, 0.01, 0.02):
        s = shells(damping=0.3)
        x, R, v, a = state(s, np.random.default_rng(7))
        at, step = (x, R, speed * v, a), np.random.default_rng(8).normal(size=x.shape)
        expected, ours = differences(s, at, step), action(s, R, step)
        errors.append((ours - expected) / abs(expected).max())
        scale = abs(ours).max()
        np.testing.assert_allclose(product(s, R, step), ours, atol=1e-12 * scale)
    # a derivative by velocities left out is of order one at rest as well
    assert abs(errors[0]).max() <= 1e-6
    assert abs(errors[1]).max() >= 1e-4
    np.testing.assert_allclose(errors[2], 2.0 * errors[1], atol=0.02 * abs(errors[2]).max())


def test_forces_are_the_derivative_of_the_energy(rng):
    s = shells(edges={"shell_left": "clamped"})
    x, R, v, _ = state(s, rng)
    put(s, x, R, 0.0 * v, 0.0 * v)
    ours, eps, step = forces(s, np.zeros(3)), 1e-6, rng.normal(size=x.shape)
    sides = []
    for sign in (1.0, -1.0):
        put(s, x + sign * eps * step, R, 0.0 * v, 0.0 * v)
        sides.append(COMM.allreduce(float(s.family.energies(s.block.frames).sum())))
    # differences are good to 1e-9; triangles counted by two ranks are off by per cents
    assert np.vdot(ours, step) == pytest.approx((sides[0] - sides[1]) / (2.0 * eps), rel=1e-6)


def test_rigid_motion_and_spin_leave_no_forces(rng):
    """Far from the origin, rotated by more than a half turn, spinning, with damping."""
    s = shells(damping=0.3)
    Q, spin = so3.exp(np.array([2.0, -2.5, 1.0])), np.array([3.0, -2.0, 5.0])
    x = s.mesh.points @ Q.T + np.array([100.0, -50.0, 70.0])
    v = np.cross(spin, x)
    put(s, x, np.tile(np.eye(3), (len(x), 1, 1)), v, 0.0 * v)
    # round-off of positions of size 100 in curvatures over 0.1; strains of order one make
    # forces of order one
    np.testing.assert_allclose(forces(s, np.zeros(3)), 0.0, atol=1e-10)


@MASSES
def test_inertia_is_that_of_the_velocity_field(mass, rng):
    """Energy and momenta of a rigid motion; the mass matrix gives the same energy."""
    s = shells(lambda p: np.column_stack([p, 0.0 * p[:, 0]]), mass=mass)
    x, n = s.mesh.points, len(s.mesh.points)
    spin, speed = np.array([0.3, -0.5, 0.7]), np.array([1.0, 2.0, 3.0])
    v = speed + np.cross(spin, x)
    put(s, x, so3.exp(rng.normal(size=(n, 3))), v, 0.0 * v)
    own = np.zeros(motion.WIDTH)
    s.family.add_motion(s.block, np.ones(len(s.family.areas), dtype=bool), own)
    total = COMM.allreduce(own)
    m, size, centre = 1.5 * 2.0 * 1.2, np.array([2.0, 1.2, 0.0]), np.array([1.0, 0.6, 0.0])
    moments = m * np.array([size[1] ** 2, size[0] ** 2, size[0] ** 2 + size[1] ** 2]) / 12.0
    at_centre = speed + np.cross(spin, centre)
    energy = 0.5 * m * at_centre @ at_centre + 0.5 * moments @ spin**2
    momentum = np.cross(centre, m * at_centre) + moments * spin
    assert total[motion.MASS] == pytest.approx(m, rel=1e-13)
    np.testing.assert_allclose(total[motion.LINEAR : motion.LINEAR + 3], m * at_centre, rtol=1e-12)
    exact = mass == "consistent"
    # exact for linear velocities; lumps at the corners add a fraction (cell/size)^2
    assert total[motion.KINETIC] == pytest.approx(energy, rel=1e-12 if exact else 0.05)
    np.testing.assert_allclose(
        total[motion.LINEAR + 3 :], momentum, rtol=1e-12 if exact else 0.2, atol=1e-12
    )
    s.block.step[:] = s.block.velocity
    s.block.residual[:] = 0.0
    s.family.add_action(s.block, np.zeros(3), MASS.array, 1.0)
    s.block.add_ghosts()
    owned = s.block.velocity[: s.block.owned, :3]
    twice = COMM.allreduce(float(np.vdot(s.block.owned_residual, owned)))
    assert 0.5 * twice == pytest.approx(total[motion.KINETIC], rel=1e-12)
