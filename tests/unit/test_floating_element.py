# SPDX-License-Identifier: LGPL-3.0-or-later
"""Forces and matrices of bodies in floating frames, against bodies made of particles."""

import numpy as np
import pytest

from flexfem.core.nodes import motion
from flexfem.core.nodes.frame_kernels import Nodes, step_rates_into
from flexfem.families.floating.inertia import BodyData, room_for
from flexfem.families.floating.loops import (
    add_motion,
    add_residual,
    coordinates_into,
    energies_into,
    tangents_into,
)
from flexfem.lie import se3, so3
from tests.called import called
from tests.unit.particle_body import coordinates, particle_body, positions, state

pytestmark = pytest.mark.serial

GRAVITY = np.array([0.3, -0.2, -9.0])
KINDS = [
    {},
    {"stiffening": True},
    {"mean_axes": True},
    {"mean_axes": True, "stiffening": True},
    {"nonlinear": True},
]


def _nodes(frames):
    return np.arange(len(frames), dtype=np.int32)[np.newaxis]


def _seen(kind, *arrays):
    """Nodes of the element: without the frame where it follows from the other nodes."""
    return tuple(array[1:] if "mean_axes" in kind else array for array in arrays)


def _body(data, frames):
    """Data for loops of a body with these nodes."""
    return data.memory, room_for(data, len(frames)).memory, _nodes(frames)


def _state(**given):
    """Nodes with these arrays, the others zero."""
    kinds = {name: layout.axes for name, (_, layout) in Nodes.fields.items()}
    nothing = {name: np.zeros((1,) * axes) for name, axes in kinds.items() if axes}
    return Nodes(**({"inertial": False} | nothing | {"unturned": np.array([-1])} | given))


def _residual(data, frames, velocity, acceleration, gravity=GRAVITY):
    out = np.zeros((len(frames), 6))
    nodes = _state(frames=frames, velocity=velocity, acceleration=acceleration, residual=out)
    add_residual(*_body(data, frames), nodes.memory, gravity, 1.0)
    return out


def _at(frames, velocity, acceleration, t):
    """Frames on a path with these twists and rates at t = 0."""
    return se3.retract(frames, t * velocity + 0.5 * t * t * acceleration)


@pytest.mark.parametrize("kind", [{}, {"stiffening": True}, {"nonlinear": True}], ids=str)
def test_forces_are_those_of_the_particles(rng, kind):
    """Virtual work of inertia, weight, elasticity and damping by central differences."""
    body = particle_body(rng, **kind)
    frames, velocity, acceleration = state(rng, body)
    h, eps = 1e-3, 1e-6
    path = [positions(body, _at(frames, velocity, acceleration, k * h)) for k in (-2, -1, 0, 1, 2)]
    inertial = np.tensordot([-1.0, 16.0, -30.0, 16.0, -1.0], path, 1) / (12.0 * h * h)
    ahead, behind = (coordinates(body, _at(frames, velocity, acceleration, t)) for t in (eps, -eps))
    lost = body.data.damping @ (ahead - behind) / (2.0 * eps)
    expected = np.zeros_like(velocity)
    for node in range(len(frames)):
        for i in range(6 if node <= len(body.rest) else 3):
            step = np.zeros_like(velocity)
            step[node, i] = eps
            ends = [se3.retract(frames, sign * step) for sign in (1.0, -1.0)]
            moved, bent = (
                (f(body, ends[0]) - f(body, ends[1])) / (2.0 * eps)
                for f in (positions, coordinates)
            )
            work = body.masses @ np.sum((inertial - GRAVITY) * moved, axis=1)
            stored = [np.zeros(1), np.zeros(1)]
            for energy, end in zip(stored, ends, strict=True):
                energies_into(*_body(body.data, end), end, energy)
            elastic = (stored[0] - stored[1])[0] / (2.0 * eps)
            expected[node, i] = work + elastic + lost @ bent
    found = _residual(body.data, frames, velocity, acceleration)
    found[-1, 1:3] = expected[-1, 1:3]  # of four amplitudes the second node has one
    # the differences are good to 1e-7; a missing Coriolis or weight term is above 1e-2
    assert found == pytest.approx(expected, rel=0, abs=1e-5 * np.abs(expected).max())


