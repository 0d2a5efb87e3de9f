# SPDX-License-Identifier: LGPL-3.0-or-later
"""Contract of every joint class; a class without example fails."""

import importlib
import pkgutil
from dataclasses import replace

import numpy as np
import pytest

import flexfem as ff
import flexfem.joints
from flexfem.core.joint import Joint
from flexfem.core.row import RowKind
from flexfem.joints.force import ForcePart
from flexfem.joints.hinge_line import LinePart
from flexfem.lie import se3, so3
from tests.contract.joint_examples import DYNAMICS, EXAMPLES, UNIT, Placed
from tests.contract.line_examples import SLIDING

# rows and terms of one process; what models make of joints is tested on all ranks elsewhere
pytestmark = pytest.mark.serial

EVERY = pytest.mark.parametrize("example", EXAMPLES.values(), ids=EXAMPLES)
#: Those without weight, whose forces balance.
WEIGHTLESS = pytest.mark.parametrize(
    "example",
    [example for example in EXAMPLES.values() if example.cls is not ff.Catenary],
    ids=[name for name, example in EXAMPLES.items() if example.cls is not ff.Catenary],
)
ELASTIC = [name for name, example in EXAMPLES.items() if example.elastic]


def _classes() -> set[type[Joint]]:
    for module in pkgutil.walk_packages(flexfem.joints.__path__, "flexfem.joints."):
        importlib.import_module(module.name)
    found, queue = set(), [Joint]
    while queue:
        queue += (below := queue.pop().__subclasses__())
        found |= {cls for cls in below if cls.__module__.startswith("flexfem.joints")}
    return found


def test_every_joint_class_has_an_example():
    # joints of lines have no rows of their own: tests/unit/test_joints_of_lines.py
    # those of forces have one law together: tests/verification/test_forces.py
    others = {ff.HingeLine, ff.ClampedLine, LinePart, ff.Force, ForcePart}
    assert _classes() == {e.cls for e in (*EXAMPLES.values(), *SLIDING.values())} | others


@EVERY
def test_start(example, rng):
    """The right number of rows, and rigid ones satisfied at the start."""
    joint = Placed(example, rng)
    assert np.sum(joint.rows.joint_of_row == 0) == example.rows
    joint.evaluate()
    if joint.rows.rigid.all():
        # round-off; a direction in the wrong axes leaves a gap of order 1
        np.testing.assert_allclose(joint.evaluate(), 0.0, atol=1e-14)


@EVERY
@pytest.mark.parametrize("ground", [False, True], ids=["bodies", "ground"])
def test_gradient(example, ground, rng):
    joint = Placed(example, rng, ground)
    joint.disturb(rng)
    joint.rigid()
    expected = joint.derivative(joint.evaluate).reshape(-1, joint.count, 6)
    joint.evaluate()
    # differences are good to 1e-10; a missing lever arm or a transposed axis is of order 1
    np.testing.assert_allclose(joint.dense(joint.rows.force_jacobian), expected, atol=1e-7)
    np.testing.assert_array_equal(joint.rows.step_jacobian, joint.rows.force_jacobian)


@EVERY
@pytest.mark.parametrize("ground", [False, True], ids=["bodies", "ground"])
def test_second_derivatives(example, ground, rng):
    joint = Placed(example, rng, ground)
    joint.disturb(rng)
    joint.rigid()
    factor = rng.normal(size=joint.rows.size)
    expected = joint.differenced_hessian(factor)
    # differences are good to 1e-9; a symmetrised derivative would differ by the forces themselves
    np.testing.assert_allclose(joint.hessian(factor), expected, atol=1e-7)


@EVERY
def test_second_rates(example, rng):
    """Acceleration of every row at constant local velocities, from differences of its rate."""
    joint = Placed(example, rng)
    joint.disturb(rng)
    joint.rigid()
    rates = joint.differenced_rates()
    # centripetal terms left out would be of order 1
    np.testing.assert_allclose(joint.rows.second_rates(), rates, atol=1e-7)


