# SPDX-License-Identifier: LGPL-3.0-or-later
"""What every joint class must satisfy; a class without example fails."""

import importlib
import pkgutil
from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
import flexfem.joints
from flexfem.core.joint import Joint, RowKind
from flexfem.core.pose import Pose
from flexfem.lie import se3, so3
from flexfem.options import RunOptions
from flexfem.simulation.stepping import Simulation
from flexfem.system.constraints import Constraints, PlacedJoint

AXIS = np.array([0.6, -0.3, 0.8])
UNIT = AXIS / np.linalg.norm(AXIS)
ACROSS = np.cross(UNIT, [1.0, 0.0, 0.0])
#: gamma/(beta h) and beta h^2 of some time step
DYNAMICS = np.array([21.0, 0.013])


@dataclass(frozen=True)
class Example:
    """A joint to be tested.

    Attributes:
        cls: its class; arguments: all but name and markers.
        rows: number of its constraints.
        gap: vector from marker a to marker b at the start, inertial axes.
        driven: local motion of b relative to a (in a's axes) at time t that satisfies a drive.
    """

    cls: type[Joint]
    rows: int
    arguments: dict[str, Any]
    gap: np.ndarray
    driven: Callable[[float, np.ndarray], tuple[np.ndarray, np.ndarray]] | None = None

    @property
    def elastic(self) -> bool:
        return "stiffness" in self.arguments


def _vector(t: float) -> np.ndarray:
    return np.array([0.3 * t, -0.2 * t * t, np.sin(t)])


HERE, ALONG, APART = np.zeros(3), 1.3 * UNIT, np.array([0.4, 1.1, -0.7])
EXAMPLES = {
    "Spherical": Example(ff.Spherical, 3, {}, HERE),
    "Revolute": Example(ff.Revolute, 5, {"axis": AXIS}, HERE),
    "Rigid": Example(ff.Rigid, 6, {}, HERE),
    "Cylindrical": Example(ff.Cylindrical, 4, {"axis": AXIS}, ALONG),
    "Prismatic": Example(ff.Prismatic, 5, {"axis": AXIS}, ALONG),
    "PointOnLine": Example(ff.PointOnLine, 2, {"axis": AXIS}, ALONG),
    "PointOnPlane": Example(ff.PointOnPlane, 1, {"axis": AXIS}, 0.8 * ACROSS),
    "PrescribedTranslation": Example(
        ff.PrescribedTranslation, 3, {"displacement": _vector}, APART,
        lambda t, axis: (_vector(t), np.zeros(3)),
    ),
    "PrescribedTranslation-axis": Example(
        ff.PrescribedTranslation, 1, {"displacement": lambda t: 0.4 * t, "axis": AXIS}, APART,
        lambda t, axis: (0.4 * t * axis, np.zeros(3)),
    ),
    "PrescribedRotation": Example(
        ff.PrescribedRotation, 3, {"rotation": _vector}, APART,
        lambda t, axis: (np.zeros(3), _vector(t)),
    ),
    "PrescribedAngle": Example(
        ff.PrescribedAngle, 1, {"axis": AXIS, "angle": lambda t: 0.7 * t}, APART,
        lambda t, axis: (np.zeros(3), 0.7 * t * axis),
    ),
    "SpringDamper": Example(
        ff.SpringDamper, 1, {"stiffness": 70.0, "damping": 4.0, "rest_length": 0.9}, APART
    ),
    "SpringDamper-spring": Example(ff.SpringDamper, 1, {"stiffness": 70.0}, APART),
    "SpringDamper-damper": Example(ff.SpringDamper, 1, {"stiffness": 0.0, "damping": 4.0}, APART),
    "TorsionalSpringDamper": Example(
        ff.TorsionalSpringDamper, 1,
        {"axis": AXIS, "stiffness": 70.0, "damping": 4.0, "rest_angle": 0.3}, APART,
    ),
}  # fmt: skip
EVERY = pytest.mark.parametrize("example", EXAMPLES.values(), ids=EXAMPLES)
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
    assert _classes() == {example.cls for example in EXAMPLES.values()}