@pytest.mark.parametrize("kind", KINDS, ids=str)
def test_power_and_momenta(rng, kind):
    """Forces do the work by which energy changes, and their sums are the rates of the momenta."""
    body = particle_body(rng, **kind)
    kept = {name: getattr(body.data, name) for name in BodyData.fields}
    data = BodyData(**(kept | {"damping": np.zeros_like(body.data.damping)}))
    frames, velocity, acceleration = _seen(kind, *state(rng, body))

    def measured(t):
        at, moving = _at(frames, velocity, acceleration, t), velocity + t * acceleration
        out, energy, chosen = np.zeros(motion.WIDTH), np.zeros(1), np.array([True])
        add_motion(*_body(data, at), chosen, at, moving, out)
        energies_into(*_body(data, at), at, energy)
        return np.array([out[0] + energy[0], *out[motion.LINEAR :]])

    h = 1e-5
    rates = (measured(h) - measured(-h)) / (2.0 * h)
    force = _residual(data, frames, velocity, acceleration, np.zeros(3))
    R = se3.rotation(frames)
    bodies = slice(0, len(body.rest) + ("mean_axes" not in kind))
    turned, moments = (np.einsum("nij,nj->ni", R, part)[bodies] for part in np.split(force, 2, 1))
    total = turned.sum(axis=0)
    about_origin = (moments + np.cross(frames[bodies, :3], turned)).sum(axis=0)
    expected = np.array([np.sum(force * velocity), *total, *about_origin])
    # round-off of the differences is 1e-8; an unsymmetric mass would show at 1e-2
    assert rates == pytest.approx(expected, rel=0, abs=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize("inertial", [False, True])
@pytest.mark.parametrize("kind", KINDS, ids=str)
def test_matrices_are_derivatives(rng, kind, inertial):
    """Along the local twists of all nodes, velocities and accelerations following."""
    body = particle_body(rng, **kind)
    frames, velocity, acceleration = _seen(kind, *state(rng, body))
    increments = 0.1 * rng.normal(size=velocity.shape)
    increments[len(frames) - 2 :] = 0.0
    shifts, count = np.array([3.0, 7.0, 1.0]), len(frames)
    out = np.empty((1, 6 * count, 6 * count))
    nodes = _state(
        frames=frames, velocity=velocity, acceleration=acceleration, increment=increments
    )
    tangents_into(*_body(body.data, frames), nodes.memory, GRAVITY, shifts, inertial, out)
    expected, eps = np.zeros_like(out[0]), 1e-6
    rates_into = called(step_rates_into)
    for node in range(count):
        amplitudes = node >= count - 2
        by_v, by_w = np.empty(36), np.empty(36)
        rates_into(
            inertial, increments[node], velocity[node], acceleration[node], shifts, by_v, by_w
        )
        for i in range(3 if amplitudes else 6):
            ends = []
            for sign in (eps, -eps):
                moved, v, w = frames.copy(), velocity.copy(), acceleration.copy()
                moved[node] = se3.retract(frames[node], sign * np.eye(6)[i])
                v[node] += sign * by_v.reshape(6, 6)[:, i]
                w[node] += sign * by_w.reshape(6, 6)[:, i]
                ends.append(_residual(body.data, moved, v, w).ravel())
            expected[:, 6 * node + i] = (ends[0] - ends[1]) / (2.0 * eps)
    free = np.ones(6 * count, dtype=bool)
    free[-9:-6] = free[-5:] = False  # amplitudes do not rotate, the last node has one
    # differences reach 1e-9; a dropped term of the geometry is above 1e-3
    assert out[0][:, free] == pytest.approx(
        expected[:, free], rel=0, abs=1e-7 * np.abs(expected).max()
    )


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-3, 0.6, 0.65, 2.0, 3.0])
def test_rotations_count_as_rotation_vectors(rng, angle):
    """Near none, where series take over (0.64 rad), and far beyond what a linear body allows."""
    body = particle_body(rng, 1, 0)
    frames, still, _ = state(rng, body)
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    turned = se3.frame(body.rest[0], so3.exp(angle * axis))
    frames[1] = se3.compose(frames[0], turned)
    base, eta = np.empty((1, 24)), np.empty((1, 6, 3))
    coordinates_into(*_body(body.data, frames), frames, 0.0 * still, 0.0 * still, base, eta)
    # near half a turn round-off is divided by the sine; sin for the angle would be off by 1e-10
    # at 1e-3 rad
    assert eta[0, 3:, 0] == pytest.approx(angle * axis, rel=0, abs=2e-13)
