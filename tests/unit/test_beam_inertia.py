# SPDX-License-Identifier: LGPL-3.0-or-later
"""Inertia, weight and damping of the SE(3) beam: momenta, closed forms, dissipation."""

import numpy as np
import pytest

import flexfem as ff
from flexfem.core.nodes.motion import KINETIC, WIDTH
from flexfem.lie import se3, so3
from tests.unit.sections import shifted_sections

CORNERS = [[0, 0, 0], [0.5, 0, 0], [1, 0, 0], [1, 0.6, 0], [1, 0.6, 0.7], [1, 1.2, 0.7]]


def _arc(n: int, centre: float = 2.0) -> np.ndarray:
    """Arc of radius 2 and 2 rad about (0, centre, 0)."""
    s = np.linspace(0.0, 2.0, n + 1)
    return np.stack([2.0 * np.sin(s), centre - 2.0 * np.cos(s), 0.0 * s], axis=1)


def _helix(n: int) -> np.ndarray:
    s = np.linspace(0.0, 3.0, n + 1)
    return np.stack([np.cos(s), np.sin(s), 0.4 * s], axis=1)


SHAPES = {
    "straight": np.linspace([0.1, 0.2, -0.1], [1.3, 0.9, 0.8], 6),
    "arc": _arc(5),
    "helix": _helix(5),
    "corner": np.array(CORNERS, dtype=float),
}
MASS, CENTRE = 1.3, np.array([0.0, 0.11, -0.07])
FIRST = MASS * so3.skew(CENTRE)
ROTARY = np.array([[0.4, 0.05, 0.02], [0.05, 0.3, 0.01], [0.02, 0.01, 0.2]])
# the mass centre lies off the axis of the beam
SECTION = ff.Section.general(
    (50.0, 40.0, 30.0, 20.0, 10.0, 5.0), np.block([[MASS * np.eye(3), -FIRST], [FIRST, ROTARY]])
)
SIMPLE = ff.Section.general((1e3, 400.0, 300.0, 20.0, 10.0, 5.0), (2.0, 2.0, 2.0, 0.3, 0.2, 0.1))


@pytest.mark.parametrize("shape", SHAPES)
def test_residual_is_the_rate_of_the_momenta(one_beam, shape, rng):
    """Internal forces sum to nothing, inertia forces to the rate of momentum, in any state."""
    beam = one_beam(SHAPES[shape], SECTION, 0.03)
    beam.disturb(rng)
    block, state, eps, sides = beam.block, beam.state(), 1e-5, []
    rate = beam.wrench(beam.residual())
    for sign in (1.0, -1.0):
        block.frames[:] = se3.retract(state.frames, sign * eps * state.velocity)
        block.velocity[:] = state.velocity + sign * eps * state.acceleration
        sides.append(beam.momenta())
    expected = (sides[0] - sides[1]) / (2.0 * eps)
    # differences are good to 1e-9; an inertia force that is interpolated along the element misses
    # the rate by the square of its turning, 1e-2 here, and loses momentum over a run
    np.testing.assert_allclose(rate, expected, atol=1e-7 * np.abs(expected).max())


def _kinetic(beam) -> float:
    motion = np.zeros(WIDTH)
    beam.beams.add_motion(beam.block, np.ones(len(beam.beams.data.cells), dtype=bool), motion)
    return beam.total(motion[[KINETIC]])


@pytest.mark.parametrize("shape", SHAPES)
def test_power_of_the_inertia_forces_is_the_rate_of_the_kinetic_energy(one_beam, shape, rng):
    beam = one_beam(SHAPES[shape], SECTION)
    beam.disturb(rng)
    block, state, eps, sides = beam.block, beam.state(), 1e-5, []
    force = beam.residual()
    block.velocity[:], block.acceleration[:] = 0.0, 0.0
    force -= beam.residual()
    power = beam.total((force * state.velocity[: block.owned]).sum(axis=1))
    for sign in (1.0, -1.0):
        block.frames[:] = se3.retract(state.frames, sign * eps * state.velocity)
        block.velocity[:] = state.velocity + sign * eps * state.acceleration
        sides.append(_kinetic(beam))
    # differences are good to 1e-9; an energy with first moments lumped on the axis is off by 1e-2
    assert power == pytest.approx((sides[0] - sides[1]) / (2.0 * eps), rel=1e-7)