@WEIGHTLESS
def test_common_rigid_motion_changes_nothing(example, rng):
    joint = Placed(example, rng)
    joint.disturb(rng)
    before, gradient = joint.evaluate(), joint.rows.force_jacobian.copy()
    motion = se3.exp(np.array([3.0, -2.0, 1.0, 0.9, 1.4, -0.5]))
    joint.face.frames[:] = se3.compose(motion, joint.face.frames)
    after = joint.evaluate()
    terms = joint.rows.kinds == RowKind.INERTIAL
    inertial = terms[joint.rows.term_start[:-1]]
    # the gap of coinciding points has inertial components: it rotates with the motion
    turned = before.copy()
    turned[inertial] = (before[inertial].reshape(-1, 3) @ se3.rotation(motion).T).ravel()
    np.testing.assert_allclose(after, turned, atol=1e-13)
    # local forces of all other rows stay as they are; inertial axes in them would rotate them
    np.testing.assert_allclose(joint.rows.force_jacobian[~terms], gradient[~terms], atol=1e-12)


@WEIGHTLESS
def test_forces_of_a_closed_joint_balance(example, rng):
    """Action and reaction: the gradients of both sides have no resultant in a satisfied state."""
    joint = Placed(example, rng)
    joint.evaluate()
    back = np.swapaxes(se3.adjoint(se3.inverse(joint.face.frames)), -1, -2)
    wrench = np.einsum("sij,rsj->ri", back, joint.dense(joint.rows.force_jacobian))
    # a force on b without its reaction on a is of order 1
    np.testing.assert_allclose(wrench, 0.0, atol=1e-13)


@WEIGHTLESS
@pytest.mark.parametrize("ground", [False, True], ids=["bodies", "ground"])
def test_reactions(example, ground, rng):
    """Wrenches at the markers from those on the nodes; the ground's from balance."""
    joint = Placed(example, rng, ground)
    joint.disturb(rng)
    joint.evaluate()
    rows = joint.rows
    rows.forces[:] = rng.normal(size=rows.size)
    wrench = np.zeros((rows.marker_start[-1], 6))
    for m, found in enumerate(rows.reactions(rows.forces)):
        wrench[m % joint.count] += found  # a partner has the same markers
    node = -np.einsum("r,rni->ni", rows.forces, joint.dense(rows.force_jacobian))
    R = se3.rotation(joint.face.frames)
    force, moment = (np.einsum("nij,nj->ni", R, part) for part in (node[:, :3], node[:, 3:]))
    arm = np.einsum("nij,nj->ni", R, joint.offsets[:, :3])
    expected = np.concatenate([force, moment - np.cross(arm, force)], axis=1)
    if ground:
        # all forces of a joint balance, in any state; so do moments, but for the three rows of
        # coinciding points, whose moments balance where the points do coincide
        expected[0, :3] = -expected[1:, :3].sum(axis=0)
        expected[0, 3:] = wrench[0, 3:]
    # a moment about the node instead of the marker is of order 1
    np.testing.assert_allclose(wrench[: joint.count], expected, atol=1e-12)


@pytest.mark.parametrize("name", [n for n, e in EXAMPLES.items() if e.driven])
def test_driven_joints_follow_their_function(name, rng):
    example = EXAMPLES[name]
    assert example.cls.driven
    joint, local = Placed(example, rng), None
    for t in np.linspace(0.1, 1.2, 12):
        joint.rows.set_time(t)
        first = se3.compose(joint.face.frames[0], joint.offsets[0])
        start = [se3.frame(p.position, p.rotation) for p in joint.poses]
        relative = se3.compose(se3.inverse(start[0]), start[1])
        local = se3.rotation(start[0]).T @ UNIT
        shift, turn = example.driven(t, local)
        moved = se3.frame(se3.position(relative) + shift, so3.exp(turn) @ se3.rotation(relative))
        motion = se3.exp(rng.normal(size=6))  # wherever marker a may be
        first = se3.compose(motion, first)
        joint.face.frames[0] = se3.compose(first, se3.inverse(joint.offsets[0]))
        joint.face.frames[1] = se3.compose(se3.compose(first, moved), se3.inverse(joint.offsets[1]))
        # the opposite direction, or an axis left in inertial axes, shows as 0.1 and more
        np.testing.assert_allclose(joint.evaluate(), 0.0, atol=1e-13)
        joint.face.frames[1] = se3.retract(joint.face.frames[1], np.full(6, 0.1))
        assert np.abs(joint.evaluate()).max() > 1e-2
        joint.rows.accept()