class Placed:
    """One joint between two nodes, its markers with offsets and axes of their own."""

    def __init__(self, example: Example, rng: np.random.Generator, ground: bool = False) -> None:
        nodes = se3.exp(rng.normal(size=(2, 6)))
        first = se3.compose(nodes[0], se3.exp(rng.normal(size=6)))
        turn = so3.exp(rng.normal(size=3))
        second = se3.frame(se3.position(first) + example.gap, turn)
        offsets = se3.compose(se3.inverse(nodes), np.array([first, second]))
        poses = tuple(Pose(se3.position(h), se3.rotation(h)) for h in (first, second))
        self.slots = (0, 1)
        if ground:  # the first marker does not move
            offsets[0], self.slots = first, (-1, 1)
        self.start, self.offsets, self.poses = nodes, offsets, poses
        self.face = SimpleNamespace(
            keys=[(1, 0), (1, 1)], frames=nodes.copy(), velocities=np.zeros((2, 6)),
            increments=np.zeros((2, 6)), inertial=np.zeros(2, dtype=bool),
        )  # fmt: skip
        joint = example.cls("joint", ff.Ground(), ff.Ground(), **example.arguments)
        self.rows = Constraints(
            MPI.COMM_SELF,
            [PlacedJoint(joint, 0, poses, self.slots, offsets, owned=True, shared=False)],
            self.face,
        )

    def evaluate(self) -> np.ndarray:
        self.rows.evaluate(DYNAMICS)
        return self.rows.values.copy()

    def disturb(self, rng: np.random.Generator) -> None:
        """A state off the constraints, moving, with a finite increment."""
        self.face.frames[:] = se3.retract(self.start, 0.3 * rng.normal(size=(2, 6)))
        self.face.velocities[:] = rng.normal(size=(2, 6))
        self.face.increments[:] = 0.2 * rng.normal(size=(2, 6))

    def rigid(self) -> None:
        """Make elastic rows rigid, so that values are those of the constraint functions."""
        self.rows.elastic[:] = 0.0
        self.rows._damped = False

    def derivative(self, function: Callable[[], np.ndarray], eps: float = 1e-5) -> np.ndarray:
        """Central differences along all 12 local twists; velocities follow the increments."""
        face = self.face
        kept = [a.copy() for a in (face.frames, face.velocities, face.increments)]
        columns = []
        for k in range(12):
            sides = []
            for sign in (1.0, -1.0):
                step = sign * eps * np.eye(12)[k].reshape(2, 6)
                face.frames[:] = se3.retract(kept[0], step)
                if face.inertial.all():
                    self._follow_inertial(kept, step)
                else:
                    n = se3.log(se3.compose(se3.exp(kept[2]), se3.exp(step)))
                    face.velocities[:] = kept[1] + DYNAMICS[0] * (n - kept[2])
                    face.increments[:] = n
                sides.append(np.array(function(), copy=True))
            columns.append((sides[0] - sides[1]) / (2.0 * eps))
        face.frames[:], face.velocities[:], face.increments[:] = kept
        return np.stack(columns, axis=-1)

    def _follow_inertial(self, kept: list[np.ndarray], step: np.ndarray) -> None:
        """Velocities after a step where translations are integrated in inertial axes."""
        face, (frames, velocities, increments) = self.face, kept
        R, turned = se3.rotation(frames), se3.rotation(face.frames)
        theta = so3.log(so3.exp(increments[:, 3:]) @ so3.exp(step[:, 3:]))
        speed = np.einsum("nij,nj->ni", R, velocities[:, :3])
        speed += DYNAMICS[0] * (face.frames[:, :3] - frames[:, :3])
        face.velocities[:, :3] = np.einsum("nji,nj->ni", turned, speed)
        face.velocities[:, 3:] = velocities[:, 3:] + DYNAMICS[0] * (theta - increments[:, 3:])
        face.increments[:, 3:] = theta


@EVERY
def test_start(example, rng):
    """The right number of rows, and rigid ones satisfied at the start."""
    joint = Placed(example, rng)
    assert joint.rows.size == example.rows
    if not example.elastic:
        # round-off; a direction in the wrong axes leaves a gap of order 1
        np.testing.assert_allclose(joint.evaluate(), 0.0, atol=1e-14)


@EVERY
@pytest.mark.parametrize("ground", [False, True], ids=["bodies", "ground"])
def test_gradient(example, ground, rng):
    joint = Placed(example, rng, ground)
    joint.disturb(rng)
    joint.rigid()
    expected = joint.derivative(joint.evaluate).reshape(-1, 2, 6)
    joint.evaluate()
    # differences are good to 1e-10; a missing lever arm or a transposed axis is of order 1
    np.testing.assert_allclose(joint.rows.force_jacobian, expected, atol=1e-7)
    np.testing.assert_array_equal(joint.rows.step_jacobian, joint.rows.force_jacobian)


@EVERY
@pytest.mark.parametrize("ground", [False, True], ids=["bodies", "ground"])
def test_second_derivatives(example, ground, rng):
    joint = Placed(example, rng, ground)
    joint.disturb(rng)
    joint.rigid()
    factor = rng.normal(size=example.rows)

    def force() -> np.ndarray:
        joint.evaluate()
        return np.einsum("r,rij->ij", factor, joint.rows.force_jacobian).ravel()

    expected = joint.derivative(force)
    joint.evaluate()
    # differences are good to 1e-9; a symmetrised derivative would differ by the forces themselves
    np.testing.assert_allclose(joint.rows.hessians(factor)[0], expected, atol=1e-7)


@EVERY
def test_second_rates(example, rng):
    """Acceleration of every row at constant local velocities, from differences of its rate."""
    joint, eps, sides = Placed(example, rng), 1e-5, []
    joint.disturb(rng)
    joint.rigid()
    frames = joint.face.frames.copy()
    for sign in (1.0, -1.0):
        joint.face.frames[:] = se3.retract(frames, sign * eps * joint.face.velocities)
        joint.evaluate()
        sides.append(joint.rows.rates())
    joint.face.frames[:] = frames
    joint.evaluate()
    # centripetal terms left out would be of order 1
    np.testing.assert_allclose(
        joint.rows.second_rates(), (sides[0] - sides[1]) / (2.0 * eps), atol=1e-7
    )


