# SPDX-License-Identifier: LGPL-3.0-or-later
"""What every joint class must satisfy; a class without example fails."""

import importlib
import pkgutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest

import flexfem as ff
import flexfem.joints
from flexfem.core.joint import Joint
from flexfem.core.pose import Pose
from flexfem.core.row import RowKind
from flexfem.lie import se3, so3
from flexfem.options import RunOptions
from flexfem.simulation.stepping import Simulation
from flexfem.system.constraints import Constraints
from flexfem.system.row_table import PlacedJoint

AXIS = np.array([0.6, -0.3, 0.8])
UNIT = AXIS / np.linalg.norm(AXIS)
ACROSS = np.cross(UNIT, [1.0, 0.0, 0.0])
#: gamma/(beta h) and beta h^2 of some time step
DYNAMICS = np.array([21.0, 0.013])


@dataclass(frozen=True)
class Example:
    """A joint to be tested.

    Attributes:
        cls: its class; arguments: all but name and markers, of which there are ``markers``.
        rows: number of its constraints.
        gap: vector from marker a to marker b at the start, inertial axes.
        driven: local motion of b relative to a (in a's axes) at time t that satisfies a drive.
    """

    cls: type[Joint]
    rows: int
    arguments: dict[str, Any]
    gap: np.ndarray
    driven: Callable[[float, np.ndarray], tuple[np.ndarray, np.ndarray]] | None = None
    elastic: bool = False
    make: Callable[[], Joint] | None = None
    markers: int = 2

    def joint(self) -> Joint:
        if self.make is not None:
            return self.make()
        return self.cls("joint", ff.Ground(), ff.Ground(), **self.arguments)


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
        ff.SpringDamper, 1, {"stiffness": 70.0, "damping": 4.0, "rest_length": 0.9}, APART,
        elastic=True,
    ),
    "SpringDamper-spring": Example(
        ff.SpringDamper, 1, {"stiffness": 70.0}, APART, elastic=True
    ),
    "SpringDamper-damper": Example(
        ff.SpringDamper, 1, {"stiffness": 0.0, "damping": 4.0}, APART, elastic=True
    ),
    "TorsionalSpringDamper": Example(
        ff.TorsionalSpringDamper, 1,
        {"axis": AXIS, "stiffness": 70.0, "damping": 4.0, "rest_angle": 0.3}, APART,
        elastic=True,
    ),
}  # fmt: skip


def _ground(count: int) -> list[ff.Ground]:
    return [ff.Ground() for _ in range(count)]


def _slider() -> ff.Cylindrical:
    return ff.Cylindrical("slider", *_ground(2), axis=AXIS)


