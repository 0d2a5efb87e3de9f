# SPDX-License-Identifier: LGPL-3.0-or-later
"""Loads on shells: resultants, power, tangents by differences, work."""

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem.lie import se3
from flexfem.system.system import System
from tests.contract.loaded_shells import disturb, inertial, load_forces, loaded, sums

SECTION = ff.ShellSection.isotropic(0.1, ff.Material(1e3, 0.3, 10.0))


def sphere(p: np.ndarray) -> np.ndarray:
    """Unit sphere without caps, its normals outwards."""
    f, t = p.T
    return np.column_stack([np.cos(t) * np.cos(f), np.cos(t) * np.sin(f), np.sin(t)])


def barrel() -> ff.SurfaceMesh:
    """Closed around, open at both ends."""
    angles = np.linspace(0.0, 2.0 * np.pi, 9)[:-1]
    return ff.SurfaceMesh.grid("shell", angles, np.linspace(-0.9, 1.1, 5), sphere, closed=True)


def _system(
    mesh: ff.SurfaceMesh,
    load: object,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
    element: str = "rotation_free",
) -> System:
    return loaded(ff.Shell("shell", SECTION, element=element), mesh, load, comm)


@pytest.mark.three_ranks
def test_pressure_on_an_open_surface_is_that_on_its_cover(rng):
    """Gauss: the resultant depends on the rims alone, and so does the moment."""
    system = _system(barrel(), ff.Pressure("load", "shell", 7.0))
    disturb(system, rng, 0.2)
    block, mesh = system.parts[0].block, barrel()
    points = np.zeros((len(mesh.points), 3))
    points[block.node_ids[: block.owned]] = block.frames[: block.owned, :3]
    points = system.comm.allreduce(points)
    total = np.zeros(3)
    for rim in mesh.boundary_lines("shell"):
        ring = points[rim]
        total += 0.5 * np.cross(ring[:-1], ring[1:]).sum(axis=0)
    # round-off; a pressure against the normal has the other sign, the area of the start is off by
    # tens of per cents
    np.testing.assert_allclose(sums(system)[:3], 7.0 * total, atol=1e-12)


def test_positive_pressure_pushes_along_the_normal():
    mesh = ff.SurfaceMesh.rectangle("shell", (2.0, 3.0), (3, 2))
    system = _system(mesh, ff.Pressure("load", "shell", 7.0))
    # of 6 m^2 at (1, 1.5); the wrong side has the other sign
    expected = [0.0, 0.0, 42.0, 63.0, -42.0, 0.0]
    np.testing.assert_allclose(sums(system), expected, atol=1e-12)