@EVERY
def test_targets_are_all_that_a_drive_with_targets_changes(example, rng):
    """A run asks such a drive for its targets alone: terms and laws have to stay."""
    joint = Placed(example, rng)
    own = joint.rows.joints[-1]
    if own.targets(0.0) is None:
        return
    assert example.cls.driven
    first = own.rows(0.0)
    for t in (0.2, 0.9):
        rows = own.rows(t)
        assert [row.target for row in rows] == list(own.targets(t))
        for row, start in zip(rows, first, strict=True):
            assert row.law is start.law is None
            for term, before in zip(row.terms, start.terms, strict=True):
                np.testing.assert_array_equal(term.data, before.data)


def _force(joint: Placed) -> float:
    """Force or moment of an elastic row from its equation at zero multiplier."""
    joint.rows.multipliers[:] = 0.0
    return joint.evaluate()[0] / (joint.rows.compliance[0] * DYNAMICS[1])


@pytest.mark.parametrize("name", [n for n in ELASTIC if n.startswith("Spring")])
def test_spring_damper_force(name, rng):
    """k (length - rest) + c d(length)/dt, with points and velocities by hand."""
    example, joint = EXAMPLES[name], Placed(EXAMPLES[name], rng)
    joint.disturb(rng)
    rest = example.arguments.get("rest_length", np.linalg.norm(example.gap))
    frames, v = joint.face.frames, joint.face.velocities
    R, arm = se3.rotation(frames), joint.offsets[:, :3]
    x = frames[:, :3] + np.einsum("nij,nj->ni", R, arm)
    speed = np.einsum("nij,nj->ni", R, v[:, :3] + np.cross(v[:, 3:], arm))
    length = np.linalg.norm(x[1] - x[0])
    n = (x[1] - x[0]) / length
    rate, given = n @ (speed[1] - speed[0]), example.arguments
    if "force" in given:
        expected = given["force"](length - rest, rate)
    else:
        expected = given["stiffness"] * (length - rest) + given.get("damping", 0.0) * rate
    assert _force(joint) == pytest.approx(expected, rel=1e-12)
    # positive multipliers pull: the residual of b gets the force n, that of a the force -n
    np.testing.assert_allclose(joint.rows.force_jacobian[0, 1, :3], R[1].T @ n, atol=1e-14)
    np.testing.assert_allclose(
        joint.rows.force_jacobian[0, 0, 3:], np.cross(arm[0], R[0].T @ -n), atol=1e-14
    )


