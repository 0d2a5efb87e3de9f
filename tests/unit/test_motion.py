# SPDX-License-Identifier: LGPL-3.0-or-later
"""Energies, momenta and rates of beams and masses against the equations of motion."""

import numpy as np
import pytest

import flexfem as ff
from flexfem.core.nodes import motion
from flexfem.layout.node_loads import NodeMasses
from flexfem.lie import se3, so3
from tests.unit.linear_law import linear_law

# a corner, so that section axes differ from those of the node
POINTS = np.array([[0.0, 0, 0], [0.4, 0, 0], [0.9, 0, 0], [0.9, 0.5, 0], [0.9, 0.8, 0.3]])
INERTIA = np.diag([3.0, 3.0, 3.0, 0.4, 0.1, 0.3])
INERTIA[3:, :3] = 3.0 * so3.skew(np.array([0.0, 0.05, -0.02]))
INERTIA[:3, 3:] = INERTIA[3:, :3].T
SECTION = ff.Section.general(stiffness=(900.0, 400.0, 500.0, 3.0, 2.0, 4.0), inertia=INERTIA)


@pytest.fixture
def moving(one_beam, rng):
    beam = one_beam(POINTS, SECTION, damping=0.02)
    beam.disturb(rng)
    return beam


def _motion(beam) -> np.ndarray:
    out, chosen = np.zeros(motion.WIDTH), np.ones(len(beam.beams.lengths), dtype=bool)
    beam.beams.add_motion(beam.block, chosen, out)
    return beam.comm.allreduce(out)


@pytest.mark.three_ranks
def test_beam_momenta_are_those_of_the_residual(moving):
    found = _motion(moving)[motion.LINEAR :]
    # round-off; section axes taken for the node's, or lumped translation, change it by percents
    np.testing.assert_allclose(found, moving.momenta(), rtol=1e-12, atol=1e-12)


@pytest.mark.three_ranks
def test_beam_kinetic_energy_is_that_of_the_residual(moving):
    block = moving.block
    block.acceleration[:] = 0.0
    without = moving.residual()
    block.acceleration[:] = block.velocity
    doubled = moving.total(np.sum((moving.residual() - without) * block.velocity[: block.owned]))
    # round-off; lumping the translation instead adds some percents
    assert _motion(moving)[motion.KINETIC] == pytest.approx(0.5 * doubled, rel=1e-12)


@pytest.mark.three_ranks
def test_first_moment_moves_with_the_linear_momentum(moving):
    block, eps = moving.block, 1e-6
    momentum, frames = _motion(moving)[motion.LINEAR : motion.ANGULAR], block.frames.copy()
    ends = []
    for sign in (1.0, -1.0):
        block.frames[:] = se3.compose(frames, se3.exp(sign * eps * block.velocity))
        ends.append(_motion(moving)[motion.FIRST : motion.LINEAR])
    # central differences: 1e-9 relative; the offset mass centre adds a percent
    np.testing.assert_allclose((ends[0] - ends[1]) / (2 * eps), momentum, rtol=1e-7)


@pytest.mark.three_ranks
def test_viscosity(moving):
    block, eps, beams = moving.block, 1e-6, moving.beams
    stress, strains = beams.viscosity(block)
    frames, ends, moved = block.frames.copy(), [], []
    for sign in (1.0, -1.0):
        block.frames[:] = se3.compose(frames, se3.exp(sign * eps * block.velocity))
        ends.append(beams.resultants(block.frames))
        moved.append(beams.viscosity(block)[1])
    # round-off; they are the strains of the beams but for the strains at rest
    np.testing.assert_allclose(moved[0] - moved[1], ends[0][0] - ends[1][0], atol=1e-12)
    np.testing.assert_allclose(moved[0] + moved[1], 2.0 * strains, atol=1e-9)
    block.frames[:] = frames
    # central differences; the two inverse tangent maps exchanged are off by the strain
    measured = 0.02 * (ends[0][1] - ends[1][1]) / (2 * eps)
    np.testing.assert_allclose(stress, measured, rtol=1e-6, atol=1e-6)


