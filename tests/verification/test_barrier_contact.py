# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contact by barriers: nothing touches, no energy is made, friction is Coulomb's, on all ranks."""

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem._checks import InputError
from flexfem.integrators.split.step import Split
from flexfem.simulation.motion.stepping import Simulation
from tests.verification.motions import run_undamped


def energy(history: dict) -> np.ndarray:
    return history["energy_kinetic"] + history["energy_strain"] + history["energy_gravity"]


def sheet_above_ground() -> ff.Model:
    u = np.linspace(-0.2, 0.2, 6)
    mesh = ff.SurfaceMesh.grid("sheet", u, u, lambda p: np.c_[p, np.full(len(p), 6e-3)])
    section = ff.ShellSection.isotropic(1e-3, ff.Material(7e10, 0.3, 2700.0))
    model = ff.Model("landing", surface=mesh)
    ground = ff.RigidPlane(ff.Ground())
    model.add(
        ff.Shell("sheet", section, velocity=(0.0, 0.0, -0.63)),
        ff.Contact("ground", "sheet", surfaces=ground, law="barrier"),
        ff.ContactProbe("touch", "ground"), ff.EnergyProbe(), ff.MomentumProbe("momentum"),
    )  # fmt: skip
    return model


@pytest.mark.parametrize("dt", [pytest.param(1e-3, marks=pytest.mark.serial), 5e-3])
def test_a_sheet_that_lands_flat_makes_no_energy(dt: float) -> None:
    found, alone = (
        run_undamped(sheet_above_ground(), dt, 0.03, comm).history
        for comm in (MPI.COMM_WORLD, MPI.COMM_SELF)
    )
    if MPI.COMM_WORLD.rank == 0:
        total, start = energy(found), found["energy_kinetic"][0]
        # the criterion of energy; forces at the end of the step make up to 6 times the energy
        assert (total.max() - total[0]) / start < 1e-6
        assert found["touch_gap"].min() > 0.0
        assert found["touch_closed"].max() >= 36  # all nodes at once
        # it leaves with the momentum that it has brought; half of it if it stuck
        assert found["momentum_pz"][-1] == pytest.approx(-found["momentum_pz"][0], rel=1e-3)
        for name in ("touch_gap", "touch_normal", "momentum_pz", "energy_kinetic"):
            scale = np.abs(alone[name]).max()
            # equality on ranks; a pair that a rank misses changes these by a hundredth
            np.testing.assert_allclose(found[name], alone[name], rtol=0.0, atol=1e-9 * scale)


def test_impulses_of_shared_nodes_count_once() -> None:
    """Whether impulses last, by which steps are predicted, is no matter of who has the nodes."""
    options = ff.RunOptions(dt=1e-3, t_end=1.0, quiet=True, split_above=20)
    simulation = Simulation(sheet_above_ground(), options)
    split, block = Split.of(simulation.system), simulation.system.parts[0].block
    assert split is not None
    ghosts = np.unique(np.concatenate(block.comm.allgather(block.node_ids[block.owned :])))
    # nodes that ranks share change by so much that all of them together change by 0.09
    change = 0.09 * np.sqrt(36.0 / max(len(ghosts), 1))
    split._jumps[0][:] = 1.0
    split._last_jumps[0][:] = 1.0 - change * np.isin(block.node_ids, ghosts)[:, np.newaxis]
    assert split._lasts()


@pytest.mark.serial
def test_damping_of_a_thin_shell_makes_no_energy_in_impacts() -> None:
    """Velocities of single nodes by impulses alone make eleven times the energy of motion here."""
    u = np.linspace(0.0, 0.05, 3)
    mesh = ff.SurfaceMesh.grid("sheet", u, u, lambda p: np.c_[p, 2e-4 + 0.05 * p[:, 0]])
    section = ff.ShellSection.isotropic(1e-4, ff.Material(131e9, 0.3, 8300.0))
    model = ff.Model("damped", surface=mesh)
    model.add(
        ff.Shell("sheet", section, element="director", damping=1e-3, velocity=(0.0, 0.0, -0.5)),
        ff.Contact("ground", "sheet", surfaces=ff.RigidPlane(ff.Ground()), law="barrier"),
        ff.EnergyProbe(),
    )  # fmt: skip
    options = ff.RunOptions(dt=2e-4, t_end=3e-3, rho_inf=0.3, quiet=True)
    total = energy(found := ff.simulate(model, options).history)
    # the criterion of energy; made by impulses of masses alone: 11.5
    assert (total.max() - total[0]) / found["energy_kinetic"][0] < 1e-6
    # there has been an impact: a sheet that falls freely has no strains
    assert found["energy_strain"].max() > 0.1 * total[0]