def test_torsional_spring_damper_moment(rng):
    """k (angle - rest) + c d(angle)/dt about the axis, beyond a full turn."""
    joint = Placed(EXAMPLES["TorsionalSpringDamper"], rng)
    spin, angle = 2.5, 0.0
    start = se3.compose(joint.start[1], joint.offsets[1])
    axis = UNIT
    while angle < 7.0:
        angle += 0.25
        turned = se3.frame(se3.position(start), so3.exp(angle * axis) @ se3.rotation(start))
        joint.face.frames[1] = se3.compose(turned, se3.inverse(joint.offsets[1]))
        local = se3.rotation(joint.face.frames[1]).T @ axis
        joint.face.velocities[1] = np.concatenate([np.zeros(3), spin * local])
        # an angle kept within a turn would drop by 70 * 2 pi after half a turn
        assert _force(joint) == pytest.approx(70.0 * (angle - 0.3) + 4.0 * spin, rel=1e-12)
        joint.rows.accept()


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_angles_stay_continuous_over_turns(direction, rng):
    joint, angle = Placed(EXAMPLES["PrescribedAngle"], rng), 0.0
    start = se3.compose(joint.start[1], joint.offsets[1])
    for _ in range(30):
        angle += 2.0 * direction  # less than half a turn a step
        turned = se3.frame(se3.position(start), so3.exp(angle * UNIT) @ se3.rotation(start))
        joint.face.frames[1] = se3.compose(turned, se3.inverse(joint.offsets[1]))
        # a memory that is not updated, or updated within an iteration, is off by 2 pi
        assert joint.evaluate()[0] == pytest.approx(angle, abs=1e-12)
        assert joint.evaluate()[0] == pytest.approx(angle, abs=1e-12)
        joint.rows.accept()


@pytest.mark.parametrize("name", ELASTIC)
@pytest.mark.parametrize("ground", [False, True], ids=["bodies", "ground"])
@pytest.mark.parametrize("inertial", [False, True], ids=["se3", "inertial"])
def test_step_jacobian_of_elastic_rows(name, ground, inertial, rng):
    """Their residual depends on positions, and on velocities through the increment."""
    joint = Placed(EXAMPLES[name], rng, ground)
    joint.face.inertial[:] = inertial
    joint.disturb(rng)
    rows = joint.rows
    rows.multipliers[:] = 0.7
    for _ in range(20):  # to the law's own force, on which friction is linearised
        rows.multipliers += np.where(rows.rigid, 0.0, joint.evaluate() / rows.compliance.clip(1e-9))

    def unscaled() -> np.ndarray:
        joint.evaluate()
        return np.where(rows.rigid, 0.0, rows.values / rows.compliance.clip(1e-9))

    expected = joint.derivative(unscaled).reshape(-1, joint.count, 6)
    joint.evaluate()
    jacobian = joint.dense(rows.step_jacobian)[~rows.rigid]
    jacobian /= rows.compliance[~rows.rigid, np.newaxis, np.newaxis]
    # differences are good to 1e-9; frozen directions would be off by order 1e-1
    np.testing.assert_allclose(jacobian, expected[~rows.rigid], atol=1e-7)
    # derivatives with respect to the multipliers
    eps = 1e-6
    for k in range(rows.size):
        sides = []
        for sign in (1.0, -1.0):
            rows.multipliers[k] += sign * eps
            sides.append(unscaled())
            rows.multipliers[k] -= sign * eps
        joint.evaluate()
        column = np.where(np.arange(rows.size) == k, rows.compliance, 0.0)
        here = rows.coupled[:, 1] == k
        np.add.at(column, rows.coupled[here, 0], rows.coupling[here])
        got = (sides[0] - sides[1]) / (2.0 * eps) * rows.compliance
        # a coupling to the normal forces left out is of order 1e-1
        np.testing.assert_allclose(got[~rows.rigid], -column[~rows.rigid], atol=1e-8)


