# SPDX-License-Identifier: LGPL-3.0-or-later
"""An example of every joint class, and one joint between nodes of its own."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

from mpi4py import MPI

import numpy as np

import flexfem as ff
from flexfem.constraints.batch import Constraints
from flexfem.constraints.rows.data import InterfaceNodes
from flexfem.constraints.rows.placed_joint import PlacedJoint
from flexfem.core.joint import Joint
from flexfem.core.pose import Pose
from flexfem.joints.elastic_lock import ElasticLock
from flexfem.lie import se3, so3

AXIS = np.array([0.6, -0.3, 0.8])
UNIT = AXIS / np.linalg.norm(AXIS)
ACROSS = np.cross(UNIT, [1.0, 0.0, 0.0])
#: gamma/(beta h) and beta h^2 of some time step
DYNAMICS = np.array([21.0, 0.013])


@dataclass(frozen=True)
class Example:
    """A joint to be tested.

    Attributes:
        cls: its class; arguments: all but name and markers, of which there are ``markers``, one
            after the other; ``make``: what makes it where it takes something else.
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
        return self.cls("joint", *_ground(self.markers), **self.arguments)


def _vector(t: float) -> np.ndarray:
    return np.array([0.3 * t, -0.2 * t * t, np.sin(t)])


def _custom(p, R, c):
    """Three functions of all coordinates and axes that vanish where the points coincide."""
    angle = math.atan2(R[1][0], R[0][0])
    bent = R[0][2] * p[1] + np.sin(p[2]) * R[1][1] - c[0] * R[1][2] * p[0] ** 2
    return p[0] + 0.1 * p[1] * p[2], bent, (angle + 2.0) * p[2] - R[2][2] * p[1] / 3