@pytest.mark.slow
@pytest.mark.serial
def test_damping_does_not_change_where_a_beam_rests_on_a_contact() -> None:
    """Damping has no force at rest, and takes what the energies have lost before."""
    mesh = ff.LineMesh.straight({"beam": np.array([[0.0, 0.0, 6e-3], [0.5, 0.0, 6e-3]])}, 4)
    section = ff.Section.circle(0.01, ff.Material(1e9, 0.3, 1000.0))
    found = []
    for damping, rho_inf in ((1e-2, 0.5), (5e-2, 1.0)):
        model = ff.Model("rest", mesh=mesh)
        ball = ff.RigidSphere(ff.Ground((0.5, 0.0, -5e-3)), 5e-3)
        model.add(
            ff.Beam("beam", section, damping=damping),
            ff.Rigid("clamp", ff.Ground((0.0, 0.0, 6e-3)), ff.Marker("beam", 0.0)),
            ff.Gravity((0.0, 0.0, -9.81)),
            ff.Contact("support", "beam", surfaces=ball, law="barrier"),
            ff.ContactProbe("at", "support"),
            ff.EnergyProbe(),
        )
        options = ff.RunOptions(dt=2e-3, t_end=0.6, rho_inf=rho_inf, quiet=True)
        history = ff.simulate(model, options).history
        # at rest: 5e-5 J on the way
        assert history["energy_kinetic"][-1] < 1e-12
        # steps before the rest are not exact; impulses with forces of damping at rest: 0.5 and 0.6
        lost = history["energy_dissipation"][-1]
        assert abs(history["energy_balance"][-1]) < 0.05 * lost
        found.append((history["energy_strain"][-1], history["at_fz"][-1]))
    # such impulses let the beam have 1.5 and 2 times the strain energy
    np.testing.assert_allclose(found[0], found[1], rtol=1e-5)
    # 3/8 of the weight are borne by a support that does not yield
    weight = 1000.0 * np.pi * 0.005**2 * 0.5 * 9.81
    assert 0.36 * weight < found[0][1] < 0.38 * weight


def heavy_and_light() -> ff.Model:
    """Two boxes that fall on the ground beside each other, one of 1 kg, the other of 0.2 mg."""
    model, size = ff.Model("unlike"), np.array([0.1, 0.08, 0.06])
    falls = ((1.0, (2.063, -0.455, 2.878), 0.2844, 1.057),
             (1.66e-7, (2.483, -0.143, 2.183), 0.1209, 0.658))  # fmt: skip
    for k, (mass, turning, tilt, speed) in enumerate(falls):
        c, s = np.cos(tilt), np.sin(tilt)
        model.add(
            ff.RigidBody(f"box_{k}", mass, mass / 12.0 * np.diag((size**2).sum() - size**2),
                         position=(k, 0.0, 0.03 * c + 0.05 * s + 2e-4),
                         rotation=[[c, 0, s], [0, 1, 0], [-s, 0, c]], velocity=(0.1, 0, -speed),
                         angular_velocity=turning, shape=ff.Box(size)),
            ff.PositionProbe(f"x_{k}", ff.Marker(f"box_{k}")),
        )  # fmt: skip
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.Contact("all", surfaces=ff.RigidPlane(ff.Ground()), law="barrier"),
    )
    return model


@pytest.mark.three_ranks
def test_iterations_end_alike_where_ranks_have_unlike_forces() -> None:
    """Forces are accurate to a part of the largest one of all ranks, not of each rank's own."""
    options = ff.RunOptions(dt=1e-3, t_end=0.012, quiet=True)
    found, alone = (
        ff.simulate(heavy_and_light(), options, comm=comm)
        for comm in (MPI.COMM_WORLD, MPI.COMM_SELF)
    )
    if MPI.COMM_WORLD.rank == 0:
        # more on two ranks with the largest force of each, and positions differ by 7e-5 m
        assert found.summary["newton_iterations"] == alone.summary["newton_iterations"]
        for name in (f"x_{k}_{a}" for k in range(2) for a in "xyz"):
            np.testing.assert_allclose(found.history[name], alone.history[name], atol=1e-9)


def tumbling() -> ff.Model:
    model = ff.Model("tumbling")
    inertia = 0.01 * np.eye(3)
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.RigidBody("a", 1.0, inertia, position=(0.0, 0.0, 0.35), velocity=(0.3, 0.0, -1.5),
                     angular_velocity=(1.0, 2.0, 3.0), shape=ff.Box((0.2, 0.2, 0.2))),
        ff.RigidBody("b", 1.0, inertia, position=(0.1, 0.05, 0.1), shape=ff.Box((0.3, 0.2, 0.1))),
        ff.RigidBody("ball", 1.0, inertia, position=(-0.16, 0.0, 0.25), shape=ff.Sphere(0.05)),
        ff.Contact("all", surfaces=ff.RigidPlane(ff.Ground())),
        ff.ContactProbe("touch", "all"), ff.EnergyProbe(),
    )  # fmt: skip
    return model


@pytest.mark.serial
def test_boxes_and_balls_keep_their_energy_in_the_energy_momentum_scheme() -> None:
    found = run_undamped(
        tumbling(), 1e-3, 0.12, MPI.COMM_SELF, integrator="energy_momentum"
    ).history
    total = energy(found)
    # generalized-alpha, which is exact for bodies that do not turn, makes 4e-4
    assert np.ptp(total) < 1e-7 * found["energy_kinetic"].max()
    assert found["touch_gap"].min() > 0.0
    assert found["touch_closed"].max() > 0


