# SPDX-License-Identifier: LGPL-3.0-or-later
"""Loads inside elements of beams: power, tangents by differences, resultants of line loads."""

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
from flexfem.layout.numbered_model import NumberedModel
from flexfem.lie import se3, so3
from flexfem.system.build import build
from flexfem.system.measure.marker_states import MarkerStates
from flexfem.system.system import System

pytestmark = pytest.mark.serial

SECTION = ff.Section.general((9.0, 8.0, 7.0, 6.0, 5.0, 4.0), (2.0, 2.0, 2.0, 0.3, 0.2, 0.1))
CURVE = ff.NurbsCurve.arc((0, 0, 0), (2.0, 0, 0), (0, 0, 1), 1.2, degree=3, elements=3)
VECTOR = np.array([2.0, -3.0, 5.0])
MARKER = ff.Marker("beam", 0.43, (0.3, -0.5, 0.8), so3.exp(np.array([0.4, -1.1, 0.7])))


#: Two-node elements around corners: sections at the nodes are rotated against these.
KINKED = ff.LineMesh(
    [(0, 0, 0), (1, 0, 0), (2, 1, 0), (2, 2, 1)], [[0, 1], [1, 2], [2, 3]], {"beam": [0, 1, 2]}
)
ELEMENTS = pytest.mark.parametrize("elements", ["nurbs", "vectors", "se3"])


def _system(
    load: ff.PointForce | ff.PointMoment | ff.LineLoad, elements: str = "nurbs"
) -> tuple[System, NumberedModel]:
    curved = elements != "se3"
    rotations = "relative_rotation_vectors" if elements == "vectors" else None
    model = ff.Model("test", mesh=None if curved else KINKED)
    curve = CURVE if curved else None
    model.add(ff.Beam("beam", SECTION, curve=curve, interpolation=rotations), load)
    model.validate()
    serial = NumberedModel(model)
    system = build(serial, MPI.COMM_SELF, split_above=1)
    system.set_time(0.0)
    return system, serial


def _disturb(system: System, rng: np.random.Generator) -> None:
    block = system.parts[0].block
    block.frames[:] = se3.retract(block.frames, 0.3 * rng.normal(size=(len(block.frames), 6)))
    block.velocity[:] = rng.normal(size=block.velocity.shape)


def _forces(system: System) -> np.ndarray:
    (part,) = system.parts
    part.block.residual[:] = 0.0
    part.forces.add_residual(part.block, system.factors, 1.0)
    for inside in part.line_forces:
        inside.add_residual(part.block, system.factors, 1.0)
    return -part.block.residual


EVERY = pytest.mark.parametrize(
    ("kind", "follower"),
    [
        (ff.PointForce, False),
        (ff.PointForce, True),
        (ff.PointMoment, False),
        (ff.PointMoment, True),
    ],
    ids=["dead force", "follower force", "dead moment", "follower moment"],
)


@ELEMENTS
@EVERY
def test_power_is_the_load_times_the_velocity_of_its_point(kind, follower, elements, rng):
    system, serial = _system(kind("load", MARKER, VECTOR, follower=follower), elements)
    _disturb(system, rng)
    (state,) = MarkerStates(system, serial, [MARKER]).evaluate()
    inertial = state.rotation @ VECTOR if follower else VECTOR
    rate = state.velocity if kind is ff.PointForce else state.angular_velocity
    power = np.vdot(_forces(system), system.parts[0].block.velocity)
    # round-off; a force at another point or a missing lever arm is off in the first digit
    assert power == pytest.approx(inertial @ rate, rel=1e-12)


@ELEMENTS
def test_velocity_of_a_place_is_the_rate_of_its_position(elements, rng):
    system, serial = _system(ff.PointForce("load", MARKER, VECTOR), elements)
    _disturb(system, rng)
    block, eps = system.parts[0].block, 1e-6
    markers = MarkerStates(system, serial, [MARKER])
    (state,) = markers.evaluate()
    kept, ends = block.frames.copy(), []
    for sign in (1.0, -1.0):
        block.frames[:] = se3.retract(kept, sign * eps * block.velocity)
        ends += markers.evaluate()
    rate = (ends[0].position - ends[1].position) / (2.0 * eps)
    spin = so3.log(ends[0].rotation @ ends[1].rotation.T) / (2.0 * eps)
    # differences are good to 1e-9; a node's velocity instead of the point's is off by order one
    np.testing.assert_allclose(state.velocity, rate, atol=1e-7)
    np.testing.assert_allclose(state.angular_velocity, spin, atol=1e-7)