HERE, ALONG, APART = np.zeros(3), 1.3 * UNIT, np.array([0.4, 1.1, -0.7])
EXAMPLES = {
    "Spherical": Example(ff.Spherical, 3, {}, HERE),
    "Revolute": Example(ff.Revolute, 5, {"axis": AXIS}, HERE),
    "Rigid": Example(ff.Rigid, 6, {}, HERE),
    "ElasticLock": Example(ElasticLock, 3, {"locked": (2, 3, 4)}, APART),
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
    "RevoluteSpherical": Example(ff.RevoluteSpherical, 2, {"axis": AXIS}, 0.8 * ACROSS),
    "Gear": Example(
        ff.Gear, 1, {"axis": AXIS, "second_axis": (1.0, 2.0, -0.5), "ratio": -1.7}, APART,
        markers=4,
    ),
    "Gear-teeth": Example(
        ff.Gear, 1,
        {"axis": AXIS, "ratio": -1.7, "stiffness": 70.0, "damping": 2.0, "backlash": 0.05}, APART,
        elastic=True, markers=4,
    ),
    "Coupling-rack": Example(
        ff.Coupling, 1,
        {"axis": AXIS, "second_axis": (1.0, 2.0, -0.5), "ratio": 0.3,
         "motions": ("rotation", "translation")},
        APART, markers=4,
    ),
    "Coupling-slides": Example(
        ff.Coupling, 1,
        {"axis": AXIS, "ratio": -1.0, "motions": ("translation", "translation")},
        APART, markers=4,
    ),
    "Pulley": Example(ff.Pulley, 1, {"ratio": 1.7}, APART, markers=4),
    "RigidNodes": Example(
        ff.RigidNodes, 12, {}, APART, markers=3,
        make=lambda: ff.RigidNodes("joint", *_ground(1), nodes=_ground(2)),
    ),
    "RigidPoints": Example(
        ff.RigidPoints, 6, {}, APART, markers=3,
        make=lambda: ff.RigidPoints("joint", *_ground(1), nodes=_ground(2)),
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
    "LimitStop-rotation": Example(
        ff.LimitStop, 1, {"motion": "rotation", "axis": AXIS, "lower": 2.9, "stiffness": 70.0,
                          "damping": 9.0}, APART, elastic=True,
    ),
    "LimitStop-distance": Example(
        ff.LimitStop, 1, {"motion": "distance", "lower": 0.1, "upper": 0.2, "stiffness": 70.0,
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
    "CustomJoint": Example(
        ff.CustomJoint, 3,
        {"function": _custom, "parameters": (0.5,)}, HERE,
    ),
    "SpringDamper-function": Example(
        ff.SpringDamper, 1, {"force": lambda x, v: 70.0 * x + 900.0 * x**3 + 4.0 * v}, APART,
        elastic=True,
    ),
    "Bushing-functions": Example(
        ff.Bushing, 2, {"forces": {0: lambda x: 70.0 * x, 4: lambda x, v: 5.0 * x + 0.3 * v}},
        APART, elastic=True,
    ),
    "CustomForce": Example(
        ff.CustomForce, 1,
        {"force": lambda x, v, t, k: k[0] * (x - 0.9) ** 3 + 4.0 * v, "parameters": (70.0,)},
        APART, elastic=True,
    ),
    "CustomForce-rotation": Example(
        ff.CustomForce, 1,
        {"axis": AXIS, "motion": "rotation", "force": lambda x, v: 7.0 * math.sin(x) + 0.3 * v * v},
        APART, elastic=True,
    ),
    "JointFriction-function": Example(
        ff.JointFriction, 1, {}, ALONG, elastic=True,
        make=lambda: ff.JointFriction(
            "joint", _slider(), "translation",
            coefficient=lambda v: 0.5 / (1.0 + 0.1 * v), **RADIAL,
        ),
    ),
    "Actuator": Example(
        ff.Actuator, 1, {"axis": AXIS, "force": lambda t: 0.7 - t}, APART, elastic=True
    ),
    "Actuator-translation": Example(
        ff.Actuator, 1, {"axis": AXIS, "motion": "translation", "force": lambda t: 0.7 - t},
        APART, elastic=True,
    ),
    "Actuator-distance": Example(
        ff.Actuator, 1, {"motion": "distance", "force": lambda t: 0.7 - t}, APART, elastic=True
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


def _guided(*between: object, **given: object) -> Callable[[], ff.Cable]:
    """A cable over guides between two bodies."""
    ends = [ff.Marker("a"), *between, ff.Marker("z")]
    return lambda: ff.Cable("joint", ends, **given)


def _sheave(name: str, side: float, radius: float = 0.2, **given: Any) -> ff.Sheave:
    """A sheave whose axis is across the line of the markers, but not quite."""
    axis = side * (np.cross(APART, [0.0, 0.0, 1.0]) + 0.2 * APART)
    return ff.Sheave(ff.Marker(name), radius, axis, **given)


EXAMPLES |= {
    "Cable": Example(
        ff.Cable, 1, {}, APART, elastic=True, make=_guided(stiffness=70.0, damping=4.0)
    ),
    "Cable-eyelet": Example(
        ff.Cable, 1, {}, APART, elastic=True, markers=3,
        make=_guided(ff.Eyelet(ff.Marker("b")), axial_stiffness=90.0, damping=3.0, preload=20.0),
    ),
    "Cable-rigid": Example(
        ff.Cable, 1, {}, APART, markers=3,
        make=_guided(_sheave("b", 1.0), tension_only=False),
    ),
    "Cable-sheaves": Example(
        ff.Cable, 1, {}, APART, elastic=True, markers=4,
        make=_guided(_sheave("b", 1.0), _sheave("c", -1.0, 0.3), axial_stiffness=90.0, damping=3.0),
    ),
    "Cable-grip": Example(
        ff.Cable, 2, {}, APART, elastic=True, markers=4,
        make=_guided(
            _sheave("b", 1.0, grip=True), _sheave("c", 1.0, turns=1), axial_stiffness=90.0,
            rest_length=lambda t: 2.5 - 0.1 * t, damping=2.0,
        ),
    ),
    "Cable-friction": Example(
        ff.Cable, 3, {}, APART, elastic=True, markers=4,
        make=_guided(
            ff.Eyelet(ff.Marker("b"), 0.3, 0.8), _sheave("c", 1.0, friction=0.2, velocity=0.5),
            axial_stiffness=90.0, damping=3.0, preload=20.0,
        ),
    ),
    "Catenary": Example(
        ff.Catenary, 1, {"length": 1.6, "weight": 3.0, "axial_stiffness": 90.0, "up": AXIS}, APART,
        elastic=True,
    ),
    "Catenary-taut": Example(
        ff.Catenary, 1, {"length": 1.1, "weight": 0.5, "axial_stiffness": 9.0}, APART,
        elastic=True,
    ),
    "Cam": Example(
        ff.Cam, 1, {"axis": UNIT, "zero": ACROSS, "profile": lambda t: 0.8 + 0.1 * np.cos(t)},
        0.9 * ACROSS / np.linalg.norm(ACROSS),
    ),
    "Cam-flat": Example(
        ff.Cam, 1,
        {"axis": UNIT, "zero": ACROSS, "profile": lambda t: 0.8, "follower": "flat",
         "normal": ACROSS, "stiffness": 70.0, "damping": 3.0},
        0.75 * ACROSS / np.linalg.norm(ACROSS), elastic=True,
    ),
    "Cable-belt": Example(
        ff.Cable, 2, {}, APART, elastic=True,
        make=lambda: ff.Cable(
            "joint", [_sheave("a", 1.0, grip=True), _sheave("b", 1.0, 0.35, grip=True)],
            stiffness=90.0, damping=3.0, preload=10.0, closed=True,
        ),
    ),
}  # fmt: skip


def interface(frames: np.ndarray, width: int = 6) -> SimpleNamespace:
    """Nodes at rest with frames (n, 12) and so many unknowns each, as rows see them."""
    n = len(frames)
    interface_nodes = InterfaceNodes(
        frames=frames.copy(), velocities=np.zeros((n, 6)), increments=np.zeros((n, 6)),
        inertial=np.zeros(n, dtype=bool),
    )  # fmt: skip
    return SimpleNamespace(
        interface_nodes=interface_nodes, keys=[(1, k) for k in range(n)], width=np.full(n, width),
        held=np.zeros((n, 6), dtype=bool),
        **{name: getattr(interface_nodes, name) for name in InterfaceNodes.fields},
    )  # fmt: skip


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
        interface_nodes = list(range(n))
        if ground:  # the first marker does not move
            offsets[0], interface_nodes[0] = frames[0], -1
        self.start, self.offsets, self.poses, self.count = nodes, offsets, poses, n
        self.face = interface(nodes)
        placed = [
            PlacedJoint(
                joint,
                0,
                poses,
                tuple(interface_nodes),
                offsets,
                (None,) * n,
                owned=True,
                shared=False,
            )
        ]
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
        np.add.at(out, (rows.row_of_term[:, np.newaxis], rows.term_nodes), jacobian)
        return out[:, :-1]

    def hessian(self, factor: np.ndarray) -> np.ndarray:
        """Second derivatives of all rows over all nodes, (6 n, 6 n)."""
        interface_nodes, n = self.rows.pair_nodes, self.count
        out = np.zeros((n + 1, n + 1, 6, 6))
        blocks = self.rows.hessians(factor).reshape(-1, 2, 6, 2, 6).transpose(0, 1, 3, 2, 4)
        np.add.at(
            out, (interface_nodes[:, :, np.newaxis], interface_nodes[:, np.newaxis, :]), blocks
        )
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

    def differenced_hessian(self, factor: np.ndarray) -> np.ndarray:
        """Result of :meth:`hessian`, by differences of the gradients."""

        def force() -> np.ndarray:
            self.evaluate()
            return np.einsum("r,rij->ij", factor, self.dense(self.rows.force_jacobian)).ravel()

        found = self.derivative(force)
        self.evaluate()
        return found

    def differenced_rates(self, eps: float = 1e-5) -> np.ndarray:
        """Derivatives (r,) of the rows' rates by time at constant local velocities."""
        frames, sides = self.face.frames.copy(), []
        for sign in (1.0, -1.0):
            self.face.frames[:] = se3.retract(frames, sign * eps * self.face.velocities)
            self.evaluate()
            sides.append(self.rows.rates())
        self.face.frames[:] = frames
        self.evaluate()
        return (sides[0] - sides[1]) / (2.0 * eps)

    def nodal_forces(self) -> tuple[np.ndarray, np.ndarray]:
        """Forces and moments (n, 3) that the rows exert on the nodes, inertial axes."""
        rows = self.rows
        node = -np.einsum("r,rni->ni", rows.forces, self.dense(rows.force_jacobian))
        R = se3.rotation(self.face.frames)
        return tuple(np.einsum("nij,nj->ni", R, part) for part in (node[:, :3], node[:, 3:]))

    def resultants(self) -> np.ndarray:
        """Force and moment about the origin, of the forces on the nodes and of the reactions."""
        force, moment = self.nodal_forces()
        w, x, at = (
            self.rows.reactions(self.rows.forces),
            self.face.frames[:, :3],
            self.rows.poses[:, :3],
        )
        return np.array(
            [
                np.concatenate([force.sum(axis=0), (moment + np.cross(x, force)).sum(axis=0)]),
                np.concatenate(
                    [w[:, :3].sum(axis=0), (w[:, 3:] + np.cross(at, w[:, :3])).sum(axis=0)]
                ),
            ]
        )

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


def spatial_slider_crank(mass: float = 0.5, gravity: float = 9.81) -> ff.Model:
    """IFToMM library: crank 0.08 m about x at (0, 0.1, 0.12), rod 0.3 m, slider on the x axis.

    Args:
        mass: of the rod, kg.
        gravity: along -z, m/s^2.
    """
    along = np.array([0.2, -0.1, -0.2]) / 0.3
    side = np.cross((1.0, 0.0, 0.0), along)
    side /= np.linalg.norm(side)
    rotation = np.stack([along, side, np.cross(along, side)], axis=1)
    model, slider = ff.Model("slider_crank"), ff.Marker("slider")
    model.add(
        ff.Gravity((0.0, 0.0, -gravity)),
        ff.RigidBody("crank", 0.12, (1e-4, 1e-4, 1e-5), position=(0, 0.1, 0.16),
                     velocity=(0, -0.24, 0), angular_velocity=(6.0, 0, 0)),
        ff.RigidBody("rod", mass, (4e-4, 4e-3, 4e-3), position=(0.1, 0.05, 0.1), rotation=rotation,
                     velocity=(0.12, -0.24, 0), angular_velocity=(1.92, -0.96, 0.48)),
        ff.RigidBody("slider", 2.0, (1e-4, 1e-4, 1e-4), position=(0.2, 0, 0),
                     velocity=(0.24, 0, 0)),
        ff.Revolute("pin", ff.Ground((0, 0.1, 0.12)), ff.Marker("crank", offset=(0, 0, -0.04)),
                    axis=(1, 0, 0)),
        ff.Spherical("ball", ff.Marker("crank", offset=(0, 0, 0.04)),
                     ff.Marker("rod", offset=(-0.15, 0, 0))),
        ff.Universal("cross", slider, ff.Marker("rod", offset=(0.15, 0, 0)), axis=(1, 0, 0),
                     second_axis=side),
        ff.Prismatic("rail", ff.Ground(), slider, axis=(1, 0, 0)),
    )  # fmt: skip
    return model