def block(scale: float, angle: float, friction: float, speed: float = 0.0) -> ff.Model:
    """A block on a slope; its probe has the way and the speed along it."""
    a = np.radians(angle)
    normal, down = np.array([np.sin(a), 0.0, np.cos(a)]), np.array([np.cos(a), 0.0, -np.sin(a)])
    axes = np.column_stack([down, [0.0, 1.0, 0.0], normal])
    size = scale * np.array([0.2, 0.2, 0.1])
    mass = scale**3
    inertia = mass / 12.0 * np.diag((size**2).sum() - size**2)
    model = ff.Model("block")
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.RigidBody("block", mass, inertia, position=normal * (size[2] / 2 + 2e-4 * scale),
                     rotation=axes, velocity=speed * np.sqrt(scale) * down, shape=ff.Box(size)),
        ff.Contact("slope", "block", surfaces=ff.RigidPlane(ff.Ground(rotation=axes)),
                   friction=friction, restitution=0.0),
        ff.Probe("way", ff.Marker("block"), ("x", "v"),
                 lambda t, s: (s.position @ down, s.velocity @ down)),
        ff.EnergyProbe(),
    )  # fmt: skip
    return model


@pytest.mark.serial
def test_a_block_slides_sticks_and_stops_as_coulomb_says() -> None:
    angle, mu, g, t = np.radians(20.0), 0.3, 9.81, 0.1
    found = run_undamped(block(1.0, 20.0, mu), 2e-3, t, MPI.COMM_SELF).history
    expected = 0.5 * g * (np.sin(angle) - mu * np.cos(angle)) * t**2
    # the part of a step at the start in which friction is less; a lagged normal force misses 1e-2
    assert found["x"][-1] == pytest.approx(expected, rel=1e-3)
    assert np.diff(found["energy_dissipation"]).min() >= 0.0
    found = run_undamped(block(1.0, 10.0, mu), 2e-3, 0.2, MPI.COMM_SELF).history
    assert 0.0 <= found["v"][-1] < 3e-4  # creeps more slowly than the slip speed
    errors = []
    for scale in (1.0, 0.01):
        root = np.sqrt(scale)
        found = run_undamped(
            block(scale, 0.0, mu, speed=0.3), 2e-3 * root, 0.12 * root, MPI.COMM_SELF
        ).history
        errors.append(found["x"][-1] / (scale * 0.09 / (2.0 * mu * g)) - 1.0)
    assert abs(errors[0]) < 2e-3
    # a speed or a gap that is not scaled changes the error
    assert abs(errors[1] - errors[0]) < 1e-4


def hammer() -> ff.Model:
    model = ff.Model("hammer")
    model.add(
        ff.Gravity((0.0, 0.0, -9.81)),
        ff.RigidBody("ball", 1.0, 1e-3 * np.eye(3), position=(0.5, 0.0, 0.0),
                     shape=ff.Sphere(0.05)),
        ff.Revolute("hinge", ff.Ground(), ff.Marker("ball", offset=(-0.5, 0.0, 0.0)),
                    axis=(0.0, 1.0, 0.0)),
        ff.Contact("all", surfaces=ff.RigidPlane(ff.Ground((0.0, 0.0, -0.0502)))),
        ff.ContactProbe("touch", "all"), ff.PositionProbe("at", ff.Marker("ball")),
    )  # fmt: skip
    return model


@pytest.mark.slow_on_ranks
@pytest.mark.serial
def test_independent_coordinates_meet_the_same_barrier() -> None:
    found, other = (
        run_undamped(hammer(), 1e-3, 0.02, MPI.COMM_WORLD, integrator=name).history
        for name in ("independent_coordinates", "generalized_alpha")
    )
    if MPI.COMM_WORLD.rank == 0:
        assert found["touch_gap"].min() > 0.0
        assert found["touch_normal"].max() > 20.0
        for name in ("at_z", "touch_gap", "touch_normal"):
            scale = np.abs(other[name]).max()
            # a correction that is not cut passes through; one impact more or less changes 1e-1
            np.testing.assert_allclose(found[name], other[name], rtol=0.0, atol=1e-7 * scale)


@pytest.mark.serial
def test_what_barriers_cannot_do_is_refused_by_name() -> None:
    model = ff.Model("overlap")
    for name, x in (("a", 0.0), ("b", 0.15)):
        model.add(ff.RigidBody(name, 1.0, np.eye(3), position=(x, 0, 0), shape=ff.Sphere(0.1)))
    model.add(ff.Contact("all"))
    with pytest.raises(InputError, match=r'RigidBody "a" overlaps RigidBody "b" by 0.05 m at'):
        run_undamped(model, 1e-3, 2e-3, MPI.COMM_SELF)
    with pytest.raises(ValueError, match=r"restitution must lie in \[0, 1\], got 1.5"):
        ff.Contact("c", restitution=1.5)
    with pytest.raises(ValueError, match=r"static_friction must not be less than friction 0\.3"):
        ff.Contact("c", friction=0.3, static_friction=0.2)