@pytest.mark.parametrize("shape", SHAPES)
def test_mass_matrix_is_positive_for_any_offset_and_gives_the_kinetic_energy(one_beam, shape, rng):
    _, section, _ = shifted_sections()
    beam = one_beam(SHAPES[shape], section)
    beam.disturb(rng)
    beam.block.increment[:] = 0.0  # else velocities change with a tangent map
    M = beam.beams.tangent(beam.block, np.zeros(3), np.array([0.0, 1.0, 0.0]), 1.0)
    M = M.reshape(-1, 12, 12)
    np.testing.assert_allclose(M, np.swapaxes(M, 1, 2), atol=1e-14)
    least = np.linalg.eigvalsh(M)[:, 0]
    # with first moments on the axis the least eigenvalues are negative, -0.04 and less
    assert least.min(initial=1.0) > 1e-5
    v = beam.block.velocity[beam.beams.data.cells].reshape(-1, 12)
    energy = beam.total(0.5 * np.einsum("mi,mij,mj->m", v, M, v))
    assert _kinetic(beam) == pytest.approx(energy, rel=1e-12)


def test_offset_and_centred_axes_are_two_descriptions_of_one_beam(one_beam, rng):
    """Forces of a straight beam with its axis beside and through the mass centres, any state."""
    centred, section, c = shifted_sections()
    points = np.linspace([0.1, 0.2, -0.1], [1.3, 0.9, 0.8], 6)
    beside, through = one_beam(points, section), one_beam(points, centred)
    gravity = np.array([3.0, -7.0, 2.0])
    beside.gravity, through.gravity = gravity, gravity
    beside.disturb(rng)
    shift = se3.frame(c, np.eye(3))
    X = se3.adjoint(se3.inverse(shift))
    a, b = beside.block, through.block
    b.frames[:] = se3.compose(a.frames, shift)
    b.velocity[:], b.acceleration[:] = a.velocity @ X.T, a.acceleration @ X.T
    expected = through.residual() @ X
    # first moments on the axis miss forces of the size of the inertia itself
    bound = 1e-13 * beside.largest(expected)
    assert beside.largest(beside.residual() - expected) <= bound
    assert _kinetic(beside) == pytest.approx(_kinetic(through), rel=1e-13)
    np.testing.assert_allclose(beside.momenta(), through.momenta(), rtol=1e-11)


def test_steady_rotation_about_the_centre_needs_no_resultant(one_beam):
    """Uniform rod about a principal axis of its centre: momenta constant with dv/dt = 0."""
    beam = one_beam(np.linspace([-1.0, 0, 0], [1.0, 0, 0], 5), SIMPLE)
    beam.block.velocity[:] = beam.rigidly(np.zeros(3), np.array([0.0, 0.0, 3.0]))
    force = beam.residual()
    # a wrong sign in ad^T leaves the centrifugal forces unbalanced by their own size, 9 here
    assert np.abs(beam.wrench(force)).max() <= 1e-13 * 9.0
    # and the centrifugal force -m omega^2 x itself, weighted with the nodes' hat functions
    shares = 0.5 / 6.0 * np.array([-2.5, -3.0, 0.0, 3.0, 2.5])
    np.testing.assert_allclose(beam.gather(force)[:, 0], -2.0 * 9.0 * shares, atol=1e-13 * 9.0)


def test_momenta_of_a_rigidly_moving_rod(one_beam):
    """Uniform rod of mass m about its end: L = (m l^2/3) omega and the section's own part."""
    beam = one_beam(np.linspace([0.0, 0, 0], [0.0, 3.0, 0], 5), SIMPLE)
    velocity, spin = np.array([1.0, -2.0, 0.5]), np.array([0.7, -0.2, 0.4])
    beam.block.velocity[:] = beam.rigidly(velocity, spin)
    mass, centre = 6.0, np.array([0.0, 1.5, 0.0])
    axes = se3.rotation(beam.gather(beam.block.start_frames))[0]
    inertia = mass * 9.0 / 3.0 * np.diag([1.0, 0.0, 1.0])
    inertia += 3.0 * axes @ np.diag([0.3, 0.2, 0.1]) @ axes.T
    linear = mass * (velocity + np.cross(spin, centre))
    angular = inertia @ spin + mass * np.cross(centre, velocity)
    # a lumped mass matrix gives l^2 (1/3 + 1/96) instead of l^2/3: 3 per cent
    np.testing.assert_allclose(beam.momenta(), np.concatenate([linear, angular]), rtol=1e-13)