@EVERY
def test_common_rigid_motion_changes_nothing(example, rng):
    joint = Placed(example, rng)
    joint.disturb(rng)
    before, gradient = joint.evaluate(), joint.rows.force_jacobian.copy()
    motion = se3.exp(np.array([3.0, -2.0, 1.0, 0.9, 1.4, -0.5]))
    joint.face.frames[:] = se3.compose(motion, joint.face.frames)
    after = joint.evaluate()
    inertial = joint.rows._kinds == RowKind.INERTIAL
    # the gap of coinciding points has inertial components: it turns with the motion
    turned = before.copy()
    turned[inertial] = se3.rotation(motion) @ before[inertial] if inertial.any() else []
    np.testing.assert_allclose(after, turned, atol=1e-13)
    # local forces of all other rows stay as they are; inertial axes in them would turn them
    np.testing.assert_allclose(
        joint.rows.force_jacobian[~inertial], gradient[~inertial], atol=1e-13
    )


@EVERY
def test_forces_of_a_closed_joint_balance(example, rng):
    """Action and reaction: the gradients of both sides have no resultant in a satisfied state."""
    joint = Placed(example, rng)
    joint.evaluate()
    back = np.swapaxes(se3.adjoint(se3.inverse(joint.face.frames)), -1, -2)
    wrench = np.einsum("sij,rsj->ri", back, joint.rows.force_jacobian)
    # a force on b without its reaction on a is of order 1
    np.testing.assert_allclose(wrench, 0.0, atol=1e-13)


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


def _force(joint: Placed) -> float:
    """Force or moment of an elastic row from its equation at zero multiplier."""
    joint.rows.multipliers[:] = 0.0
    _, stiffness, damping = joint.rows.elastic[0]
    return joint.evaluate()[0] * (stiffness + damping * DYNAMICS[0])


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
    k, c = example.arguments["stiffness"], example.arguments.get("damping", 0.0)
    expected = k * (length - rest) + c * n @ (speed[1] - speed[0])
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
    joint.rows.multipliers[:] = 0.7
    expected = joint.derivative(joint.evaluate).reshape(-1, 2, 6)
    values = joint.evaluate()
    # rows are scaled to the size of a rigid one; frozen directions would be off by order 1e-1
    np.testing.assert_allclose(joint.rows.step_jacobian, expected, atol=1e-7)
    # the multiplier enters its own row through the compliance alone
    joint.rows.multipliers[:] = 0.7 + 1.0
    np.testing.assert_allclose(values - joint.evaluate(), joint.rows.compliance, rtol=1e-9)


def _model(joint: Joint) -> ff.Model:
    model = ff.Model("test")
    model.add(ff.RigidBody("body", 2.0, (0.2, 0.3, 0.4), position=(0.5, -0.2, 0.3)), joint)
    return model


@pytest.mark.parametrize("name", ["Spherical", "Revolute", "Rigid", "Cylindrical", "PointOnLine",
                                  "PointOnPlane", "Prismatic"])  # fmt: skip
def test_joint_with_a_gap_at_the_start_is_refused(name):
    example = EXAMPLES[name]
    marker = ff.Marker("body", offset=(0.1, 0.2, 0.3))
    joint = example.cls("elbow", ff.Ground((0.0, 1.0, 0.0)), marker, **example.arguments)
    with pytest.raises(ValueError, match=f'^{name} "elbow": .*violate') as raised:
        Simulation(_model(joint), RunOptions(dt=1e-3, t_end=1.0))
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("name", [n for n, e in EXAMPLES.items() if e.driven])
def test_drive_that_starts_elsewhere_is_refused(name):
    example = EXAMPLES[name]
    late = {
        key: (lambda t, f=value: f(t + 0.5)) if callable(value) else value
        for key, value in example.arguments.items()
    }
    joint = example.cls("motor", ff.Ground(), ff.Marker("body"), **late)
    with pytest.raises(ValueError, match=f'^{example.cls.__name__} "motor": .*violate'):
        Simulation(_model(joint), RunOptions(dt=1e-3, t_end=1.0))


def test_redundant_joints_are_named():
    axis, arm = np.array([0.3, 0.5, -0.8]), np.array([0.1, 0.2, 0.3])
    model = ff.Model("test")
    model.add(ff.RigidBody("body", 2.0, (0.2, 0.3, 0.4), position=(0.5, -0.2, 0.3)))
    for name, shift in (("one", 0.0), ("two", 0.7)):
        place, marker = arm + shift * axis, ff.Marker("body", offset=arm + shift * axis)
        ground = ff.Ground(place + np.array([0.5, -0.2, 0.3]))
        model.add(ff.Revolute(name, ground, marker, axis=axis))
    # an answer would have arbitrary multipliers
    with pytest.raises(ValueError, match=r'"one".*"two".*redundant'):
        Simulation(model, RunOptions(dt=1e-3, t_end=1.0))