@ELEMENTS
@EVERY
def test_tangent_is_the_derivative_of_the_residual(kind, follower, elements, rng):
    system, _ = _system(kind("load", MARKER, VECTOR, follower=follower), elements)
    _disturb(system, rng)
    (part,) = system.parts
    (inside,) = part.line_forces
    block, eps = part.block, 1e-5
    frames, columns = block.frames.copy(), []
    nodes = inside.nodes[0]
    for node in nodes:
        for k in range(6):
            step, sides = np.zeros_like(block.step), []
            step[node, k] = eps
            for sign in (1.0, -1.0):
                block.frames[:] = se3.retract(frames, sign * step)
                sides.append(-_forces(system)[nodes].ravel())
            columns.append((sides[0] - sides[1]) / (2.0 * eps))
    block.frames[:] = frames
    tangent = inside.tangent(block, system.factors, 1.0)[0]
    # differences are good to 1e-9; without the second derivatives of the place it is of order one
    np.testing.assert_allclose(tangent, np.stack(columns, axis=-1), atol=1e-7)
    block.step[:] = rng.normal(size=block.step.shape)
    block.residual[:] = 0.0
    inside.add_action(block, system.factors, 0.5)
    expected = 0.5 * tangent @ block.step[nodes].ravel()
    np.testing.assert_allclose(block.residual[nodes].ravel(), expected, atol=1e-12)


@ELEMENTS
@EVERY
def test_resultant_of_a_load_is_the_load(kind, follower, elements, rng):
    """Sum of the forces on the nodes, and of their moments about the inertial origin."""
    system, serial = _system(kind("load", MARKER, VECTOR, follower=follower), elements)
    _disturb(system, rng)
    (state,) = MarkerStates(system, serial, [MARKER]).evaluate()
    inertial = state.rotation @ VECTOR if follower else VECTOR
    force = inertial if kind is ff.PointForce else np.zeros(3)
    moment = np.cross(state.position, force) + (inertial if kind is ff.PointMoment else 0.0)
    block, local = system.parts[0].block, _forces(system)
    R = se3.rotation(block.frames)
    forces = np.einsum("nij,nj->ni", R, local[:, :3])
    moments = np.cross(block.frames[:, :3], forces) + np.einsum("nij,nj->ni", R, local[:, 3:])
    # round-off; at the nearest node, or shared out without moments, a tenth of the moment is lost
    np.testing.assert_allclose(forces.sum(axis=0), force, atol=1e-12)
    np.testing.assert_allclose(moments.sum(axis=0), moment, atol=1e-11)


@pytest.mark.parametrize("follower", [False, True])
def test_resultant_of_a_line_load_on_an_arc(follower):
    """Uniform in inertial axes, or in the section axes that rotate along the arc."""
    system, _ = _system(ff.LineLoad("load", "beam", (0.0, 3.0, 0.0), follower=follower))
    block = system.parts[0].block
    R = se3.rotation(block.frames)
    local = _forces(system)
    forces = np.einsum("nij,nj->ni", R, local[:, :3])
    moments = np.cross(block.frames[:, :3], forces) + np.einsum("nij,nj->ni", R, local[:, 3:])
    # radius 2 m, angle 1.2 rad; e2 starts horizontally and points to the axis of the arc
    s, c, r = np.sin(1.2), np.cos(1.2), 2.0
    total = 3.0 * r * np.array([-s, c - 1.0, 0.0] if follower else [0.0, 1.2, 0.0])
    moment = 0.0 if follower else 3.0 * r * r * s
    # frames of three elements, interpolated, follow the arc to 5e-5; half on each end of an
    # element is off by 1e-2
    np.testing.assert_allclose(forces.sum(axis=0), total, atol=1e-3 if follower else 1e-12)
    np.testing.assert_allclose(moments.sum(axis=0)[2], moment, atol=1e-3 if follower else 1e-11)


@ELEMENTS
def test_masses_inside_elements_are_refused(elements):
    curved = elements == "nurbs"
    model = ff.Model("test", mesh=None if curved else KINKED)
    model.add(
        ff.Beam("beam", SECTION, curve=CURVE if curved else None),
        ff.PointMass("lump", 1.0, MARKER),
    )
    with pytest.raises(ValueError, match=r'^PointMass "lump": Marker on "beam": point 0.43 lies'):
        build(NumberedModel(model), MPI.COMM_SELF, split_above=1)