@pytest.mark.three_ranks
def test_power_of_viscosity_is_that_of_the_residual(one_beam, rng):
    powers = []
    for damping in (0.02, 0.0):
        beam = one_beam(POINTS, SECTION, damping=damping)
        beam.disturb(np.random.default_rng(5))
        force = beam.residual()
        powers.append(beam.total(np.sum(force * beam.block.velocity[: beam.block.owned])))
        if damping:
            block, stress = beam.block, beam.beams.viscosity(beam.block)[0]
            frames, ends = block.frames.copy(), []
            for sign in (1.0, -1.0):
                block.frames[:] = se3.compose(frames, se3.exp(sign * 1e-6 * block.velocity))
                ends.append(beam.beams.viscosity(block)[1])
            rates = (ends[0] - ends[1]) / 2e-6
            found = beam.total(np.einsum("m,mi,mi->m", beam.beams.lengths, stress, rates))
    # central differences; a length too many or too few is off by its size
    assert found == pytest.approx(powers[0] - powers[1], rel=1e-7)


@pytest.mark.serial
def test_viscosity_of_a_law(one_beam):
    """A law that says the same as stiffness and damping."""
    law = linear_law(SECTION.stiffness, 0.02)
    stresses, energies = [], []
    for section, damping in ((SECTION, 0.02), (SECTION.with_law(law), 0.0)):
        beam = one_beam(POINTS, section, damping=damping)
        beam.disturb(np.random.default_rng(5))
        stresses.append(beam.beams.viscosity(beam.block)[0])
        energies.append(beam.beams.energies(beam.block.frames))
    # round-off; the potential is half the power
    np.testing.assert_allclose(stresses[1], stresses[0], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(energies[1], energies[0], rtol=1e-9)


@pytest.mark.serial
def test_chosen_cells_have_their_own_resultants(moving):
    frames = moving.block.frames
    strain, resultant = moving.beams.resultants(frames)
    some = moving.beams.resultants(frames, np.array([3, 1]))
    # the same numbers, in the order asked for
    np.testing.assert_array_equal(some[0], strain[[3, 1]])
    np.testing.assert_array_equal(some[1], resultant[[3, 1]])


@pytest.mark.serial
def test_rigid_body_momenta(moving, rng):
    """A mass off the node: momenta of its centre, and its own spin."""
    mass, centre, J = 2.5, np.array([0.1, -0.2, 0.3]), np.diag([0.2, 0.3, 0.4])
    arm = so3.skew(centre)
    M = np.block([[mass * np.eye(3), -mass * arm], [mass * arm, J - mass * arm @ arm]])
    out, block = np.zeros(motion.WIDTH), moving.block
    NodeMasses([2], [M]).add_motion(block, np.array([True]), out)
    R, v = se3.rotation(block.frames[2]), block.velocity[2]
    x = block.frames[2, :3] + R @ centre
    speed = R @ (v[:3] + np.cross(v[3:], centre))
    np.testing.assert_allclose(out[motion.MASS], mass, rtol=1e-14)
    np.testing.assert_allclose(out[motion.FIRST : motion.LINEAR], mass * x, rtol=1e-13)
    np.testing.assert_allclose(out[motion.LINEAR : motion.ANGULAR], mass * speed, rtol=1e-13)
    expected = mass * np.cross(x, speed) + R @ (J @ v[3:])
    # round-off; Koenig's theorem with a term left out is off by percents
    np.testing.assert_allclose(out[motion.ANGULAR :], expected, rtol=1e-12)
    kinetic = 0.5 * mass * speed @ speed + 0.5 * v[3:] @ J @ v[3:]
    assert out[motion.KINETIC] == pytest.approx(kinetic, rel=1e-13)
    NodeMasses([2], [M]).add_motion(block, np.array([False]), out)
    assert out[motion.MASS] == mass