@pytest.mark.parametrize("shape", SHAPES)
def test_linear_momentum_is_the_mass_times_the_mean_velocity_in_any_state(one_beam, shape, rng):
    beam = one_beam(SHAPES[shape], SIMPLE)
    beam.disturb(rng)
    block, cells = beam.block, beam.beams.data.cells
    speed = np.einsum("nij,nj->ni", se3.rotation(block.frames), block.velocity[:, :3])
    mean = 2.0 * beam.beams.lengths[:, np.newaxis] * speed[cells].mean(axis=1)
    # interpolated local velocities lose theta^2/6 of the mass of elements bent by theta: the
    # centre of mass of a free beam would not move on a straight line
    np.testing.assert_allclose(beam.momenta()[:3], beam.total(mean), atol=1e-12)


def test_momentum_of_an_arc_turning_about_its_end_is_of_second_order(one_beam):
    exact = 2.0 * (32.0 * (2.0 - np.sin(2.0)) + 0.1 * 4.0)
    errors = []
    for n in (8, 16):
        beam = one_beam(_arc(n), SIMPLE)
        beam.block.velocity[:] = beam.rigidly(np.zeros(3), np.array([0.0, 0.0, 2.0]))
        errors.append(abs(beam.momenta()[5] - exact) / exact)
    # first order would mean a length or a mass taken at one end of each element
    assert np.log2(errors[0] / errors[1]) >= 1.9
    assert errors[1] <= 2e-3


def test_weight_is_the_total_mass_times_gravity(one_beam):
    beam = one_beam(_arc(6), SECTION)
    beam.gravity = np.array([3.0, -7.0, 2.0])
    # masses count the arc length; chords would miss by 5e-3
    np.testing.assert_allclose(
        beam.wrench(beam.residual())[:3], -MASS * 4.0 * beam.gravity, rtol=1e-13
    )


def test_weight_acts_at_the_mass_centre_of_the_section(one_beam):
    beam = one_beam(np.linspace([-1.0, 0, 0], [1.0, 0, 0], 4), SECTION)
    beam.gravity = np.array([3.0, -7.0, 2.0])
    centre = se3.rotation(beam.gather(beam.block.start_frames))[0] @ CENTRE
    expected = -2.0 * MASS * np.cross(centre, beam.gravity)
    # half weights at the nodes: exact for a straight beam; without the offset the moment vanishes
    np.testing.assert_allclose(beam.wrench(beam.residual())[3:], expected, atol=1e-13)


def test_damping_is_proportional_to_stiffness_and_dissipates(one_beam, rng):
    """Its power is c rate^T D rate per length, with the rate from differences of the strain."""
    damping, eps = 0.03, 1e-6
    beam = one_beam(_helix(5), SECTION, damping)
    beam.disturb(rng)
    block, state, sides = beam.block, beam.state(), []
    force = beam.residual()
    for _, group in beam.beams.groups:
        group.cells.own[:, 7] = 0.0
    force -= beam.residual()
    power = beam.total((force * block.velocity[: block.owned]).ravel())
    for sign in (1.0, -1.0):
        block.frames[:] = se3.retract(state.frames, sign * eps * state.velocity)
        sides.append(beam.strain())
    rate, weights = (sides[0] - sides[1]) / (2.0 * eps), damping * beam.beams.lengths
    expected = beam.total(np.einsum("mi,ij,mj,m->m", rate, SECTION.stiffness, rate, weights))
    # a factor 2 (Rayleigh's function) or a rate per element instead of per length shows at once
    assert power == pytest.approx(expected, rel=1e-7)
    assert power > 0.0


def test_damping_leaves_rigid_motion_alone(one_beam):
    beam = one_beam(_helix(5), SECTION, 0.03)
    beam.block.velocity[:] = beam.rigidly(np.array([1.0, 2.0, 3.0]), np.array([0.5, -1.0, 0.2]))
    damped = beam.residual()
    for _, group in beam.beams.groups:
        group.cells.own[:, 7] = 0.0
    # mass-proportional damping, or rates that are not objective, would brake it by 1e-2
    assert beam.largest(damped - beam.residual()) <= 1e-12