ROOT = np.random.default_rng(3).normal(size=(6, 6))
FULL, VISCOUS = ROOT @ ROOT.T, ROOT.T @ ROOT
RADIAL = {"velocity": 0.8, "viscous": 0.3}
EXAMPLES |= {
    "Universal": Example(ff.Universal, 4, {"axis": AXIS, "second_axis": ACROSS}, HERE),
    "ConstantVelocity": Example(ff.ConstantVelocity, 4, {"axis": AXIS}, HERE),
    "ConstantVelocity-bent": Example(
        ff.ConstantVelocity, 4, {"axis": AXIS, "second_axis": AXIS + 0.7 * ACROSS}, HERE
    ),
    "Screw": Example(ff.Screw, 5, {"axis": AXIS, "pitch": 0.4}, ALONG),
    "Planar": Example(ff.Planar, 3, {"axis": AXIS}, 0.8 * ACROSS),
    "Distance": Example(ff.Distance, 1, {}, APART),
    "Gear": Example(
        ff.Gear, 1, {}, APART, markers=4,
        make=lambda: ff.Gear(
            "joint", *_ground(4), axis=AXIS, second_axis=(1.0, 2.0, -0.5), ratio=-1.7
        ),
    ),
    "RigidNodes": Example(
        ff.RigidNodes, 12, {}, APART, markers=3,
        make=lambda: ff.RigidNodes("joint", *_ground(1), nodes=_ground(2)),
    ),
    "Generic-locked": Example(ff.Generic, 6, {}, HERE),
    "Generic-one": Example(ff.Generic, 4, {"free": ("x", "ry")}, HERE),
    "Generic-two": Example(ff.Generic, 4, {"free": ("rz", "rx")}, HERE),
    "Generic-three": Example(ff.Generic, 2, {"free": ("rz", "y", "rx", "ry")}, HERE),
    "Generic-limits": Example(
        ff.Generic, 6, {"free": ("x", "ry"), "limits": {
            "x": (-0.01, 0.01, 30.0, 2.0), "ry": (-0.02, 0.01, 7.0, 0.5)}}, HERE, elastic=True,
    ),
    "Bushing": Example(
        ff.Bushing, 6, {"stiffness": np.arange(1.0, 7.0), "damping": np.full(6, 0.2)}, APART,
        elastic=True,
    ),
    "Bushing-full": Example(
        ff.Bushing, 12, {"stiffness": FULL, "damping": VISCOUS}, APART, elastic=True
    ),
    "LimitStop": Example(
        ff.LimitStop, 1, {"axis": AXIS, "upper": -3.0, "stiffness": 70.0, "damping": 9.0}, APART,
        elastic=True,
    ),
    "LimitStop-angle": Example(
        ff.LimitStop, 1, {"coordinate": "angle", "axis": AXIS, "lower": 2.9, "stiffness": 70.0,
                          "damping": 9.0}, APART, elastic=True,
    ),
    "LimitStop-distance": Example(
        ff.LimitStop, 1, {"coordinate": "distance", "lower": 0.1, "upper": 0.2, "stiffness": 70.0,
                          "damping": 9.0}, APART, elastic=True,
    ),
    "JointFriction": Example(
        ff.JointFriction, 1, {}, ALONG, elastic=True,
        make=lambda: ff.JointFriction("joint", _slider(), "rotation", force=0.6, **RADIAL),
    ),
    "JointFriction-normal": Example(
        ff.JointFriction, 1, {}, ALONG, elastic=True,
        make=lambda: ff.JointFriction("joint", _slider(), "translation", coefficient=0.6, **RADIAL),
    ),
    "JointFriction-revolute": Example(
        ff.JointFriction, 1, {}, HERE, elastic=True,
        make=lambda: ff.JointFriction(
            "joint", ff.Revolute("hinge", *_ground(2), axis=AXIS), coefficient=0.6, radius=0.3,
            **RADIAL
        ),
    ),
    "Lock": Example(ff.Lock, 2, {}, ALONG, make=lambda: ff.Lock("joint", _slider(), locked=True)),
    "PrescribedDisplacement": Example(
        ff.PrescribedDisplacement, 1,
        {"displacement": ff.SmoothStep(0.0, 2.0, 0.0, 0.4), "axis": AXIS}, APART,
        lambda t, axis: (ff.SmoothStep(0.0, 2.0, 0.0, 0.4)(t) * axis, np.zeros(3)),
    ),
    "PrescribedDistance": Example(
        ff.PrescribedDistance, 1, {"elongation": ff.Table([0.0, 2.0], [0.0, 1.0])}, APART,
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
    """One joint between nodes, one for each marker, which has an offset and axes of its own."""

    def __init__(self, example: Example, rng: np.random.Generator, ground: bool = False) -> None:
        joint, n = example.joint(), example.markers
        nodes = se3.exp(rng.normal(size=(n, 6)))
        frames = [se3.compose(nodes[0], se3.exp(rng.normal(size=6)))]
        for k in range(1, n):
            turn = so3.exp(rng.normal(size=3))
            frames.append(se3.frame(se3.position(frames[0]) + k * example.gap, turn))
        offsets = se3.compose(se3.inverse(nodes), np.array(frames))
        poses = tuple(Pose(se3.position(h), se3.rotation(h)) for h in frames)
        slots = list(range(n))
        if ground:  # the first marker does not move
            offsets[0], slots[0] = frames[0], -1
        self.start, self.offsets, self.poses, self.count = nodes, offsets, poses, n
        self.face = SimpleNamespace(
            keys=[(1, k) for k in range(n)], frames=nodes.copy(), velocities=np.zeros((n, 6)),
            increments=np.zeros((n, 6)), inertial=np.zeros(n, dtype=bool),
        )  # fmt: skip
        placed = [PlacedJoint(joint, 0, poses, tuple(slots), offsets, owned=True, shared=False)]
        if joint.partner is not None:
            placed.insert(0, replace(placed[0], joint=joint.partner, index=1))
        self.rows = Constraints(MPI.COMM_SELF, placed, self.face)

    def evaluate(self) -> np.ndarray:
        self.rows.evaluate(DYNAMICS)
        return self.rows.values.copy()

    def disturb(self, rng: np.random.Generator) -> None:
        """A state off the constraints, moving, with a finite increment."""
        n = self.count
        self.face.frames[:] = se3.retract(self.start, 0.3 * rng.normal(size=(n, 6)))
        self.face.velocities[:] = rng.normal(size=(n, 6))
        self.face.increments[:] = 0.2 * rng.normal(size=(n, 6))

    def rigid(self) -> None:
        """Make all rows rigid and hold, so that values are those of the constraint functions."""
        self.rows.elastic[:] = 0.0
        self.rows.active[:] = True
        self.rows._damped = False

    def dense(self, jacobian: np.ndarray) -> np.ndarray:
        """Sum (t, 2, 6) of terms to (r, n, 6) of rows and nodes."""
        rows, out = self.rows, np.zeros((self.rows.size, self.count + 1, 6))
        np.add.at(out, (rows.row_of_term[:, np.newaxis], rows.term_slots), jacobian)
        return out[:, :-1]

    def hessian(self, factor: np.ndarray) -> np.ndarray:
        """Second derivatives of all rows over all nodes, (6 n, 6 n)."""
        slots, n = self.rows.pair_slots, self.count
        out = np.zeros((n + 1, n + 1, 6, 6))
        blocks = self.rows.hessians(factor).reshape(-1, 2, 6, 2, 6).transpose(0, 1, 3, 2, 4)
        np.add.at(out, (slots[:, :, np.newaxis], slots[:, np.newaxis, :]), blocks)
        return out[:-1, :-1].transpose(0, 2, 1, 3).reshape(6 * n, 6 * n)

    def derivative(self, function: Callable[[], np.ndarray], eps: float = 1e-5) -> np.ndarray:
        """Central differences along all local twists; velocities follow the increments."""
        face = self.face
        kept = [a.copy() for a in (face.frames, face.velocities, face.increments)]
        columns = []
        for k in range(6 * self.count):
            sides = []
            for sign in (1.0, -1.0):
                step = sign * eps * np.eye(6 * self.count)[k].reshape(-1, 6)
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

    def force() -> np.ndarray:
        joint.evaluate()
        return np.einsum("r,rij->ij", factor, joint.dense(joint.rows.force_jacobian)).ravel()

    expected = joint.derivative(force)
    joint.evaluate()
    # differences are good to 1e-9; a symmetrised derivative would differ by the forces themselves
    np.testing.assert_allclose(joint.hessian(factor), expected, atol=1e-7)


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
    terms = joint.rows.kinds == RowKind.INERTIAL
    inertial = terms[joint.rows.term_start[:-1]]
    # the gap of coinciding points has inertial components: it turns with the motion
    turned = before.copy()
    turned[inertial] = (before[inertial].reshape(-1, 3) @ se3.rotation(motion).T).ravel()
    np.testing.assert_allclose(after, turned, atol=1e-13)
    # local forces of all other rows stay as they are; inertial axes in them would turn them
    np.testing.assert_allclose(joint.rows.force_jacobian[~terms], gradient[~terms], atol=1e-12)


@EVERY
def test_forces_of_a_closed_joint_balance(example, rng):
    """Action and reaction: the gradients of both sides have no resultant in a satisfied state."""
    joint = Placed(example, rng)
    joint.evaluate()
    back = np.swapaxes(se3.adjoint(se3.inverse(joint.face.frames)), -1, -2)
    wrench = np.einsum("sij,rsj->ri", back, joint.dense(joint.rows.force_jacobian))
    # a force on b without its reaction on a is of order 1
    np.testing.assert_allclose(wrench, 0.0, atol=1e-13)


@EVERY
@pytest.mark.parametrize("ground", [False, True], ids=["bodies", "ground"])
def test_reactions(example, ground, rng):
    """Wrenches at the markers from those on the nodes; the ground's from balance."""
    joint = Placed(example, rng, ground)
    joint.disturb(rng)
    joint.evaluate()
    rows = joint.rows
    rows.forces[:] = rng.normal(size=rows.size)
    wrench = np.zeros((rows.marker_start[-1], 6))
    for m, found in enumerate(rows.reactions()):
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


@pytest.mark.parametrize("name", [n for n, e in EXAMPLES.items() if e.cls.driven])
def test_drive_that_starts_elsewhere_is_refused(name):
    example = EXAMPLES[name]
    late = {
        key: (lambda t, f=value: f(t + 0.5)) if callable(value) else value
        for key, value in example.arguments.items()
    }
    joint = example.cls("motor", ff.Ground((3.0, 0.0, 0.0)), ff.Marker("body"), **late)
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