@pytest.mark.parametrize("name", ["Bushing", "Bushing-full"])
def test_bushing_forces(name, rng):
    """Force and moment ``K q + C q'`` in the axes of marker a, after a small turn."""
    example, joint = EXAMPLES[name], Placed(EXAMPLES[name], rng)
    K, C = (np.diag(m) if np.ndim(m) == 1 else m for m in map(np.array, example.arguments.values()))
    axes, start = joint.poses[0].rotation, se3.compose(joint.start[1], joint.offsets[1])
    q, rate = rng.normal(size=(2, 6))
    q[3:] *= 1e-4
    turned = so3.exp(axes @ q[3:]) @ se3.rotation(start)
    moved = se3.frame(se3.position(start) + axes @ q[:3], turned)
    joint.face.frames[1] = se3.compose(moved, se3.inverse(joint.offsets[1]))
    to_node, arm = se3.rotation(joint.face.frames[1]).T @ axes, joint.offsets[1, :3]

    def motion(twist):
        """Local twist of the node behind marker b that moves as the given one in axes of a."""
        omega = to_node @ twist[3:]
        return np.concatenate([to_node @ twist[:3] - np.cross(omega, arm), omega])

    joint.face.velocities[1] = motion(rate)
    joint.rows.multipliers[:] = 0.0
    forces = joint.evaluate() / (joint.rows.compliance * DYNAMICS[1])
    gradient = forces @ joint.dense(joint.rows.force_jacobian)[:, 1]
    found = np.array([gradient @ motion(e) for e in np.eye(6)])
    expected = K @ q + C @ rate
    # products of turn and spin are 1e-4; two per cent of the damping 1e-2
    np.testing.assert_allclose(found, expected, atol=1e-3 * np.abs(expected).max())


@pytest.mark.parametrize(
    ("axis", "angle"), [(0, 1.4), (1, -1.4), (2, 1.4), (2, 2.8)], ids=["x", "y", "z", "z far"]
)
def test_bushing_that_turns_about_one_axis_has_a_moment_about_this_alone(axis, angle, rng):
    """Whatever the axes of its markers: angles by other references would be up to 0.7 rad."""
    joint = Placed(replace(EXAMPLES["Bushing"], arguments={"stiffness": np.arange(1.0, 7.0)}), rng)
    axes, start = joint.poses[0].rotation, se3.compose(joint.start[1], joint.offsets[1])
    turned = so3.exp(angle * axes[:, axis]) @ se3.rotation(start)
    moved = se3.frame(se3.position(start), turned)
    joint.face.frames[1] = se3.compose(moved, se3.inverse(joint.offsets[1]))
    joint.rows.multipliers[:] = 0.0
    forces = joint.evaluate() / (joint.rows.compliance * DYNAMICS[1])
    expected = np.zeros(6)
    expected[3 + axis] = (4.0 + axis) * angle
    np.testing.assert_allclose(forces, expected, atol=1e-9)


@pytest.mark.parametrize("radius", [0.3, 2.0])
def test_friction_of_a_hinge_has_the_lever_arm_of_its_radius(radius, rng):
    """Moment ``mu r N tanh(w / w_0) + c w``, N from the forces of the hinge."""
    mu, w0, c, spin = 0.4, 0.8, 0.3, 0.5
    example = replace(EXAMPLES["JointFriction-revolute"], make=lambda: ff.JointFriction(
        "joint", ff.Revolute("hinge", ff.Ground(), ff.Ground(), axis=UNIT), coefficient=mu,
        radius=radius, velocity=w0, viscous=c))  # fmt: skip
    joint = Placed(example, rng)
    rows, law = joint.rows, ~joint.rows.rigid
    R, arm = se3.rotation(joint.face.frames[1]), joint.offsets[1, :3]
    omega = R.T @ (spin * UNIT)
    joint.face.velocities[1] = np.r_[-np.cross(omega, arm), omega]
    push = 3.0 * np.eye(3)[0]  # force of the hinge: the first three rows hold its point
    scale = DYNAMICS[1]
    rows.multipliers[:] = 0.0
    place = np.flatnonzero(rows.kinds[rows.term_start[:-1]] == RowKind.INERTIAL)
    assert len(place) == 3
    rows.multipliers[place] = scale * push
    for _ in range(50):  # its tangent is that of the law only where force and rate agree
        rows.multipliers += np.where(law, joint.evaluate() / rows.compliance.clip(1e-9), 0.0)
    joint.evaluate()
    expected = mu * radius * 3.0 * np.tanh(spin / w0) + c * spin
    # without the radius 0.3 of it, or twice as much
    assert rows.multipliers[law] / scale == pytest.approx([expected], rel=1e-9)