@pytest.mark.serial
def test_power_of_pressure_is_that_of_the_enclosed_volume(rng):
    """A closed box: pressure times the rate of its volume, by differences."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
    faces = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]
    mesh = ff.SurfaceMesh(corners, faces, {"shell": range(4)})
    system = _system(mesh, ff.Pressure("load", "shell", 3.0), MPI.COMM_SELF)
    forces = inertial(system, load_forces(system))
    speed, eps = rng.normal(size=(4, 3)), 1e-6
    order = system.parts[0].block.node_ids

    def volume(x: np.ndarray) -> float:
        return float(np.linalg.det(x[1:] - x[0]) / 6.0)

    rate = (volume(corners + eps * speed) - volume(corners - eps * speed)) / (2.0 * eps)
    sign = np.sign(np.dot(mesh.normals[0], [0.0, 0.0, -1.0]))  # outwards or inwards
    # differences are good to 1e-10; a share of a third of another triangle is off by order one
    assert np.vdot(forces, speed[order]) == pytest.approx(3.0 * sign * rate, rel=1e-7)


@pytest.mark.serial
def test_tangent_and_action_of_pressure_by_differences(rng):
    system = _system(barrel(), ff.Pressure("load", "shell", 7.0), MPI.COMM_SELF)
    disturb(system, rng, 0.2)
    (part,) = system.parts
    (inside,) = part.line_forces
    block, eps = part.block, 1e-6
    frames, count = block.frames.copy(), len(block.frames)
    columns = []
    for node in range(count):
        for k in range(3):
            sides = []
            for sign in (1.0, -1.0):
                block.frames[:] = frames
                axis = se3.rotation(frames)[node, :, k]
                block.frames[node, :3] += sign * eps * axis
                sides.append(-load_forces(system, 0.4).ravel())
            columns.append((sides[0] - sides[1]) / (2.0 * eps))
    block.frames[:] = frames
    full = np.zeros((count, 3, count, 3))
    for nodes, K in zip(inside.nodes, inside.tangent(block, system.factors, 0.4), strict=True):
        for i in range(3):
            for j in range(3):
                full[nodes[i], :, nodes[j]] += K[3 * i : 3 * i + 3, 3 * j : 3 * j + 3]
    full = full.reshape(3 * count, 3 * count)
    # differences are good to 1e-9; node axes left out or a transposed matrix are of order one
    np.testing.assert_allclose(full, np.stack(columns, axis=1), atol=1e-7)
    block.step[:] = rng.normal(size=block.step.shape)
    block.residual[:] = 0.0
    inside.add_action(block, system.factors, 0.4)
    np.testing.assert_allclose(
        block.residual[:, :3].ravel(), full @ block.step[:, :3].ravel(), atol=1e-12
    )
    # a potential but for the rims: in inertial axes rows of inner nodes are symmetric
    R = se3.rotation(frames)
    inertial = np.einsum("nia,namb,mjb->nimj", R, full.reshape(count, 3, count, 3), R)
    rims = np.concatenate(barrel().boundary_lines("shell"))
    inner = block.local_index(np.setdiff1d(np.arange(count), rims))
    own = inertial[inner][:, :, inner].reshape(3 * len(inner), -1)
    np.testing.assert_allclose(own, own.T, atol=1e-12)


@pytest.mark.three_ranks
@pytest.mark.parametrize("place", ["shell_top", "shell_right"])
def test_edge_load_counts_lengths_and_stays_dead(place, rng):
    lengths = {"shell_top": 2.0, "shell_right": 3.0}
    mesh = ff.SurfaceMesh.grid("shell", [0.0, 0.3, 2.0], [0.0, 1.0, 1.2, 3.0])
    load = ff.EdgeLoad("load", "shell", place, (1.0, -2.0, 3.0))
    system = _system(mesh, load)
    middle = {"shell_top": (1.0, 3.0, 0.0), "shell_right": (2.0, 1.5, 0.0)}[place]
    force = lengths[place] * np.array([1.0, -2.0, 3.0])
    # equal forces at unevenly spaced nodes have the right sum, not the right moment
    expected = np.concatenate([force, np.cross(middle, force)])
    np.testing.assert_allclose(sums(system), expected, atol=1e-12)
    disturb(system, rng, 0.2)
    np.testing.assert_allclose(sums(system)[:3], force, atol=1e-12)


@pytest.mark.three_ranks
def test_surface_load_is_the_weight_of_equal_density(rng):
    """Against gravity on lumped masses, with an amplitude."""
    weight = 10.0 * 0.1 * np.array([1.0, -2.0, 3.0])
    load = ff.SurfaceLoad("load", "shell", weight, amplitude=lambda t: 2.0)
    system = _system(barrel(), load)
    disturb(system, rng, 0.2)
    (part,) = system.parts
    forces = load_forces(system)
    part.block.residual[:] = 0.0
    part.elements.add_residual(part.block, 2.0 * np.array([1.0, -2.0, 3.0]), 1.0)
    part.block.add_ghosts()
    loaded = part.block.owned_residual.copy()
    part.block.residual[:] = 0.0
    part.elements.add_residual(part.block, np.zeros(3), 1.0)
    part.block.add_ghosts()
    # the areas of neighbours instead of own ones differ by tens of per cents
    np.testing.assert_allclose(forces, part.block.owned_residual - loaded, atol=1e-11)


def test_work_of_pressure_is_counted():
    """A free sheet that rotates in its plane, pushed along its normal: momentum, closed balance."""
    stiff = ff.ShellSection.isotropic(0.1, ff.Material(1e6, 0.3, 10.0))
    model = ff.Model("pushed", surface=ff.SurfaceMesh.rectangle("shell", (2.0, 1.0), (4, 2)))
    model.add(
        ff.Shell("shell", stiff, angular_velocity=(0.0, 0.0, 1.0)),
        ff.Pressure("push", "shell", 5.0, amplitude=lambda t: 1.0 + t),
        ff.EnergyProbe(),
        ff.MomentumProbe("all"),
    )
    history = ff.simulate(model, ff.RunOptions(dt=2e-3, t_end=0.2, rho_inf=1.0)).history
    if history:
        # the integral of the force, 10 N at the start; centrifugal strains are 1e-5
        assert history["all_pz"][-1] == pytest.approx(10.0 * (0.2 + 0.02), rel=1e-4)
        # trapezoidal rule: second order in the step; work left out is all of the energy
        assert abs(history["energy_balance"]).max() <= 1e-3 * history["energy_work"][-1]
        assert history["energy_work"][-1] > 0.5
